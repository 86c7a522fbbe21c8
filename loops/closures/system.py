"""The closure system: equations for the relaxation of centres and spins, and for the stress.

The freedoms `v` of a loop are its centres and spins, as far as the closure leaves them free. They
move the contacts by `r = A H' + D v`, and the contacts answer with `-S r`. Under the traction
closure uniform nominal stress loads grain i by `F_i = -P B_i`, and the polygon's displacement
gradient is `H = -(1/V0) sum u_i (x) B_i`; under the affine closure the branches follow `H`, spins
alone are free, and the stress is the mean of the contact forces, `(1/V0) sum f (x) d0`:

    traction   [V0  0  B^T; D^T S A   B   D^T S D] (H', P', v) = 0
    affine     [A^T S A  -V0  A^T S D; D^T S A   0   D^T S D] (H', P', v) = 0

Operators, directional work and the rates of paths solve these equations. They are in units of the
length `sqrt(V0)` and of a stiffness: `d'/l`, `r w/l`, `P/k`.
Translations, gear modes and rolling mechanisms are null vectors; they are harmless unless they
change the wanted rates. Moments on a gear mode that nothing balances are left out of the
equations: the limit of spins with a vanishing resistance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from loops.arrays import ROUNDING, Flags, Floats, Integers, Regimes, all_finite, frobenius
from loops.assembly import (
    assembled,
    balancing,
    contact_sizes,
    contact_tangent,
    grain_ends,
    translational_blocks,
    translational_sizes,
)
from loops.errors import InputError
from loops.geometry import area_growth, boundary_vectors, polygon_area, require_loop
from loops.graph import ContactState, GrainGraph, reference_branch_vectors
from loops.laws.frictional import ContactLaw

Closure = Literal["affine", "traction"]
Spins = Literal["blocked", "affine", "free"]

# Singular values below this fraction of the largest count as zero. Rounding leaves about
# size * eps = 1e-15 to 1e-13 there (loops of 3 to 200 grains).
NULL_TOLERANCE = 1e-13


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Least-squares solution of smallest norm, batch axes `...` first.

    `x` (..., N, R); `nullity`, `condition` (Frobenius, off the null vectors), `residual`
    (`|M x - b| / |b|`), `ambiguity` (largest part of a unit null vector that the observed rows
    see), all (...); `error` (..., O, R) bounds the error of the observed rows, None unless asked.
    """

    x: Floats
    nullity: Integers
    condition: Floats
    residual: Floats
    ambiguity: Floats
    error: Floats | None = None


