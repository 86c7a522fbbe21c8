"""Dangling grains and connected components of a contact graph, and how these wind."""

from __future__ import annotations

import numpy as np

from loops.arrays import Flags, Integers
from loops.graph import GrainGraph


def prune_dangling(
    graph: GrainGraph, closed: Flags | None = None, supports: Integers | None = None
) -> tuple[Flags, Flags]:
    """Remove grains with fewer than two contacts, again and again until none is left.

    What remains is the 2-core of the contact graph: the only part that loops can pass through.
    A contact of a grain with its own periodic image counts twice.

    Parameters
    ----------
    graph : GrainGraph
        The contact graph; only its topology is read.
    closed : (C,) array of bool, optional
        Contacts that count; all of them if left out.
    supports : (G,) array of int, optional
        Contacts of each grain with walls; none if left out.

    Returns
    -------
    kept_grains : (G,) array of bool
        False for dangling grains and for grains without any contact.
    kept_contacts : (C,) array of bool
        True where both grains are kept.

    Examples
    --------
    >>> from loops import GrainGraph, prune_dangling
    >>> graph = GrainGraph(x=[[0, 0], [1, 0], [0, 1], [2, 0]], radii=[0.5] * 4,
    ...                    contacts=[[0, 1], [1, 2], [2, 0], [1, 3]])
    >>> [kept.tolist() for kept in prune_dangling(graph)]
    [[True, True, True, False], [True, True, True, False]]
    """
    contacts, kept = graph.contacts, np.ones(graph.grain_count, dtype=bool)
    left = np.ones(len(contacts), dtype=bool) if closed is None else closed.copy()
    rows, held = np.flatnonzero(left), np.zeros_like(kept, dtype=np.int64)
    held += 0 if supports is None else supports
    degree = np.bincount(contacts[rows].ravel(), minlength=len(kept))
    # The sum of a grain's contact numbers is its last contact once all others are gone.
    remaining = np.zeros(len(kept), dtype=np.int64)
    np.add.at(remaining, contacts[rows], rows[:, None])
    loose = np.flatnonzero(degree + held < 2)
    while loose.size:
        kept[loose] = False
        last = np.unique(remaining[loose[degree[loose] == 1]])
        left[last], ends = False, contacts[last]
        np.subtract.at(degree, ends, 1)
        np.subtract.at(remaining, ends, last[:, None])
        touched = np.unique(ends)
        loose = touched[kept[touched] & (degree[touched] + held[touched] < 2)]
    return kept, left


def component_labels(grains: int, contacts: Integers, kept: Flags) -> tuple[int, Integers]:
    """Number the connected components of the kept grains by their smallest grain."""
    # Every grain points at a smaller one of its component, in the end at the smallest.
    i, j = contacts.T
    root, before = np.arange(grains), np.full(grains, -1)
    while (root != before).any():
        before = root.copy()
        smaller = np.minimum(before[i], before[j])
        np.minimum.at(root, before[i], smaller)
        np.minimum.at(root, before[j], smaller)
        root = root[root]
    smallest, number = np.unique(root[kept], return_inverse=True)
    numbered = np.full(grains, -1)
    numbered[kept] = number
    return len(smallest), numbered


def component_counts(graph: GrainGraph) -> tuple[Integers, Integers, Integers]:
    """Grains, contacts and windings of every component, dangling grains left out."""
    kept_grains, kept_contacts = prune_dangling(graph)
    contacts = graph.contacts[kept_contacts]
    count, label = component_labels(graph.grain_count, contacts, kept_grains)
    vertices = np.bincount(label[kept_grains], minlength=count)
    edges = np.bincount(label[contacts[:, 0]], minlength=count)
    if graph.images is None:
        return vertices, edges, np.zeros(count, dtype=np.int64)
    return vertices, edges, winding_ranks(contacts, graph.images[kept_contacts], label, count)


def winding_ranks(contacts: Integers, images: Integers, label: Integers, count: int) -> Integers:
    """Number of independent directions in which each component winds around the periodic cell.

    A spanning forest gives every grain an integer offset; the images of the other contacts less
    these offsets are the windings of the component's cycles. Faces are not used.
    """
    # Offset: periodic image of each grain when reached from its component's first grain.
    start, end = np.concatenate([contacts, contacts[:, ::-1]]).T
    steps = np.concatenate([images, -images])
    of_grain, degree = np.argsort(start, kind="stable"), np.bincount(start, minlength=len(label))
    first = np.cumsum(degree) - degree
    tree, root = np.unique(label, return_index=True)
    reached = root[tree >= 0]
    offset, known = np.zeros((len(label), 2), dtype=np.int64), np.zeros(len(label), dtype=bool)
    known[reached] = True
    while reached.size:
        # All contacts of the grains reached last, then one that leads to each new grain.
        counts = degree[reached]
        shift = first[reached] - np.cumsum(counts) + counts
        onward = of_grain[np.arange(counts.sum()) + np.repeat(shift, counts)]
        onward = onward[~known[end[onward]]]
        reached, one = np.unique(end[onward], return_index=True)
        offset[reached] = offset[start[onward[one]]] + steps[onward[one]]
        known[reached] = True
    i, j = contacts.T
    winding = offset[i] + images - offset[j]
    around = winding.any(axis=1)
    winding, where = winding[around], label[i[around]]
    ranks = np.zeros(count, dtype=np.int64)
    ranks[where] = 1
    one = np.zeros((count, 2), dtype=np.int64)
    one[where] = winding
    across = one[where, 0] * winding[:, 1] != one[where, 1] * winding[:, 0]
    ranks[where[across]] = 2
    return ranks
