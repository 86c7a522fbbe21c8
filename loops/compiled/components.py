"""Connected components of a contact network, and how they wind around a periodic cell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from loops.compiled.kernel import kernel
from loops.compiled.local_network import local_network, prune

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]
Long = NDArray[np.int64]


@kernel
def component_counts(x: Floats, contacts: Long, images: Long) -> tuple[Long, Long, Long]:
    """Grains, contacts and winding of every component, dangling grains left out.

    Parameters
    ----------
    x : (G, 2) array
        Centres.
    contacts : (C, 2) array of int
        Contacts.
    images : (C, 2) or (0, 2) array of int
        Their periodic images; no row in the plane.

    Returns
    -------
    vertices, edges : (count,) array of int
        Of each component, numbered by its smallest grain.
    ranks : (count,) array of int
        As `winding_ranks` has them, from a spanning forest.
    """
    network, degree = prune(local_network(x, contacts))
    ends, number = network.ends, network.contact
    label = component_labels(ends, network.place, degree)
    count = label.max() + 1 if len(label) else 0
    vertices, edges = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    for k in range(len(label)):
        if label[k] >= 0:
            vertices[label[k]] += 1
    for c in range(len(ends)):
        edges[label[ends[c, 0]]] += 1
    ranks, one = np.zeros(count, dtype=np.int64), np.zeros((count, 2), dtype=np.int64)
    if len(images):
        offset = _forest_offsets(ends, number, images, len(label))
        for c in range(len(ends)):
            i, j, where = ends[c, 0], ends[c, 1], label[ends[c, 0]]
            p = offset[i, 0] + images[number[c], 0] - offset[j, 0]
            q = offset[i, 1] + images[number[c], 1] - offset[j, 1]
            if ranks[where] == 0 and (p != 0 or q != 0):
                ranks[where], one[where, 0], one[where, 1] = 1, p, q
            elif one[where, 0] * q != one[where, 1] * p:
                ranks[where] = 2
    return vertices, edges, ranks


@kernel
def component_labels(ends: Integers, place: Integers, degree: Integers) -> Integers:
    """Component of each local grain, numbered by its smallest grain in the graph.

    Parameters
    ----------
    ends : (E, 2) array of int32
        Contacts between local grains, none dangling.
    place : (G,) array of int32
        Local number of each grain of the graph.
    degree : (G,) array of int32
        Contacts of each local grain.

    Returns
    -------
    (G,) array of int32
        Components, -1 for a grain without contacts.
    """
    parent = np.arange(len(degree)).astype(np.int32)
    for c in range(len(ends)):
        i, j = _root(parent, ends[c, 0]), _root(parent, ends[c, 1])
        if i != j:
            parent[max(i, j)] = min(i, j)
    label = np.full(len(degree), -1, dtype=np.int32)
    count = 0
    for k in place:
        if degree[k] > 0:
            root = _root(parent, k)
            if label[root] < 0:
                label[root] = count
                count += 1
            label[k] = label[root]
    return label


@kernel
def _root(parent: Integers, k: int) -> int:
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@kernel
def _forest_offsets(ends: Integers, number: Integers, images: Long, grains: int) -> Long:
    """Periodic image of each local grain when reached from its tree's root."""
    parent = np.arange(grains).astype(np.int32)
    offset = np.zeros((grains, 2), dtype=np.int64)
    for c in range(len(ends)):
        i = _root_with_offset(parent, offset, ends[c, 0])
        j = _root_with_offset(parent, offset, ends[c, 1])
        if i == j:
            continue
        # The larger root goes below the smaller one, so that the contact's image is met.
        low, high, sign = (i, j, 1) if i < j else (j, i, -1)
        for a in range(2):
            from_i = offset[ends[c, 0], a] + images[number[c], a]
            offset[high, a] = sign * (from_i - offset[ends[c, 1], a])
        parent[high] = low
    for k in range(grains):
        _root_with_offset(parent, offset, k)
    return offset


@kernel
def _root_with_offset(parent: Integers, offset: Long, k: int) -> int:
    """Root of a grain, which then hangs on it directly; offsets are towards the parent."""
    root = k
    p, q = 0, 0
    while parent[root] != root:
        p += offset[root, 0]
        q += offset[root, 1]
        root = parent[root]
    while parent[k] != root and k != root:
        ahead, own_p, own_q = parent[k], offset[k, 0], offset[k, 1]
        parent[k], offset[k, 0], offset[k, 1] = root, p, q
        p -= own_p
        q -= own_q
        k = ahead
    return root
