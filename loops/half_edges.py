"""Half-edges of a plane graph: their order around each grain, and the cycles they form.

Contact k of the list at hand is the half-edges 2k (from i to j) and 2k + 1 (back).
"""

from __future__ import annotations

from fractions import Fraction
from functools import cmp_to_key
from itertools import pairwise

import numpy as np

from loops.arrays import Floats, Integers
from loops.errors import InputError
from loops.graph import GrainGraph

BLOCK = 2**16  # half-edges measured at a time
ANGLE_STEPS = 2**30 - 1  # a quarter turn in the key; a whole one stays below 2^32
SHORT_CYCLE = 64  # longer cycles are few: they are ranked by doubling instead of walked


def next_half_edge(
    grains: int, contacts: Integers, numbers: Integers, branches: Floats
) -> Integers:
    """The half-edge that follows each one around the face on its left."""
    origin = contacts.ravel()
    order = _around_grains(origin, branches, numbers)
    degree = np.bincount(origin, minlength=grains)
    end = np.cumsum(degree)[degree > 0]
    begin = end - degree[degree > 0]
    clockwise = np.empty_like(order)
    clockwise[order[1:]] = order[:-1]
    clockwise[order[begin]] = order[end - 1]
    # At its end, half-edge h turns clockwise from its own way back, h ^ 1.
    return clockwise.reshape(-1, 2)[:, ::-1].ravel()


def _around_grains(origin: Integers, branches: Floats, numbers: Integers) -> Integers:
    """Half-edges sorted by origin, then counter-clockwise by direction from axis 1."""
    key = ((origin.reshape(-1, 2) << 32) | _quantised_angles(branches)).ravel()
    # Stable means timsort for integers: twice as fast where grains are numbered along space.
    order = np.argsort(key, kind="stable")
    sorted_key = key[order]
    # Rounding can put two directions in the wrong order only if their keys differ by at most 1.
    close = np.flatnonzero(np.diff(sorted_key) <= 1)
    if close.size:
        for run in np.split(close, np.flatnonzero(np.diff(close) > 1) + 1):
            tied = slice(run[0], run[-1] + 2)
            order[tied] = _sorted_exactly(order[tied], branches, origin, numbers)
    return order


def _quantised_angles(branches: Floats) -> Integers:
    """(E, 2) angle of both half-edges of each contact, monotone in [0, 2^32)."""
    dx, dy = branches.T
    cosine = dx / (np.abs(dx) + np.abs(dy))
    there = np.where(dy < 0, 3 + cosine, 1 - cosine)
    back = np.where(dy > 0, 3 - cosine, 1 + cosine)
    return (np.column_stack([there, back]) * ANGLE_STEPS).astype(np.int64)


def _sorted_exactly(
    tied: Integers, branches: Floats, origin: Integers, numbers: Integers
) -> list[int]:
    """Sort half-edges of one grain that point the same way to 30 bits, by exact arithmetic."""

    def direction(half_edge: int) -> tuple[Fraction, Fraction]:
        x, y = branches[half_edge >> 1].tolist()
        sign = -1 if half_edge & 1 else 1
        return Fraction(x) * sign, Fraction(y) * sign

    def compare(a: int, b: int) -> int:
        (ax, ay), (bx, by) = direction(a), direction(b)
        turn = ax * by - ay * bx
        if turn == 0:
            first, second = sorted(int(numbers[h >> 1]) for h in (a, b))
            raise InputError(
                f"contacts {first} and {second}",
                f"the same direction from grain {origin[a]}",
                "branches that leave a grain in different directions",
                "Drop one of the two: the contact graph is not planar.",
            )
        return -1 if turn > 0 else 1

    return sorted(tied.tolist(), key=cmp_to_key(compare))


def half_edges_by_grain(graph: GrainGraph, kept: Integers) -> Integers:
    """Half-edges of the kept contacts by first grain, second grain and image: no two are alike."""
    first = graph.contacts[kept].ravel()
    second = graph.contacts[kept, ::-1].ravel()
    if graph.images is None:
        return np.argsort(first * graph.grain_count + second)
    step = np.column_stack([graph.images[kept], -graph.images[kept]]).reshape(-1, 2)
    return np.lexsort((step[:, 1], step[:, 0], second, first))


