"""Fates of the loops between two snapshots: they survive, split, merge, change, are born or die.

A loop is the set of its half-edges, its sides each with a direction. Loops of two snapshots
overlap where they share half-edges; each connected part of this overlap is classified. With every
contact removed that only one of the snapshots has, a part is one face of the remaining graph: the
earlier loops of the part merged into it, and it was then divided into the later ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from loops.arrays import Integers
from loops.errors import InputError
from loops.faces import Faces
from loops.graph import GrainGraph, reduced_cell
from loops.shown import Shown
from loops.validation import integers


@dataclass(frozen=True, eq=False, repr=False)
class ContactMatch(Shown):
    """Contacts of two snapshots, matched.

    Attributes
    ----------
    after : (C0,) array of int
        Number of each earlier contact in the later snapshot, -1 if it opened.
    before : (C1,) array of int
        Number of each later contact in the earlier snapshot, -1 if it closed in between.
    reversed : (C0,) array of bool
        Whether the later snapshot lists the two grains in reverse order.
    """

    after: Integers
    before: Integers
    reversed: NDArray[np.bool_]

    def facts(self) -> dict[str, object]:
        """Counts of the contacts."""
        return {"shared": len(self.shared), "opened": self.opened, "closed": self.closed}

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

    A contact is identified by the ids of its two grains. In a periodic cell two grains may touch
    through several images, and images of two snapshots cannot be compared: a grain that left the
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
    >>> from loops.tracking import match_contacts
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
    # All pairs of contacts with the same key.
    order = np.argsort(late_key, kind="stable")
    ordered = late_key[order]
    begin = np.searchsorted(ordered, key, side="left")
    count = np.searchsorted(ordered, key, side="right") - begin
    c = np.repeat(np.arange(len(key)), count)
    within = np.arange(len(c)) - np.repeat(np.cumsum(count) - count, count)
    late = order[begin[c] + within]
    turned = low[c] != late_low[late]
    if before.cell is not None or after.cell is not None:
        start, end = before.branches[c], after.branches[late]
        own = before.contacts[c, 0] == before.contacts[c, 1]
        turned = np.where(own, np.sum(start * end, axis=1) < 0, turned)
        moved = end - np.where(turned, -1.0, 1.0)[:, None] * start
        cells = [reduced_cell(one.cell) for one in (before, after) if one.cell is not None]
        near = np.hypot(*moved.T) < 0.5 * min(np.hypot(*cell[:, 0]) for cell in cells)
        c, late, turned = c[near], late[near], turned[near]
    forth, back = np.full(len(key), -1), np.full(len(late_key), -1)
    forth[c], back[late] = late, c
    flipped = np.zeros(len(key), dtype=bool)
    flipped[c] = turned
    return ContactMatch(forth, back, flipped)


def _checked(graph: GrainGraph, ids: ArrayLike) -> Integers:
    numbers = integers("ids of the grains", ids, graph.grain_count)
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


class Fate(IntEnum):
    """Fate of a loop between two snapshots, see `loop_fates`."""

    SURVIVED = 0
    SPLIT = 1
    MERGED = 2
    CHANGED = 3
    DIED = 4
    BORN = 5


@dataclass(frozen=True, eq=False, repr=False)
class LoopFates(Shown):
    """The loops of two snapshots and how they follow from each other.

    Loops are numbered as in `Faces.loops`: earlier ones 0..L0-1, later ones 0..L1-1.

    Attributes
    ----------
    contacts : ContactMatch
        The contacts that the snapshots share.
    before, after : (L0,), (L1,) array of int8
        `Fate` of each earlier loop, and of each later one: how it came to be.
    successor : (L0,) array of int
        The later loop that shares most half-edges with each earlier one, the first of several;
        -1 if there is none.
    predecessor : (L1,) array of int
        The same the other way.
    shared : (L0,) array of int
        Half-edges that each earlier loop shares with its successor.
    order_before, order_after : (L0,), (L1,) array of int
        Orders of the loops.
    links : (n, 2) array of int
        Every pair of an earlier and a later loop that share half-edges, ascending: all successors
        of a loop that split, all that came of a part that changed.
    """

    contacts: ContactMatch
    before: NDArray[np.int8]
    after: NDArray[np.int8]
    successor: Integers
    predecessor: Integers
    shared: Integers
    order_before: Integers
    order_after: Integers
    links: Integers

    def facts(self) -> dict[str, object]:
        """Counts of the loops by fate."""
        ends = {"loops before": len(self.before), "loops after": len(self.after)}
        born = np.count_nonzero(self.after == Fate.BORN)
        counts = {fate.name.lower(): np.count_nonzero(self.before == fate) for fate in Fate}
        return {**ends, **counts, "born": born}


def loop_fates(contacts: ContactMatch, before: Faces, after: Faces) -> LoopFates:
    """Fate of every loop of a snapshot.

    Earlier and later loops that share a half-edge belong to one part, and so on through all loops
    that are linked in this way. A half-edge of the part is *lone* if no loop of the other snapshot
    has it, and *inner* if its way back belongs to a loop of the same part and snapshot. A part of
    k earlier and m later loops

    - `SURVIVED`, 1 to 1: no half-edge is lone;
    - `SPLIT`, 1 to m >= 2: no earlier half-edge is lone, lone later ones are inner (contacts that
      closed inside the loop);
    - `MERGED`, k >= 2 to 1: no later half-edge is lone, lone earlier ones are inner (contacts that
      opened between the loops);
    - `DIED`, 1 to 0, and `BORN`, 0 to 1: no half-edge of the loop bounds a loop of the other
      snapshot; it opened to the outside, or closed from there, or all of its contacts are new;
    - `CHANGED`: anything else with k, m >= 1. Contacts opened and closed in it (an exchange of
      neighbours, 2 to 2, the commonest), a cluster inside a loop joined it or came loose, or a
      loop on the border lost only some of its sides to the outside.

    Parameters
    ----------
    contacts : ContactMatch
        From `match_contacts`.
    before, after : Faces
        Faces of the two snapshots, from `find_faces`.

    Returns
    -------
    LoopFates
        The fate of every loop of either snapshot.

    Examples
    --------
    >>> from loops import GrainGraph, find_faces
    >>> from loops.tracking import match_contacts
    >>> from loops.tracking import Fate, loop_fates
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> crossed = square.replace(contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]],
    ...                          normal_force=[0.0] * 5, shear_force=[0.0] * 5)
    >>> match = match_contacts(square, range(4), crossed, range(4))
    >>> fates = loop_fates(match, find_faces(square), find_faces(crossed))
    >>> [Fate(k).name for k in fates.before], [Fate(k).name for k in fates.after]
    (['SPLIT'], ['SPLIT', 'SPLIT'])
    >>> fates.successor.tolist(), fates.predecessor.tolist()
    ([0], [0, 0])
    """
    old, new = (
        _loop_of_half_edge(before, len(contacts.after)),
        _loop_of_half_edge(after, len(contacts.before)),
    )
    # Both half-edges of every shared contact, in the earlier and in the later snapshot.
    c, side = contacts.shared, np.array([0, 1])
    here = (2 * c[:, None] + side).ravel()
    there = (2 * contacts.after[c, None] + (side ^ contacts.reversed[c, None])).ravel()
    both = (old[here] >= 0) & (new[there] >= 0)
    here, there = here[both], there[both]
    size, later = len(before.loops), len(after.loops)
    pair, weight = np.unique(old[here] * max(later, 1) + new[there], return_counts=True)
    a, b = np.divmod(pair, max(later, 1))
    links = csr_array((np.ones(len(a)), (a, size + b)), shape=(size + later, size + later))
    parts, label = connected_components(links, directed=False)
    was = _lone(old, here, label[:size], parts)
    now = _lone(new, there, label[size:], parts)
    fate = np.full(parts, Fate.CHANGED, dtype=np.int8)
    from_one, to_one = was.loops == 1, now.loops == 1
    kept, complete = was.lone == 0, now.lone == 0
    fate[from_one & to_one & kept & complete] = Fate.SURVIVED
    fate[from_one & (now.loops > 1) & kept & (now.border == 0)] = Fate.SPLIT
    fate[(was.loops > 1) & to_one & complete & (was.border == 0)] = Fate.MERGED
    fate[now.loops == 0] = Fate.DIED
    fate[was.loops == 0] = Fate.BORN
    successor, shared = _most_shared(a, b, weight, size)
    predecessor, _ = _most_shared(b, a, weight, later)
    return LoopFates(
        contacts=contacts,
        before=fate[label[:size]],
        after=fate[label[size:]],
        successor=successor,
        predecessor=predecessor,
        shared=shared,
        order_before=before.order[before.loops],
        order_after=after.order[after.loops],
        links=np.stack([a, b], axis=1),
    )


class ExchangeCounts(NamedTuple):
    """Numbers of loops of one order that became loops of another."""

    order_before: Integers
    order_after: Integers
    loops: Integers


def exchange_counts(fates: LoopFates) -> ExchangeCounts:
    """Count the loops by order and by the order of their successor.

    Every earlier loop counts once. A loop that split counts with the successor that shares most
    of its half-edges, and loops that merged count one by one: rows add up to the earlier loops,
    columns do not add up to the later ones.

    Parameters
    ----------
    fates : LoopFates
        From `loop_fates`.

    Returns
    -------
    ExchangeCounts
        Pairs of orders that occur, ascending.

    Examples
    --------
    >>> from loops import GrainGraph, find_faces
    >>> from loops.tracking import match_contacts
    >>> from loops.tracking import exchange_counts, loop_fates
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> faces = find_faces(square)
    >>> fates = loop_fates(match_contacts(square, range(4), square, range(4)), faces, faces)
    >>> [part.tolist() for part in exchange_counts(fates)]
    [[4], [4], [1]]
    """
    followed = fates.successor >= 0
    next_order = np.zeros_like(fates.order_before)
    next_order[followed] = fates.order_after[fates.successor[followed]]
    born = fates.order_after[fates.after == Fate.BORN]
    earlier = np.concatenate([fates.order_before, np.zeros_like(born)])
    later = np.concatenate([next_order, born])
    size = int(later.max(initial=0)) + 1
    pair, loops = np.unique(earlier * size + later, return_counts=True)
    return ExchangeCounts(*np.divmod(pair, size), loops)


def exchange_matrix(counts: ExchangeCounts, last: int | None = None) -> Integers:
    """Exchange matrix between orders, `M[order before, order after]`.

    Parameters
    ----------
    counts : ExchangeCounts
        From `exchange_counts`; of several intervals at once if their arrays are joined.
    last : int, optional
        Orders beyond it count as this one. The largest order if left out.

    Returns
    -------
    (last + 1, last + 1) array of int
        Indexed by the orders themselves; row 0 holds loops born, column 0 loops that died.

    Examples
    --------
    >>> import numpy as np
    >>> from loops.tracking import ExchangeCounts, exchange_matrix
    >>> counts = ExchangeCounts(np.array([3, 9]), np.array([4, 0]), np.array([2, 1]))
    >>> exchange_matrix(counts, last=4)[3:].tolist()
    [[0, 0, 0, 0, 2], [1, 0, 0, 0, 0]]
    """
    before, after = counts.order_before, counts.order_after
    if last is None:
        last = int(max(before.max(initial=0), after.max(initial=0)))
    matrix = np.zeros((last + 1, last + 1), dtype=np.int64)
    np.add.at(matrix, (np.minimum(before, last), np.minimum(after, last)), counts.loops)
    return matrix


def _loop_of_half_edge(faces: Faces, contacts: int) -> Integers:
    """(2 C,) array: loop that each half-edge bounds, -1 if it bounds none."""
    loop = np.full(2 * contacts, -1)
    loop[2 * faces.contacts + ~faces.forward] = np.repeat(faces.row, faces.order)
    return loop


class _Part(NamedTuple):
    """Loops of each part, their lone half-edges, and how many of these are not inner."""

    loops: Integers
    lone: Integers
    border: Integers


def _lone(loop: Integers, shared: Integers, label: Integers, parts: int) -> _Part:
    part = np.full(len(loop), -1)
    part[loop >= 0] = label[loop[loop >= 0]]
    back = part.reshape(-1, 2)[:, ::-1].ravel()
    lone = loop >= 0
    lone[shared] = False
    return _Part(
        loops=np.bincount(label, minlength=parts),
        lone=np.bincount(part[lone], minlength=parts),
        border=np.bincount(part[lone & (back != part)], minlength=parts),
    )


def _most_shared(
    one: Integers, other: Integers, weight: Integers, count: int
) -> tuple[Integers, Integers]:
    """For each of `count` loops the loop that shares most of its half-edges, and their number."""
    order = np.lexsort((other, -weight, one))
    found, first = np.unique(one[order], return_index=True)
    partner, most = np.full(count, -1), np.zeros(count, dtype=np.int64)
    partner[found], most[found] = other[order[first]], weight[order[first]]
    return partner, most
