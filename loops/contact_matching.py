"""The same contacts in two snapshots of a sample, however their grains are numbered or wrapped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Integers
from loops.errors import InputError
from loops.graph import GrainGraph, branch_vectors


@dataclass(frozen=True, eq=False)
class ContactMatch:
    """Which contact is which in two snapshots.

    Attributes
    ----------
    after : (C0,) array of int
        Number of each earlier contact in the later snapshot, -1 if it opened.
    before : (C1,) array of int
        Number of each later contact in the earlier snapshot, -1 if it closed in between.
    reversed : (C0,) array of bool
        Whether the later snapshot lists its grains the other way round.
    """

    after: Integers
    before: Integers
    reversed: NDArray[np.bool_]

    @property
    def shared(self) -> Integers:
        """(S,) array: earlier contacts that are still there."""
        return np.flatnonzero(self.after >= 0)

    @property
    def opened(self) -> int:
        """Number of contacts lost."""
        return int(np.count_nonzero(self.after < 0))

    @property
    def closed(self) -> int:
        """Number of contacts gained."""
        return int(np.count_nonzero(self.before < 0))


def match_contacts(
    before: GrainGraph, before_ids: ArrayLike, after: GrainGraph, after_ids: ArrayLike
) -> ContactMatch:
    """Find the contacts that two snapshots share.

    A contact is known by the ids of its two grains. In a periodic cell two grains may touch
    through several images, and the images say nothing across snapshots: a grain that left the
    cell may have been wrapped, the cell shifted or flipped. There a contact is the same if its
    branch moved by less than half the shortest vector of the lattice, in either snapshot. Branches
    of two images differ by a whole lattice vector at least, so the match is unique.

    Parameters
    ----------
    before, after : GrainGraph
        The two snapshots, one state each.
    before_ids, after_ids : (G,) array of int
        Ids of their grains, each once; grains may come and go.

    Returns
    -------
    ContactMatch
        The match both ways.

    Raises
    ------
    InputError
        If ids repeat or are not one for each grain.

    Examples
    --------
    >>> from loops import GrainGraph
    >>> from loops.contact_matching import match_contacts
    >>> x = [[0, 0], [1, 0], [0, 1]]
    >>> one = GrainGraph(x=x, radii=[0.5] * 3, contacts=[[0, 1], [1, 2]])
    >>> two = GrainGraph(x=x[::-1], radii=[0.5] * 3, contacts=[[0, 2], [1, 2]])
    >>> match = match_contacts(one, [7, 8, 9], two, [9, 8, 7])
    >>> match.after.tolist(), match.before.tolist(), match.reversed.tolist()
    ([1, -1], [-1, 0], [True, False])
    """
    first_ids, second_ids = _checked(before, before_ids), _checked(after, after_ids)
    known = np.unique(np.concatenate([first_ids, second_ids]))
    low, key = _keys(before.contacts, np.searchsorted(known, first_ids), len(known))
    late_low, late_key = _keys(after.contacts, np.searchsorted(known, second_ids), len(known))
    c, late = _join(key, late_key)
    turned = low[c] != late_low[late]
    if before.cell is not None or after.cell is not None:
        start, end = branch_vectors(before)[c], branch_vectors(after)[late]
        own = before.contacts[c, 0] == before.contacts[c, 1]
        turned = np.where(own, np.sum(start * end, axis=1) < 0, turned)
        moved = end - np.where(turned, -1.0, 1.0)[:, None] * start
        near = np.hypot(moved[:, 0], moved[:, 1]) < 0.5 * _shortest_lattice_vector(before, after)
        c, late, turned = c[near], late[near], turned[near]
    forth, back = np.full(len(key), -1), np.full(len(late_key), -1)
    forth[c], back[late] = late, c
    flipped = np.zeros(len(key), dtype=bool)
    flipped[c] = turned
    return ContactMatch(forth, back, flipped)


def _checked(graph: GrainGraph, ids: ArrayLike) -> Integers:
    numbers = np.asarray(ids, dtype=np.int64)
    if numbers.shape != (graph.grain_count,):
        where, received = "ids of the grains", f"shape {numbers.shape}"
        raise InputError(where, received, f"({graph.grain_count},)", "Give one id for each grain.")
    ordered = np.sort(numbers)
    twice = np.flatnonzero(ordered[1:] == ordered[:-1])
    if len(twice):
        received = f"{ordered[twice[0]]} twice"
        raise InputError("ids of the grains", received, "each id once", "Renumber the grains.")
    return numbers


def _keys(contacts: Integers, rank: Integers, count: int) -> tuple[NDArray[np.bool_], Integers]:
    """Whether grain i has the lower id, and one number for each pair of ids."""
    i, j = rank[contacts].T
    return i <= j, np.minimum(i, j) * count + np.maximum(i, j)


def _join(key: Integers, other: Integers) -> tuple[Integers, Integers]:
    """All pairs of rows with the same key."""
    order = np.argsort(other, kind="stable")
    ordered = other[order]
    begin = np.searchsorted(ordered, key, side="left")
    count = np.searchsorted(ordered, key, side="right") - begin
    row = np.repeat(np.arange(len(key)), count)
    within = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    return row, order[begin[row] + within]


def _shortest_lattice_vector(*graphs: GrainGraph) -> float:
    """Length of the shortest period of any of the graphs, by Lagrange's reduction."""
    shortest = np.inf
    for graph in graphs:
        if graph.cell is None:
            continue
        a, b = sorted(graph.cell.T, key=lambda v: float(v @ v))
        while True:
            b = b - np.rint(a @ b / (a @ a)) * a
            if b @ b >= a @ a:
                break
            a, b = b, a
        shortest = min(shortest, float(np.hypot(*a)))
    return shortest
