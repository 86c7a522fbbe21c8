"""The closure as linear equations between rates, `E z = 0`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Floats, Regimes
from loops.contact_state import ContactState
from loops.contact_tangent import (
    ContactTangent,
    contact_tangent,
    translational_blocks,
    translational_compliances,
)
from loops.null_space import LeastSquares, solve_through_null_space
from stability.paths.model import PathModel
from stability.paths.unknowns import Kind, Unknowns

# Below this determinant of a contact's block, in units of kn^2, its compliance is not used: the
# rates would carry a noise of 1e-16 over it, which the integrator can't tell from their change.
# In long loops, where the other equations cost the cube of the length, some noise is put up with.
SOFT_BLOCK, SOFT_BLOCK_LONG, LONG = 0.1, 1e-3, 24


@dataclass(frozen=True, eq=False)
class Equations:
    """Closure equations `E z = 0` of the scaled unknowns `z` (r,).

    `matrix` (R, r): `E`; four control equations complete it; `branch_rate` (C, 2, r): Branch rates
    `d' = branch_rate @ z`; `spin` (G, r): Spins `w = spin @ z`; `unknowns`: What `z` stands for.
    """

    matrix: Floats
    branch_rate: Floats
    spin: Floats
    unknowns: Unknowns


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
    model: PathModel, H: Floats, contacts: ContactState, regime: Regimes, kind: Kind, z: Unknowns
) -> Equations:
    """Equations of the model's closure in one state."""
    if kind == "ring":
        return _ring(model, translational_compliances(contacts, model.law, regime), z)
    build = _affine if kind == "affine" else saddle_equations
    return build(model, H, contacts, regime, z)


def loop_spin(H: Floats) -> Floats:
    """(4,) spin of the loop per component of `H'`: `w = (L21 - L12)/2`, `L = -H' F^-1`."""
    F = np.eye(2) - H.reshape(2, 2)
    inverse = np.array([[F[1, 1], -F[0, 1]], [-F[1, 0], F[0, 0]]])
    inverse /= F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    return 0.5 * np.array([inverse[0, 1], inverse[1, 1], -inverse[0, 0], -inverse[1, 0]])


def _spins(model: PathModel, H: Floats, z: Unknowns) -> Floats:
    """(G, r) spins: unknown, turning with the loop, or blocked."""
    if model.spins == "affine":
        return np.broadcast_to(loop_spin(H) @ z.H, z.w.shape)
    return z.w


def _affine(
    model: PathModel, H: Floats, contacts: ContactState, regime: Regimes, z: Unknowns
) -> Equations:
    """`d' = -H' d0` and `P = (1/V0) sum f (x) d0`; with free spins the moments too."""
    branch_rate = -np.einsum("abr,cb->car", z.H.reshape(2, 2, -1), model.d0)
    spin = _spins(model, H, z)
    if model.spins == "blocked":
        force_rate = -translational_blocks(contacts, model.law, regime) @ branch_rate
    else:
        blocks = contact_tangent(contacts, model.law, regime)
        force_rate = _force_rate(model, blocks, branch_rate, spin)
    stress_rate = np.einsum("cir,cj->ijr", force_rate, model.d0).reshape(4, z.count)
    rows = [stress_rate / (model.volume * model.stiffness) - z.P]
    if model.spins == "free":
        moments = _moments(model, blocks, branch_rate, spin)
        rows.append(moments / (model.stiffness * model.volume))
    return Equations(np.concatenate(rows), branch_rate, spin, z)


def _ring(model: PathModel, compliance: Floats, z: Unknowns) -> Equations:
    """One redundant force `f^`: `d' = -k^-1 (f^ - P m)`, `sum d' = 0`, `V0 H = sum d' (x) m`."""
    pressed = np.einsum("abr,cb->car", z.P.reshape(2, 2, -1), model.m)
    soft = compliance * model.stiffness
    branch_rate = soft @ (pressed - model.length * z.force)
    gradient = np.einsum("cir,cj->ijr", branch_rate, model.m).reshape(4, z.count) / model.volume
    rows = [branch_rate.sum(axis=0) / model.length, gradient - z.H]
    return Equations(np.concatenate(rows), branch_rate, z.w, z)


def saddle_equations(
    model: PathModel, H: Floats, contacts: ContactState, regime: Regimes, z: Unknowns
) -> Equations:
    """Grain by grain: `f` in balance with `-P b_i`, `V0 H = -sum u_i (x) b_i`, moments if free."""
    grains, L = model.grain_count, model.length
    i, j = model.contacts.T
    branch_rate = L * (z.u[j] - z.u[i])
    spin = _spins(model, H, z)
    blocks = contact_tangent(contacts, model.law, regime)
    force_rate = _force_rate(model, blocks, branch_rate, spin) / (model.stiffness * L)
    # The mean displacement is free: held at zero.
    balance = np.broadcast_to(z.u.mean(axis=0), (grains, 2, z.count)).copy()
    balance -= np.einsum("abr,gb->gar", z.P.reshape(2, 2, -1), model.b / L)
    np.add.at(balance, i, -force_rate)
    np.add.at(balance, j, force_rate)
    gradient = z.H + np.einsum("gar,gb->abr", z.u, model.b / L).reshape(4, z.count)
    rows = [balance.reshape(2 * grains, z.count), gradient]
    if model.spins == "free":
        moments = _moments(model, blocks, branch_rate, spin)
        rows.append(moments / (model.stiffness * model.volume))
    return Equations(np.concatenate(rows), branch_rate, spin, z)