def cycles(following: Integers) -> tuple[Integers, Integers]:
    """Cycles of a permutation."""
    first, position = _walk_short_cycles(following)
    rest = np.flatnonzero(position < 0)
    if rest.size:
        local = np.searchsorted(rest, following[rest])
        long_first, position[rest] = _rank_by_doubling(local)
        first[rest] = rest[long_first]
    start = np.flatnonzero(position == 0)
    offsets = np.zeros(len(start) + 1, dtype=np.int64)
    np.cumsum(np.bincount(first, minlength=1)[start], out=offsets[1:])
    begin = np.empty_like(following)
    begin[start] = offsets[:-1]
    members = np.empty_like(following)
    members[begin[first] + position] = np.arange(len(following))
    return offsets, members


def _walk_short_cycles(following: Integers) -> tuple[Integers, Integers]:
    """Smallest element of each cycle and the place after it; places are -1 in long cycles."""
    start, size = _short_starts(following)
    first = np.empty_like(following)
    position = np.full_like(following, -1)
    at, k = start, 0
    while start.size:
        first[at], position[at] = start, k
        k += 1
        unfinished = size > k
        start, size, at = start[unfinished], size[unfinished], following[at[unfinished]]
    return first, position


def _short_starts(following: Integers) -> tuple[Integers, Integers]:
    """Smallest elements of the short cycles and the cycles' lengths, by walking from everywhere.

    A walk ends at an element smaller than its start, so few walks last beyond their first steps.
    """
    starts, sizes = [], []
    start, at = np.arange(len(following)), following
    for size in range(1, SHORT_CYCLE + 1):
        closed = at == start
        starts.append(start[closed])
        sizes.append(np.full(len(starts[-1]), size))
        going = at > start
        start, at = start[going], following[at[going]]
    return np.concatenate(starts), np.concatenate(sizes)


def _rank_by_doubling(following: Integers) -> tuple[Integers, Integers]:
    """Smallest element of each cycle and the place after it, in log2(length) passes."""
    smallest = np.arange(len(following))
    distance = np.zeros_like(following)
    jump, reach = following, 1
    while (smallest[following] != smallest).any():
        nearer = smallest[jump] < smallest
        ahead = jump[nearer]
        smallest[nearer], distance[nearer] = smallest[ahead], distance[ahead] + reach
        jump, reach = jump[jump], 2 * reach
    length = np.bincount(smallest, minlength=1)[smallest]
    return smallest, np.where(distance == 0, 0, length - distance)


def measured_faces(
    graph: GrainGraph,
    branches: Floats,
    grains: Integers,
    contacts: Integers,
    sign: Integers,
    offsets: Integers,
) -> tuple[Floats, Integers]:
    """Signed area of each face and the sum of images along it."""
    faces = len(offsets) - 1
    area, winding = np.zeros(faces), np.zeros((faces, 2), dtype=np.int64)
    # In blocks that stay in the cache.
    cuts = np.searchsorted(offsets, np.arange(0, offsets[-1], BLOCK))
    for start, stop in pairwise(np.unique(np.append(cuts, faces)).tolist()):
        block = slice(offsets[start], offsets[stop])
        begin = offsets[start:stop] - offsets[start]
        first = np.repeat(begin, np.diff(offsets[start : stop + 1]))
        # Corners relative to the first one of their face: no cancellation far from the origin.
        x = graph.x[grains[block]]
        x -= x[first]
        turn = sign[block, None]
        if graph.images is not None and graph.cell is not None:
            image = graph.images[contacts[block]] * turn
            passed = np.cumsum(image, axis=0) - image
            x += (passed - passed[first]) @ graph.cell.T
            winding[start:stop] = np.add.reduceat(image, begin)
        d = branches[contacts[block]] * turn
        cross = x[:, 0] * d[:, 1] - x[:, 1] * d[:, 0]
        area[start:stop] = 0.5 * np.add.reduceat(cross, begin)
    return area, winding
