"""Branches that cross: a contact graph with such branches is not planar.

Branches are compared where they pass close to each other: a grid of bins is laid over the cell
(over the bounding box in the plane), and crowded bins are halved until few branches are left in
each, so that sizes of grains may differ a lot.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from loops.arrays import ROUNDING, Flags, Floats, Integers
from loops.compiled import use_compiled
from loops.graph import GrainGraph, require_one_state

PAIRS_AT_ONCE = 2**15  # pieces of branches compared at a time
CROWD = 16  # branches in a bin beyond which it is halved
SPLITS = 12  # times a bin may be halved
PIECES = 4  # pieces per contact that the grid may cut the branches into, on average
MEASURED_BRANCHES = 10_000  # least number of branches of which the mean extent is measured
REPEATS = 8  # the kernel stops counting after so many meetings per wanted pair


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
        The search stops once it has found this many pairs, in no particular order.
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
    length = np.hypot(*graph.branches[named].T)
    crossings = np.bincount(pair.ravel(), minlength=len(named))
    order = np.lexsort((named, length, -graph.normal_force[named], crossings))
    rank = np.empty(len(named), dtype=np.int64)
    rank[order] = np.arange(len(named))
    dropped = np.zeros(len(named), dtype=bool)
    while len(pair):
        # Drop each contact that ranks first among those it crosses: there is always one.
        worst = np.full(len(named), -1)
        np.maximum.at(worst, pair, rank[pair].max(axis=1)[:, None])
        dropped |= worst == rank
        pair = pair[~dropped[pair].any(axis=1)]
    return named[dropped]


def _compiled_crossings(graph: GrainGraph, max_pairs: int) -> Integers | None:
    """Crossings by the kernel; None where its bins are too crowded, as in fans around large grains.

    A pair may meet in several bins: it counts once.
    """
    from loops.compiled import given
    from loops.compiled.crossings import crossing_pairs
    from loops.compiled.network import local_network

    u, home, sides = cell_coordinates(graph)
    none = np.zeros((0, 2), dtype=np.int64)
    step = 1 + graph.contact_count // MEASURED_BRANCHES
    i, j = graph.contacts[::step].T
    vector = u[j] - u[i]
    if home is not None and graph.images is not None:
        vector += home[j] + graph.images[::step] - home[i]
    counts = bin_counts(graph.contact_count, np.abs(vector).mean(axis=0), sides)
    limit = min(REPEATS * max_pairs, np.iinfo(np.int64).max)
    network = local_network(given(graph.x, np.float64), given(graph.contacts, np.int64))
    status, pairs = crossing_pairs(
        network.grain,
        network.contact,
        network.ends,
        given(u, np.float64),
        given(none if home is None else home, np.int64),
        given(none if graph.images is None else graph.images, np.int64),
        given(counts, np.int64),
        limit,
    )
    pairs = np.unique(pairs, axis=0)
    if status < 0 or (status > 0 and len(pairs) < max_pairs):
        return None
    return pairs[:max_pairs]


def _meeting_pairs(branches: CellBranches, pieces: BinnedBranches) -> Iterator[Integers]:
    """Pairs of contacts that meet in a bin, in blocks of whole bins."""
    starts = np.concatenate([[0], np.cumsum(pieces.bin_sizes())])
    cuts = np.searchsorted(starts, np.arange(0, starts[-1], PAIRS_AT_ONCE))
    for low, high in pairwise(np.unique(np.append(starts[cuts], starts[-1])).tolist()):
        block = pieces.take(slice(low, high))
        start = branches.start[block.contact] - block.shift
        grain, cell = branches.ends(block)
        vector = branches.vector[block.contact]
        segments = _Segments(start.T.copy(), vector.T.copy(), grain.copy(), cell)
        for apart in range(1, high - low):
            first = np.flatnonzero(block.bin[apart:] == block.bin[:-apart])
            if first.size == 0:
                break
            first = first[_meet(segments, first, first + apart)]
            if first.size:
                pairs = np.column_stack([block.contact[first], block.contact[first + apart]])
                yield np.sort(pairs, axis=1)


class _Segments(NamedTuple):
    """Branches of the pieces of a bin, axis or end first."""

    start: Floats  # (2, P)
    vector: Floats  # (2, P)
    grain: Integers  # (2, P)
    cell: Integers  # (2, P)


def _meet(segments: _Segments, one: Integers, other: Integers) -> Flags:
    """Whether pairs of branches have a point in common other than a common grain."""
    a, b = segments.vector[:, one], segments.vector[:, other]
    apart = segments.start[:, other] - segments.start[:, one]
    turn = _cross(a, b)
    # Each branch's ends lie on either side of the other's line, or on it.
    meets = _straddle(_cross(a, apart), turn, a) & _straddle(_cross(apart, b), -turn, b)
    close = np.flatnonzero(meets)
    a, b, apart, turn = a[:, close], b[:, close], apart[:, close], turn[close]
    low = np.maximum(np.minimum(a, 0), apart + np.minimum(b, 0))
    high = np.minimum(np.maximum(a, 0), apart + np.maximum(b, 0))
    beside = (low[0] <= high[0] + ROUNDING) & (low[1] <= high[1] + ROUNDING)
    parallel = np.abs(turn) <= ROUNDING * (_size(a) + _size(b))
    along = a[0] * b[0] + a[1] * b[1]
    # Branches with a common grain overlap if they are parallel and leave it the same way.
    one, other = one[close], other[close]
    shared, same_way = np.zeros((2, len(close)), dtype=bool)
    for p, q in ((0, 0), (1, 1), (0, 1), (1, 0)):
        here = segments.grain[p, one] == segments.grain[q, other]
        here &= segments.cell[p, one] == segments.cell[q, other]
        shared |= here
        same_way |= here & ((along > 0) if p == q else (along < 0))
    meets[close] = np.where(shared, parallel & same_way, beside)
    return meets


def _straddle(side: Floats, change: Floats, line: Floats) -> Flags:
    tolerance = ROUNDING * _size(line)
    other = side + change
    return (np.minimum(side, other) <= tolerance) & (np.maximum(side, other) >= -tolerance)


def _cross(a: Floats, b: Floats) -> Floats:
    return a[0] * b[1] - a[1] * b[0]


def _size(a: Floats) -> Floats:
    return np.abs(a[0]) + np.abs(a[1])


@dataclass(frozen=True, eq=False)
class CellBranches:
    """Branches in coordinates of the cell, or of the bounding box in the plane."""

    start: Floats  # (C, 2) grain i, brought into the cell
    vector: Floats  # (C, 2)
    grains: Integers  # (C, 2)
    reach: Integers  # (C, 2) cell that grain j lies in, seen from grain i in the first one
    sides: Floats  # (2,) lengths of the cell's sides

    def ends(self, pieces: BinnedBranches) -> tuple[Integers, Integers]:
        """(2, P) grain at the start and the end of each piece's branch, and a code of its cell."""
        cell = np.stack([-pieces.shift, self.reach[pieces.contact] - pieces.shift])
        return self.grains[pieces.contact].T, (cell[..., 0] << 32) + cell[..., 1]


