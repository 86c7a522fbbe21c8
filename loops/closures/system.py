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

from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol, cast, get_args

import numpy as np

from loops.arrays import ROUNDING, Flags, Floats, Integers, Regimes, frobenius, one_blas_thread
from loops.assembly import (
    assembled,
    balancing,
    contact_sizes,
    contact_tangent,
    grain_ends,
    translational_blocks,
    translational_sizes,
)
from loops.closures.null_space import solve_through_null_space
from loops.closures.ring import change
from loops.closures.spins import LoopSpin, affine_spin, gear_projector, other_arms
from loops.errors import check_choice
from loops.geometry import boundary_vectors, polygon_area
from loops.graph import ContactState, GrainGraph, graph_of
from loops.laws.frictional import ContactLaw, require_law
from loops.scene import Scene

Closure = Literal["affine", "traction"]
Spins = Literal["blocked", "affine", "free"]

Arms = tuple[Floats, Floats]


class HasLaw(Protocol):
    """A loop, scene or snapshot: it has a graph and the law of its contacts."""

    @property
    def graph(self) -> GrainGraph:
        """Grains and contacts."""
        ...

    @property
    def law(self) -> ContactLaw:
        """Law of the contacts."""
        ...


def with_law(subject: GrainGraph | HasLaw, law: ContactLaw | None) -> tuple[GrainGraph, ContactLaw]:
    """Return a graph and its law: those of a loop, scene or snapshot, unless a law is given.

    `InputError` for what has no graph, or no law.
    """
    graph = graph_of(subject)
    own: Any = getattr(subject, "law", None) if law is None else law
    require_law(own, graph.contact_shape)
    return graph, own


def named_closure(closure: Closure | None) -> Closure:
    """Return the closure of one loop; `InputError` without one: the answer depends on it."""
    check_choice("closure", closure, get_args(Closure))
    return cast(Closure, closure)


def closure_of(
    scene: Scene, closure: Closure | Literal["packing"] | None, packings: tuple[str, ...]
) -> Closure | Literal["packing"]:
    """Return the closure that was named; without one 'packing', of boundaries of these kinds."""
    if closure == "packing" or (closure is None and scene.boundary.kind in packings):
        return "packing"
    return named_closure(closure)


# Unknowns up to which linear algebra gives the same bits with any number of threads.
FEW_UNKNOWNS = 24


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
    """Return the geometry of a closure whose stress refers to `volume` (...).

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
    """Return the closure form of a graph in its current state."""
    spin = affine_spin(graph) if spins == "affine" else None
    x0, d0 = (graph.x0, None) if closure == "traction" else (None, graph.reference_branches)
    return closure_form(spins, graph.contacts, graph.radii, volume, x0=x0, d0=d0, spin=spin)


def drive(form: ClosureForm) -> Floats:
    """Return (..., C, 4, 4) `A`, the prescribed motions of the contacts per component of `H'`."""
    branches = () if form.branches is None else form.branches.shape[:-2]
    spin = () if form.spin is None else form.spin.row.shape[:-1]
    batch = np.broadcast_shapes(form.radii.shape[:-2], branches, spin)
    A = np.zeros((*batch, len(form.ends), 4, 4))
    if form.branches is not None:
        A[..., 0, :2] = A[..., 1, 2:] = -form.branches
    if form.spin is not None:
        A[..., 2:, :] = form.radii[..., None] * form.spin.row[..., None, None, :]
    return A


def boundary_matrix(x0: Floats) -> Floats:
    """Return (..., 2 n, 4) the force on centres per component of `-P`: `B_ib` at (i a, a b)."""
    vectors = boundary_vectors(x0)
    matrix = np.zeros((*vectors.shape[:-2], 2 * vectors.shape[-2], 4))
    for a in range(2):
        matrix[..., a::2, 2 * a : 2 * a + 2] = vectors
    return matrix


def closure_matrix(form: ClosureForm, S: Floats, A: Floats, *, signed: bool = True) -> Floats:
    """Return (..., 4 + size, 8 + size) the equations of a closure for `(H', P', v)`, see above.

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
    """Return (..., C, 4, 4) `S` in spins times radii; blocked spins need no moments."""
    if spins == "blocked":
        return only_branches(translational_blocks(state, law, regime))
    return in_radii(state, contact_tangent(state, law, regime, arms))


def spring_sizes(state: ContactState, law: ContactLaw, regime: Regimes, spins: Spins) -> Floats:
    """Return the sums of the sizes of the terms of `contact_springs`."""
    if spins == "blocked":
        return only_branches(translational_sizes(state, law, regime))
    return in_radii(state, contact_sizes(state, law, regime))


def only_branches(k: Floats) -> Floats:
    """Return (..., C, 4, 4) tangents of contacts whose spins do not move."""
    S = np.zeros((*k.shape[:-2], 4, 4))
    S[..., :2, :2] = k
    return S


def in_radii(state: ContactState, S: Floats) -> Floats:
    """Return tangents for motions whose spins are multiplied by the radii."""
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
    """Return (4 + size, 2) the rigid translations: orthonormal null vectors of `(P', v)`."""
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
    """Return the answer of a closure, and `MacroTangent.sensitivity`, (...)."""
    form, sizes = form_of(graph, closure, spins, volume), spring_sizes(state, law, regime, spins)

    def by_arms(arms: Arms | None) -> Relaxed:
        gear = None
        # Few unknowns are solved alike by any number of threads, and without loading scipy.
        with one_blas_thread(of_scipy=False) if form.size > FEW_UNKNOWNS else nullcontext():
            if spins == "free":
                gear = gear_projector(graph.contacts, graph.radii, state, law, regime, arms)
            return relax(form, contact_springs(state, law, regime, spins, arms), sizes, gear)

    own = by_arms(None)
    if spins != "free" or graph.contact_count != graph.grain_count or graph.grain_count % 2:
        return own, np.zeros(own.stress.shape[:-2])
    other = by_arms(other_arms(state, law))
    pairs = (np.nan_to_num(one.stress).reshape(-1, 4, 4) for one in (own, other))
    with np.errstate(over="ignore"):
        changes = [change(*pair) for pair in zip(*pairs, strict=True)]
    return own, frobenius(other.error) + np.reshape(changes, own.residual.shape)
