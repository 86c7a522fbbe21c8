"""Rates of a state under a control: the closure's linear equations, their solution, the tangent."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from loops.arrays import Floats, Regimes
from loops.assembly import contact_kinematics
from loops.closures.null_space import (
    AMBIGUITY_LIMIT,
    RESIDUAL_LIMIT,
    LeastSquares,
    solve_through_null_space,
)
from loops.closures.ring import NX, NY, G
from loops.closures.spins import LoopSpin, gear_projector, spin_of_gradient
from loops.closures.system import closure_matrix, contact_springs, drive
from loops.graph import ContactState
from loops.laws.frictional import Regime, edge_rates
from stability.paths import ring_rates
from stability.paths.kernels import NO_FUNCTIONS, answer, arrays_of, ring_under
from stability.paths.model import PathModel, Unknowns, all_unknowns
from stability.paths.state import (
    Mode,
    PathState,
    Rates,
    centres,
    contacts_at,
    displacement_gradient,
    pack,
    path_stress,
    power,
    velocities,
    with_signs,
)
from stability.programmes import Programme

# Slip of a gear mode over the largest depth over the radius that may be rounding.
GEAR_RTOL = 64 * float(np.finfo(float).eps)
# Stresses of strains that mirrors in the axes keep apart, in 11, 12, 21, 22.
MIXED = np.array([0, 1, 1, 0]) != np.array([0, 1, 1, 0])[:, None]
# Gauge in which the loading parameter grows by one per unit of time, see `StateRates`.
UNIT_PARAMETER: Floats = np.array([0.0, 0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class StateRates:
    """State and regimes under a programme; derived quantities are computed on first use.

    The gauge fixes the unit of time of the rates: its product with `(H', parameter')` is one.
    """

    model: PathModel
    state: PathState
    mode: Mode
    programme: Programme
    gauge: Floats

    @cached_property
    def H(self) -> Floats:
        """(4,) displacement gradient."""
        return displacement_gradient(self.model, self.state.place)

    @cached_property
    def P(self) -> Floats:
        """(4,) nominal stress."""
        return path_stress(self.model, self.contacts)

    @cached_property
    def x(self) -> Floats:
        """(G, 2) centres."""
        return centres(self.model, self.state.place)

    @cached_property
    def contacts(self) -> ContactState:
        """Contacts with their forces."""
        return contacts_at(self.model, self.state, self.mode)

    @cached_property
    def sided(self) -> ContactState:
        """Contacts whose `T` has the sign of the side on which they slide."""
        return with_signs(self.contacts, self.mode)

    @cached_property
    def equations(self) -> Equations:
        """Equations of the closure."""
        return closure_equations(self.model, self.H, self.sided, self.mode.regime)

    @cached_property
    def by_kernel(self) -> tuple[Rates, Floats] | None:
        """Rates in the unit of time of the gauge and tangent, if kernels know them."""
        mode, state = self.mode, self.state
        ring = ring_under(self.model, mode.regime, self.programme)
        if ring is None:
            return None
        numbers, whole, p = arrays_of(ring, mode.regime, mode.side, self.programme, NO_FUNCTIONS)
        y = pack(state.place, state.shear_force, state.parameter, state.work)
        p.shared[0, : len(y)], p.shared[1, :5] = y, self.gauge
        answer().call(ring_rates.LOOK, numbers.ctypes.data, whole.ctypes.data)
        condition, parameter, known = p.shared[2, [5, 6, -1]].tolist()
        if not known:
            return None
        columns = p.table[:, ring_rates.EN : ring_rates.SHEAR_RATE + 1]
        en, et, spun, w_i, w_j, normal, shear = columns.T
        nx, ny = p.table[:, NX], p.table[:, NY]
        rates = Rates(
            p.small[ring_rates.H_RATE, :4], p.small[ring_rates.P_RATE, :4], parameter,
            en, p.table[:, G] * et - spun, normal, shear,
            np.column_stack([nx * en - ny * et, ny * en + nx * et, w_i, w_j]), condition, True,
        )  # fmt: skip
        return rates, p.small[ring_rates.TANGENT : ring_rates.CONTROL, :4]

    @cached_property
    def raw_rates(self) -> Rates:
        """Rates in the unit of time of the gauge.

        The loading parameter is an unknown like the others, so a limit of the control
        (`parameter' = 0`) is an ordinary point unless the gauge is that parameter.
        """
        if self.by_kernel is not None:
            return self.by_kernel[0]
        model, law, equations = self.model, self.model.law, self.equations
        control = self.programme.equations(self.H, self.P)
        z, parameter, found = solve_rates(model, equations.matrix, control, self.gauge)
        motion = model.length * (equations.motion @ z)
        if model.spins != "blocked":
            motion[:, 2:] /= model.radii[model.contacts]
        relative = model.length * (equations.relative @ z)
        un, ut = relative.T
        D = law.local_stiffness(self.sided, self.mode.regime)
        N, T = -(D @ relative[..., None])[..., 0].T
        return Rates(
            z[:4],
            z[4:8] * model.stiffness,
            parameter,
            *(un, ut, N, T),
            motion,
            np.inf if found is None else float(found.condition),
            is_trusted(found),
        )

    @cached_property
    def rates(self) -> Rates:
        """Rates per unit length of the path in the space of `H`, `|H'| = 1`.

        The arc length is a regular parameter where the loading parameter turns back.
        """
        size = float(np.linalg.norm(self.raw_rates.H))
        # No strain at all: a loop that has collapsed to a line.
        return self.raw_rates.scaled(1.0 / size if size > 0.0 else np.nan)

    @cached_property
    def y_rates(self) -> Floats:
        """Right-hand side `y'` per unit length of the path; not numbers if it is not trusted."""
        model, rates = self.model, self.rates
        place = rates.H if model.closure == "affine" else velocities(model, rates)
        work = power(model, self.mode, self.contacts, rates)
        y = pack(place, rates.shear_force, rates.parameter, work)
        return y if rates.trusted else np.full_like(y, np.nan)

    @cached_property
    def A(self) -> Floats:
        """(4, 4) macroscopic tangent, `P' = A H'`, in these regimes; nan if not trusted."""
        if self.by_kernel is not None:
            return self.by_kernel[1]
        A = self.model.stiffness * stress_of_strain(self.equations.matrix)
        if self.model.mirrors:
            # What is not a number stays so.
            A[MIXED] -= A[MIXED]
        return A

    @cached_property
    def slip(self) -> Floats:
        """(C,) how fast contacts at yield would leave the cone if they stuck.

        Positive when a contact must slide, negative when it must not; minus infinity where it never
        slides.
        """
        side = np.where(self.mode.side != 0.0, self.mode.side, np.sign(self.contacts.shear_force))
        rates, law = self.rates, self.model.law
        _, sticking, strength = edge_rates(law, self.sided, side, rates.un, rates.ut)
        return np.asarray(np.where(side == 0.0, 1.0, side) * sticking - strength)

    @cached_property
    def balance_determinant(self) -> float:
        """Number that changes its sign where other paths branch off.

        The determinant of the grains' balance, control and gauge together, its root of the order of
        their number. At a limit of the control it does not vanish.
        """
        model = self.model
        small = (
            model.grain_count <= ring_rates.MOST_GRAINS and (self.mode.regime != Regime.OPEN).all()
        )
        if model.closure == "affine" or model.spins == "free" or not small:
            return np.nan
        matrix, control = self.equations.matrix, self.programme.equations(self.H, self.P)
        everything = all_unknowns(len(matrix) - 4)
        system, _ = control_system(model, matrix, everything, control, self.gauge)
        sign, size = np.linalg.slogdet(system)
        return float(sign * np.exp(size / len(system)))

    @cached_property
    def imbalance(self) -> float:
        """Largest force on a grain that `-P b_i` leaves unbalanced, over `kn` times length.

        Not a number under the affine closure, which does not balance the grains.
        """
        model = self.model
        if model.closure == "affine":
            return np.nan
        i, j = model.contacts.T
        f = self.contacts.forces
        unbalanced = -model.b @ self.P.reshape(2, 2).T
        np.add.at(unbalanced, i, -f)
        np.add.at(unbalanced, j, f)
        return float(np.abs(unbalanced).max() / (model.stiffness * model.length))


@dataclass(frozen=True, eq=False)
class Equations:
    """Closure equations of all unknowns `(H', P'/kn, v)`, see `loops.closures.system`.

    `matrix` (4 + m, 8 + m); four control equations complete it; `motion` (C, 4, 8 + m): Motions of
    the contacts, branch rates and spins times radii, over the length scale; `relative`
    (C, 2, 8 + m): Their normal and shear displacements `(un', ut')` over it.
    """

    matrix: Floats
    motion: Floats
    relative: Floats


def closure_equations(
    model: PathModel, H: Floats, contacts: ContactState, regime: Regimes
) -> Equations:
    """Equations of the model's closure in one state."""
    form, motion = model.form, model.motion
    if model.spins == "affine":
        # A loop that has collapsed to a line has no rotation: not a number, and not trusted.
        with np.errstate(divide="ignore", invalid="ignore"):
            row = spin_of_gradient(np.eye(2) - H.reshape(2, 2))
        row = np.where(np.isfinite(row), row, np.nan)
        form = replace(form, spin=LoopSpin(row, np.zeros(4)))
        motion = motion.copy()
        motion[:, :, :4] = drive(form)
    S = contact_springs(contacts, model.law, regime, model.spins) / model.stiffness
    matrix = closure_matrix(form, S, motion[:, :, :4])
    equations = Equations(matrix, motion, relative_motion(model, contacts) @ motion)
    if model.spins == "free":
        equations = with_gear_mode(model, contacts, regime, equations)
    if model.closure == "traction":
        # The mean displacement is free: held at zero.
        for first in (4, 5):
            centres = slice(first, 4 + 2 * model.grain_count, 2)
            equations.matrix[centres, 4:][:, centres] += 1.0 / model.grain_count
    return equations