def solve_through_null_space(
    matrix: Floats,
    rhs: Floats,
    observed: Floats,
    known: Floats | None = None,
    *,
    size: Floats | None = None,
    doubt: Floats | None = None,
    soft: Flags | bool = False,
    tolerance: float = NULL_TOLERANCE,
) -> LeastSquares:
    """Solve `M x = b`, (..., N, N) and (..., N, R), for the solution of smallest norm.

    `observed` (..., O, N) are the rows that map `x` to what is wanted of it: a null vector that
    they do not see is harmless. `known` (..., N, Z) are orthonormal null vectors of `M` and of its
    transpose that they do not see either; where these are all there are, the inverse of
    `M + Z Z^T` solves it, elsewhere the singular values do, at ten times the cost.

    With `size`, the sum of the sizes of the terms behind every entry of `M`, comes a bound on the
    error of `Y b`, `Y` the observed rows of the inverse, of first order in the rounding `e`:
    `|Y| (|r| + e (size |x| + |b|))`, `r` what is left over. A null vector `v` of which `p` is
    observed adds `|p| |b_u| / s`, `s` the least that its singular value may be and `b_u` what loads
    it; everything if `s` may be zero, but for systems with `known` null vectors, which have others
    like them: nothing if `p` and `b_u` are rounding. Where `soft` (...) a vector is null but for a
    stiffness below rounding, and `p b_u` is rounding as well: everything there. `doubt` is what
    else `b` may err by. A system that is not finite has the solution nan and an infinite residual.
    """
    batch = matrix.shape[:-2]
    matrix, rhs, observed = (_flat(a, batch) for a in (matrix, rhs, observed))
    finite = all_finite(matrix) & all_finite(rhs)
    every = bool(finite.all())
    if not every:
        matrix = np.where(finite[:, None, None], matrix, 0.0)
    # Where other singular values are as small the known null vectors mix with theirs.
    bordered = matrix if known is None else matrix + known @ np.swapaxes(known, -1, -2)
    inverse, condition = _inverse(bordered)
    nullity = np.full(len(matrix), 0 if known is None else known.shape[-1])
    ambiguity = np.zeros(len(matrix))
    dropped = np.zeros((len(matrix), observed.shape[-2], rhs.shape[-1]))
    rest = np.flatnonzero(~(condition * tolerance < 1))
    if len(rest):
        inverse[rest], others, condition[rest], ambiguity[rest], dropped[rest] = (
            _by_singular_values(
                bordered[rest],
                rhs[rest],
                observed[rest],
                tolerance,
                None if size is None else _flat(size, batch)[rest],
                (known is not None) & ~np.broadcast_to(soft, batch).reshape(-1)[rest],
            )
        )
        nullity[rest] += others
    x = inverse @ rhs
    # One step of refinement: an inverse alone leaves a residual of condition times rounding.
    x += inverse @ (rhs - matrix @ x)
    left = np.abs(matrix @ x - rhs)
    load = frobenius(rhs)
    residual = frobenius(left) / np.where(load > 0, load, 1.0)
    if not every:
        x[~finite] = np.nan
        condition[~finite] = residual[~finite] = ambiguity[~finite] = np.inf
    error = None
    if size is not None:
        unsure = _flat(size, batch) @ np.abs(x if every else np.nan_to_num(x))
        unsure += np.abs(rhs)
        unsure *= ROUNDING
        unsure += left
        if doubt is not None:
            unsure += _flat(doubt, batch)
        error = (np.abs(observed @ inverse) @ unsure + dropped).reshape(*batch, *dropped.shape[1:])
    return LeastSquares(
        x=x.reshape(*batch, *x.shape[-2:]),
        nullity=nullity.reshape(batch),
        condition=condition.reshape(batch),
        residual=residual.reshape(batch),
        ambiguity=ambiguity.reshape(batch),
        error=error,
    )


def _flat(a: Floats, batch: tuple[int, ...]) -> Floats:
    """One batch axis."""
    own = a if a.shape[:-2] == batch else np.broadcast_to(a, (*batch, *a.shape[-2:]))
    return own.reshape(-1, *a.shape[-2:])


def _inverse(matrix: Floats) -> tuple[Floats, Floats]:
    """Inverses and condition numbers, infinite where there is none."""
    try:
        inverse: Floats = np.asarray(np.linalg.inv(matrix), dtype=float)
    except np.linalg.LinAlgError:
        return np.zeros_like(matrix), np.full(len(matrix), np.inf)
    condition = frobenius(matrix) * frobenius(inverse)
    return inverse, np.where(np.isfinite(condition), condition, np.inf)


