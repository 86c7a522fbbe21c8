"""Pairs of grains, or of a grain and a wall, that touch or soon might: law's parameters, frames."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from loops.arrays import Flags, Floats, Integers
from loops.errors import InputError
from loops.graph import GrainGraph, contact_state, require_one_state
from loops.laws import FrictionalLaw, HertzMindlin, LinearFrictional
from loops.packing import PlaneContacts
from stability.packing.state import PackingState

# A pair at one geometry, as the kernels take it; all lengths but `d` are over the mean radius.
PAIR = np.dtype(
    [
        ("grains", "i8", 2),
        ("d", "f8", 2),  # from the first centre to the second, or to the point of the wall
        ("n", "f8", 2),
        ("t", "f8", 2),
        ("turning", "f8"),  # the shear rate is `turning` times `t . d'`
        ("lever", "f8", 2),  # minus `lever` times the spins
        ("arm", "f8", 2),  # levers of the shear force
        ("rotation", "f8", 2),  # force rate per `t . d'`, as the pair rotates
        ("growth", "f8"),  # moment rate per `n . d'`, as the arms grow
        ("kn", "f8"),
        ("kt", "f8"),
        ("coupling", "f8"),  # stuck, `-T'` per `n . d'`: of a `T` that goes with `kt`
        ("mu", "f8"),  # 0 where the strength is not finite
        ("slides", "i8"),  # whether the strength is finite
    ]
)

# Smallest overlap, over the distance of the centres, that stiffnesses are estimated at.
SMALL_OVERLAP = 1e-4
# N over the overlap times Hertz's tangent; the law is his where most contacts are that close to it.
HERTZ, HERTZ_BAND, MOSTLY = 2.0 / 3.0, 0.01, 0.9


class Pairs(NamedTuple):
    """Pairs (P, 2) with the image of the second grain (P, 2), and `kn`, `kt`, `mu` (P,).

    The second one of a pair is the wall, if there is one. Under Hertz's law `kn`, `kt` are the
    tangents over the root of the overlap, `N = 2/3 kn overlap^(3/2)`; `by_displacement`, `T` goes
    with `kt`. A `law` of one's own holds between grains, `kn` and `kt` at walls.
    """

    grains: Integers
    images: Integers
    kn: Floats
    kt: Floats
    mu: Floats
    hertz: bool = False
    by_displacement: bool = False
    law: FrictionalLaw | None = None

    def __len__(self) -> int:
        return len(self.grains)


def touching_distances(state: PackingState, pairs: Pairs) -> Floats:
    """(P,) distances of the centres at first touch."""
    return np.asarray(state.radii[pairs.grains].sum(axis=1))


def overlaps(state: PackingState, pairs: Pairs) -> Floats:
    """(P,) overlaps, zero where a pair is apart."""
    length = np.linalg.norm(state.branches, axis=1)
    return np.asarray(np.maximum(touching_distances(state, pairs) - length, 0.0))


def normal_forces(pairs: Pairs, overlap: Floats) -> Floats:
    """(P,) `N` of the overlaps."""
    return HERTZ * pairs.kn * overlap**1.5 if pairs.hertz else pairs.kn * overlap


def tangents(pairs: Pairs, overlap: Floats) -> tuple[Floats, Floats]:
    """(P,) `kn` and `kt` at the overlaps."""
    root = np.sqrt(overlap) if pairs.hertz else 1.0
    return pairs.kn * root, pairs.kt * root


def normal_energy(pairs: Pairs, overlap: Floats) -> Floats:
    """(P,) energy of the normal springs at the overlaps."""
    return (0.4 if pairs.hertz else 0.5) * normal_forces(pairs, overlap) * overlap


def typical_stiffness(pairs: Pairs, state: PackingState) -> Floats:
    """(P,) `kn`, of pairs that hardly touch at a small overlap."""
    least = SMALL_OVERLAP * touching_distances(state, pairs)
    return tangents(pairs, np.maximum(overlaps(state, pairs), least))[0]


def strength(pairs: Pairs, N: Floats) -> Floats:
    """`mu N`, infinite where a closed contact never slides."""
    finite = np.isfinite(pairs.mu)
    return np.where(finite, np.where(finite, pairs.mu, 0.0) * N, np.inf)


def require_movable(graph: GrainGraph, law: object) -> LinearFrictional | HertzMindlin:
    """The law of equations of motion, checked as that of a path but for Hertz and Mindlin's."""
    if isinstance(law, HertzMindlin):
        require_carrying(graph)
        return law
    return require_replayable(graph, law)


def require_carrying(graph: GrainGraph) -> None:
    """Refuse graphs that are not one state with contacts."""
    require_one_state(graph)
    if not graph.contact_count:
        raise InputError("packing", "no contacts", "a packing that carries", "Compress it first.")


