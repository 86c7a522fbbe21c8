"""Faces of a contact graph, walked half-edge by half-edge."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from loops.compiled.components import component_labels
from loops.compiled.half_edges import following_half_edges
from loops.compiled.kernel import kernel
from loops.compiled.local_network import LocalNetwork, local_branches, local_network, prune

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Integers = NDArray[np.int32]
Long = NDArray[np.int64]


@kernel
def plane_faces(
    x: Floats, contacts: Long, images: Long, cell: Floats
) -> tuple[bool, Long, Long, Long, Mask, Floats, Mask, Long]:
    """Faces in the form of `Faces`.

    Parameters
    ----------
    x : (G, 2) array
        Centres.
    contacts : (C, 2) array of int
        Contacts.
    images : (C, 2) or (0, 2) array of int
        Their periodic images; no row in the plane.
    cell : (2, 2) array
        Periodic cell.

    Returns
    -------
    good : bool
        False if two branches of a grain have the same direction, or doubles cannot tell; the rest
        then means nothing.
    offsets, grains, contacts, forward, area : arrays
        As in `Faces`.
    winds : (F,) array of bool
        Whether the images along the face do not add up to zero.
    component : (F,) array of int
        As in `Faces`.
    """
    network, degree = prune(local_network(x, contacts))
    d, local_images = local_branches(network, images, cell)
    following, good = following_half_edges(network.ends, degree, d)
    begin, member, smallest = _walk(following, network.contact)
    area, winds = _measure(begin, member, d, local_images)
    label = component_labels(network.ends, network.place, degree)
    order = _by_smallest(smallest, 2 * len(contacts))
    component = np.empty(len(order), dtype=np.int64)
    for f in range(len(order)):
        h = member[begin[order[f]]]
        component[f] = label[network.ends[h >> 1, h & 1]]
    offsets, grains, numbers, forward = _in_order(order, begin, member, network)
    return good, offsets, grains, numbers, forward, area[order], winds[order], component


@kernel
def _walk(following: Integers, number: Integers) -> tuple[Integers, Integers, Integers]:
    """Cycles of the permutation, which is used up.

    Where each begins, its members from the smallest on as the graph numbers them, that smallest.
    """
    begin = np.empty(len(following) + 1, dtype=np.int32)
    smallest = np.empty(len(following), dtype=np.int32)
    member = np.empty(len(following), dtype=np.int32)
    faces, k = 0, 0
    for first in range(len(following)):
        if following[first] < 0:
            continue
        begin[faces] = k
        start, least = first, 2 * number[first >> 1] + (first & 1)
        h = following[first]
        while h != first:
            own = 2 * number[h >> 1] + (h & 1)
            if own < least:
                start, least = h, own
            h = following[h]
        h = start
        while following[h] >= 0:
            member[k] = h
            k += 1
            ahead = following[h]
            following[h] = -1
            h = ahead
        smallest[faces] = least
        faces += 1
    begin[faces] = k
    return begin[: faces + 1].copy(), member, smallest[:faces].copy()


@kernel
def _measure(begin: Integers, member: Integers, d: Floats, images: Integers) -> tuple[Floats, Mask]:
    """Signed area of each face, from the corner where it starts, and whether it winds."""
    faces = len(begin) - 1
    area, winds = np.empty(faces), np.zeros(faces, dtype=np.bool_)
    for f in range(faces):
        double, x, y, p, q = 0.0, 0.0, 0.0, 0, 0
        for k in range(begin[f], begin[f + 1]):
            c, sign = member[k] >> 1, 1 - 2 * (member[k] & 1)
            dx, dy = sign * d[c, 0], sign * d[c, 1]
            double += x * dy - y * dx
            x += dx
            y += dy
            if len(images):
                p += sign * images[c, 0]
                q += sign * images[c, 1]
        area[f] = 0.5 * double
        winds[f] = p != 0 or q != 0
    return area, winds


@kernel
def _by_smallest(smallest: Integers, half_edges: int) -> Integers:
    """Faces by their smallest half-edge."""
    face_of = np.full(half_edges, -1, dtype=np.int32)
    for f in range(len(smallest)):
        face_of[smallest[f]] = f
    order = np.empty(len(smallest), dtype=np.int32)
    f = 0
    for face in face_of:
        if face >= 0:
            order[f] = face
            f += 1
    return order


@kernel
def _in_order(
    order: Integers, begin: Integers, member: Integers, network: LocalNetwork
) -> tuple[Long, Long, Long, Mask]:
    """Half-edges face by face, in the graph's numbers."""
    half_edges = len(member)
    # Looked up along space first: a face is then one place in memory.
    own, from_grain = np.empty(half_edges, dtype=np.int32), np.empty(half_edges, dtype=np.int32)
    for k in range(half_edges):
        h = member[k]
        own[k] = 2 * network.contact[h >> 1] + (h & 1)
        from_grain[k] = network.grain[network.ends[h >> 1, h & 1]]
    offsets = np.zeros(len(order) + 1, dtype=np.int64)
    grains, contacts = np.empty(half_edges, dtype=np.int64), np.empty(half_edges, dtype=np.int64)
    forward = np.empty(half_edges, dtype=np.bool_)
    out = 0
    for f in range(len(order)):
        for k in range(begin[order[f]], begin[order[f] + 1]):
            grains[out], contacts[out] = from_grain[k], own[k] >> 1
            forward[out] = own[k] & 1 == 0
            out += 1
        offsets[f + 1] = out
    return offsets, grains, contacts, forward