@dataclass(frozen=True, eq=False)
class BinnedBranches:
    """Pieces of branches by the bin that they pass, P pieces sorted by bin."""

    counts: tuple[int, int]  # columns and rows of bins in the cell
    bin: Integers  # (P,) row * columns + column
    contact: Integers  # (P,)
    shift: Integers  # (P, 2) image of the bin that the branch passes, for a start in the cell

    def take(self, which: Integers | Flags | slice) -> BinnedBranches:
        """Some of the pieces."""
        return BinnedBranches(self.counts, self.bin[which], self.contact[which], self.shift[which])

    def bin_sizes(self) -> Integers:
        """Number of pieces in each bin that has any."""
        if len(self.bin) == 0:
            return np.zeros(0, dtype=np.int64)
        return np.diff(np.flatnonzero(np.diff(self.bin, prepend=-1, append=-1)))


def cell_branches(graph: GrainGraph) -> CellBranches:
    """Branches of a graph that has contacts, in coordinates of its cell or bounding box."""
    i, j = graph.contacts.T
    u, home, sides = cell_coordinates(graph)
    reach = np.zeros((graph.contact_count, 2), dtype=np.int64)
    if home is not None and graph.images is not None:
        reach = home[j] + graph.images - home[i]
    vector = u[j] - u[i] + reach
    return CellBranches(u[i], vector, graph.contacts, reach, sides)


def cell_coordinates(graph: GrainGraph) -> tuple[Floats, Integers | None, Floats]:
    """Centres in coordinates of the cell or of the bounding box."""
    if graph.cell is not None and graph.images is not None:
        u = np.linalg.solve(graph.cell, graph.x.T).T
        home = np.floor(u).astype(np.int64)
        return u - home, home, np.hypot(*graph.cell)
    touching = np.zeros(graph.grain_count, dtype=bool)
    touching[graph.contacts] = True
    # Axis by axis: numpy takes ten times as long for both at once.
    along = [values[touching] for values in graph.x.T]
    lowest, highest = (np.array([f(values) for values in along]) for f in (np.min, np.max))
    extent = highest - lowest
    # A margin all around, so that rounding puts nothing outside the bins.
    sides = 1.002 * np.maximum(extent, 1e-9 * extent.max())
    return (graph.x - lowest) / sides + 0.001, None, sides


