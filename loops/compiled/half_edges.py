"""The half-edge that follows each one around its face: exact, one grain after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from loops.compiled.exact import UNDECIDED, turn
from loops.compiled.kernel import kernel

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]
Long = NDArray[np.int64]

FEW = 16  # grains with more contacts have them sorted by merging
CLOSE = 1e-13  # angles, as this module measures them, are right to a hundredth of it


@kernel
def following_half_edges(ends: Integers, degree: Integers, d: Floats) -> tuple[Integers, bool]:
    """Next half-edge clockwise from the way back, at the end of each half-edge.

    Parameters
    ----------
    ends : (E, 2) array of int32
        Contacts, none dangling.
    degree : (G,) array of int32
        Contacts of each grain.
    d : (E, 2) array
        Branch vectors.

    Returns
    -------
    following : (2 E,) array of int32
        A permutation of the half-edges.
    good : bool
        False if two branches of a grain have the same direction, or doubles cannot tell.
    """
    begin, edge, angle = _around_grains(ends, degree, d)
    following = np.empty(2 * len(ends), dtype=np.int32)
    largest = degree.max() if len(degree) else 0
    order, spare = np.empty(largest, dtype=np.int32), np.empty(largest, dtype=np.int32)
    good = True
    for g in range(len(degree)):
        first, n = begin[g], degree[g]
        if n > FEW or not _sort_by_angle(edge[first : first + n], angle[first : first + n], order):
            order[:n] = edge[first : first + n]
            good &= _sort_exactly(d, n, order, spare)
        for k in range(n):
            following[order[k] ^ 1] = order[k - 1 if k > 0 else n - 1]
    return following, good


@kernel
def _around_grains(
    ends: Integers, degree: Integers, d: Floats
) -> tuple[Integers, Integers, Floats]:
    """Half-edges by the grain that they leave, and an angle of each that grows with its own."""
    begin = np.empty(len(degree) + 1, dtype=np.int32)
    begin[0] = 0
    for g in range(len(degree)):
        begin[g + 1] = begin[g] + degree[g]
    at = begin.copy()
    edge, angle = np.empty(2 * len(ends), dtype=np.int32), np.empty(2 * len(ends))
    for c in range(len(ends)):
        dx, dy = d[c, 0], d[c, 1]
        cosine = dx / (abs(dx) + abs(dy))
        i, j = ends[c, 0], ends[c, 1]
        edge[at[i]], angle[at[i]] = 2 * c, 3.0 + cosine if dy < 0.0 else 1.0 - cosine
        at[i] += 1
        edge[at[j]], angle[at[j]] = 2 * c + 1, 3.0 - cosine if dy > 0.0 else 1.0 + cosine
        at[j] += 1
    return begin, edge, angle


@kernel
def _sort_by_angle(edge: Integers, angle: Floats, order: Integers) -> bool:
    """Half-edges by counting the smaller angles; False if two angles are too close to tell."""
    apart = True
    for k in range(len(edge)):
        rank = 0
        for other in range(len(edge)):
            rank += angle[other] < angle[k]
            apart &= (other == k) | (abs(angle[other] - angle[k]) > CLOSE)
        order[rank] = edge[k]
    # Just below a whole turn is next to nothing: the two are adjacent all the same.
    return apart


@kernel
def _sort_exactly(d: Floats, n: int, order: Integers, spare: Integers) -> bool:
    """Sort n half-edges by direction, merging; False if two are alike or cannot be told apart."""
    good, run = True, 1
    while run < n:
        for start in range(0, n, 2 * run):
            middle, end = min(start + run, n), min(start + 2 * run, n)
            spare[start:end] = order[start:end]
            a, b = start, middle
            for k in range(start, end):
                second = a == middle
                if a < middle and b < end:
                    before = _before(d, spare[b], spare[a])
                    good &= before != UNDECIDED and before != 0
                    second = before == 1
                if second:
                    order[k] = spare[b]
                    b += 1
                else:
                    order[k] = spare[a]
                    a += 1
        run *= 2
    return good


@kernel
def _before(d: Floats, a: int, b: int) -> int:
    """1 if half-edge a comes before b, counter-clockwise from axis 1; -1 after; 0 the same way."""
    sign_a, sign_b = 1 - 2 * (a & 1), 1 - 2 * (b & 1)
    ax, ay = sign_a * d[a >> 1, 0], sign_a * d[a >> 1, 1]
    bx, by = sign_b * d[b >> 1, 0], sign_b * d[b >> 1, 1]
    below_a, below_b = ay < 0.0 or (ay == 0.0 and ax < 0.0), by < 0.0 or (by == 0.0 and bx < 0.0)
    if below_a != below_b:
        return 1 if below_b else -1
    return turn(ax, ay, bx, by)
