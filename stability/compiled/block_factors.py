"""Factors `L U` of a sparse matrix of blocks 3 x 3, one for each pair of bodies that touch.

Bodies are numbered in the order of elimination. The pattern is symmetric, the matrix is not: below
the diagonal column k of `L` has blocks `lower` in the `rows` from `begin[k]` on, and row k of `U`
blocks `upper` in the same columns. Pivots are whole blocks, without exchanges between bodies.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from loops.arrays import Floats, Integers
from loops.compiled import inlined, kernel

# Right-hand sides that are solved at once.
LANES = 4
# Products and sums in one instruction, rounded once.
fused = partial(kernel, fastmath={"contract"})


@kernel
def structure(ends: Integers, place: Integers) -> tuple[Integers, Integers]:
    """Begin of each column (B + 1,) and sorted rows of the blocks below the diagonal of `L`.

    `ends` (P, 2) are bodies that touch, `place` (B,) their numbers in the order of elimination.
    """
    bodies = len(place)
    start = np.zeros(bodies + 1, dtype=np.int64)
    for p in range(len(ends)):
        start[min(place[ends[p, 0]], place[ends[p, 1]]) + 1] += 1
    for k in range(bodies):
        start[k + 1] += start[k]
    later, at = np.empty(len(ends), dtype=np.int64), start.copy()
    for p in range(len(ends)):
        i, j = place[ends[p, 0]], place[ends[p, 1]]
        low = min(i, j)
        later[at[low]] = max(i, j)
        at[low] += 1
    begin, rows = np.zeros(bodies + 1, dtype=np.int64), np.empty(8 * bodies, dtype=np.int64)
    met = np.full(bodies, -1)
    # Columns whose first row is k: the first of them, then the next of each.
    child, sibling = np.full(bodies, -1), np.full(bodies, -1)
    for k in range(bodies):
        first = end = begin[k]
        met[k] = k
        if end + bodies > len(rows):
            longer = np.empty(2 * len(rows) + bodies, dtype=np.int64)
            for q in range(end):
                longer[q] = rows[q]
            rows = longer
        for q in range(start[k], start[k + 1]):
            if met[later[q]] != k:
                met[later[q]] = k
                rows[end] = later[q]
                end += 1
        c = child[k]
        while c >= 0:
            for q in range(begin[c], begin[c + 1]):
                if met[rows[q]] != k:
                    met[rows[q]] = k
                    rows[end] = rows[q]
                    end += 1
            c = sibling[c]
        for q in range(first + 1, end):
            row, to = rows[q], q
            while to > first and rows[to - 1] > row:
                rows[to] = rows[to - 1]
                to -= 1
            rows[to] = row
        begin[k + 1] = end
        if end > first:
            sibling[k] = child[rows[first]]
            child[rows[first]] = k
    return begin, rows[: begin[bodies]]


@kernel
def _factorise(D: Floats, swap: Integers) -> bool:
    """`L U` in place of a block with its rows in the order `swap`; False if it is singular.

    On the diagonal stand the reciprocals of U's. An inverse would square the block's condition.
    """
    for c in range(3):
        swap[c] = c
    for c in range(3):
        best = c
        for i in range(c + 1, 3):
            if abs(D[i, c]) > abs(D[best, c]):
                best = i
        if not abs(D[best, c]) > 0.0:
            return False
        swap[c], swap[best] = swap[best], swap[c]
        for k in range(3):
            D[c, k], D[best, k] = D[best, k], D[c, k]
        D[c, c] = 1.0 / D[c, c]
        for i in range(c + 1, 3):
            D[i, c] *= D[c, c]
            for k in range(c + 1, 3):
                D[i, k] -= D[i, c] * D[c, k]
    return True


@inlined
def _entries(x: Floats, q: int) -> tuple[float, ...]:
    """The nine entries of a block, read at once."""
    return (
        x[q, 0, 0], x[q, 0, 1], x[q, 0, 2],
        x[q, 1, 0], x[q, 1, 1], x[q, 1, 2],
        x[q, 2, 0], x[q, 2, 1], x[q, 2, 2],
    )  # fmt: skip


@fused
def eliminate(
    begin: Integers, rows: Integers, lower: Floats, upper: Floats, pivot: Floats, swap: Integers
) -> bool:
    """The factors in place of the blocks, with rows of pivots in the order `swap` (B, 3).

    False if one of them is singular.

    Column by column: a list leads from each to the columns before with a block in its row.
    """
    bodies = len(pivot)
    first, following, at = np.full(bodies, -1), np.full(bodies, -1), begin.copy()
    below, right = np.empty((2, bodies, 3, 3))
    for k in range(bodies):
        for q in range(begin[k], begin[k + 1]):
            for a in range(3):
                for b in range(3):
                    below[rows[q], a, b] = lower[q, a, b]
                    right[rows[q], a, b] = upper[q, a, b]
        D, c = pivot[k], first[k]
        while c >= 0:
            after, p = following[c], at[c]
            low, u = _entries(lower, p), _entries(upper, p)
            for a in range(3):
                d, e, f = low[3 * a], low[3 * a + 1], low[3 * a + 2]
                for b in range(3):
                    D[a, b] -= d * u[b] + e * u[3 + b] + f * u[6 + b]
            for q in range(p + 1, begin[c + 1]):
                i, v, w = rows[q], _entries(lower, q), _entries(upper, q)
                for a in range(3):
                    d, e, f = 3 * a, 3 * a + 1, 3 * a + 2
                    for b in range(3):
                        below[i, a, b] -= v[d] * u[b] + v[e] * u[3 + b] + v[f] * u[6 + b]
                        right[i, a, b] -= low[d] * w[b] + low[e] * w[3 + b] + low[f] * w[6 + b]
            at[c] = p + 1
            if p + 1 < begin[c + 1]:
                following[c], first[rows[p + 1]] = first[rows[p + 1]], c
            c = after
        if not _factorise(D, swap[k]):
            return False
        for q in range(begin[k], begin[k + 1]):
            i = rows[q]
            for a in range(3):
                y0 = below[i, a, 0] * D[0, 0]
                y1 = (below[i, a, 1] - y0 * D[0, 1]) * D[1, 1]
                y2 = (below[i, a, 2] - y0 * D[0, 2] - y1 * D[1, 2]) * D[2, 2]
                y1 -= y2 * D[2, 1]
                lower[q, a, swap[k, 0]] = y0 - y1 * D[1, 0] - y2 * D[2, 0]
                lower[q, a, swap[k, 1]], lower[q, a, swap[k, 2]] = y1, y2
                for b in range(3):
                    upper[q, a, b] = right[i, a, b]
        if begin[k] < begin[k + 1]:
            following[k], first[rows[begin[k]]] = first[rows[begin[k]]], k
    return True


@fused
def solve(
    begin: Integers,
    rows: Integers,
    lower: Floats,
    upper: Floats,
    pivot: Floats,
    swap: Integers,
    into: Integers,
    x: Floats,
    start: int,
    out: Floats,
) -> None:
    """Motions `out` (k, 3 B) under loads `x` (3 B, m), which are overwritten.

    Loads are zero before row `start` and numbered by the order of elimination, in which freedom f
    of the motions is row `into[f]`.
    """
    if x.shape[1] % LANES or x.shape[1] < len(out):
        raise ValueError("right-hand sides by LANES")
    bodies, left = len(pivot), np.empty((3, LANES))
    for e in range(0, len(out), LANES):
        for k in range(start // 3, bodies):
            j = 3 * k
            s = x[j, e], x[j, e + 1], x[j, e + 2], x[j, e + 3]
            t = x[j + 1, e], x[j + 1, e + 1], x[j + 1, e + 2], x[j + 1, e + 3]
            u = x[j + 2, e], x[j + 2, e + 1], x[j + 2, e + 2], x[j + 2, e + 3]
            for q in range(begin[k], begin[k + 1]):
                for a in range(3):
                    l0, l1, l2 = lower[q, a, 0], lower[q, a, 1], lower[q, a, 2]
                    for r in range(LANES):
                        x[3 * rows[q] + a, e + r] -= l0 * s[r] + l1 * t[r] + l2 * u[r]
        for k in range(bodies - 1, -1, -1):
            for a in range(3):
                for r in range(LANES):
                    left[a, r] = x[3 * k + a, e + r]
            for q in range(begin[k], begin[k + 1]):
                j = 3 * rows[q]
                s = x[j, e], x[j, e + 1], x[j, e + 2], x[j, e + 3]
                t = x[j + 1, e], x[j + 1, e + 1], x[j + 1, e + 2], x[j + 1, e + 3]
                u = x[j + 2, e], x[j + 2, e + 1], x[j + 2, e + 2], x[j + 2, e + 3]
                for a in range(3):
                    u0, u1, u2 = upper[q, a, 0], upper[q, a, 1], upper[q, a, 2]
                    for r in range(LANES):
                        left[a, r] -= u0 * s[r] + u1 * t[r] + u2 * u[r]
            D, i, j, m = pivot[k], swap[k, 0], swap[k, 1], swap[k, 2]
            for r in range(LANES):
                y0 = left[i, r]
                y1 = left[j, r] - D[1, 0] * y0
                y2 = (left[m, r] - D[2, 0] * y0 - D[2, 1] * y1) * D[2, 2]
                y1 = (y1 - D[1, 2] * y2) * D[1, 1]
                y0 = (y0 - D[0, 1] * y1 - D[0, 2] * y2) * D[0, 0]
                x[3 * k, e + r], x[3 * k + 1, e + r], x[3 * k + 2, e + r] = y0, y1, y2
    for r in range(len(out)):
        for f in range(len(into)):
            out[r, f] = x[into[f], r]
