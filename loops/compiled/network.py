"""Kernels of contact networks: faces and components.

Grains and contacts are numbered anew along space (local numbers), so that neighbours lie close in
memory. Arrays: centres `x` (G, 2), `contacts` (C, 2), their `branches` (C, 2) and periodic `images`
(C, 2), without rows in the plane.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Flags, Floats, Integers
from loops.compiled import inlined, kernel

Short = NDArray[np.int32]
BITS = 11  # bins along each axis: 2^11, their codes sorted in two passes of 2^11 counters
BINS = 2**BITS
COUNTING_SORT_MAX = 16  # a grain with more contacts has them sorted by numpy
# Directions closer than this are left to exact arithmetic; their rounding is a hundredth of it.
CLOSE = 1e-13


@kernel
def spatial_order(x: Floats) -> Short:
    """(G,) grains along a Z-shaped curve through a grid of bins; within a bin, by number."""
    grains = len(x)
    low0, low1, high0, high1 = x[0, 0], x[0, 1], x[0, 0], x[0, 1]
    for g in range(grains):
        low0, high0 = min(low0, x[g, 0]), max(high0, x[g, 0])
        low1, high1 = min(low1, x[g, 1]), max(high1, x[g, 1])
    scale0, scale1 = _bins_per_length(low0, high0), _bins_per_length(low1, high1)
    # The code of the bin in the upper 32 bits, the grain in the lower ones.
    keys = np.empty(grains, dtype=np.int64)
    for g in range(grains):
        column, row = int((x[g, 0] - low0) * scale0), int((x[g, 1] - low1) * scale1)
        keys[g] = (_spread(column) | (_spread(row) << 1)) << 32 | g
    other = np.empty_like(keys)
    _sort_by_digit(keys, other, 32)
    _sort_by_digit(other, keys, 32 + BITS)
    order = np.empty(grains, dtype=np.int32)
    for g in range(grains):
        order[g] = keys[g] & 0x7FFFFFFF
    return order


@inlined
def _bins_per_length(low: float, high: float) -> float:
    # Slightly less than the number of bins, so that the last grain falls into the last bin.
    return (BINS - 0.001) / (high - low) if high > low else 0.0


@inlined
def _spread(value: int) -> int:
    """Spread the bits of a number to the even places, zeros between them."""
    value = (value | (value << 8)) & 0x00FF00FF
    value = (value | (value << 4)) & 0x0F0F0F0F
    value = (value | (value << 2)) & 0x33333333
    return (value | (value << 1)) & 0x55555555


@kernel
def _sort_by_digit(keys: Integers, out: Integers, shift: int) -> None:
    """One pass of a radix sort, stable."""
    begin = np.zeros(BINS + 1, dtype=np.int64)
    for key in keys:
        begin[((key >> shift) & (BINS - 1)) + 1] += 1
    for digit in range(BINS):
        begin[digit + 1] += begin[digit]
    for key in keys:
        digit = (key >> shift) & (BINS - 1)
        out[begin[digit]] = key
        begin[digit] += 1


class LocalNetwork(NamedTuple):
    """Grains sorted along space, contacts by their first grain."""

    grain: Short  # (G,) number in the graph
    place: Short  # (G,) local number of each grain of the graph
    x: Floats  # (G, 2)
    contact: Short  # (E,) number in the graph
    ends: Short  # (E, 2)


@kernel
def local_network(x: Floats, contacts: Integers) -> LocalNetwork:
    """Renumber grains along space and contacts by their first grain."""
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
def prune(network: LocalNetwork) -> tuple[LocalNetwork, Short]:
    """Remove grains with fewer than two contacts until none is left; grains keep their numbers.

    Return also the remaining degrees (G,); a contact of a grain with its own image counts twice.
    """
    ends, count = network.ends, len(network.ends)
    degree = np.zeros(len(network.grain), dtype=np.int32)
    # XOR of the numbers of a grain's contacts: its last contact once the others are removed.
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
    network: LocalNetwork, images: Integers, branches: Floats
) -> tuple[Floats, Short]:
    """Branch vectors (E, 2) and periodic images (E, 2) or (0, 2) of the local contacts."""
    count = len(network.ends)
    d = np.empty((count, 2))
    local = np.empty((count if len(images) else 0, 2), dtype=np.int32)
    for c in range(count):
        number = network.contact[c]
        d[c, 0], d[c, 1] = branches[number, 0], branches[number, 1]
        if len(images):
            local[c, 0], local[c, 1] = images[number, 0], images[number, 1]
    return d, local


@kernel
def following_half_edges(ends: Short, degree: Short, d: Floats) -> tuple[Short, bool]:
    """(2 E,) next half-edge of each: at its end, clockwise from its opposite half-edge.

    Return also whether all directions differ by more than their rounding.
    """
    begin, edge, angle = _around_grains(ends, degree, d)
    following = np.empty(2 * len(ends), dtype=np.int32)
    order = np.empty(degree.max() if len(degree) else 0, dtype=np.int32)
    good = True
    for g in range(len(degree)):
        first, n = begin[g], degree[g]
        here = slice(first, first + n)
        if n > COUNTING_SORT_MAX or not _sort_by_angle(edge[here], angle[here], order):
            ranked = first + np.argsort(angle[here])
            for k in range(n):
                order[k] = edge[ranked[k]]
                good &= k == 0 or angle[ranked[k]] - angle[ranked[k - 1]] > CLOSE
        for k in range(n):
            following[order[k] ^ 1] = order[k - 1 if k > 0 else n - 1]
    return following, good


@kernel
def _around_grains(ends: Short, degree: Short, d: Floats) -> tuple[Short, Short, Floats]:
    """Half-edges sorted by the grain that they leave, and a monotone measure of their angles."""
    begin = np.empty(len(degree) + 1, dtype=np.int32)
    begin[0] = 0
    for g in range(len(degree)):
        begin[g + 1] = begin[g] + degree[g]
    at = begin.copy()
    edge, angle = np.empty(2 * len(ends), dtype=np.int32), np.empty(2 * len(ends))
    for c in range(len(ends)):
        dx, dy = d[c, 0], d[c, 1]
        cosine = dx / (abs(dx) + abs(dy))
        i, j = ends[c, 0], ends[c, 1]
        edge[at[i]], angle[at[i]] = 2 * c, 3.0 + cosine if dy < 0.0 else 1.0 - cosine
        at[i] += 1
        edge[at[j]], angle[at[j]] = 2 * c + 1, 3.0 - cosine if dy > 0.0 else 1.0 + cosine
        at[j] += 1
    return begin, edge, angle


@inlined
def _sort_by_angle(edge: Short, angle: Floats, order: Short) -> bool:
    """Sort half-edges by counting smaller angles; False if two angles are too close to compare."""
    apart = True
    for k in range(len(edge)):
        rank = 0
        for other in range(len(edge)):
            rank += angle[other] < angle[k]
            apart &= (other == k) | (abs(angle[other] - angle[k]) > CLOSE)
        order[rank] = edge[k]
    # Angles just above zero and just below a whole turn are adjacent in the cycle either way.
    return apart


@kernel
def network_components(
    x: Floats, contacts: Integers, images: Integers
) -> tuple[Integers, Integers, Integers]:
    """Grains, contacts and winding rank of every component, dangling grains left out.

    Components are numbered by their smallest grain; ranks, as `winding_ranks` has them, come from a
    spanning forest.
    """
    network, degree = prune(local_network(x, contacts))
    ends, number = network.ends, network.contact
    label = _component_labels(ends, network.place, degree)
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
def _component_labels(ends: Short, place: Short, degree: Short) -> Short:
    """(G,) component of each local grain, by smallest grain in the graph; -1 without contacts."""
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


@inlined
def _root(parent: Short, k: int) -> int:
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@kernel
def _forest_offsets(ends: Short, number: Short, images: Integers, grains: int) -> Integers:
    """Periodic image of each local grain when reached from its tree's root."""
    parent = np.arange(grains).astype(np.int32)
    offset = np.zeros((grains, 2), dtype=np.int64)
    for c in range(len(ends)):
        i = _root_with_offset(parent, offset, ends[c, 0])
        j = _root_with_offset(parent, offset, ends[c, 1])
        if i == j:
            continue
        # Attach the larger root to the smaller one; its offset agrees with the contact's image.
        low, high, sign = (i, j, 1) if i < j else (j, i, -1)
        for a in range(2):
            from_i = offset[ends[c, 0], a] + images[number[c], a]
            offset[high, a] = sign * (from_i - offset[ends[c, 1], a])
        parent[high] = low
    for k in range(grains):
        _root_with_offset(parent, offset, k)
    return offset


