"""Kernels of contact networks: faces, components and crossing branches.

All of them work in a numbering of their own that follows space, so that neighbours lie close in
memory. Arrays: centres `x` (G, 2), `contacts` (C, 2), periodic `images` (C, 2), no row of them in
the plane, `cell` (2, 2).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Flags, Floats, Integers
from loops.compiled.kernel import kernel

Short = NDArray[np.int32]
BITS = 11  # bins along each axis: 2^11, their codes sorted in two passes of 2^11 counters
BINS = 2**BITS
SPLITTER = 2.0**27 + 1.0
# Within these sizes neither a product nor its rounding error leaves the range of doubles.
TINY, HUGE = 1e-250, 1e150
UNDECIDED = 2
FEW = 16  # grains with more contacts have them sorted by merging
CLOSE = 1e-13  # angles, as this module measures them, are right to a hundredth of it
MARGIN = 1e-9  # of a bin: a branch this close to a bin counts as passing it
ROUND_OFF = 8 * float(np.finfo(np.float64).eps)
FARTHEST = 2**14  # cells that a branch may pass
WORK = 100  # comparisons per contact, and a hundred thousand, beyond which bins are too crowded


@kernel
def spatial_order(x: Floats) -> Short:
    """(G,) grains along a Z-shaped curve through a grid of bins, those of one bin by number."""
    grains = len(x)
    low0, low1, high0, high1 = x[0, 0], x[0, 1], x[0, 0], x[0, 1]
    for g in range(grains):
        low0, high0 = min(low0, x[g, 0]), max(high0, x[g, 0])
        low1, high1 = min(low1, x[g, 1]), max(high1, x[g, 1])
    scale0, scale1 = _bins_per_length(low0, high0), _bins_per_length(low1, high1)
    # The code of the bin above, the grain below.
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


@kernel
def _bins_per_length(low: float, high: float) -> float:
    # A hair less than all, so that the last grain falls into the last bin.
    return (BINS - 0.001) / (high - low) if high > low else 0.0


@kernel
def _spread(value: int) -> int:
    """The bits of a number on even places, zeros between them."""
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
    """Grains along space; contacts by their first grain. Numbers are local but for `grain`."""

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

    Besides the degrees (G,) that are left, a contact of a grain with its own image counted twice.
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
def local_branches(network: LocalNetwork, images: Integers, cell: Floats) -> tuple[Floats, Short]:
    """Branch vectors (E, 2) and periodic images (E, 2) or (0, 2) of the local contacts."""
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


@kernel
def product_error(a: float, b: float, product: float) -> float:
    """Rounding error of a product, `a b - product` (Dekker), within `TINY` and `HUGE`."""
    high_a = SPLITTER * a - (SPLITTER * a - a)
    high_b = SPLITTER * b - (SPLITTER * b - b)
    low_a, low_b = a - high_a, b - high_b
    return low_a * low_b - (((product - high_a * high_b) - low_a * high_b) - high_a * low_b)


@kernel
def turn(ax: float, ay: float, bx: float, by: float) -> int:
    """Sign of `ax by - ay bx`, exactly; `UNDECIDED` where doubles do not reach."""
    left, right = ax * by, ay * bx
    if left > right:
        return 1
    if left < right:
        return -1
    if (ax == 0.0 or by == 0.0) and (ay == 0.0 or bx == 0.0):
        return 0
    largest = max(max(abs(ax), abs(ay)), max(abs(bx), abs(by)))
    if not (abs(left) > TINY and largest < HUGE):
        return UNDECIDED
    left_error, right_error = product_error(ax, by, left), product_error(ay, bx, right)
    if left_error == right_error:
        return 0
    return 1 if left_error > right_error else -1


@kernel
def following_half_edges(ends: Short, degree: Short, d: Floats) -> tuple[Short, bool]:
    """Next half-edge clockwise from the way back, at the end of each half-edge, (2 E,).

    False if two branches of a grain have the same direction, or doubles cannot tell.
    """
    begin, edge, angle = _around_grains(ends, degree, d)
    following = np.empty(2 * len(ends), dtype=np.int32)
    largest = degree.max() if len(degree) else 0
    order, spare = np.empty(largest, dtype=np.int32), np.empty(largest, dtype=np.int32)
    good = True
    for g in range(len(degree)):
        first, n = begin[g], degree[g]
        if n > FEW or not _sort_by_angle(edge[first : first + n], angle[first : first + n], order):
            order[:n] = edge[first : first + n]
            good &= _sort_exactly(d, n, order, spare)
        for k in range(n):
            following[order[k] ^ 1] = order[k - 1 if k > 0 else n - 1]
    return following, good


@kernel
def _around_grains(ends: Short, degree: Short, d: Floats) -> tuple[Short, Short, Floats]:
    """Half-edges by the grain that they leave, and an angle of each that grows with its own."""
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


@kernel
def _sort_by_angle(edge: Short, angle: Floats, order: Short) -> bool:
    """Half-edges by counting the smaller angles; False if two angles are too close to tell."""
    apart = True
    for k in range(len(edge)):
        rank = 0
        for other in range(len(edge)):
            rank += angle[other] < angle[k]
            apart &= (other == k) | (abs(angle[other] - angle[k]) > CLOSE)
        order[rank] = edge[k]
    # Just below a whole turn is next to nothing: the two are adjacent all the same.
    return apart


@kernel
def _sort_exactly(d: Floats, n: int, order: Short, spare: Short) -> bool:
    """Sort n half-edges by direction, merging; False if two are alike or cannot be told apart."""
    good, run = True, 1
    while run < n:
        for start in range(0, n, 2 * run):
            middle, end = min(start + run, n), min(start + 2 * run, n)
            spare[start:end] = order[start:end]
            a, b = start, middle
            for k in range(start, end):
                second = a == middle
                if a < middle and b < end:
                    before = _turned_before(d, spare[b], spare[a])
                    good &= before != UNDECIDED and before != 0
                    second = before == 1
                if second:
                    order[k] = spare[b]
                    b += 1
                else:
                    order[k] = spare[a]
                    a += 1
        run *= 2
    return good


@kernel
def _turned_before(d: Floats, a: int, b: int) -> int:
    """1 if half-edge a comes before b, counter-clockwise from axis 1; -1 after; 0 the same way."""
    sign_a, sign_b = 1 - 2 * (a & 1), 1 - 2 * (b & 1)
    ax, ay = sign_a * d[a >> 1, 0], sign_a * d[a >> 1, 1]
    bx, by = sign_b * d[b >> 1, 0], sign_b * d[b >> 1, 1]
    below_a, below_b = ay < 0.0 or (ay == 0.0 and ax < 0.0), by < 0.0 or (by == 0.0 and bx < 0.0)
    if below_a != below_b:
        return 1 if below_b else -1
    return turn(ax, ay, bx, by)


@kernel
def component_counts(
    x: Floats, contacts: Integers, images: Integers
) -> tuple[Integers, Integers, Integers]:
    """Grains, contacts and winding rank of every component, dangling grains left out.

    Components are numbered by their smallest grain; ranks, as `winding_ranks` has them, come from a
    spanning forest.
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
def component_labels(ends: Short, place: Short, degree: Short) -> Short:
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


