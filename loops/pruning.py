"""Dangling grains and connected components of a contact graph, and how these wind."""

from __future__ import annotations

import numpy as np

from loops.arrays import Flags, Integers
from loops.graph import GrainGraph


def prune_dangling(graph: GrainGraph) -> tuple[Flags, Flags]:
    """Remove grains with fewer than two contacts, again and again until none is left.

    What remains is the 2-core of the contact graph: the only part that loops can pass through.
    A contact of a grain with its own periodic image counts twice.

    Parameters
    ----------
    graph : GrainGraph
        The contact graph; only its topology is read.

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
    contacts, grains = graph.contacts, graph.grain_count
    degree = np.bincount(contacts.ravel(), minlength=grains)
    # The sum of a grain's contact numbers is its last contact once all others are gone.
    remaining = np.zeros(grains, dtype=np.int64)
    np.add.at(remaining, contacts, np.arange(len(contacts))[:, None])
    kept_contacts = np.ones(len(contacts), dtype=bool)
    leaves = np.flatnonzero(degree == 1)
    while leaves.size:
        last = np.unique(remaining[leaves])
        kept_contacts[last] = False
        ends = contacts[last]
        np.subtract.at(degree, ends, 1)
        np.subtract.at(remaining, ends, last[:, None])
        touched = np.unique(ends)
        leaves = touched[degree[touched] == 1]
    return degree > 0, kept_contacts


def component_labels(grains: int, contacts: Integers, kept: Flags) -> tuple[int, Integers]:
    """Number the connected components of the kept grains by their smallest grain."""
    # Loaded here, since the kernels do without scipy.
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    links = csr_array((np.ones(len(contacts)), contacts.T), shape=(grains, grains))
    _, label = connected_components(links, directed=False)
    _, first, inverse = np.unique(label[kept], return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    numbered = np.full(grains, -1)
    numbered[kept] = rank[inverse]
    return len(first), numbered


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
    offset = _forest_offsets(contacts, images, label, count)
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


def _forest_offsets(contacts: Integers, images: Integers, label: Integers, count: int) -> Integers:
    """Periodic image of each grain when reached from its component's first grain."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order

    grains = len(label)
    tree, first = np.unique(label, return_index=True)
    roots = first[tree >= 0]
    start = np.concatenate([contacts[:, 0], contacts[:, 1], np.full(count, grains)])
    end = np.concatenate([contacts[:, 1], contacts[:, 0], roots])
    links = csr_array((np.ones(len(start)), (start, end)), shape=(grains + 1, grains + 1))
    _, parent = breadth_first_order(links, grains)
    parent = np.where(parent < 0, grains, parent)
    # If two contacts join a grain to its parent, the tree holds either of them.
    step = np.flatnonzero(parent[end[:-count]] == start[:-count])
    chosen = np.full(grains + 1, -1)
    chosen[end[step]] = step
    steps = np.concatenate([images, -images, [[0, 0]]])
    offset = steps[chosen]
    while (parent < grains).any():
        offset += offset[parent]
        parent = parent[parent]
    return offset[:-1]
