"""Rates and event functions of a loop's path by numpy alone: what kernels give is held to them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from loops.assembly import contact_kinematics, motions
from loops.closures.null_space import solve_through_null_space
from loops.closures.spins import LoopSpin, gear_projector, spin_of_gradient
from loops.closures.system import closure_matrix, contact_springs, drive
from loops.laws.compiled import PressedContacts
from loops.laws.frictional import Regime, edge_rates, with_sides
from stability.paths import ring_rates
from stability.paths.model import all_unknowns
from stability.paths.state import (
    Rates,
    pair_overlaps,
    pairs_in_reach,
    shear_stiffness,
)
from stability.paths.state_rates import StateRates, is_trusted, stress_of_strain
from stability.programmes import area_ratio
from stability.spectra import subspace_basis

# Slip of a gear mode over the largest depth over the radius that may be rounding.
GEAR_RTOL = 64 * float(np.finfo(float).eps)
MIXED = np.array([0, 1, 1, 0]) != np.array([0, 1, 1, 0])[:, None]


class PlainRates(StateRates):
    """Rates of a state by the closure system, see `loops.closures.system`."""

    @cached_property
    def H(self):
        return displacement_gradient(self.model, self.y)

    @cached_property
    def contacts(self):
        return contacts_at(self.model, self.y, self.mode)

    @cached_property
    def P(self):
        return stress_of(self.model, self.contacts)

    @cached_property
    def sided(self):
        mode = self.mode
        side = np.where(mode.regime == Regime.SLIDING, mode.side, 0.0)
        return with_sides(self.contacts, side)

    @cached_property
    def equations(self):
        return closure_equations(self.model, self.H, self.sided, self.mode.regime)

    @cached_property
    def raw_rates(self):
        model, law, equations = self.model, self.model.law, self.equations
        control = self.programme.equations(self.H, self.P)
        z, parameter, found = solve_rates(model, equations.matrix, control, self.gauge)
        motion = model.length * (equations.motion @ z)
        if model.spins != "blocked":
            motion[:, 2:] /= model.radii[model.contacts]
        relative = model.length * (equations.relative @ z)
        D = law.local_stiffness(self.sided, self.mode.regime)
        N, T = -(D @ relative[..., None])[..., 0].T
        condition = np.inf if found is None else float(found.condition)
        return Rates(
            z[:4], z[4:8] * model.stiffness, parameter, *relative.T, N, T, motion, condition,
            found is not None and is_trusted(found),
        )  # fmt: skip

    @cached_property
    def y_rates(self):
        model, rates = self.model, self.rates
        place = rates.H if model.closure == "affine" else velocities(model, rates)
        work = power(model, self.mode, self.contacts, rates)
        y = np.concatenate([place.ravel(), rates.shear_force, [rates.parameter], work])
        return y if rates.trusted else np.full_like(y, np.nan)

    @cached_property
    def A(self):
        A = self.model.stiffness * stress_of_strain(self.equations.matrix)
        if self.model.mirrors:
            A[MIXED] -= A[MIXED]
        return A

    @cached_property
    def slip(self):
        """How fast contacts at yield would leave the cone if they stuck."""
        side = np.where(self.mode.side != 0.0, self.mode.side, np.sign(self.contacts.shear_force))
        rates, law = self.rates, self.model.law
        _, sticking, strength = edge_rates(law, self.sided, side, rates.un, rates.ut)
        return np.where(side == 0.0, 1.0, side) * sticking - strength

    @cached_property
    def balance_determinant(self):
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

    def values(self, stage, start, sense, size, subspaces):
        """Event functions in the order of `event_functions`."""
        model, mode, law = self.model, self.mode, self.model.law
        force, unit = model.stiffness * model.length, model.touching * size
        sticks, slides = (
            (mode.regime == one) & model.has_cone for one in (Regime.ELASTIC, Regime.SLIDING)
        )
        is_open, programme = mode.regime == Regime.OPEN, stage.programme
        driven = np.abs(programme.rate).argmax()
        strain = np.abs(programme.strain[driven]).max()
        weight = max(np.abs(programme.stress[driven]).max() * model.stiffness, strain)
        beyond = np.abs(self.contacts.shear_force) - law.strength(self.contacts)
        value = stage.value(self.H, self.P, self.parameter - start)
        pairs = pairs_in_reach(model, self.x)
        touch = pair_overlaps(model, pairs, self.x).max(initial=-ring_rates.WATCHED_GAP)
        return np.concatenate([
            beyond[sticks] / (force * size), -self.slip[slides] / force,
            (law.gap(self.contacts) / unit)[~is_open], (self.contacts.overlap / unit)[is_open],
            *(spectra(self.A, one) for one in subspaces), [-area_ratio(self.H)],
            [-self.rates.parameter * np.abs(programme.rate[driven]) / weight],
            [sense * (value - stage.target)], [touch],
        ])  # fmt: skip


def spectra(A, subspace):
    """Eigenvalues of Ks, then real parts of those of K, ascending, over the norm of K."""
    basis = subspace_basis(subspace)
    K = basis @ A @ basis.T
    norm = np.linalg.norm(K)
    symmetric = np.linalg.eigvalsh(0.5 * (K + K.T))
    return np.concatenate([symmetric, np.sort(np.linalg.eigvals(K).real)]) / norm


@dataclass(frozen=True, eq=False)
class Equations:
    """Closure equations of all unknowns `(H', P'/kn, v)`, see `loops.closures.system`.

    `matrix` (4 + m, 8 + m); four control equations complete it; `motion` (C, 4, 8 + m): Motions of
    the contacts, branch rates and spins times radii, over the length scale; `relative`
    (C, 2, 8 + m): Their normal and shear displacements `(un', ut')` over it.
    """

    matrix: np.ndarray
    motion: np.ndarray
    relative: np.ndarray


def closure_equations(model, H, contacts, regime):
    """Equations of the model's closure in one state."""
    form = model.form
    moving, prescribed = motions(np.eye(form.size), form.ends), drive(form)
    motion = np.concatenate([prescribed, np.zeros_like(prescribed), moving], axis=-1)
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