def _by_singular_values(
    matrix: Floats,
    rhs: Floats,
    observed: Floats,
    tolerance: float,
    size: Floats | None,
    mechanisms: Flags,
) -> tuple[Floats, Integers, Floats, Floats, Floats]:
    """Pseudo-inverse, nullity, condition, ambiguity, and what the null vectors might have added.

    The matrix errs by `E = e size`: so a singular value by `|u| E |v| + e s_max`, the load on its
    vector by `|u| (E |x| + e |b|)`, and what the observed rows see of it by `|Y| E |v|`. Where the
    singular value may vanish its vector may have added anything, unless the system has
    `mechanisms`, which are null exactly: there load and what is seen of them are rounding.
    """
    u, s, vt = np.linalg.svd(matrix)
    null = s <= tolerance * s[:, :1]
    scale = np.where(null, 0.0, 1.0 / np.where(null, 1.0, s))
    inverse = (np.swapaxes(vt, -1, -2) * scale[:, None, :]) @ np.swapaxes(u, -1, -2)
    v, ut = np.swapaxes(vt * null[..., None], -1, -2), np.swapaxes(u * null[:, None, :], -1, -2)
    seen, loaded = np.abs(observed @ v), np.abs(ut @ rhs)
    ambiguity = np.max(np.linalg.norm(seen, axis=-2), axis=-1)
    dropped = np.zeros((len(matrix), observed.shape[-2], rhs.shape[-1]))
    if size is not None:
        E, left, right = ROUNDING * size, np.abs(ut), np.abs(v)
        unsure = left @ (E @ np.abs(inverse @ rhs) + ROUNDING * np.abs(rhs))
        least = s - np.einsum("bsi,bij,bjs->bs", left, E, right) - ROUNDING * s[:, :1]
        lost = null & (least <= 0)
        known = null & ~lost
        weight = np.where(known, 1.0 / np.where(known, least, 1.0), 0.0)[:, None, :]
        reach = np.abs(observed @ inverse) @ (E @ right)
        dropped = ((seen + reach) * weight) @ (loaded + unsure)
        product = np.linalg.norm(seen, axis=-2) * np.linalg.norm(loaded, axis=-1)
        harmless = mechanisms[:, None] & (product <= (ROUNDING * s[:, :1]) ** 2)
        dropped[(lost & ~harmless).any(axis=-1)] = np.inf
    smallest = np.min(np.where(null, np.inf, s), axis=-1)
    return inverse, null.sum(axis=-1), s[:, 0] / smallest, ambiguity, dropped


Arms = tuple[Floats, Floats]
SYMMETRIC = np.array([[1, 0, 0, 0], [0, 0, 0, 1], [0, 0.5**0.5, 0.5**0.5, 0]])
# Rows of the spins' shear are of order one: below the first a singular value is rounding. Between
# the two a mode has next to no stiffness and a load in proportion: held it gives another tangent.
GEAR_TOLERANCE, SOFT_GEAR = 2e-15, 1e-2


class LoopSpin(NamedTuple):
    """Spin `w = row . (H11, H12, H21, H22)` of all grains, (..., 4), and the error of the row."""

    row: Floats
    error: Floats


def spin_of_gradient(f: Floats) -> Floats:
    """(..., 4) spin `(L21 - L12)/2` per component of `H'`, `L = -H' F^-1`, F (..., 2, 2)."""
    det = f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0]
    row = np.stack([-f[..., 0, 1], f[..., 0, 0], -f[..., 1, 1], f[..., 1, 0]], axis=-1)
    return np.asarray(0.5 * row / det[..., None])


def affine_spin(graph: GrainGraph) -> LoopSpin:
    """Spin of grains that turn with the loop, counter-clockwise positive.

    `F = 1 - H` is the mean over the polygon, `H` by the boundary formula (see `loop_strain`), or
    that of the cell; the identity where the reference is the current configuration.
    """
    if graph.x0 is graph.x and graph.cell0 is graph.cell:
        row = spin_of_gradient(np.eye(2))
        return LoopSpin(row, np.zeros(4))
    if graph.cell is not None and graph.cell0 is not None:
        f = graph.cell @ np.linalg.inv(graph.cell0)
        doubt = ROUNDING * np.abs(graph.cell) @ np.abs(np.linalg.inv(graph.cell0))
    else:
        # `F = 1 + (1/V0) sum u_i (x) B_i`.
        try:
            require_loop(graph)
        except InputError:
            raise InputError(
                "spins 'affine'",
                "a packing without a cell, away from its reference",
                "a loop, a periodic cell, or the reference as it stands",
                "The rotation of a loop is that of its polygon.",
            ) from None
        start = graph.x0 - graph.x0[..., :1, :]
        end = graph.x - graph.x[..., :1, :]
        b = boundary_vectors(graph.x0)
        area = np.abs(polygon_area(graph.x0))[..., None, None]
        h = np.swapaxes(end - start, -1, -2) @ b / area
        terms = np.swapaxes(np.abs(start) + np.abs(end), -1, -2) @ np.abs(b) / area
        doubt = terms + np.abs(h) * area_growth(graph.x0)[..., None, None]
        f, doubt = np.eye(2) + h, ROUNDING * (doubt + np.eye(2))
    return LoopSpin(spin_of_gradient(f), _spin_error(f, doubt))


