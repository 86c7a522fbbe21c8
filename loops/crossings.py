"""Branches that cross: where a contact graph is not planar."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.branch_bins import (
    ROUND_OFF,
    BinnedBranches,
    Branches,
    bin_counts,
    cell_branches,
    cell_coordinates,
    close_branches,
)
from loops.compiled import use_compiled
from loops.graph import GrainGraph, branch_vectors, require_one_state

BLOCK = 2**15  # pieces of branches compared at a time
SAMPLE = 10_000  # branches that the mean extent is taken from, at least
REPEATS = 8  # times a crossing may be met before the kernel gives up counting


def find_crossings(
    graph: GrainGraph, max_pairs: int = 1000, *, compiled: bool | None = None
) -> Integers:
    """Pairs of contacts whose branches meet elsewhere than in a common grain.

    They cross, touch (the centre of a grain lies on a branch it has no part in) or overlap along
    a line; touching is judged to round-off. Dangling contacts are looked at as well. Euler's
    formula misses some crossings, such as a loop in the shape of an eight or two components that
    cross; this is the geometric test. Time and memory grow with the number of contacts, whatever
    the sizes of the grains.

    Parameters
    ----------
    graph : GrainGraph
        One state, in the plane or in a periodic cell of any shape.
    max_pairs : int
        The search stops once it has found this many pairs; which ones is not said.
    compiled : bool, optional
        Whether to take the compiled kernel; by the size of the graph if left out.

    Returns
    -------
    (M, 2) array of int
        Pairs of contacts, the smaller number first, in ascending order; `(c, c)` if a branch
        overlaps its own periodic image.

    Raises
    ------
    InputError
        If the graph has batch axes.

    Examples
    --------
    >>> from loops import GrainGraph, find_crossings
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3]])
    >>> find_crossings(square).tolist()
    [[4, 5]]
    """
    require_one_state(graph)
    if graph.contact_count == 0:
        return np.zeros((0, 2), dtype=np.int64)
    if use_compiled(compiled, graph.contact_count):
        pairs = _compiled_crossings(graph, max_pairs)
        if pairs is not None:
            return pairs
    branches = cell_branches(graph)
    batches, unsorted = [np.zeros((0, 2), dtype=np.int64)], 0
    for pieces in close_branches(branches):
        for pairs in _meeting_pairs(branches, pieces):
            batches.append(pairs)
            unsorted += len(pairs)
            if unsorted >= max_pairs:
                # A pair may have been found in several bins.
                batches, unsorted = [np.unique(np.concatenate(batches), axis=0)], 0
                if len(batches[0]) >= max_pairs:
                    return batches[0][:max_pairs]
    return np.unique(np.concatenate(batches), axis=0)


def crossing_contacts_to_drop(graph: GrainGraph, pairs: Integers) -> Integers:
    """Contacts whose removal leaves none of the given pairs of crossing branches.

    Of two that cross, the one with more crossings goes; of equal ones the one with the smaller
    normal force, then the longer branch, then the larger number.

    Parameters
    ----------
    graph : GrainGraph
        One state.
    pairs : (M, 2) array of int
        From `find_crossings`.

    Returns
    -------
    (K,) array of int
        Contacts to leave out, ascending.

    Examples
    --------
    >>> from loops import GrainGraph, crossing_contacts_to_drop, find_crossings
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2], [1, 3]],
    ...                     normal_force=[1, 1, 1, 1, 0.2, 0.3])
    >>> crossing_contacts_to_drop(square, find_crossings(square)).tolist()
    [4]
    """
    named, pair = np.unique(pairs, return_inverse=True)
    pair = pair.reshape(-1, 2)
    length = np.hypot(*branch_vectors(graph)[named].T)
    crossings = np.bincount(pair.ravel(), minlength=len(named))
    order = np.lexsort((named, length, -graph.normal_force[named], crossings))
    rank = np.empty(len(named), dtype=np.int64)
    rank[order] = np.arange(len(named))
    dropped = np.zeros(len(named), dtype=bool)
    while len(pair):
        # The first of its neighbourhood goes; among all pairs left there is always one.
        worst = np.full(len(named), -1)
        np.maximum.at(worst, pair, rank[pair].max(axis=1)[:, None])
        dropped |= worst == rank
        pair = pair[~dropped[pair].any(axis=1)]
    return named[dropped]


def _compiled_crossings(graph: GrainGraph, max_pairs: int) -> Integers | None:
    """Crossings by the kernel; None where its bins are too crowded, as in fans around large grains.

    A pair may meet in several bins: it counts once.
    """
    from loops.compiled.kernel import given
    from loops.compiled.network import crossing_pairs

    u, home, sides = cell_coordinates(graph)
    none = np.zeros((0, 2), dtype=np.int64)
    counts = bin_counts(graph.contact_count, _mean_extent(graph, u, home), sides)
    limit = min(REPEATS * max_pairs, np.iinfo(np.int64).max)
    status, pairs = crossing_pairs(
        given(graph.x, np.float64),
        given(u, np.float64),
        given(none if home is None else home, np.int64),
        given(graph.contacts, np.int64),
        given(none if graph.images is None else graph.images, np.int64),
        given(counts, np.int64),
        limit,
    )
    pairs = np.unique(pairs, axis=0)
    if status < 0 or (status > 0 and len(pairs) < max_pairs):
        return None
    return pairs[:max_pairs]


def _mean_extent(graph: GrainGraph, u: Floats, home: Integers | None) -> Floats:
    """Mean extent of a branch along either axis, from every so many contacts."""
    step = 1 + graph.contact_count // SAMPLE
    i, j = graph.contacts[::step].T
    vector = u[j] - u[i]
    if home is not None and graph.images is not None:
        vector += home[j] + graph.images[::step] - home[i]
    return np.asarray(np.abs(vector).mean(axis=0))


def _meeting_pairs(branches: Branches, pieces: BinnedBranches) -> Iterator[Integers]:
    """Pairs of contacts that meet in a bin, in blocks of whole bins."""
    starts = np.concatenate([[0], np.cumsum(pieces.bin_sizes())])
    cuts = np.searchsorted(starts, np.arange(0, starts[-1], BLOCK))
    for low, high in pairwise(np.unique(np.append(starts[cuts], starts[-1])).tolist()):
        block = pieces.take(slice(low, high))
        segments = _segments(branches, block)
        for apart in range(1, high - low):
            first = np.flatnonzero(block.bin[apart:] == block.bin[:-apart])
            if first.size == 0:
                break
            first = first[_meet(segments, first, first + apart)]
            if first.size:
                pairs = np.column_stack([block.contact[first], block.contact[first + apart]])
                yield np.sort(pairs, axis=1)


class _Segments(NamedTuple):
    """Branches as they pass their bin, axis or end first."""

    start: Floats  # (2, P)
    vector: Floats  # (2, P)
    grain: Integers  # (2, P)
    cell: Integers  # (2, P)


def _segments(branches: Branches, pieces: BinnedBranches) -> _Segments:
    start = branches.start[pieces.contact] - pieces.shift
    vector = branches.vector[pieces.contact]
    grain, cell = branches.ends(pieces)
    return _Segments(start.T.copy(), vector.T.copy(), grain.copy(), cell)


def _meet(segments: _Segments, one: Integers, other: Integers) -> Flags:
    """Which pairs of branches have a point in common that is no common grain."""
    a, b = segments.vector[:, one], segments.vector[:, other]
    apart = segments.start[:, other] - segments.start[:, one]
    turn = _cross(a, b)
    # Each branch's ends lie on either side of the other's line, or on it.
    meets = _straddle(_cross(a, apart), turn, a) & _straddle(_cross(apart, b), -turn, b)
    close = np.flatnonzero(meets)
    a, b, apart, turn = a[:, close], b[:, close], apart[:, close], turn[close]
    low = np.maximum(np.minimum(a, 0), apart + np.minimum(b, 0))
    high = np.minimum(np.maximum(a, 0), apart + np.maximum(b, 0))
    beside = (low[0] <= high[0] + ROUND_OFF) & (low[1] <= high[1] + ROUND_OFF)
    parallel = np.abs(turn) <= ROUND_OFF * (_size(a) + _size(b))
    along = a[0] * b[0] + a[1] * b[1]
    shared, overlap = _at_common_grains(segments, one[close], other[close], along)
    meets[close] = np.where(shared, parallel & overlap, beside)
    return meets


def _straddle(side: Floats, change: Floats, line: Floats) -> Flags:
    tolerance = ROUND_OFF * _size(line)
    other = side + change
    return (np.minimum(side, other) <= tolerance) & (np.maximum(side, other) >= -tolerance)


def _at_common_grains(
    segments: _Segments, one: Integers, other: Integers, along: Floats
) -> tuple[Flags, Flags]:
    """Whether two branches share a grain, and whether they leave one into the same half-plane."""
    shared = np.zeros(len(one), dtype=bool)
    same_way = np.zeros(len(one), dtype=bool)
    for p, q in ((0, 0), (1, 1), (0, 1), (1, 0)):
        here = segments.grain[p, one] == segments.grain[q, other]
        here &= segments.cell[p, one] == segments.cell[q, other]
        shared |= here
        same_way |= here & ((along > 0) if p == q else (along < 0))
    return shared, same_way


def _cross(a: Floats, b: Floats) -> Floats:
    return a[0] * b[1] - a[1] * b[0]


def _size(a: Floats) -> Floats:
    return np.abs(a[0]) + np.abs(a[1])
