"""The one closure system: how centres and spins relax, and what stress that leaves.

Under the traction closure the grains obey `[K, B; B^T, 0] (u, P) = (-K_w w, -V0 H)`: uniform
nominal stress loads grain i by `F_i = -P B_i`, and the polygon's displacement gradient is
`H = -(1/V0) sum u_i (x) B_i`. Under the affine closure the centres are given and the spins relax.
Translations, gear modes and rolling mechanisms are null vectors; they are harmless unless they
change what is watched. On a gear mode the moments that nothing balances are left standing: the
limit of spins with a vanishing resistance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from loops.arrays import Floats, Integers, Regimes, frobenius
from loops.assembly import assemble_elements, element_matrices
from loops.closures.macro_tangent import Spins
from loops.closures.spins import LoopSpin, gear_projector, other_arms
from loops.contact_state import ContactState
from loops.contact_tangent import ContactTangent, contact_sizes, contact_tangent
from loops.geometry import boundary_vectors, polygon_area
from loops.graph import GrainGraph
from loops.laws.protocol import ContactLaw
from loops.null_space import ROUNDING, LeastSquares, solve_through_null_space

Arms = tuple[Floats, Floats]
SYMMETRIC = np.array([[1, 0, 0, 0], [0, 0, 0, 1], [0, 0.5**0.5, 0.5**0.5, 0]])


class Terms(NamedTuple):
    """Contacts of a loop or packing as the system takes them.

    `tangent` and the `sizes` of its terms, with spins or not; `radii` (..., G) and `gear`
    (..., G, G) where spins are free, see `gear_projector`.
    """

    contacts: Integers
    tangent: ContactTangent
    sizes: ContactTangent
    radii: Floats
    gear: Floats | None


class Relaxed(NamedTuple):
    """What a closure answers to four unit displacement gradients.

    `stress` (..., 4, 4) and its `error` are `V0 P'`, under the affine closure what the spins add
    to it; `motion` (..., 2 G or 3 G, 4) the rates of centres and spins, `found` the status of the
    solve.
    """

    stress: Floats
    error: Floats
    motion: Floats
    found: LeastSquares


class _Scaled(NamedTuple):
    """Tangent of the grains and the sizes of its terms, in unknowns `u/l, r w/l`, of order one.

    `stiffness` (..., 1, 1) is what they are scaled by, zero where every contact is open.
    """

    k: Floats
    sizes: Floats
    scale: Floats
    stiffness: Floats


def contact_terms(
    graph: GrainGraph,
    law: ContactLaw,
    spins: Spins,
    state: ContactState,
    regime: Regimes,
    arms: Arms | None = None,
) -> Terms:
    """Blocks of the contacts of a graph; `arms` of the spins other than the law's if given."""
    gear = None
    if spins == "free":
        gear = gear_projector(graph, state, law, regime, arms)
    tangent = contact_tangent(state, law, regime, arms)
    return Terms(graph.contacts, tangent, contact_sizes(state, law, regime), graph.radii, gear)


def sensitivity(
    relax: Callable[[Terms], Relaxed],
    own: Relaxed,
    given: Floats | float,
    graph: GrainGraph,
    law: ContactLaw,
    state: ContactState,
    regime: Regimes,
) -> Floats:
    """(...) see `MacroTangent.sensitivity`, times V0; `given` is what else adds to the stress."""
    if graph.contact_count != graph.grain_count or graph.grain_count % 2:
        return np.zeros(own.stress.shape[:-2])
    other = relax(contact_terms(graph, law, "free", state, regime, other_arms(state, law)))
    doubt = frobenius(other.error)
    return np.maximum(
        *(
            _towards_zero(_smallest(given + own.stress, m), _smallest(given + other.stress, m))
            + doubt
            for m in (2, 3)
        )
    )


def _smallest(stress: Floats, components: int) -> Floats:
    """(...) smallest eigenvalue of Ks in (11, 22) or in (11, 22, (12 + 21)/sqrt 2)."""
    k = SYMMETRIC[:components] @ np.nan_to_num(stress) @ SYMMETRIC[:components].T
    return np.asarray(np.linalg.eigvalsh(0.5 * (k + np.swapaxes(k, -1, -2)))[..., 0])


