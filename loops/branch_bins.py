"""Bins that gather the branches of a graph which pass close to each other.

A grid of bins is laid over the cell (over the bounding box in the plane); crowded bins are halved
until few branches are left in each, so that sizes of grains may differ a lot.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.graph import GrainGraph

CROWD = 16  # branches in a bin beyond which it is halved
SPLITS = 12  # times a bin may be halved
PIECES = 4  # pieces per contact that the grid may cut the branches into, on average
BLOCK = 2**16  # branches cut at a time
ROUND_OFF = 8 * np.finfo(float).eps  # of coordinates of order one


@dataclass(frozen=True, eq=False)
class Branches:
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
    """Which branch passes which bin: P pieces, sorted by bin."""

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


def cell_branches(graph: GrainGraph) -> Branches:
    """Branches of a graph that has contacts, in coordinates of its cell or bounding box."""
    i, j = graph.contacts.T
    u, home, sides = cell_coordinates(graph)
    reach = np.zeros((graph.contact_count, 2), dtype=np.int64)
    if home is not None and graph.images is not None:
        reach = home[j] + graph.images - home[i]
    vector = u[j] - u[i] + reach
    return Branches(u[i], vector, graph.contacts, reach, sides)


def cell_coordinates(graph: GrainGraph) -> tuple[Floats, Integers | None, Floats]:
    """Centres in coordinates of the cell or of the bounding box."""
    if graph.cell is not None and graph.images is not None:
        u = np.linalg.solve(graph.cell, graph.x.T).T
        home = np.floor(u).astype(np.int64)
        return u - home, home, np.hypot(*graph.cell)
    touching = np.zeros(graph.grain_count, dtype=bool)
    touching[graph.contacts] = True
    lowest, highest = graph.x[touching].min(axis=0), graph.x[touching].max(axis=0)
    extent = highest - lowest
    # A margin all around, so that rounding puts nothing outside the bins.
    sides = 1.002 * np.maximum(extent, 1e-9 * extent.max())
    return (graph.x - lowest) / sides + 0.001, None, sides


def close_branches(branches: Branches) -> Iterator[BinnedBranches]:
    """Bins that can be compared pair by pair, fine ones last.

    A bin whose branches all meet in one grain is left out if it is crowded: large grains are the
    centres of fans of branches that have nothing to cross there.
    """
    pieces = _cut(
        branches,
        bin_counts(len(branches.vector), np.abs(branches.vector).mean(axis=0), branches.sides),
    )
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


def _cut(branches: Branches, counts: tuple[int, int]) -> BinnedBranches:
    """Cut every branch by the grid; in blocks, as the coordinates take more room than the bins."""
    contacts = np.arange(len(branches.vector))
    parts = [
        _cut_block(branches, counts, contacts[k : k + BLOCK])
        for k in range(0, len(contacts), BLOCK)
    ]
    return _sorted(counts, *map(np.concatenate, zip(*parts, strict=True)))


def _cut_block(
    branches: Branches, counts: tuple[int, int], contact: Integers
) -> tuple[Integers, Integers, Integers]:
    """Cut branches by the columns of the grid, then every part by its rows."""
    x, y = (branches.start[contact] * counts).T
    dx, dy = (branches.vector[contact] * counts).T
    branch, column = _spread(*_span(x, x + dx))
    x, y, dx, dy = x[branch], y[branch], dx[branch], dy[branch]
    with np.errstate(divide="ignore", invalid="ignore"):
        enter = np.clip((column + (dx < 0) - x) / dx, 0, 1)
        leave = np.clip((column + (dx >= 0) - x) / dx, 0, 1)
    enter[dx == 0], leave[dx == 0] = 0, 1
    part, row = _spread(*_span(y + enter * dy, y + leave * dy))
    shift, place = np.divmod(np.column_stack([column[part], row]), counts)
    return _numbered(place, counts), contact[branch[part]], shift


def _span(a: Floats, b: Floats) -> tuple[Integers, Integers]:
    """First and last unit interval between two values, with a margin for round-off."""
    margin = 1e-9 + ROUND_OFF * np.maximum(np.abs(a), np.abs(b))
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


def _in_fans(branches: Branches, pieces: BinnedBranches) -> Flags:
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


def _halve(branches: Branches, pieces: BinnedBranches) -> BinnedBranches:
    """Halve every bin both ways and keep each branch in the quarters that it passes."""
    counts = (2 * pieces.counts[0], 2 * pieces.counts[1])
    row, column = np.divmod(pieces.bin, pieces.counts[0])
    start = (branches.start[pieces.contact] - pieces.shift) * counts
    vector = branches.vector[pieces.contact] * counts
    half = 0.5 + 1e-9 + ROUND_OFF * max(counts)
    kept, number = [], []
    for right, up in ((0, 0), (1, 0), (0, 1), (1, 1)):
        quarter = np.column_stack([2 * column + right, 2 * row + up])
        passes = np.flatnonzero(_passes(start - quarter - 0.5, vector, half))
        kept.append(passes)
        number.append(_numbered(quarter[passes], counts))
    which = np.concatenate(kept)
    return _sorted(counts, np.concatenate(number), pieces.contact[which], pieces.shift[which])


def _passes(start: Floats, vector: Floats, half: float) -> Flags:
    """Whether a segment meets the square of a half side around the origin (separating axes)."""
    end = start + vector
    beside = (np.minimum(start, end) > half) | (np.maximum(start, end) < -half)
    turn = np.abs(start[:, 0] * vector[:, 1] - start[:, 1] * vector[:, 0])
    width = half * (np.abs(vector[:, 0]) + np.abs(vector[:, 1]))
    return ~beside.any(axis=1) & (turn <= width)