def require_replayable(graph: GrainGraph, law: object) -> LinearFrictional:
    """The law; refuse all but linear springs, and graphs that are not one state with contacts."""
    require_carrying(graph)
    if not isinstance(law, LinearFrictional):
        raise InputError(
            "law",
            type(law).__name__,
            "LinearFrictional: springs and a cone that are piecewise linear",
            "Give gl.LinearFrictional.",
        )
    state = contact_state(graph)
    closed = (graph.normal_force > 0) & (state.overlap > 0)
    hertz = HERTZ * (law.kn * state.overlap)[closed]
    as_hertz = np.abs(graph.normal_force[closed] - hertz) < HERTZ_BAND * hertz
    if np.count_nonzero(as_hertz) > MOSTLY * len(as_hertz):
        received = "normal forces of 2/3 of kn times the overlap, as Hertz's tangents give them"
        expected = "linear springs, of which N is kn times the overlap"
        raise InputError(
            "law", received, expected, "Give law='hertz' (--law hertz), or study rates."
        )
    return law


def contact_pairs(
    start: PackingState, law: LinearFrictional | HertzMindlin, planes: PlaneContacts | None = None
) -> Pairs:
    """The contacts of the start as pairs, those with walls last.

    Under Hertz's law walls have the stiffness over the root of the overlap that their forces tell,
    and the ratio of their `kt` to `kn`.
    """
    count, hertz = int(np.count_nonzero(~start.at_wall)), isinstance(law, HertzMindlin)
    if isinstance(law, HertzMindlin):
        radii = start.radii[start.contacts[:count]]
        kn = law.young / (1.0 - law.poisson**2) * np.sqrt(_effective_radii(radii))
        kt = law.stiffness_ratio * kn
    else:
        kn, kt = law.kn, law.kt
    numbers = [np.broadcast_to(k, count).astype(float) for k in (kn, kt, law.mu)]
    if len(start.walls) and planes is not None:
        mu = np.where(planes.kt > 0, np.inf, 0.0) if planes.mu is None else planes.mu
        kn, kt = planes.kn, planes.kt
        if hertz:
            foot = np.linalg.norm(planes.branch, axis=1)
            root = np.sqrt(np.maximum(start.radii[planes.grain] - foot, 0.0))
            carried = start.normal_force[count:]
            told = (root > 0) & (carried > 0)
            over = np.where(told, root, 1.0)
            own = np.where(told, carried / (HERTZ * over**3), kn)
            kn, kt = own, kt * own / kn
        numbers = [np.append(k, own) for k, own in zip(numbers, (kn, kt, mu), strict=True)]
    by_displacement = isinstance(law, HertzMindlin) and law.shear_history == "displacement"
    kn, kt, mu = numbers
    return Pairs(start.contacts, start.images, kn, kt, mu, hertz, by_displacement)


def law_of(
    law: LinearFrictional | HertzMindlin, pairs: Pairs, rows: Flags, state: PackingState
) -> LinearFrictional | HertzMindlin:
    """The law of the picked pairs between grains, of the same kind as the one given."""
    kn, kt, mu = (k[rows] for k in pairs[2:5])
    if isinstance(law, LinearFrictional):
        return LinearFrictional(kn, kt, mu, law.shear_increment)
    modulus = kn / np.sqrt(_effective_radii(state.radii[pairs.grains[rows]]))
    return HertzMindlin(modulus, 0.0, mu, law.shear_increment, law.shear_history, kt / kn)


def frame_of(state: PackingState, pairs: Pairs, by_radii: bool, reach: float = 0.0) -> NDArray[Any]:
    """Records `PAIR` (P,) of the pairs at the geometry and forces of a state.

    Springs that are not linear have their tangents, and those with an overlap below `reach`, which
    may open, `N` over the overlap: so they open where the grains part. Open ones have those at it.
    """
    frame = np.empty(len(pairs), dtype=PAIR)
    d = state.branches
    length = np.linalg.norm(d, axis=1)
    n = d / length[:, None]
    t = np.column_stack([-n[:, 1], n[:, 0]])
    radii = state.radii[pairs.grains]
    arms = 0.5 * (length[:, None] + radii - radii[:, ::-1])
    unit = state.mean_radius
    N, T = state.normal_force, state.shear_force
    frame["grains"], frame["d"], frame["n"], frame["t"] = pairs.grains, state.apart, n, t
    frame["turning"] = radii.sum(axis=1) / length if by_radii else 1.0
    frame["lever"] = (radii if by_radii else arms) / unit
    frame["arm"] = arms / unit
    frame["rotation"] = (N[:, None] * t - T[:, None] * n) / length[:, None]
    # A wall keeps its direction.
    frame["rotation"][state.at_wall] = 0.0
    frame["growth"] = 0.5 * T / unit
    frame["kn"], frame["kt"], frame["coupling"] = pairs.kn, pairs.kt, 0.0
    if pairs.hertz:
        overlap = radii.sum(axis=1) - length
        closed = overlap > 0
        at = np.where(closed, overlap, reach)
        kn, frame["kt"] = tangents(pairs, at)
        frame["kn"] = np.where(overlap > reach, kn, HERTZ * kn)
        if pairs.by_displacement:
            frame["coupling"] = np.where(closed, T / (2.0 * np.where(closed, overlap, 1.0)), 0.0)
    frame["slides"] = np.isfinite(pairs.mu)
    frame["mu"] = np.where(frame["slides"], pairs.mu, 0.0)
    return frame