def _towards_zero(own: Floats, other: Floats) -> Floats:
    return np.maximum(0.0, np.sign(own) * (own - other))


def boundary_matrix(x0: Floats) -> Floats:
    """(..., 2 n, 4) force on the centres of a ring per component of `-P`: `B_ib` at (i a, a b)."""
    vectors = boundary_vectors(x0)
    matrix = np.zeros((*vectors.shape[:-2], 2 * vectors.shape[-2], 4))
    for a in range(2):
        matrix[..., a::2, 2 * a : 2 * a + 2] = vectors
    return matrix


def saddle_matrix(tangent: Floats, boundary: Floats) -> Floats:
    """`[K, B; B^T, 0]`, (..., N + 4, N + 4), `B` filled up with zeros for the spins."""
    size, centres = tangent.shape[-1], boundary.shape[-2]
    batch = np.broadcast_shapes(tangent.shape[:-2], boundary.shape[:-2])
    system = np.zeros((*batch, size + 4, size + 4))
    system[..., :size, :size] = tangent
    system[..., :centres, size:] = boundary
    system[..., size:, :centres] = np.swapaxes(boundary, -1, -2)
    return system


def relax_centres(
    x0: Floats, blocks: Terms, spins: Spins, spin: LoopSpin | None, rows: Floats | None = None
) -> Relaxed:
    """Traction closure of a loop with corners `x0` (..., n, 2).

    `spin` is prescribed for spins 'affine'; `rows` (O, 2 G or 3 G) of the motion are watched
    besides the stress.
    """
    moves = 2 * x0.shape[-2]
    area = np.abs(polygon_area(x0))
    k, sizes, scale, stiffness = _scaled(blocks, spins, np.sqrt(area), x0.shape[-2])
    length = scale[..., :1, None]
    kept = k.shape[-1] if spins == "free" else moves
    load, doubt = np.zeros((*k.shape[:-2], kept + 4, 4)), None
    load[..., kept:, :] = -np.eye(4)
    motion = np.zeros((*k.shape[:-1], 4))
    if spin is not None:
        motion[..., moves:, :] = spin.row[..., None, :] / scale[..., moves:, None]
        load[..., :kept, :] = -k[..., :kept, kept:] @ motion[..., kept:, :]
        unsure = spin.error + ROUNDING * np.abs(spin.row)
        doubt = np.zeros(load.shape)
        doubt[..., :kept, :] = sizes[..., :kept, kept:] @ (
            unsure[..., None, :] / scale[..., moves:, None]
        )
    boundary = boundary_matrix(x0) / length
    system = saddle_matrix(k[..., :kept, :kept], boundary)
    size = saddle_matrix(sizes[..., :kept, :kept], np.abs(boundary))
    watched = np.zeros((*k.shape[:-2], 4 + (0 if rows is None else len(rows)), kept + 4))
    watched[..., :4, kept:] = np.eye(4)
    if rows is not None:
        watched[..., 4:, :kept] = (rows * scale[..., None, :] / length)[..., :kept]
    known = _translations(x0.shape[-2], kept + 4)
    found = solve_through_null_space(system, load, watched, known, size=size, doubt=doubt)
    motion[..., :kept, :] = found.x[..., :kept, :]
    stress = found.x[..., kept:, :] * stiffness
    error = np.asarray(found.error)[..., :4, :] * stiffness
    return Relaxed(stress, error, motion * scale[..., None], found)


