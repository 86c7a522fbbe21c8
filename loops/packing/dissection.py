"""Nested dissection of a packing: an elimination tree whose fronts are dense matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import maximum_bipartite_matching

from loops.arrays import Flags, Floats, Integers

# Grains of a leaf: small fronts cost calls, large ones arithmetic.
LEAF = 32


@dataclass(frozen=True, eq=False)
class Front:
    """Grains that a front eliminates, those that it leaves to its ancestors, and its children."""

    own: Integers
    rest: Integers
    children: tuple[int, ...]


def dissection(x: Floats, edges: Integers) -> list[Front]:
    """Fronts of the graph of `edges` (E, 2) on grains at `x` (G, 2), children before parents.

    A separator is the smallest set of grains that touches every edge across a straight cut.
    """
    own: list[Integers] = []
    children: list[tuple[int, ...]] = []

    def cut(grains: Integers, edges: Integers) -> int | None:
        if len(grains) == 0:
            return None
        if len(grains) <= LEAF:
            return place(grains, ())
        along = x[grains, int(np.argmax(np.ptp(x[grains], axis=0)))]
        side = np.zeros(len(x), dtype=np.int8)
        half = np.argsort(along, kind="stable")
        side[grains[half[: len(half) // 2]]] = 1
        side[grains[half[len(half) // 2 :]]] = 2
        ends = side[edges]
        across = edges[ends[:, 0] != ends[:, 1]]
        first = side[across[:, 0]] == 1
        side[_vertex_cover(np.where(first[:, None], across, across[:, ::-1]))] = 3
        ends = side[edges]
        inside = [edges[(ends == s).all(axis=1)] for s in (1, 2)]
        below = [
            cut(grains[side[grains] == s], part) for s, part in zip((1, 2), inside, strict=True)
        ]
        return place(grains[side[grains] == 3], tuple(k for k in below if k is not None))

    def place(grains: Integers, below: tuple[int, ...]) -> int:
        own.append(grains)
        children.append(below)
        return len(own) - 1

    cut(np.arange(len(x)), edges)
    return _with_rests(own, children, edges, len(x))


def _vertex_cover(edges: Integers) -> Integers:
    """Smallest set of vertices that touches all `edges` (E, 2) from one side to the other.

    By König's theorem from a maximum matching: vertices of the first side that no alternating path
    from an unmatched one reaches, and vertices of the second side that one reaches.
    """
    (left, i), (right, j) = (np.unique(ends, return_inverse=True) for ends in edges.T)
    graph = sparse.csr_array((np.ones(len(edges), dtype=np.int8), (i, j)), (len(left), len(right)))
    partner = np.asarray(maximum_bipartite_matching(graph, perm_type="column"), dtype=np.int64)
    back = np.full(len(right), -1)
    back[partner[partner >= 0]] = np.flatnonzero(partner >= 0)
    reached_left, reached_right = partner < 0, np.zeros(len(right), dtype=bool)
    new: Flags = reached_left
    while new.any():
        reached = (graph.T @ new.astype(np.int64) > 0) & ~reached_right
        reached_right |= reached
        # Every vertex that is reached is matched: else the matching could grow.
        new = np.zeros(len(left), dtype=bool)
        new[back[reached]] = True
        reached_left |= new
    return np.concatenate([left[~reached_left], right[reached_right]])


def _with_rests(
    own: list[Integers], children: list[tuple[int, ...]], edges: Integers, count: int
) -> list[Front]:
    """What each front leaves: later neighbours of its own grains, and of its children's."""
    turn = np.empty(count, dtype=np.int64)
    for k, grains in enumerate(own):
        turn[grains] = k
    pairs = np.concatenate([edges, edges[:, ::-1]])
    pairs = pairs[turn[pairs[:, 0]] < turn[pairs[:, 1]]]
    pairs = pairs[np.argsort(turn[pairs[:, 0]], kind="stable")]
    start = np.searchsorted(turn[pairs[:, 0]], np.arange(len(own) + 1))
    fronts: list[Front] = []
    for k, grains in enumerate(own):
        later = [pairs[start[k] : start[k + 1], 1]]
        later += [fronts[c].rest[turn[fronts[c].rest] > k] for c in children[k]]
        fronts.append(Front(grains, np.unique(np.concatenate(later)), children[k]))
    return fronts