def relative_motion(model: PathModel, contacts: ContactState) -> Floats:
    """(C, 2, 4) relative displacements per motion of a contact, spins times radii."""
    rows = contact_kinematics(contacts, model.law)
    rows[..., 2:] /= model.radii[model.contacts][:, None]
    return rows


def with_gear_mode(
    model: PathModel, contacts: ContactState, regime: Regimes, equations: Equations
) -> Equations:
    """Take a gear mode that nearly closes for the first spin, and its moment for the first moment.

    From grain to grain all contacts roll but the last, which slips by next to nothing. The square
    of that resists the mode: below rounding of the matrix, and noise for an integrator. The slip
    follows from the depths of the rims beneath the contacts, to rounding of its own; as unknown it
    is of order one. On modes of a whole ring that roll everywhere no moments act, see
    `loops.closures.system`; those of a chain are loaded by the contact that slides, and stay.
    """
    law, n, ring = model.law, model.grain_count, np.arange(model.grain_count)
    if not (law.local_stiffness(contacts, regime)[:, :, 1] != 0.0).any(axis=1).all():
        return equations
    projector, soft = gear_projector(model.contacts, model.radii, contacts, law, regime)
    equations.matrix[-n:, -n:] += projector
    plain = np.array_equal(model.contacts.T, [ring, np.roll(ring, -1)]) and n % 2 == 0
    if projector.any() or not (soft and plain) or model.symmetry is not None:
        return equations
    d, radii = 0.5 * contacts.overlap, model.radii[model.contacts].T
    own, arms = law.shear_kinematics(contacts)[1:], (contacts.arm_i, contacts.arm_j)
    modes, slips = [], []
    for levers in (arms, own):
        # Depths over the radii: those of arms do not follow from their rounded lengths.
        depth = np.where(np.equal(levers, arms), d / radii, 1.0 - levers / radii)
        logs = np.log1p(-depth)
        turned = np.cumsum(logs[0] - logs[1])
        if abs(turned[-1]) <= GEAR_RTOL * np.abs(depth).max():
            return equations
        modes.append((1.0 - 2.0 * (ring % 2)) * np.exp(np.append(0.0, turned[:-1])))
        slips.append((1.0 - depth[1, -1]) * np.expm1(turned[-1]))
    D = law.local_stiffness(contacts, regime)[-1] / model.stiffness
    matrix, motion, relative = (each.copy() for each in vars(equations).values())
    place = len(matrix) - n
    # Forces on the unknowns per unit of the last contact's slip.
    moments = -D[1, 1] * np.array([arms[0][-1], arms[1][-1]]) / radii[:, -1]
    push = motion[-1].T @ np.append(D[0, 1] * contacts.n[-1] + D[1, 1] * contacts.t[-1], moments)
    matrix[:, place + 4] = np.delete(push, slice(4, 8))
    motion[..., place + 4] = motion[..., place + 4 :] @ modes[1] / slips[1]
    relative[..., place + 4] = 0.0
    relative[-1, 1, place + 4] = 1.0
    growth = (modes[0] / model.radii)[model.contacts].sum(axis=1) / slips[0] / model.stiffness
    growth = 0.5 * (contacts.shear_force * growth)[:, None] * contacts.n
    matrix[place] = D[1] @ relative[-1] + np.einsum("cm,cmk->k", growth, motion[:, :2])
    return Equations(matrix, motion, relative)