def relax_spins(d0: Floats, grains: int, blocks: Terms, rows: Floats | None = None) -> Relaxed:
    """Affine closure with free spins: they relax to zero moment, `K_ww w = -K_wx x'`."""
    moves, (tangent, terms) = 2 * grains, (blocks.tangent, blocks.sizes)
    length = np.hypot(d0[..., 0], d0[..., 1]).max(axis=-1)
    k, sizes, scale, stiffness = _scaled(blocks, "free", length, grains)
    turn = scale[..., moves:, None]
    ends = blocks.contacts.T[..., None] == np.arange(grains)
    load, doubt, seen, blur = (
        np.zeros((*k.shape[:-2], *shape))
        for shape in ((moves // 2, 4), (moves // 2, 4), (4, moves // 2), (4, moves // 2))
    )
    for end, p, q, p_size, q_size in (
        (ends[0], tangent.p_i, tangent.q_i, terms.p_i, terms.q_i),
        (ends[1], tangent.p_j, tangent.q_j, terms.p_j, terms.q_j),
    ):
        load += end.T.astype(float) @ _outer(p, d0)
        doubt += end.T.astype(float) @ _outer(p_size, np.abs(d0))
        seen += np.swapaxes(_outer(q, d0), -1, -2) @ end.astype(float)
        blur += np.swapaxes(_outer(q_size, np.abs(d0)), -1, -2) @ end.astype(float)
    load, doubt = (a * turn / np.where(stiffness > 0, stiffness, 1.0) for a in (load, doubt))
    seen, blur = (a * np.swapaxes(turn, -1, -2) for a in (seen, blur))
    unit = np.linalg.norm(seen, axis=(-2, -1), keepdims=True)
    unit = np.where(unit > 0, unit, 1.0)
    watched = seen / unit
    if rows is not None:
        own = rows[:, moves:] * scale[..., None, moves:] / length[..., None, None]
        watched = np.concatenate(
            [watched, np.broadcast_to(own, (*k.shape[:-2], *own.shape[-2:]))], axis=-2
        )
    block, block_size = k[..., moves:, moves:], sizes[..., moves:, moves:]
    found = solve_through_null_space(block, load, watched, size=block_size, doubt=ROUNDING * doubt)
    error = np.asarray(found.error)[..., :4, :] * unit + ROUNDING * blur @ np.abs(found.x)
    motion = np.zeros((*k.shape[:-1], 4))
    motion[..., moves:, :] = found.x * turn
    return Relaxed(seen @ found.x, error, motion, found)


def stress_sum(f: Floats, d0: Floats) -> Floats:
    """(..., 4): sum over contacts of `f_i d0_j`."""
    total = np.swapaxes(f, -1, -2) @ d0
    return total.reshape(*total.shape[:-2], 4)


def _scaled(blocks: Terms, spins: Spins, length: Floats, grains: int) -> _Scaled:
    with_spins = spins != "blocked"
    k, sizes = (
        assemble_elements(element, blocks.contacts, grains)
        for element in (
            element_matrices(blocks.tangent, with_spins),
            np.abs(element_matrices(blocks.sizes, with_spins)),
        )
    )
    batch = np.broadcast_shapes(k.shape[:-2], length.shape, blocks.radii.shape[:-1])
    scale = np.broadcast_to(length[..., None], (*batch, k.shape[-1])).copy()
    if with_spins:
        scale[..., 2 * grains :] /= blocks.radii
    product = scale[..., :, None] * scale[..., None, :]
    k = k * product
    stiffness = np.abs(k).max(axis=(-2, -1), keepdims=True)
    k /= (unit := np.where(stiffness > 0, stiffness, 1.0))
    product /= unit
    sizes = sizes * product
    if blocks.gear is not None:
        k[..., 2 * grains :, 2 * grains :] += blocks.gear
        sizes[..., 2 * grains :, 2 * grains :] += np.abs(blocks.gear)
    return _Scaled(k, sizes, scale, stiffness)


def _outer(p: Floats, d0: Floats) -> Floats:
    """(..., C, 4) products per component of H."""
    return (p[..., :, None] * d0[..., None, :]).reshape(
        *np.broadcast_shapes(p.shape[:-1], d0.shape[:-1]), 4
    )


def _translations(grains: int, size: int) -> Floats:
    """(size, 2) orthonormal rigid translations: null vectors of the system and its transpose."""
    z = np.zeros((size, 2))
    z[0 : 2 * grains : 2, 0] = z[1 : 2 * grains : 2, 1] = grains**-0.5
    return z