def _force_rate(
    model: PathModel, blocks: ContactTangent, branch_rate: Floats, spin: Floats
) -> Floats:
    """(C, 2, R) `f' = -k d' + q_i w_i + q_j w_j`."""
    i, j = model.contacts.T
    rolled = blocks.q_i[:, :, None] * spin[i, None, :] + blocks.q_j[:, :, None] * spin[j, None, :]
    return np.asarray(rolled - blocks.k @ branch_rate)


def _moments(model: PathModel, blocks: ContactTangent, branch_rate: Floats, spin: Floats) -> Floats:
    """(G, R) rate of the moment that each grain needs from outside."""
    i, j = model.contacts.T
    total = np.zeros((model.grain_count, branch_rate.shape[-1]))
    for grain, p, row in ((i, blocks.p_i, 0), (j, blocks.p_j, 1)):
        c = blocks.c[:, row]
        share = np.einsum("ck,ckr->cr", p, branch_rate)
        np.add.at(total, grain, share + c[:, :1] * spin[i] + c[:, 1:] * spin[j])
    return total


# A solve is trusted while its residual and the stress of its null vectors stay below these.
RESIDUAL_LIMIT = 1e-8
AMBIGUITY_LIMIT = 1e-6


@dataclass(frozen=True, eq=False)
class Gauge:
    """What fixes the unit of time: `H . H' + parameter * parameter' = 1`."""

    H: Floats
    parameter: float


UNIT_PARAMETER = Gauge(np.zeros(4), 1.0)
RECEDING = Gauge(np.zeros(4), -1.0)


@dataclass(frozen=True, eq=False)
class Solution:
    """Rates in scaled unknowns.

    `z` (r,): The numbers that `Unknowns` reads; `parameter`: Rate of the loading parameter;
    `condition`: Condition number of the solve; `trusted`: Whether it has one answer.
    """

    z: Floats
    parameter: float
    condition: float
    trusted: bool


def solve_rates(
    model: PathModel, equations: Equations, control: tuple[Floats, Floats, Floats], gauge: Gauge
) -> Solution:
    """Rates of the unknowns under a control, in the unit of time of the gauge."""
    system, unit = control_system(model, equations, control, gauge)
    size = system.shape[1] - 1
    if not np.isfinite(system).all():
        return Solution(np.full(size, np.nan), np.nan, np.inf, False)
    system = _combined(system, equations.unknowns)
    scale = np.abs(system[-1]).max()
    system[-1] /= scale
    rhs = np.zeros((len(system), 1))
    rhs[-1] = 1.0 / scale
    seen = np.zeros((9, size + 1))
    seen[:4, :size], seen[4:8, :size] = equations.unknowns.H, equations.unknowns.P
    seen[8, size] = 1.0
    found = solve_through_null_space(system, rhs, seen)
    z = found.x[:, 0]
    return Solution(z[:size], float(z[size] * unit), float(found.condition), is_trusted(found))


def control_system(
    model: PathModel, equations: Equations, control: tuple[Floats, Floats, Floats], gauge: Gauge
) -> tuple[Floats, float]:
    """Closure, control and gauge as one system, and the unit of the loading parameter."""
    stress, strain, rate = control
    z = equations.unknowns
    rows, size = equations.matrix.shape
    stress = stress * model.stiffness
    weight = np.maximum(np.abs(stress).max(axis=1), np.abs(strain).max(axis=1))
    drive = rate / weight
    unit = 1.0 / np.abs(drive).max()
    system = np.zeros((rows + 5, size + 1))
    system[:rows, :size] = equations.matrix
    system[rows:-1, :size] = (strain @ z.H + stress @ z.P) / weight[:, None]
    system[rows:-1, size] = -drive * unit
    system[-1, :size] = gauge.H @ z.H
    system[-1, size] = gauge.parameter * unit
    return system, float(unit)


def _combined(system: Floats, z: Unknowns) -> Floats:
    """As many rows as unknowns: combinations of closure and control, and the gauge.

    In a symmetric state the other rows agree. They are not looked at: near a singular state they
    hold nothing but the rounding of the forces, times the compliance.
    """
    if z.rows is None:
        return system
    control = system[-5:-1]
    # As many combinations of the control's equations are left as strains; they are alike in size.
    kept = np.linalg.svd(control)[0][:, : z.strains]
    return np.concatenate([z.rows @ system[:-5], kept.T @ control, system[-1:]])


def is_trusted(found: LeastSquares) -> bool:
    """Whether a solve has an answer, and only one."""
    return bool(found.residual <= RESIDUAL_LIMIT and found.ambiguity <= AMBIGUITY_LIMIT)