def relative_motion(model, contacts):
    """(C, 2, 4) relative displacements per motion of a contact, spins times radii."""
    rows = contact_kinematics(contacts, model.law)
    rows[..., 2:] /= model.radii[model.contacts][:, None]
    return rows


def with_gear_mode(model, contacts, regime, equations):
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


def solve_rates(model, matrix, control, gauge):
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


def control_system(model, matrix, unknowns, control, gauge):
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


def power(model, mode, contacts, rates):
    """(4,) rates of the work terms.

    External work `V0 P:H'`; work of the moments that hold the spins, `sum T (a_i w_i + a_j w_j)`;
    work spent on the shear of the contacts, `-sum T (t.d' - a_i w_i - a_j w_j)`; of this the part
    dissipated by slip, `-T (ut' + T'/kt)`. The moments are those that hold the spins and those of
    rolling springs.
    """
    T, (w_i, w_j) = contacts.shear_force, rates.motion[:, 2:].T
    rolled = contacts.arm_i * w_i + contacts.arm_j * w_j
    shear = (contacts.t * rates.motion[:, :2]).sum(axis=1) - rolled
    sliding = mode.regime == Regime.SLIDING
    slipped = np.zeros(1)
    if sliding.any():
        elastic = -rates.shear_force / shear_stiffness(model, contacts)
        slipped = np.where(sliding, -T * (rates.ut - elastic), 0.0)
    external = model.volume * (stress_of(model, contacts) @ rates.H)
    return np.array([external, T @ rolled, -T @ shear, slipped.sum()])


def velocities(model, rates):
    """(G, 2) velocities of the grains; their mean is zero under the traction closure."""
    if model.closure == "affine":
        return -model.x0 @ rates.H.reshape(2, 2).T
    velocity = np.zeros((model.grain_count, 2))
    # The ring's contacts come first, from grain to grain.
    velocity[1:] = np.cumsum(rates.motion[: model.grain_count - 1, :2], axis=0)
    return velocity - velocity.mean(axis=0)


def contacts_at(model, y, mode):
    """Contacts of a state with their forces, by numpy: `l0^2 - l^2 = -(2 d0 + u).u`."""
    place = y[: model.places].reshape(-1, 2)
    i, j = model.contacts.T
    moved = -model.d0 @ place.T if model.closure == "affine" else place[j] - place[i]
    d, regime = model.d0 + moved, mode.regime
    length = np.hypot(*d.T)
    shortening = -((d + model.d0) * moved).sum(axis=1) / (length + model.length0)
    n, is_open = d / length[:, None], regime == Regime.OPEN
    contacts = PressedContacts(
        length=length, n=n, t=np.stack([-n[:, 1], n[:, 0]], axis=1), normal_force=0.0 * length,
        shear_force=np.where(is_open, 0.0, y[model.shears]), radii_i=model.radii[i],
        radii_j=model.radii[j], depth=model.overlap0 + shortening,
    )  # fmt: skip
    normal = np.where(is_open, 0.0, model.law.closed_force(contacts))
    contacts = replace(contacts, normal_force=normal)
    if not model.law.keeps_strength:
        return contacts
    sliding = regime == Regime.SLIDING
    T = mode.side * np.where(sliding, model.law.strength(contacts), 0.0)
    return replace(contacts, shear_force=np.where(sliding, T, contacts.shear_force))


def displacement_gradient(model, y):
    """(4,) `H`: as integrated, or of the polygon, `-(1/V0) sum u_i (x) b_i`."""
    if model.closure == "affine":
        return y[:4]
    place = y[: model.places].reshape(-1, 2)
    return -(place.T @ model.b).ravel() / model.volume


def stress_of(model, contacts):
    """(4,) nominal stress `P = (1/V0) sum f (x) d0`."""
    return (contacts.forces.T @ model.d0).ravel() / model.volume