def _spin_error(f: Floats, doubt: Floats) -> Floats:
    """First order: `|F^-1| |dF| |F^-1|` for every entry, and the rounding of the determinant."""
    det = np.abs(f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0])[..., None, None]
    adjugate = np.abs(f[..., ::-1, ::-1])
    adjugate[..., 0, 1], adjugate[..., 1, 0] = np.abs(f[..., 0, 1]), np.abs(f[..., 1, 0])
    inverse = adjugate / det
    error = inverse @ (doubt + ROUNDING * np.abs(f)) @ inverse
    return 0.5 * np.stack(
        [error[..., 0, 1], error[..., 1, 1], error[..., 0, 0], error[..., 1, 0]], axis=-1
    )


def other_arms(state: ContactState, law: ContactLaw) -> tuple[Floats, Floats]:
    """Arms `b_i, b_j` of spins by the other rule of sharing them between the grains.

    By the point of contact (arms) if the law shares them by the radii, and vice versa: a change of
    less than the overlap, as objective as the law's own rule; `b_i + b_j` stays.
    """
    _, b_i, b_j = law.shear_kinematics(state)
    total = b_i + b_j
    share = state.radii_i / state.touching_length + state.arm_i / state.length - b_i / total
    return share * total, (1.0 - share) * total


def gear_projector(
    graph: GrainGraph,
    state: ContactState,
    law: ContactLaw,
    regime: Regimes,
    arms: tuple[Floats, Floats] | None = None,
) -> tuple[Floats, Flags]:
    """(..., G, G) projector on the spins times radii that no contact feels, (...) soft gear modes.

    Gear modes: in an even loop of a law that shears by the radii, and between contacts that slide.
    They are null vectors of the tangent, exactly; of its transpose only if the law balances
    moments with the same arms. A soft one is null but for next to nothing, as in even loops of a
    law that shears by the branch.
    """
    stiffness, (_, b_i, b_j) = law.local_stiffness(state, regime), law.shear_kinematics(state)
    b_i, b_j = (b_i, b_j) if arms is None else arms
    felt = (stiffness[..., 0, 1] != 0) | (stiffness[..., 1, 1] != 0)
    rolls = np.broadcast_to(law.rolling_stiffness(state, regime) != 0, felt.shape)
    grains, radii, c = graph.grain_count, graph.radii, np.arange(graph.contact_count)
    i, j = graph.contacts.T
    batch = np.broadcast_shapes(felt.shape[:-1], b_i.shape[:-1], radii.shape[:-1])
    rows = np.zeros((*batch, max(grains, (1 + rolls.any()) * len(c)), grains))
    # Shear and roll per spin times radius of either grain, of order one.
    b_i, b_j = b_i / radii[..., i], b_j / radii[..., j]
    scale = np.where(felt, np.maximum(b_i, b_j), np.inf)
    rows[..., c, i] = b_i / scale
    rows[..., c, j] += b_j / scale
    if rolls.any():
        least = np.where(rolls, np.minimum(radii[..., i], radii[..., j]), 0.0)
        rows[..., len(c) + c, i] = least / radii[..., i]
        rows[..., len(c) + c, j] -= least / radii[..., j]
    _, s, vt = np.linalg.svd(rows, full_matrices=False)
    null = s <= GEAR_TOLERANCE
    if grains == len(c) and (np.bincount(graph.contacts.ravel()) == 2).all():
        # Around a ring that shears everywhere arms cancel two by two (equal grains, mirror images),
        # or by chance.
        uneven = np.sort(np.abs(b_i - b_j) / np.maximum(b_i, b_j), axis=-1)
        paired = (uneven[..., 1::2] - uneven[..., : len(c) - 1 : 2] <= ROUNDING).all(axis=-1)
        null &= ~(felt.all(axis=-1) & ~paired)[..., None]
    v = vt * null[..., None]
    soft = np.asarray((~null & (s < SOFT_GEAR)).any(axis=-1))
    return np.asarray(np.swapaxes(v, -1, -2) @ v), soft


