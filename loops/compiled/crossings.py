"""Branches that cross, bin by bin of a grid over the packing."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from loops.compiled.kernel import kernel
from loops.compiled.local_network import local_network

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]
Long = NDArray[np.int64]

MARGIN = 1e-9  # of a bin: a branch this close to a bin counts as passing it
ROUND_OFF = 8 * float(np.finfo(np.float64).eps)
FARTHEST = 2**14  # cells that a branch may pass
WORK = 100  # comparisons per contact, and a hundred thousand, beyond which bins are too crowded


@kernel
def crossing_pairs(
    x: Floats, u: Floats, home: Long, contacts: Long, images: Long, counts: Long, limit: int
) -> tuple[int, Long]:
    """Pairs of contacts whose branches meet elsewhere than in a common grain.

    Parameters
    ----------
    x : (G, 2) array
        Centres, to bring neighbours together in memory.
    u : (G, 2) array
        Centres in coordinates of the cell or bounding box, in the unit square.
    home : (G, 2) or (0, 2) array of int
        Cell that each centre was brought in from; no row in the plane.
    contacts : (C, 2) array of int
        Contacts.
    images : (C, 2) or (0, 2) array of int
        Their periodic images.
    counts : (2,) array of int
        Columns and rows of bins.
    limit : int
        The search stops once it has found so many, repeats included.

    Returns
    -------
    status : int
        0 when every pair was looked at, 1 when stopped at the limit, -1 when nothing was looked
        at since too many branches share a bin, or one passes too many cells.
    pairs : (M, 2) array of int
        Pairs of contacts; one that meets in several bins is there as many times.
    """
    network = local_network(x, contacts)
    start, vector, reach = _branches(network.grain, network.contact, network.ends, u, home, images)
    pairs = np.empty((min(limit, 1024), 2), dtype=np.int64)
    if np.abs(reach).max() > FARTHEST:
        return -1, pairs[:0]
    begin, contact, shift = _pieces(start, vector, counts)
    largest, work = 0, 0
    for b in range(len(begin) - 1):
        size = begin[b + 1] - begin[b]
        largest = max(largest, size)
        work += size * size
    if work > WORK * (len(contacts) + 1000):
        return -1, pairs[:0]
    segment, tag = np.empty((largest, 4)), np.empty((largest, 2), dtype=np.int64)
    found = 0
    for b in range(len(begin) - 1):
        size = begin[b + 1] - begin[b]
        for k in range(size):
            c, p, q = contact[begin[b] + k], shift[begin[b] + k, 0], shift[begin[b] + k, 1]
            segment[k, 0], segment[k, 1] = start[c, 0] - p, start[c, 1] - q
            segment[k, 2], segment[k, 3] = vector[c, 0], vector[c, 1]
            tag[k, 0] = _place(network.ends[c, 0], -p, -q)
            tag[k, 1] = _place(network.ends[c, 1], reach[c, 0] - p, reach[c, 1] - q)
            for other in range(k):
                if not _meet(segment[k], segment[other], tag[k], tag[other]):
                    continue
                if found == len(pairs):
                    pairs = np.concatenate((pairs, np.empty_like(pairs)))
                one = network.contact[c]
                two = network.contact[contact[begin[b] + other]]
                pairs[found, 0], pairs[found, 1] = min(one, two), max(one, two)
                found += 1
                if found == limit:
                    return 1, pairs[:found]
    return 0, pairs[:found]


@kernel
def _branches(
    grain: Integers, number: Integers, ends: Integers, u: Floats, home: Long, images: Long
) -> tuple[Floats, Floats, Integers]:
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
def _pieces(start: Floats, vector: Floats, counts: Long) -> tuple[Long, Integers, Integers]:
    """Branches that pass each bin: where they begin, which they are, images of the bin passed."""
    bins = counts[0] * counts[1]
    begin = np.zeros(bins + 2, dtype=np.int64)
    contact, shift = np.empty(0, dtype=np.int32), np.empty((0, 2), dtype=np.int32)
    # Counted first, then put in place: `begin` is ahead by one bin until the second pass is over.
    for fill in range(2):
        for c in range(len(start)):
            x, dx = start[c, 0] * counts[0], vector[c, 0] * counts[0]
            y, dy = start[c, 1] * counts[1], vector[c, 1] * counts[1]
            low, high = _span(x, x + dx)
            for column in range(low, high + 1):
                enter, leave = 0.0, 1.0
                if dx != 0.0:
                    enter = min(max((column + (1 if dx < 0.0 else 0) - x) / dx, 0.0), 1.0)
                    leave = min(max((column + (1 if dx >= 0.0 else 0) - x) / dx, 0.0), 1.0)
                bottom, top = _span(y + enter * dy, y + leave * dy)
                for row in range(bottom, top + 1):
                    p, q = column // counts[0], row // counts[1]
                    b = (row - q * counts[1]) * counts[0] + column - p * counts[0]
                    if fill == 1:
                        at = begin[b + 1]
                        contact[at] = c
                        shift[at, 0], shift[at, 1] = p, q
                        begin[b + 1] += 1
                    else:
                        begin[b + 2] += 1
        if fill == 0:
            for b in range(bins):
                begin[b + 2] += begin[b + 1]
            contact = np.empty(begin[bins + 1], dtype=np.int32)
            shift = np.empty((begin[bins + 1], 2), dtype=np.int32)
    return begin[: bins + 1], contact, shift


@kernel
def _span(a: float, b: float) -> tuple[int, int]:
    """First and last unit interval between two values, with a margin for round-off."""
    margin = MARGIN + ROUND_OFF * max(abs(a), abs(b))
    return math.floor(min(a, b) - margin), math.floor(max(a, b) + margin)


@kernel
def _place(grain: int, p: int, q: int) -> int:
    """One number for a grain and its cell."""
    return (grain << 32) + (p << 16) + q


@kernel
def _meet(a: Floats, b: Floats, a_ends: Long, b_ends: Long) -> bool:
    """Whether two branches have a point in common that is no common grain."""
    turn = a[2] * b[3] - a[3] * b[2]
    size_a, size_b = abs(a[2]) + abs(a[3]), abs(b[2]) + abs(b[3])
    same_side = (a_ends[0] == b_ends[0]) | (a_ends[1] == b_ends[1])
    end_to_start = (a_ends[0] == b_ends[1]) | (a_ends[1] == b_ends[0])
    if same_side | end_to_start:
        if abs(turn) > ROUND_OFF * (size_a + size_b):
            return False
        # Along a line they overlap if they leave the common grain the same way.
        along = a[2] * b[2] + a[3] * b[3]
        return (same_side and along > 0.0) or (end_to_start and along < 0.0)
    ahead_x, ahead_y = b[0] - a[0], b[1] - a[1]
    # Each branch's ends lie on either side of the other's line, or on it.
    if not _straddle(a[2] * ahead_y - a[3] * ahead_x, turn, size_a):
        return False
    if not _straddle(ahead_x * b[3] - ahead_y * b[2], -turn, size_b):
        return False
    low_x = max(min(a[2], 0.0), ahead_x + min(b[2], 0.0))
    low_y = max(min(a[3], 0.0), ahead_y + min(b[3], 0.0))
    high_x = min(max(a[2], 0.0), ahead_x + max(b[2], 0.0))
    high_y = min(max(a[3], 0.0), ahead_y + max(b[3], 0.0))
    return low_x <= high_x + ROUND_OFF and low_y <= high_y + ROUND_OFF


@kernel
def _straddle(side: float, change: float, size: float) -> bool:
    other = side + change
    return min(side, other) <= ROUND_OFF * size and max(side, other) >= -ROUND_OFF * size
