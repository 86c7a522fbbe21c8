"""Pairs of grains that touch or soon might, with the parameters of the law, and their frames."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from loops.arrays import Floats, Integers
from loops.errors import InputError
from loops.graph import GrainGraph, require_one_state
from loops.laws import LinearFrictional
from stability.packing.state import PackingState

# A pair at one geometry, as the kernels take it; all lengths but `d` are over the mean radius.
PAIR = np.dtype(
    [
        ("grains", "i8", 2),
        ("d", "f8", 2),  # branch vector
        ("n", "f8", 2),
        ("t", "f8", 2),
        ("turning", "f8"),  # the shear rate is `turning` times `t . d'`
        ("lever", "f8", 2),  # minus `lever` times the spins
        ("arm", "f8", 2),  # levers of the shear force
        ("rotation", "f8", 2),  # force rate per `t . d'`, as the pair rotates
        ("growth", "f8"),  # moment rate per `n . d'`, as the arms grow
        ("kn", "f8"),
        ("kt", "f8"),
        ("mu", "f8"),  # 0 where the strength is not finite
        ("slides", "i8"),  # whether the strength is finite
    ]
)


class Pairs(NamedTuple):
    """Pairs (P, 2) with the image of the second grain (P, 2), and `kn`, `kt`, `mu` (P,)."""

    grains: Integers
    images: Integers
    kn: Floats
    kt: Floats
    mu: Floats

    def __len__(self) -> int:
        return len(self.grains)


def touching_distances(state: PackingState, pairs: Pairs) -> Floats:
    """(P,) distances of the centres at first touch."""
    return np.asarray(state.radii[pairs.grains].sum(axis=1))


def strength(pairs: Pairs, N: Floats) -> Floats:
    """`mu N`, infinite where a closed contact never slides."""
    finite = np.isfinite(pairs.mu)
    return np.where(finite, np.where(finite, pairs.mu, 0.0) * N, np.inf)


def require_replayable(graph: GrainGraph, law: object) -> LinearFrictional:
    """The law; refuse all but `LinearFrictional`, and graphs that are not one periodic state."""
    require_one_state(graph)
    if not isinstance(law, LinearFrictional):
        raise InputError(
            "law",
            type(law).__name__,
            "LinearFrictional: springs and a cone that are piecewise linear",
            "Give gl.LinearFrictional.",
        )
    if graph.cell is None:
        raise InputError(
            "packing", "no cell", "a periodic packing", "Paths of samples with walls are missing."
        )
    if not graph.contact_count:
        raise InputError("packing", "no contacts", "a packing that carries", "Compress it first.")
    return law


def contact_pairs(graph: GrainGraph, law: LinearFrictional) -> Pairs:
    """The contacts of a graph as pairs."""
    assert graph.images is not None
    numbers = (np.broadcast_to(k, graph.contact_count) for k in (law.kn, law.kt, law.mu))
    return Pairs(graph.contacts, graph.images, *(np.array(k, dtype=float) for k in numbers))


def frame_of(state: PackingState, pairs: Pairs, by_radii: bool) -> NDArray[Any]:
    """Records `PAIR` (P,) of the pairs at the geometry and forces of a state."""
    frame = np.empty(len(pairs), dtype=PAIR)
    d = state.branches
    length = np.linalg.norm(d, axis=1)
    n = d / length[:, None]
    t = np.column_stack([-n[:, 1], n[:, 0]])
    radii = state.radii[pairs.grains]
    arms = 0.5 * (length[:, None] + radii - radii[:, ::-1])
    unit = float(state.radii.mean())
    N, T = state.normal_force, state.shear_force
    frame["grains"], frame["d"], frame["n"], frame["t"] = pairs.grains, d, n, t
    frame["turning"] = radii.sum(axis=1) / length if by_radii else 1.0
    frame["lever"] = (radii if by_radii else arms) / unit
    frame["arm"] = arms / unit
    frame["rotation"] = (N[:, None] * t - T[:, None] * n) / length[:, None]
    frame["growth"] = 0.5 * T / unit
    frame["kn"], frame["kt"] = pairs.kn, pairs.kt
    frame["slides"] = np.isfinite(pairs.mu)
    frame["mu"] = np.where(frame["slides"], pairs.mu, 0.0)
    return frame


def with_near(pairs: Pairs, x: Floats, cell: Floats, radii: Floats, gap: float) -> Pairs:
    """The pairs, then all others closer than `gap`, with medians of the parameters."""
    grains, images = near_pairs(x, cell, radii, gap)
    # Compared in one order: the smaller grain first, of one grain the larger image.
    known = {tuple(row) for row in np.column_stack(_ordered(pairs.grains, pairs.images)).tolist()}
    rows = np.column_stack([grains, images]).tolist()
    new = np.array([tuple(row) not in known for row in rows], dtype=bool)
    numbers = (
        np.append(k, np.full(np.count_nonzero(new), np.median(k)))
        for k in (pairs.kn, pairs.kt, pairs.mu)
    )
    return Pairs(
        np.concatenate([pairs.grains, grains[new]]),
        np.concatenate([pairs.images, images[new]]),
        *numbers,
    )


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