def solve_rates(
    model: PathModel, matrix: Floats, control: tuple[Floats, Floats, Floats], gauge: Floats
) -> tuple[Floats, float, LeastSquares | None]:
    """Unknowns of a state (8 + m,) and the rate of the loading parameter under a control.

    In the unit of time of the gauge. The status of the solve is None if the system is not finite.
    """
    fields = model.unknowns.fields
    system, unit = control_system(model, matrix, model.unknowns, control, gauge)
    if not np.isfinite(system).all():
        return np.full(len(fields), np.nan), np.nan, None
    scale = np.abs(system[-1]).max()
    system[-1] /= scale
    rhs = np.zeros((len(system), 1))
    rhs[-1] = 1.0 / scale
    found = solve_through_null_space(system, rhs, block_diag(fields[:8], 1.0))
    z = found.x[:, 0]
    return fields @ z[:-1], float(z[-1] * unit), found


def control_system(
    model: PathModel,
    matrix: Floats,
    unknowns: Unknowns,
    control: tuple[Floats, Floats, Floats],
    gauge: Floats,
) -> tuple[Floats, float]:
    """Closure, control and gauge as one system, and the unit of the loading parameter.

    In a symmetric state only as many combinations of the control are kept as there are strains. The
    other rows agree with them, and near a singular state they hold nothing but the rounding of the
    forces times the compliance.
    """
    stress, strain, rate = control
    stress = stress * model.stiffness
    weight = np.maximum(np.abs(stress).max(axis=1), np.abs(strain).max(axis=1))
    drive = rate / weight
    unit = 1.0 / np.abs(drive).max()
    H, P = unknowns.fields[:4], unknowns.fields[4:8]
    held = np.column_stack([(strain @ H + stress @ P) / weight[:, None], -drive * unit])
    if unknowns.strains < 4:
        held = np.linalg.svd(held)[0][:, : unknowns.strains].T @ held
    reduced = unknowns.rows @ matrix @ unknowns.fields
    equations = np.column_stack([reduced, np.zeros(len(reduced))])
    return np.vstack([equations, held, np.append(gauge[:4] @ H, gauge[4] * unit)]), float(unit)


def stress_of_strain(matrix: Floats) -> Floats:
    """(4, 4) stress over `kn` per strain; nan if not trusted."""
    if matrix.shape == (4, 8):
        # Affine, spins not free: they read A H' - P' = 0.
        return matrix[:, :4].copy()
    moving = matrix[:, 4:]
    found = solve_through_null_space(moving, -matrix[:, :4], np.eye(4, moving.shape[1]))
    return found.x[:4] if is_trusted(found) else np.full((4, 4), np.nan)


def is_trusted(found: LeastSquares | None) -> bool:
    """Whether a solve has exactly one answer."""
    if found is None:
        return False
    return bool(found.residual <= RESIDUAL_LIMIT and found.ambiguity <= AMBIGUITY_LIMIT)
