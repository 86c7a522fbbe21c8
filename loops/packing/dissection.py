"""Nested dissection of a packing: an elimination tree whose fronts are dense matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Floats, Integers

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

    Separators are the grains on one side of a straight cut that have a neighbour on the other.
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
        across = edges[ends[:, 0] != ends[:, 1]].ravel()
        border = [np.unique(across[side[across] == s]) for s in (1, 2)]
        side[border[int(len(border[1]) < len(border[0]))]] = 3
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
