"""The closure as linear equations between rates, `E z = 0`, and their solution under a control."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from loops.arrays import Floats, Regimes
from loops.closures.macro_tangent import AMBIGUITY_LIMIT, RESIDUAL_LIMIT
from loops.closures.spins import LoopSpin, spin_of_gradient
from loops.closures.system import closure_matrix, contact_springs, drive
from loops.closures.traction import ring_equations
from loops.contact_state import ContactState
from loops.contact_tangent import translational_blocks, translational_compliances
from loops.null_space import LeastSquares, solve_through_null_space
from stability.paths.model import PathModel
from stability.paths.unknowns import Kind, Unknowns

# Below this determinant of a contact's block, in units of kn^2, its compliance is not used: the
# rates would carry a noise of 1e-16 over it, which the integrator can't tell from their change.
# In long loops, where the other equations cost the cube of the length, some noise is put up with.
SOFT_BLOCK, SOFT_BLOCK_LONG, LONG = 0.1, 1e-3, 24
# What fixes the unit of time, a row on `(H', parameter')` that is one.
UNIT_PARAMETER: Floats = np.array([0.0, 0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Equations:
    """Closure equations of all unknowns `(H', P'/kn, v)`, see `loops.closures.system`.

    `matrix` (4 + m, 8 + m); four control equations complete it; `motion` (C, 4, 8 + m): Motions of
    the contacts, branch rates and spins times radii, over the length scale.
    """

    matrix: Floats
    motion: Floats


def closure_kind(model: PathModel, contacts: ContactState, regime: Regimes) -> Kind:
    """Which equations serve a state: those of a plain ring need every contact's compliance."""
    if model.closure == "affine":
        return "affine"
    if model.is_plain_ring:
        k = translational_blocks(contacts, model.law, regime)
        soft = SOFT_BLOCK if model.grain_count <= LONG else SOFT_BLOCK_LONG
        if (np.abs(np.linalg.det(k)) > soft * model.stiffness**2).all():
            return "ring"
    return "saddle"


def closure_equations(
    model: PathModel, H: Floats, contacts: ContactState, regime: Regimes, kind: Kind
) -> Equations:
    """Equations of the model's closure in one state."""
    if kind == "ring":
        compliance = translational_compliances(contacts, model.law, regime) * model.stiffness
        return Equations(*ring_equations(compliance, model.m / model.length))
    form, motion = model.form, model.motion
    if model.spins == "affine":
        row = spin_of_gradient(np.eye(2) - H.reshape(2, 2))
        form = replace(form, spin=LoopSpin(row, np.zeros(4)))
        motion = motion.copy()
        motion[:, :, :4] = drive(form)
    S = contact_springs(contacts, model.law, regime, model.spins) / model.stiffness
    matrix = closure_matrix(form, S, motion[:, :, :4])
    if kind == "saddle":
        # The mean displacement is free: held at zero.
        for first in (4, 5):
            centres = slice(first, 4 + 2 * model.grain_count, 2)
            matrix[centres, 4:][:, centres] += 1.0 / model.grain_count
    return Equations(matrix, motion)


def solve_rates(
    model: PathModel,
    matrix: Floats,
    unknowns: Unknowns,
    control: tuple[Floats, Floats, Floats],
    gauge: Floats,
) -> tuple[Floats, float, LeastSquares | None]:
    """Unknowns of a state (8 + m,) and the rate of the loading parameter under a control.

    In the unit of time of the gauge. The status of the solve is None where a number is not one.
    """
    system, unit = control_system(model, unknowns.of(matrix), unknowns, control, gauge)
    size = system.shape[1] - 1
    if not np.isfinite(system).all():
        return np.full(matrix.shape[1], np.nan), np.nan, None
    scale = np.abs(system[-1]).max()
    system[-1] /= scale
    rhs = np.zeros((len(system), 1))
    rhs[-1] = 1.0 / scale
    seen = np.zeros((9, size + 1))
    seen[:8, :size] = unknowns.tensors
    seen[8, size] = 1.0
    found = solve_through_null_space(system, rhs, seen)
    z = found.x[:, 0]
    return unknowns.values(z[:size]), float(z[size] * unit), found


def control_system(
    model: PathModel,
    matrix: Floats,
    unknowns: Unknowns,
    control: tuple[Floats, Floats, Floats],
    gauge: Floats,
) -> tuple[Floats, float]:
    """Closure, control and gauge as one system, and the unit of the loading parameter.

    In a symmetric state as many rows as unknowns: combinations of the control. The other rows
    agree. They are not looked at: near a singular state they hold nothing but the rounding of the
    forces, times the compliance.
    """
    stress, strain, rate = control
    stress = stress * model.stiffness
    weight = np.maximum(np.abs(stress).max(axis=1), np.abs(strain).max(axis=1))
    drive = rate / weight
    unit = 1.0 / np.abs(drive).max()
    H, P = unknowns.tensors[:4], unknowns.tensors[4:]
    held = np.column_stack([(strain @ H + stress @ P) / weight[:, None], -drive * unit])
    if unknowns.rows is not None:
        # As many combinations of the control's equations are left as strains; they are alike.
        held = np.linalg.svd(held)[0][:, : unknowns.strains].T @ held
    rows, size = matrix.shape
    system = np.zeros((rows + len(held) + 1, size + 1))
    system[:rows, :size] = matrix
    system[rows:-1] = held
    system[-1, :size] = gauge[:4] @ H
    system[-1, size] = gauge[4] * unit
    return system, float(unit)


def stress_of_strain(matrix: Floats, unknowns: Unknowns) -> Floats:
    """(4, 4) what the unknowns' strains do to their stresses, over `kn`; nan if not trusted."""
    if matrix.shape == (4, 8):
        # Affine, spins not free: they read A H' - P' = 0.
        return matrix[:, :4]
    E, t = unknowns.of(matrix), unknowns.strains
    strain, stress = unknowns.tensors[:4, :t], unknowns.tensors[4:, t:]
    found = solve_through_null_space(E[:, t:], -E[:, :t], stress)
    if not is_trusted(found):
        return np.full((4, 4), np.nan)
    return np.asarray(stress @ found.x @ strain.T)


def is_trusted(found: LeastSquares | None) -> bool:
    """Whether a solve has an answer, and only one."""
    if found is None:
        return False
    return bool(found.residual <= RESIDUAL_LIMIT and found.ambiguity <= AMBIGUITY_LIMIT)