def with_near(pairs: Pairs, state: PackingState, gap: float) -> Pairs:
    """The pairs, then all others closer than `gap`, with medians of the parameters.

    A wall is as stiff to other grains as to those that are known, over their radius if that varies
    less. Under Hertz's law stiffness goes with the root of the effective radius.
    """
    count, radii, walls = state.count, state.radii, state.walls
    grains, images = near_pairs(state.x[:count], state.cell, radii[:count], gap)
    if len(walls):
        away = np.sum((state.x[:count, None] - state.x[count:]) * walls, axis=2)
        grain, wall = np.nonzero(away < radii[:count, None] + gap)
        near = np.column_stack([grain, count + wall])
        grains = np.vstack([grains[~images.any(axis=1)], near])
        images = np.zeros_like(grains)
    # Compared in one order: the smaller grain first, of one grain the larger image.
    known = {tuple(row) for row in np.column_stack(_ordered(pairs.grains, pairs.images)).tolist()}
    rows = np.column_stack([grains, images]).tolist()
    new = np.array([tuple(row) not in known for row in rows], dtype=bool)
    grains, images = grains[new], images[new]
    one, other = np.ones(len(pairs)), np.ones(len(grains))
    if pairs.hertz:
        one, other = (np.sqrt(_effective_radii(radii[g])) for g in (pairs.grains, grains))
    numbers = []
    for k, old, fresh in ((pairs.kn, one, other), (pairs.kt, one, other), (pairs.mu, 1.0, 1.0)):
        k = k / old
        added = np.full(len(grains), np.median(k[pairs.grains[:, 1] < count]))
        for body in range(count, count + len(walls)):
            of, own = pairs.grains[:, 1] == body, grains[:, 1] == body
            added[own] = _as_known(k[of], radii[pairs.grains[of, 0]], radii[grains[own, 0]])
        numbers.append(np.append(k * old, added * fresh))
    kn, kt, mu = numbers
    every = np.concatenate([pairs.grains, grains]), np.concatenate([pairs.images, images])
    return Pairs(*every, kn, kt, mu, pairs.hertz, pairs.by_displacement, pairs.law)


def _effective_radii(radii: Floats) -> Floats:
    """(P,) `r_i r_j/(r_i + r_j)` of radii (P, 2); of the grain alone at a wall."""
    i, j = radii.T
    return np.asarray(np.where(j > 0, i * j / (i + j), i))


def _as_known(values: Floats, radii: Floats, others: Floats) -> Floats:
    """The mean of the values, or of the values over the radii where that varies less."""
    mean = float(values.mean())
    if not np.isfinite(mean):
        return np.full(len(others), mean)
    per_radius = values / radii
    if np.std(per_radius) * mean < np.std(values) * per_radius.mean():
        return np.asarray(per_radius.mean() * others)
    return np.full(len(others), mean)


def near_pairs(x: Floats, cell: Floats, radii: Floats, gap: float) -> tuple[Integers, Integers]:
    """Pairs (P, 2) whose surfaces are closer than `gap`, smaller grain first, and their images."""
    reach = 2.0 * float(radii.max()) + gap
    share = np.linalg.solve(cell, x.T).T
    home = np.floor(share).astype(np.int64)
    share = share - home
    # Images of grains are needed up to this distance from the cell, in shares of its sides.
    margin = reach * np.linalg.norm(np.linalg.inv(cell), axis=1)
    count = np.ceil(margin).astype(int)
    shifts = np.stack(
        np.meshgrid(*(np.arange(-m, m + 1) for m in count), indexing="ij"), axis=-1
    ).reshape(-1, 2)
    copies = share[None] + shifts[:, None]
    shift, j = np.nonzero(((copies > -margin) & (copies < 1 + margin)).all(axis=2))
    tree = cKDTree(copies[shift, j] @ cell.T)
    found = cKDTree(share @ cell.T).sparse_distance_matrix(tree, reach, output_type="coo_matrix")
    i, other = found.row.astype(np.int64), found.col
    second, image = j[other], shifts[shift[other]] + home[i] - home[j[other]]
    first = i < second
    own = (i == second) & ((image[:, 0] > 0) | ((image[:, 0] == 0) & (image[:, 1] > 0)))
    close = found.data < radii[i] + radii[second] + gap
    kept = (first | own) & close
    return np.column_stack([i, second])[kept], image[kept]


def _ordered(grains: Integers, images: Integers) -> tuple[Integers, Integers]:
    i, j = grains.T
    back = (images[:, 0] < 0) | ((images[:, 0] == 0) & (images[:, 1] < 0))
    flip = (i > j) | ((i == j) & back)
    return (
        np.where(flip[:, None], grains[:, ::-1], grains),
        np.where(flip[:, None], -images, images),
    )