@dataclass(frozen=True, eq=False)
class ClosureForm:
    """Geometry of a closure, lengths over `sqrt(V0)`.

    `ends` (C, 6) are the freedoms of the contacts' grains and `size` their number; `radii`
    (..., C, 2) those of the two grains; `branches` (..., C, 2) follow `H` under the affine closure;
    `boundary` (..., size, 4) is `B` under the traction closure; `spin` is that of all grains where
    they turn with the loop.
    """

    ends: Integers
    size: int
    radii: Floats
    branches: Floats | None
    boundary: Floats | None
    spin: LoopSpin | None


class Relaxed(NamedTuple):
    """Solution of a closure for four unit displacement gradients.

    `stress` (..., 4, 4) is `P'` and `error` a bound on its error; `v` (..., size, 4) are the
    freedoms; `residual` and `ambiguity` (...) are those of the solve.
    """

    stress: Floats
    error: Floats
    v: Floats
    residual: Floats
    ambiguity: Floats


def closure_form(
    spins: Spins, contacts: Integers, radii: Floats, volume: Floats,
    *, x0: Floats | None = None, d0: Floats | None = None, spin: LoopSpin | None = None,
) -> ClosureForm:  # fmt: skip
    """Geometry of a closure whose stress refers to `volume` (...).

    From the centres `x0` (..., n, 2) of a ring, or the branches `d0` (..., C, 2) that follow `H`.
    """
    length, grains = np.sqrt(volume)[..., None, None], radii.shape[-1]
    ends, size = grain_ends(contacts, grains, spins == "free")
    branches = boundary = None
    if x0 is not None:
        ratio = volume / np.abs(polygon_area(x0))
        matrix = boundary_matrix(x0) * (ratio[..., None, None] / length)
        boundary = np.zeros((*matrix.shape[:-2], size, 4))
        boundary[..., : 2 * grains, :] = matrix
    if d0 is not None:
        branches, size = d0 / length, size - 2 * grains
        ends = np.maximum(ends - 2 * grains, -1)
    return ClosureForm(ends, size, radii[..., contacts] / length, branches, boundary, spin)


def form_of(graph: GrainGraph, closure: Closure, spins: Spins, volume: Floats) -> ClosureForm:
    """Closure form of a graph in its current state."""
    spin = affine_spin(graph) if spins == "affine" else None
    x0, d0 = (graph.x0, None) if closure == "traction" else (None, reference_branch_vectors(graph))
    return closure_form(spins, graph.contacts, graph.radii, volume, x0=x0, d0=d0, spin=spin)


def drive(form: ClosureForm) -> Floats:
    """(..., C, 4, 4) `A`: the motions of the contacts per component of `H'` that are prescribed."""
    batch = form.radii.shape[:-2]
    if form.branches is not None:
        batch = np.broadcast_shapes(batch, form.branches.shape[:-2])
    if form.spin is not None:
        batch = np.broadcast_shapes(batch, form.spin.row.shape[:-1])
    A = np.zeros((*batch, len(form.ends), 4, 4))
    if form.branches is not None:
        A[..., 0, :2] = A[..., 1, 2:] = -form.branches
    if form.spin is not None:
        A[..., 2:, :] = form.radii[..., None] * form.spin.row[..., None, None, :]
    return A


def boundary_matrix(x0: Floats) -> Floats:
    """(..., 2 n, 4) force on the centres of a ring per component of `-P`: `B_ib` at (i a, a b)."""
    vectors = boundary_vectors(x0)
    matrix = np.zeros((*vectors.shape[:-2], 2 * vectors.shape[-2], 4))
    for a in range(2):
        matrix[..., a::2, 2 * a : 2 * a + 2] = vectors
    return matrix


