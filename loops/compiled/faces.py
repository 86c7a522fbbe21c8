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
    begin, member = _walk(following, network, local_images)
    area, winds = _measure(begin, member, d, local_images)
    label = component_labels(network.ends, network.place, degree)
    order = _by_first(begin, member, network, local_images)
    component = np.empty(len(order), dtype=np.int64)
    for f in range(len(order)):
        h = member[begin[order[f]]]
        component[f] = label[network.ends[h >> 1, h & 1]]
    offsets, grains, numbers, forward = _in_order(order, begin, member, network)
    return good, offsets, grains, numbers, forward, area[order], winds[order], component


@kernel
def _walk(
    following: Integers, network: LocalNetwork, images: Integers
) -> tuple[Integers, Integers]:
    """Cycles of the permutation, which is used up: where each begins, its members from the first.

    The first of a cycle is the one of `Faces`: smallest grain, then smallest next grain.
    """
    begin = np.empty(len(following) + 1, dtype=np.int32)
    member = np.empty(len(following), dtype=np.int32)
    # Grains that the half-edges leave, in the graph's numbers.
    leaves = np.empty(len(following), dtype=np.int32)
    for c in range(len(network.ends)):
        leaves[2 * c] = network.grain[network.ends[c, 0]]
        leaves[2 * c + 1] = network.grain[network.ends[c, 1]]
    faces, k = 0, 0
    for any_one in range(len(following)):
        if following[any_one] < 0:
            continue
        begin[faces] = k
        start, least = any_one, leaves[any_one]
        h = following[any_one]
        while h != any_one:
            grain = leaves[h]
            if grain < least or (grain == least and _before(h, start, network, images)):
                start, least = h, grain
            h = following[h]
        h = start
        while following[h] >= 0:
            member[k] = h
            k += 1
            ahead = following[h]
            following[h] = -1
            h = ahead
        faces += 1
    begin[faces] = k
    return begin[: faces + 1].copy(), member


@kernel
def _grain(network: LocalNetwork, half_edge: int) -> int:
    """Grain that a half-edge leaves, in the graph's numbers."""
    return network.grain[network.ends[half_edge >> 1, half_edge & 1]]


@kernel
def _before(a: int, b: int, network: LocalNetwork, images: Integers) -> bool:
    """Whether half-edge a comes before b: by first grain, second grain, image."""
    one, other = _grain(network, a), _grain(network, b)
    if one == other:
        one, other = _grain(network, a ^ 1), _grain(network, b ^ 1)
    if one != other or len(images) == 0:
        return one < other
    sign_a, sign_b = 1 - 2 * (a & 1), 1 - 2 * (b & 1)
    one, other = sign_a * images[a >> 1, 0], sign_b * images[b >> 1, 0]
    if one == other:
        one, other = sign_a * images[a >> 1, 1], sign_b * images[b >> 1, 1]
    return one < other


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
def _by_first(
    begin: Integers, member: Integers, network: LocalNetwork, images: Integers
) -> Integers:
    """Faces by their first half-edge: sorted by its second grain, then by its first."""
    faces = len(begin) - 1
    order, other = np.arange(faces).astype(np.int32), np.empty(faces, dtype=np.int32)
    for flip in (1, 0):
        start = np.zeros(len(network.grain) + 1, dtype=np.int32)
        for f in range(faces):
            start[_grain(network, member[begin[f]] ^ flip) + 1] += 1
        for g in range(len(network.grain)):
            start[g + 1] += start[g]
        for face in order:
            g = _grain(network, member[begin[face]] ^ flip)
            other[start[g]] = face
            start[g] += 1
        order, other = other, order
    # Only images are left to tell apart two with both grains in common.
    for k in range(1, faces if len(images) else 0):
        late, at = order[k], k
        first = member[begin[late]]
        while at > 0 and _before(first, member[begin[order[at - 1]]], network, images):
            order[at] = order[at - 1]
            at -= 1
        order[at] = late
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