@kernel
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
def _root_with_offset(parent: Short, offset: Integers, k: int) -> int:
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


@kernel
def plane_faces(
    x: Floats, contacts: Integers, images: Integers, cell: Floats
) -> tuple[bool, Integers, Integers, Integers, Flags, Floats, Flags, Integers]:
    """Whether all directions could be told apart, and the faces as in `Faces`.

    Offsets, grains, contacts, forward, area, whether the images along a face do not add up to zero,
    component.
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
def _walk(following: Short, network: LocalNetwork, images: Short) -> tuple[Short, Short]:
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
    order: Short, begin: Short, member: Short, network: LocalNetwork
) -> tuple[Integers, Integers, Integers, Flags]:
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


@kernel
def crossing_pairs(
    x: Floats,
    u: Floats,
    home: Integers,
    contacts: Integers,
    images: Integers,
    counts: Integers,
    limit: int,
) -> tuple[int, Integers]:
    """Pairs of contacts whose branches meet elsewhere than in a common grain.

    `u` (G, 2) are the centres in the unit square of the cell or bounding box, `home` (G, 2), no row
    in the plane, the cells they were brought in from, `counts` the columns and rows of bins. Status
    0 when every pair was looked at; 1 when stopped at `limit` pairs; -1 when nothing was, since too
    many branches share a bin, or one passes too many cells. A pair that meets in several bins is
    there as often.
    """
    network = local_network(x, contacts)
    start, vector, reach = _branches(network.grain, network.contact, network.ends, u, home, images)
    pairs = np.empty((min(limit, 1024), 2), dtype=np.int64)
    if np.abs(reach).max() > FARTHEST:
        return -1, pairs[:0]
    begin, contact, shift = _pieces(start, vector, counts, len(home) > 0)
    largest, work = 0, 0
    for b in range(len(begin) - 1):
        size = begin[b + 1] - begin[b]
        largest = max(largest, size)
        work += size * size
    if work > WORK * (len(contacts) + 1000):
        return -1, pairs[:0]
    ends, number = network.ends, network.contact
    # Branches of the bin at hand: start and vector, and one number for either end.
    x0, y0, dx, dy = np.empty(largest), np.empty(largest), np.empty(largest), np.empty(largest)
    tail, head = np.empty(largest, dtype=np.int64), np.empty(largest, dtype=np.int64)
    found = 0
    for b in range(len(begin) - 1):
        first = begin[b]
        for k in range(begin[b + 1] - first):
            c, p, q = contact[first + k], 0, 0
            if len(shift):
                p, q = shift[first + k, 0], shift[first + k, 1]
            ax, ay, adx, ady = start[c, 0] - p, start[c, 1] - q, vector[c, 0], vector[c, 1]
            a_tail = _place(ends[c, 0], -p, -q)
            a_head = _place(ends[c, 1], reach[c, 0] - p, reach[c, 1] - q)
            x0[k], y0[k], dx[k], dy[k], tail[k], head[k] = ax, ay, adx, ady, a_tail, a_head
            for other in range(k):
                bdx, bdy = dx[other], dy[other]
                same_side = (a_tail == tail[other]) | (a_head == head[other])
                end_to_start = (a_tail == head[other]) | (a_head == tail[other])
                if same_side | end_to_start:
                    if not _same_line(adx, ady, bdx, bdy, same_side, end_to_start):
                        continue
                elif not _meet(ax, ay, adx, ady, x0[other], y0[other], bdx, bdy):
                    continue
                if found == len(pairs):
                    pairs = np.concatenate((pairs, np.empty_like(pairs)))
                one, two = number[c], number[contact[first + other]]
                pairs[found, 0], pairs[found, 1] = min(one, two), max(one, two)
                found += 1
                if found == limit:
                    return 1, pairs[:found]
    return 0, pairs[:found]


@kernel
def _branches(
    grain: Short, number: Short, ends: Short, u: Floats, home: Integers, images: Integers
) -> tuple[Floats, Floats, Short]:
    """Start, vector and cell of the end of every local contact."""
    count = len(ends)
    start, vector = np.empty((count, 2)), np.empty((count, 2))
    reach = np.zeros((count, 2), dtype=np.int32)
    for c in range(count):
        i, j = grain[ends[c, 0]], grain[ends[c, 1]]
        for a in range(2):
            if len(home):
                reach[c, a] = home[j, a] + images[number[c], a] - home[i, a]
            start[c, a] = u[i, a]
            vector[c, a] = u[j, a] - u[i, a] + reach[c, a]
    return start, vector, reach


@kernel
def _pieces(
    start: Floats, vector: Floats, counts: Integers, periodic: bool
) -> tuple[Short, Short, Short]:
    """Branches that pass each bin: where they begin, which they are, images of the bin passed.

    Without a cell there are no images, no row.
    """
    columns, rows = counts[0], counts[1]
    room, found = 3 * len(start) + 16, 0
    where, which = np.empty(room, dtype=np.int32), np.empty(room, dtype=np.int32)
    cell = np.empty((room if periodic else 0, 2), dtype=np.int32)
    begin = np.zeros(columns * rows + 1, dtype=np.int32)
    for c in range(len(start)):
        x, dx = start[c, 0] * columns, vector[c, 0] * columns
        y, dy = start[c, 1] * rows, vector[c, 1] * rows
        low, high = _span(x, x + dx)
        for column in range(low, high + 1):
            enter, leave = 0.0, 1.0
            if high > low and dx != 0.0:
                enter = min(max((column + (1 if dx < 0.0 else 0) - x) / dx, 0.0), 1.0)
                leave = min(max((column + (1 if dx >= 0.0 else 0) - x) / dx, 0.0), 1.0)
            bottom, top = _span(y + enter * dy, y + leave * dy)
            for row in range(bottom, top + 1):
                if found == room:
                    where, which = _doubled(where), _doubled(which)
                    cell = np.concatenate((cell, np.empty_like(cell)))
                    room *= 2
                p, q = 0, 0
                if periodic:
                    p, q = column // columns, row // rows
                    cell[found, 0], cell[found, 1] = p, q
                where[found] = (row - q * rows) * columns + column - p * columns
                which[found] = c
                begin[where[found] + 1] += 1
                found += 1
    for b in range(len(begin) - 1):
        begin[b + 1] += begin[b]
    contact = np.empty(found, dtype=np.int32)
    shift = np.empty((found if periodic else 0, 2), dtype=np.int32)
    at = begin.copy()
    for k in range(found):
        place = at[where[k]]
        at[where[k]] += 1
        contact[place] = which[k]
        if periodic:
            shift[place, 0], shift[place, 1] = cell[k, 0], cell[k, 1]
    return begin, contact, shift


@kernel
def _doubled(values: Short) -> Short:
    return np.concatenate((values, np.empty_like(values)))


@kernel
def _span(a: float, b: float) -> tuple[int, int]:
    """First and last unit interval between two values, with a margin for round-off."""
    margin = MARGIN + ROUND_OFF * max(abs(a), abs(b))
    return math.floor(min(a, b) - margin), math.floor(max(a, b) + margin)


@kernel
def _place(grain: int, p: int, q: int) -> int:
    """One number for a grain and its cell."""
    return (grain << 32) + (p << 16) + q


@kernel
def _same_line(
    ax: float, ay: float, bx: float, by: float, same_side: bool, end_to_start: bool
) -> bool:
    """Whether two branches with a common grain overlap: they leave it the same way."""
    if abs(ax * by - ay * bx) > ROUND_OFF * (abs(ax) + abs(ay) + abs(bx) + abs(by)):
        return False
    along = ax * bx + ay * by
    return (same_side and along > 0.0) or (end_to_start and along < 0.0)


@kernel
def _meet(
    ax: float, ay: float, adx: float, ady: float, bx: float, by: float, bdx: float, bdy: float
) -> bool:
    """Whether two branches without a common grain have a point in common."""
    ahead_x, ahead_y = bx - ax, by - ay
    turn = adx * bdy - ady * bdx
    # Each branch's ends lie on either side of the other's line, or on it.
    if not _straddle(adx * ahead_y - ady * ahead_x, turn, abs(adx) + abs(ady)):
        return False
    if not _straddle(ahead_x * bdy - ahead_y * bdx, -turn, abs(bdx) + abs(bdy)):
        return False
    low_x = max(min(adx, 0.0), ahead_x + min(bdx, 0.0))
    low_y = max(min(ady, 0.0), ahead_y + min(bdy, 0.0))
    high_x = min(max(adx, 0.0), ahead_x + max(bdx, 0.0))
    high_y = min(max(ady, 0.0), ahead_y + max(bdy, 0.0))
    return low_x <= high_x + ROUND_OFF and low_y <= high_y + ROUND_OFF


@kernel
def _straddle(side: float, change: float, size: float) -> bool:
    other = side + change
    return min(side, other) <= ROUND_OFF * size and max(side, other) >= -ROUND_OFF * size
