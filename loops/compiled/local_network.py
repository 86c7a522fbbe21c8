"""A contact network in a numbering of its own that follows space, without dangling grains."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops.compiled.kernel import kernel
from loops.compiled.spatial_order import spatial_order

Integers = NDArray[np.int32]


class LocalNetwork(NamedTuple):
    """Grains along space; contacts by their first grain. Numbers are local but for `grain`."""

    grain: Integers  # (G,) number in the graph
    place: Integers  # (G,) local number of each grain of the graph
    x: NDArray[np.float64]  # (G, 2)
    contact: Integers  # (E,) number in the graph
    ends: Integers  # (E, 2)


@kernel
def local_network(x: NDArray[np.float64], contacts: NDArray[np.int64]) -> LocalNetwork:
    """Renumber grains along space and contacts by their first grain.

    Parameters
    ----------
    x : (G, 2) array
        Centres.
    contacts : (C, 2) array of int
        Contacts.

    Returns
    -------
    LocalNetwork
        All grains and contacts.
    """
    grain = spatial_order(x)
    grains, count = len(grain), len(contacts)
    place = np.empty(grains, dtype=np.int32)
    sorted_x = np.empty((grains, 2))
    for k in range(grains):
        g = grain[k]
        place[g] = k
        sorted_x[k, 0], sorted_x[k, 1] = x[g, 0], x[g, 1]
    begin = np.zeros(grains + 1, dtype=np.int32)
    first = np.empty(count, dtype=np.int32)
    for c in range(count):
        first[c] = place[contacts[c, 0]]
        begin[first[c] + 1] += 1
    for k in range(grains):
        begin[k + 1] += begin[k]
    number = np.empty(count, dtype=np.int32)
    ends = np.empty((count, 2), dtype=np.int32)
    for c in range(count):
        k = begin[first[c]]
        begin[first[c]] += 1
        number[k] = c
        ends[k, 0], ends[k, 1] = first[c], place[contacts[c, 1]]
    return LocalNetwork(grain, place, sorted_x, number, ends)


@kernel
def prune(network: LocalNetwork) -> tuple[LocalNetwork, Integers]:
    """Remove grains with fewer than two contacts until none is left.

    Parameters
    ----------
    network : LocalNetwork
        All grains and contacts.

    Returns
    -------
    LocalNetwork
        The contacts that are left; grains keep their numbers.
    degree : (G,) array of int32
        Contacts left to each grain, one with its own image counted twice.
    """
    ends, count = network.ends, len(network.ends)
    degree = np.zeros(len(network.grain), dtype=np.int32)
    # All contacts of a grain in one number: its last contact once the others are gone.
    remaining = np.zeros(len(network.grain), dtype=np.int32)
    for c in range(count):
        for side in range(2):
            degree[ends[c, side]] += 1
            remaining[ends[c, side]] ^= c
    kept = np.ones(count, dtype=np.bool_)
    left = count
    for g in range(len(degree)):
        leaf = g
        while degree[leaf] == 1:
            c = remaining[leaf]
            kept[c] = False
            left -= 1
            other = ends[c, 0] + ends[c, 1] - leaf
            degree[leaf] = 0
            degree[other] -= 1
            remaining[other] ^= c
            leaf = other
    if left == count:
        return network, degree
    number = np.empty(left, dtype=np.int32)
    left_ends = np.empty((left, 2), dtype=np.int32)
    k = 0
    for c in range(count):
        if kept[c]:
            number[k] = network.contact[c]
            left_ends[k, 0], left_ends[k, 1] = ends[c, 0], ends[c, 1]
            k += 1
    return LocalNetwork(network.grain, network.place, network.x, number, left_ends), degree


@kernel
def local_branches(
    network: LocalNetwork, images: NDArray[np.int64], cell: NDArray[np.float64]
) -> tuple[NDArray[np.float64], Integers]:
    """Branch vectors and periodic images of the local contacts.

    Parameters
    ----------
    network : LocalNetwork
        Contacts at hand.
    images : (C, 2) or (0, 2) array of int
        Images of the graph's contacts; no row in the plane.
    cell : (2, 2) array
        Periodic cell.

    Returns
    -------
    d : (E, 2) array
        Branch vectors.
    images : (E, 2) or (0, 2) array of int32
        Images.
    """
    count, x = len(network.ends), network.x
    d = np.empty((count, 2))
    local = np.empty((count if len(images) else 0, 2), dtype=np.int32)
    for c in range(count):
        i, j = network.ends[c, 0], network.ends[c, 1]
        d[c, 0], d[c, 1] = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1]
        if len(images):
            p, q = images[network.contact[c], 0], images[network.contact[c], 1]
            local[c, 0], local[c, 1] = p, q
            d[c, 0] += cell[0, 0] * p + cell[0, 1] * q
            d[c, 1] += cell[1, 0] * p + cell[1, 1] * q
    return d, local
