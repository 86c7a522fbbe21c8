"""Kernels of crossing branches: pairs that meet in a bin of a grid.

Grains and contacts are numbered along space, as in `loops.compiled.network`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Floats, Integers
from loops.compiled import inlined, kernel

Short = NDArray[np.int32]
MARGIN = 1e-9  # of a bin: a branch this close to a bin counts as passing it
ROUNDING = 8 * float(np.finfo(np.float64).eps)
FARTHEST = 2**14  # cells that a branch may pass
# Bins are too crowded beyond so many comparisons per contact, and a hundred thousand.
MOST_COMPARISONS = 100


@kernel
def crossing_pairs(
    grain: Short,
    number: Short,
    ends: Short,
    u: Floats,
    home: Integers,
    images: Integers,
    counts: Integers,
    limit: int,
) -> tuple[int, Integers]:
    """Pairs of contacts whose branches meet, other than in a common grain.

    `grain`, `number`, `ends` are those of a `LocalNetwork`; `u` (G, 2) the centres in the unit
    square of the cell or bounding box, `home` (G, 2), no row in the plane, the cells they were
    brought in from, `counts` the columns and rows of bins. Status 0 when every pair was compared;
    1 when stopped at `limit` pairs; -1 when none was, since too many branches share a bin, or one
    passes too many cells. A pair that meets in several bins is listed as often.
    """
    start, vector, reach = _branches(grain, number, ends, u, home, images)
    pairs = np.empty((min(limit, 1024), 2), dtype=np.int64)
    if len(home) and np.abs(reach).max() > FARTHEST:
        return -1, pairs[:0]
    begin, contact, shift = _pieces(start, vector, counts, len(home) > 0)
    largest, work = 0, 0
    for b in range(len(begin) - 1):
        size = begin[b + 1] - begin[b]
        largest = max(largest, size)
        work += size * size
    if work > MOST_COMPARISONS * (len(ends) + 1000):
        return -1, pairs[:0]
    # Branches of the current bin: start, vector, and one number for the grain at either end.
    x0, y0, dx, dy = np.empty(largest), np.empty(largest), np.empty(largest), np.empty(largest)
    tail, head = np.empty(largest, dtype=np.int64), np.empty(largest, dtype=np.int64)
    found = 0
    for b in range(len(begin) - 1):
        first = begin[b]
        for k in range(begin[b + 1] - first):
            c, p, q = contact[first + k], 0, 0
            if len(shift):
                p, q = shift[first + k, 0], shift[first + k, 1]
            ax, ay, adx, ady = start[c, 0] - p, start[c, 1] - q, vector[c, 0], vector[c, 1]
            a_tail = _place(ends[c, 0], -p, -q)
            a_head = _place(ends[c, 1], reach[c, 0] - p, reach[c, 1] - q)
            x0[k], y0[k], dx[k], dy[k], tail[k], head[k] = ax, ay, adx, ady, a_tail, a_head
            for other in range(k):
                bdx, bdy = dx[other], dy[other]
                same_side = (a_tail == tail[other]) | (a_head == head[other])
                end_to_start = (a_tail == head[other]) | (a_head == tail[other])
                if same_side | end_to_start:
                    # They overlap if both leave the common grain in the same direction.
                    size, along = abs(adx) + abs(ady) + abs(bdx) + abs(bdy), adx * bdx + ady * bdy
                    if abs(adx * bdy - ady * bdx) > ROUNDING * size or not (
                        (same_side and along > 0.0) or (end_to_start and along < 0.0)
                    ):
                        continue
                elif not _meet(ax, ay, adx, ady, x0[other], y0[other], bdx, bdy):
                    continue
                if found == len(pairs):
                    pairs = np.concatenate((pairs, np.empty_like(pairs)))
                one, two = number[c], number[contact[first + other]]
                pairs[found, 0], pairs[found, 1] = min(one, two), max(one, two)
                found += 1
                if found == limit:
                    return 1, pairs[:found]
    return 0, pairs[:found]


@kernel
def _branches(
    grain: Short, number: Short, ends: Short, u: Floats, home: Integers, images: Integers
) -> tuple[Floats, Floats, Short]:
    """Start, vector and cell of the end of every local contact."""
    count = len(ends)
    start, vector = np.empty((count, 2)), np.empty((count, 2))
    reach = np.zeros((count, 2), dtype=np.int32)
    for c in range(count):
        i, j = grain[ends[c, 0]], grain[ends[c, 1]]
        for a in range(2):
            if len(home):
                reach[c, a] = home[j, a] + images[number[c], a] - home[i, a]
            start[c, a] = u[i, a]
            vector[c, a] = u[j, a] - u[i, a] + reach[c, a]
    return start, vector, reach


@kernel
def _pieces(
    start: Floats, vector: Floats, counts: Integers, periodic: bool
) -> tuple[Short, Short, Short]:
    """Branches of each bin: begin of each bin, contacts, periodic images of the bin.

    Without a cell the images have no rows.
    """
    columns, rows = counts[0], counts[1]
    room, found = 3 * len(start) + 16, 0
    where, which = np.empty(room, dtype=np.int32), np.empty(room, dtype=np.int32)
    cell = np.empty((room if periodic else 0, 2), dtype=np.int32)
    begin = np.zeros(columns * rows + 1, dtype=np.int32)
    for c in range(len(start)):
        x, dx = start[c, 0] * columns, vector[c, 0] * columns
        y, dy = start[c, 1] * rows, vector[c, 1] * rows
        low, high = _span(x, x + dx)
        for column in range(low, high + 1):
            enter, leave = 0.0, 1.0
            if high > low and dx != 0.0:
                enter = min(max((column + (1 if dx < 0.0 else 0) - x) / dx, 0.0), 1.0)
                leave = min(max((column + (1 if dx >= 0.0 else 0) - x) / dx, 0.0), 1.0)
            bottom, top = _span(y + enter * dy, y + leave * dy)
            for row in range(bottom, top + 1):
                if found == room:
                    where, which = _doubled(where), _doubled(which)
                    cell = np.concatenate((cell, np.empty_like(cell)))
                    room *= 2
                p, q = 0, 0
                if periodic:
                    p, q = column // columns, row // rows
                    cell[found, 0], cell[found, 1] = p, q
                where[found] = (row - q * rows) * columns + column - p * columns
                which[found] = c
                begin[where[found] + 1] += 1
                found += 1
    for b in range(len(begin) - 1):
        begin[b + 1] += begin[b]
    contact = np.empty(found, dtype=np.int32)
    shift = np.empty((found if periodic else 0, 2), dtype=np.int32)
    at = begin.copy()
    for k in range(found):
        place = at[where[k]]
        at[where[k]] += 1
        contact[place] = which[k]
        if periodic:
            shift[place, 0], shift[place, 1] = cell[k, 0], cell[k, 1]
    return begin, contact, shift


@kernel
def _doubled(values: Short) -> Short:
    return np.concatenate((values, np.empty_like(values)))


@inlined
def _span(a: float, b: float) -> tuple[int, int]:
    """First and last unit interval between two values, with a margin for round-off."""
    margin = MARGIN + ROUNDING * max(abs(a), abs(b))
    return math.floor(min(a, b) - margin), math.floor(max(a, b) + margin)


@inlined
def _place(grain: int, p: int, q: int) -> int:
    """One number for a grain and its cell."""
    return (grain << 32) + (p << 16) + q


@inlined
def _meet(
    ax: float, ay: float, adx: float, ady: float, bx: float, by: float, bdx: float, bdy: float
) -> bool:
    """Whether two branches without a common grain have a point in common."""
    ahead_x, ahead_y = bx - ax, by - ay
    turn = adx * bdy - ady * bdx
    # Each branch's ends lie on either side of the other's line, or on it.
    if not _straddle(adx * ahead_y - ady * ahead_x, turn, abs(adx) + abs(ady)):
        return False
    if not _straddle(ahead_x * bdy - ahead_y * bdx, -turn, abs(bdx) + abs(bdy)):
        return False
    low_x = max(min(adx, 0.0), ahead_x + min(bdx, 0.0))
    low_y = max(min(ady, 0.0), ahead_y + min(bdy, 0.0))
    high_x = min(max(adx, 0.0), ahead_x + max(bdx, 0.0))
    high_y = min(max(ady, 0.0), ahead_y + max(bdy, 0.0))
    return low_x <= high_x + ROUNDING and low_y <= high_y + ROUNDING


@kernel
def _straddle(side: float, change: float, size: float) -> bool:
    other = side + change
    return min(side, other) <= ROUNDING * size and max(side, other) >= -ROUNDING * size