@kernel
def _root_with_offset(parent: Short, offset: Integers, k: int) -> int:
    """Root of a grain, with path compression; offsets are relative to the parent."""
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


@kernel
def plane_faces(
    x: Floats, contacts: Integers, images: Integers, branches: Floats
) -> tuple[bool, Integers, Integers, Integers, Flags, Floats, Flags, Integers]:
    """Faces of a network: offsets, grains, contacts, forward and area, as in `Faces`.

    First, whether all directions differ by more than their rounding; last, whether each face winds
    around the cell (its images do not add up to zero), and its component.
    """
    network, degree = prune(local_network(x, contacts))
    d, local_images = local_branches(network, images, branches)
    following, good = following_half_edges(network.ends, degree, d)
    begin, member = _walk(following, network, local_images)
    area, winds = _measure(begin, member, d, local_images)
    label = _component_labels(network.ends, network.place, degree)
    order = _by_first(begin, member, network, local_images)
    component = np.empty(len(order), dtype=np.int64)
    for f in range(len(order)):
        h = member[begin[order[f]]]
        component[f] = label[network.ends[h >> 1, h & 1]]
    offsets, grains, numbers, forward = _in_order(order, begin, member, network)
    return good, offsets, grains, numbers, forward, area[order], winds[order], component


@kernel
def _walk(following: Short, network: LocalNetwork, images: Short) -> tuple[Short, Short]:
    """Cycles of the permutation `following` (overwritten): begin of each, members in order.

    A cycle starts as in `Faces`: at the smallest grain, then by the smallest next grain.
    """
    begin = np.empty(len(following) + 1, dtype=np.int32)
    member = np.empty(len(following), dtype=np.int32)
    # Grain that each half-edge leaves, in the numbering of the graph.
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


@inlined
def _grain(network: LocalNetwork, half_edge: int) -> int:
    """Grain that a half-edge leaves, in the numbering of the graph."""
    return network.grain[network.ends[half_edge >> 1, half_edge & 1]]


@inlined
def _before(a: int, b: int, network: LocalNetwork, images: Short) -> bool:
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
def _measure(begin: Short, member: Short, d: Floats, images: Short) -> tuple[Floats, Flags]:
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
def _by_first(begin: Short, member: Short, network: LocalNetwork, images: Short) -> Short:
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
    # Two faces with the same first two grains are ordered by their periodic images.
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
    order: Short, begin: Short, member: Short, network: LocalNetwork
) -> tuple[Integers, Integers, Integers, Flags]:
    """Half-edges face by face, in the numbering of the graph."""
    half_edges = len(member)
    # Gathered in local order first: the half-edges of a face are then close in memory.
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