def close_branches(branches: CellBranches) -> Iterator[BinnedBranches]:
    """Bins that can be compared pair by pair, fine ones last.

    A bin whose branches all meet in one grain is left out if it is crowded: large grains are the
    centres of fans of branches that have nothing to cross there.
    """
    count = len(branches.vector)
    counts = bin_counts(count, np.abs(branches.vector).mean(axis=0), branches.sides)
    # Cut branches by the columns of the grid, then every part by its rows.
    x, y = (branches.start * counts).T
    dx, dy = (branches.vector * counts).T
    branch, column = _spread(*_span(x, x + dx))
    x, y, dx, dy = x[branch], y[branch], dx[branch], dy[branch]
    with np.errstate(divide="ignore", invalid="ignore"):
        enter = np.clip((column + (dx < 0) - x) / dx, 0, 1)
        leave = np.clip((column + (dx >= 0) - x) / dx, 0, 1)
    enter[dx == 0], leave[dx == 0] = 0, 1
    part, row = _spread(*_span(y + enter * dy, y + leave * dy))
    shift, place = np.divmod(np.column_stack([column[part], row]), counts)
    pieces = _sorted(counts, _numbered(place, counts), branch[part], shift)
    limit = 2 * len(pieces.contact)
    for _ in range(SPLITS):
        size = pieces.bin_sizes()
        yield pieces.take(np.repeat((size > 1) & (size <= CROWD), size))
        pieces = pieces.take(np.repeat(size > CROWD, size))
        pieces = pieces.take(~_in_fans(branches, pieces))
        if len(pieces.contact) == 0 or len(pieces.contact) > limit:
            break
        pieces = _halve(branches, pieces)
    yield pieces


def bin_counts(contacts: int, extent: Floats, sides: Floats) -> tuple[int, int]:
    """Columns and rows: square bins, two contacts in each, fewer bins if branches are long."""
    width, height = np.maximum(sides, sides.max() / contacts)
    counts = np.sqrt([0.5 * contacts * width / height, 0.5 * contacts * height / width])
    crossed = contacts * float(extent @ counts)
    columns, rows = counts * min(1.0, PIECES * contacts / max(crossed, 1.0))
    return max(1, int(columns)), max(1, int(rows))


def _span(a: Floats, b: Floats) -> tuple[Integers, Integers]:
    """First and last unit interval between two values, with a margin for round-off."""
    margin = 1e-9 + ROUNDING * np.maximum(np.abs(a), np.abs(b))
    low = np.floor(np.minimum(a, b) - margin)
    high = np.floor(np.maximum(a, b) + margin)
    return low.astype(np.int64), high.astype(np.int64)


def _spread(low: Integers, high: Integers) -> tuple[Integers, Integers]:
    """Every item repeated for each integer of its range, and that integer."""
    count = high - low + 1
    item = np.repeat(np.arange(len(low)), count)
    before = np.cumsum(count) - count
    return item, np.arange(len(item)) - (before - low)[item]


def _numbered(place: Integers, counts: tuple[int, int]) -> Integers:
    """Number of a bin from its column and row."""
    return place[:, 1] * counts[0] + place[:, 0]


def _sorted(
    counts: tuple[int, int], number: Integers, contact: Integers, shift: Integers
) -> BinnedBranches:
    order = np.argsort(number, kind="stable")
    return BinnedBranches(counts, number[order], contact[order], shift[order])


def _in_fans(branches: CellBranches, pieces: BinnedBranches) -> Flags:
    """Pieces in bins whose branches all meet in one grain."""
    if len(pieces.contact) == 0:
        return np.zeros(0, dtype=bool)
    size = pieces.bin_sizes()
    begin = np.cumsum(size) - size
    grain, cell = branches.ends(pieces)
    fan = np.zeros(len(size), dtype=bool)
    for side in (0, 1):
        hub, hub_cell = np.repeat(grain[side, begin], size), np.repeat(cell[side, begin], size)
        meets = ((grain == hub) & (cell == hub_cell)).any(axis=0)
        fan |= np.logical_and.reduceat(meets, begin)
    return np.repeat(fan, size)


def _halve(branches: CellBranches, pieces: BinnedBranches) -> BinnedBranches:
    """Halve every bin both ways and keep each branch in the quarters that it passes."""
    counts = (2 * pieces.counts[0], 2 * pieces.counts[1])
    row, column = np.divmod(pieces.bin, pieces.counts[0])
    start = (branches.start[pieces.contact] - pieces.shift) * counts
    vector = branches.vector[pieces.contact] * counts
    half = 0.5 + 1e-9 + ROUNDING * max(counts)
    kept, number = [], []
    for right, up in ((0, 0), (1, 0), (0, 1), (1, 1)):
        quarter = np.column_stack([2 * column + right, 2 * row + up])
        # A branch meets the square of a half side unless an axis separates them: 1, 2, or its own.
        tail = start - quarter - 0.5
        head = tail + vector
        beside = (np.minimum(tail, head) > half) | (np.maximum(tail, head) < -half)
        turn = np.abs(tail[:, 0] * vector[:, 1] - tail[:, 1] * vector[:, 0])
        width = half * (np.abs(vector[:, 0]) + np.abs(vector[:, 1]))
        passes = np.flatnonzero(~beside.any(axis=1) & (turn <= width))
        kept.append(passes)
        number.append(_numbered(quarter[passes], counts))
    which = np.concatenate(kept)
    return _sorted(counts, np.concatenate(number), pieces.contact[which], pieces.shift[which])