def closure_matrix(form: ClosureForm, S: Floats, A: Floats, *, signed: bool = True) -> Floats:
    """(..., 4 + size, 8 + size) equations of a closure for `(H', P', v)`, see above.

    Not `signed`: the sums of the sizes of the terms of every entry.
    """
    ends, size, boundary = form.ends, form.size, form.boundary
    whole = () if boundary is None else boundary.shape[:-2]
    batch = np.broadcast_shapes(S.shape[:-3], A.shape[:-3], whole)
    matrix = np.zeros((*batch, 4 + size, 8 + size))
    stress, balance = matrix[..., :4, :], matrix[..., 4:, :]
    forces = S @ A
    if size:
        balance[..., :4] = balancing(forces, ends, size, signed)
        balance[..., 8:] = assembled(S, ends, size, signed)
    if boundary is not None:
        boundary = boundary if signed else np.abs(boundary)
        balance[..., 4:8], stress[..., 8:] = boundary, np.swapaxes(boundary, -1, -2)
        stress[..., :4] = np.eye(4)
    if form.branches is None:
        return matrix
    # The stress works on the branches alone, not the moments that hold spins.
    branches = -form.branches if signed else np.abs(form.branches)
    flat = forces[..., :2, :].reshape(*forces.shape[:-2], 8)
    mean = (np.swapaxes(branches, -1, -2) @ flat).reshape(*batch, 2, 2, 4)
    stress[..., :4] = np.swapaxes(mean, -3, -2).reshape(*batch, 4, 4)
    stress[..., 4:8] = -np.eye(4)
    if size:
        per_motion = np.swapaxes(S[..., :2, :], -1, -2)[..., None] * branches[..., None, None, :]
        per_motion = per_motion.reshape(*per_motion.shape[:-2], 4)
        stress[..., 8:] = np.swapaxes(balancing(per_motion, ends, size, signed), -1, -2)
    return matrix


def contact_springs(
    state: ContactState, law: ContactLaw, regime: Regimes, spins: Spins, arms: Arms | None = None
) -> Floats:
    """(..., C, 4, 4) `S` of the contacts in spins times radii; blocked ones need no moments."""
    if spins == "blocked":
        return only_branches(translational_blocks(state, law, regime))
    return in_radii(state, contact_tangent(state, law, regime, arms))


def spring_sizes(state: ContactState, law: ContactLaw, regime: Regimes, spins: Spins) -> Floats:
    """Sums of the sizes of the terms of `contact_springs`."""
    if spins == "blocked":
        return only_branches(translational_sizes(state, law, regime))
    return in_radii(state, contact_sizes(state, law, regime))


def only_branches(k: Floats) -> Floats:
    """(..., C, 4, 4) tangents of contacts whose spins do not move."""
    S = np.zeros((*k.shape[:-2], 4, 4))
    S[..., :2, :2] = k
    return S


def in_radii(state: ContactState, S: Floats) -> Floats:
    """Tangents for motions whose spins are multiplied by the radii."""
    ones = np.ones(np.broadcast_shapes(state.radii_i.shape, state.radii_j.shape))
    turn = np.stack([ones, ones, 1.0 / state.radii_i, 1.0 / state.radii_j], axis=-1)
    return np.asarray(S * (turn[..., :, None] * turn[..., None, :]))


def relax(
    form: ClosureForm,
    S: Floats,
    sizes: Floats,
    gear: tuple[Floats, Flags] | None = None,
    rows: Floats | None = None,
) -> Relaxed:
    """Solve a closure for unit displacement gradients.

    `S` and the `sizes` of its terms are those of `contact_springs`, `gear` is the answer of
    `gear_projector`. `rows` (O, C, 4) of the motion of the contacts are watched besides the stress.
    """
    stiffness = np.abs(S).max(axis=(-3, -2, -1), keepdims=True)
    unit = np.where(stiffness > 0, stiffness, 1.0)
    A = drive(form)
    E = closure_matrix(form, S / unit, A)
    size = closure_matrix(form, sizes / unit, np.abs(A), signed=False)
    doubt = ROUNDING * size[..., :4]
    if form.spin is not None:
        unsure = np.zeros(A.shape)
        unsure[..., 2:, :] = form.radii[..., None] * form.spin.error[..., None, None, :]
        doubt = doubt + closure_matrix(form, sizes / unit, unsure, signed=False)[..., :4]
    if form.boundary is not None:
        doubt[..., :4, :] = 0.0
    elif not form.size:
        none = np.zeros(E.shape[:-2])
        return Relaxed(
            E[..., :4] * stiffness[..., 0], doubt * stiffness[..., 0], E[..., 4:, :4], none, none
        )
    soft: Flags | bool = False
    if gear is not None:
        projector, soft = gear
        grains = projector.shape[-1]
        E[..., -grains:, -grains:] += projector
        size[..., -grains:, -grains:] += np.abs(projector)
    watched = np.zeros((*E.shape[:-2], 4 + (0 if rows is None else len(rows)), E.shape[-1] - 4))
    watched[..., :4, :4] = np.eye(4)
    if rows is not None:
        seen = balancing(np.moveaxis(rows, 0, -1), form.ends, form.size)
        watched[..., 4:, 4:] = np.swapaxes(seen, -1, -2)
    known = None if form.boundary is None else translations(form)
    found = solve_through_null_space(
        E[..., 4:], -E[..., :4], watched, known, size=size[..., 4:], doubt=doubt, soft=soft
    )
    stress, v = found.x[..., :4, :] * stiffness[..., 0], found.x[..., 4:, :]
    error = np.asarray(found.error)[..., :4, :] * stiffness[..., 0]
    return Relaxed(stress, error, v, found.residual, found.ambiguity)


def translations(form: ClosureForm) -> Floats:
    """(4 + size, 2) rigid translations, orthonormal: null vectors of `(P', v)` and the rows."""
    centres = 2 * (form.ends[:, :4].max() // 2 + 1)
    z = np.zeros((4 + form.size, 2))
    z[4 : 4 + centres : 2, 0] = z[5 : 4 + centres : 2, 1] = (centres // 2) ** -0.5
    return z


def relaxed_loop(
    graph: GrainGraph,
    law: ContactLaw,
    closure: Closure,
    spins: Spins,
    state: ContactState,
    regime: Regimes,
    volume: Floats,
) -> tuple[Relaxed, Floats]:
    """Answer of the closure of a loop or packing, and `MacroTangent.sensitivity`, (...)."""
    form, sizes = form_of(graph, closure, spins, volume), spring_sizes(state, law, regime, spins)

    def by_arms(arms: Arms | None) -> Relaxed:
        gear = None
        if spins == "free":
            gear = gear_projector(graph, state, law, regime, arms)
        return relax(form, contact_springs(state, law, regime, spins, arms), sizes, gear)

    own = by_arms(None)
    if spins != "free" or graph.contact_count != graph.grain_count or graph.grain_count % 2:
        return own, np.zeros(own.stress.shape[:-2])
    other = by_arms(other_arms(state, law))
    doubt = frobenius(other.error)
    # A change of the smallest eigenvalue counts where it leads towards zero or beyond.
    changes = []
    for components in (2, 3):
        smallest, changed = _smallest(own.stress, components), _smallest(other.stress, components)
        changes.append(np.maximum(0.0, np.sign(smallest) * (smallest - changed)) + doubt)
    return own, np.maximum(*changes)


def _smallest(stress: Floats, components: int) -> Floats:
    """(...) smallest eigenvalue of Ks in (11, 22) or in (11, 22, (12 + 21)/sqrt 2)."""
    k = SYMMETRIC[:components] @ np.nan_to_num(stress) @ SYMMETRIC[:components].T
    return np.asarray(np.linalg.eigvalsh(0.5 * (k + np.swapaxes(k, -1, -2)))[..., 0])
