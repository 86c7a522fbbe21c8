"""The loops of a plane or periodic contact graph: faces as cycles of half-edges.

Every contact is two half-edges, one each way. A half-edge is followed, at the grain where it
ends, by the next one clockwise from its own way back; the cycles of this permutation are the
faces, each on the left of its half-edges. Contact k of the list at hand is the half-edges 2k (from
i to j) and 2k + 1 (back).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from fractions import Fraction
from functools import cmp_to_key
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Floats, Integers
from loops.compiled import use_compiled
from loops.errors import InputError
from loops.graph import (
    GrainGraph,
    HasGraph,
    graph_of,
    require_one_state,
)
from loops.pruning import component_counts, component_labels, prune_dangling
from loops.shown import Shown

# Number of orders in the short display.
MOST_ORDERS = 8
ANGLE_STEPS = 2**30 - 1  # a quarter turn in the key; a whole one stays below 2^32


class FaceKind(IntEnum):
    """Kind of a half-edge cycle: a loop, the outside of a cluster, or around the cell."""

    LOOP = 0
    OUTER = 1
    WINDING = 2


@dataclass(frozen=True, eq=False, repr=False)
class Faces(Shown):
    """Every half-edge cycle of the pruned contact graph.

    Face f holds the half-edges `offsets[f]` to `offsets[f + 1]`, in order, with the face on their
    left: counter-clockwise around a loop. It starts at its smallest grain (if it passes that grain
    twice, with the smaller next grain), and faces are numbered by that grain, then by the next: the
    order and the directions of the contacts do not matter.

    Attributes
    ----------
    offsets : (F + 1,) array of int
        Where each face starts in the arrays of half-edges; the last entry is H.
    grains : (H,) array of int
        Grain at the start of each half-edge.
    contacts : (H,) array of int
        Contact of each half-edge, as numbered in the graph.
    forward : (H,) array of bool
        Whether the half-edge runs from i to j of its contact.
    area : (F,) array
        Signed area of the polygon through the centres, unrolled through periodic images (length
        squared). It is no area for a face that winds around the cell.
    kind : (F,) array of int8
        `FaceKind`. LOOP: bounded, positive area. OUTER: the outside of a cluster, negative area.
        WINDING: the images along the cycle do not add up to zero.
    component : (F,) array of int
        Connected component of the pruned graph, numbered by its smallest grain.
    """

    offsets: Integers
    grains: Integers
    contacts: Integers
    forward: NDArray[np.bool_]
    area: Floats
    kind: NDArray[np.int8]
    component: Integers

    @property
    def order(self) -> Integers:
        """(F,) array: number of half-edges of each face."""
        return np.diff(self.offsets)

    @property
    def loops(self) -> Integers:
        """(L,) array: faces that are loops."""
        return np.flatnonzero(self.kind == FaceKind.LOOP)

    @property
    def row(self) -> Integers:
        """(F,) array: place of each face among the loops, -1 for the other faces."""
        row = np.full(len(self.kind), -1)
        row[self.loops] = np.arange(len(self.loops))
        return row

    def facts(self) -> dict[str, object]:
        """Names and values shown at the prompt and in a notebook."""
        orders, counts = np.unique(self.order[self.loops], return_counts=True)
        shown = dict(zip(orders[:MOST_ORDERS].tolist(), counts[:MOST_ORDERS].tolist(), strict=True))
        return {"loops": len(self.loops), "other faces": len(self.kind) - len(self.loops),
                "loops by order": shown}  # fmt: skip


def find_faces(graph: GrainGraph | HasGraph, *, compiled: bool | None = None) -> Faces:
    """Find the loops of a contact graph, and the other faces with them.

    Dangling grains are pruned first. A loop may pass a grain twice (a pinch) or a contact twice,
    once each way (a bridge). A cluster that lies inside a loop without touching it leaves the
    loop as it is. Crossing branches are not looked for: `find_crossings` does that, and without
    it the faces of a graph that is not planar mean nothing.

    Parameters
    ----------
    graph : GrainGraph, or loop, scene or snapshot
        One state, in the plane or in a periodic cell.
    compiled : bool, optional
        Whether to take the compiled kernel, which gives the same faces, areas to round-off; by the
        size of the graph if left out.

    Returns
    -------
    Faces
        All half-edge cycles; `faces.loops` are the loops.

    Raises
    ------
    InputError
        If the graph has batch axes, or two branches leave a grain in exactly the same direction.

    Examples
    --------
    >>> from loops import GrainGraph, find_faces
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
    >>> faces = find_faces(square)
    >>> faces.order.tolist(), faces.area.tolist(), faces.loops.tolist()
    ([3, 3, 4], [0.5, 0.5, -1.0], [0, 1])
    """
    graph = graph_of(graph)
    require_one_state(graph)
    if use_compiled(compiled, graph.contact_count):
        from loops.compiled import given
        from loops.compiled.network import plane_faces

        images = np.zeros((0, 2)) if graph.images is None else graph.images
        good, offsets, grains, contacts, forward, area, winds, component = plane_faces(
            given(graph.x, np.float64),
            given(graph.contacts, np.int64),
            given(images, np.int64),
            given(graph.branches, np.float64),
        )
        # Else two directions are equal, or too close for double precision.
        if good:
            kind = _kind(area, winds)
            return Faces(offsets, grains, contacts, forward, area, kind, component)
    kept_grains, kept_contacts = prune_dangling(graph)
    kept = np.flatnonzero(kept_contacts)
    branches = graph.branches
    following = next_half_edge(graph.grain_count, graph.contacts[kept], kept, branches[kept])
    order = half_edges_by_grain(graph, kept)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    offsets, member = cycles(rank[following[order]])
    edge = order[member]
    grains = graph.contacts[kept].ravel()[edge]
    contacts, sign = kept[edge >> 1], 1 - 2 * (edge & 1)
    area, winding = measured_faces(graph, branches, grains, contacts, sign, offsets)
    label = component_labels(graph.grain_count, graph.contacts[kept], kept_grains)[1]
    return Faces(
        offsets=offsets,
        grains=grains,
        contacts=contacts,
        forward=sign > 0,
        area=area,
        kind=_kind(area, np.asarray(winding.any(axis=1))),
        component=label[grains[offsets[:-1]]],
    )


class LoopGroup(NamedTuple):
    """All loops of one order: `grains`, `contacts`, `forward` are (L, n), `face` is (L,)."""

    grains: Integers
    contacts: Integers
    forward: NDArray[np.bool_]
    face: Integers


def faces_by_order(faces: Faces, loops: Integers | None = None) -> dict[int, LoopGroup]:
    """Sort the loops by their number of sides, each group one batch.

    Parameters
    ----------
    faces : Faces
        Faces of a contact graph.
    loops : (L,) array of int, optional
        Some of its loops; all of them if left out.

    Returns
    -------
    dict of int to LoopGroup
        Order n, ascending, to the loops of that order. Contact k of a loop joins its grains k and
        k + 1, from i to j where `forward`.

    Examples
    --------
    >>> from loops import GrainGraph, find_faces, faces_by_order
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
    >>> {n: group.grains.tolist() for n, group in faces_by_order(find_faces(square)).items()}
    {3: [[0, 1, 2], [0, 2, 3]]}
    """
    order, loops = faces.order, faces.loops if loops is None else loops
    groups = {}
    for n in np.unique(order[loops]).tolist():
        face = loops[order[loops] == n]
        at = faces.offsets[face][:, None] + np.arange(n)
        groups[n] = LoopGroup(faces.grains[at], faces.contacts[at], faces.forward[at], face)
    return groups


@dataclass(frozen=True, eq=False, repr=False)
class EulerCheck(Shown):
    """Euler's formula of every component of the pruned contact graph."""

    components: int
    vertices: int
    edges: int
    faces: int
    characteristic: Integers
    expected: Integers

    @property
    def ok(self) -> bool:
        """Whether every component has the characteristic expected of it."""
        return bool(np.array_equal(self.characteristic, self.expected))


def euler_check(graph: GrainGraph, faces: Faces, *, compiled: bool | None = None) -> EulerCheck:
    """Check the faces by Euler's formula, component by component.

    `V - E + F = 2` in the plane, outer cycle included, and for a strip around a periodic cell,
    whose two borders both count; 0 for a component that winds both ways.
    How a component winds is read from a spanning forest, not from its faces. Some crossings show
    here, others do not: see `find_crossings`.

    Parameters
    ----------
    graph : GrainGraph
        The contact graph.
    faces : Faces
        Its faces.
    compiled : bool, optional
        Whether to take the compiled kernel; by the size of the graph if left out.

    Returns
    -------
    EulerCheck
        Totals, characteristics and the verdict `ok`.

    Examples
    --------
    >>> from loops import GrainGraph, euler_check, find_faces
    >>> triangle = GrainGraph(x=[[0, 0], [1, 0], [0, 1]], radii=[0.5] * 3,
    ...                       contacts=[[0, 1], [1, 2], [2, 0]])
    >>> check = euler_check(triangle, find_faces(triangle))
    >>> check.vertices, check.edges, check.faces, check.characteristic.tolist(), check.ok
    (3, 3, 2, [2], True)
    """
    if use_compiled(compiled, graph.contact_count):
        from loops.compiled import given
        from loops.compiled.network import network_components

        images = np.zeros((0, 2)) if graph.images is None else graph.images
        vertices, edges, ranks = network_components(
            given(graph.x, np.float64), given(graph.contacts, np.int64), given(images, np.int64)
        )
    else:
        vertices, edges, ranks = component_counts(graph)
    count = len(vertices)
    return EulerCheck(
        components=count,
        vertices=int(vertices.sum()),
        edges=int(edges.sum()),
        faces=len(faces.area),
        characteristic=vertices - edges + np.bincount(faces.component, minlength=count),
        expected=np.where(ranks == 2, 0, 2),
    )


def outline_area(graph: GrainGraph, faces: Faces) -> float:
    """Area of the sample: of the periodic cell, else of the polygons around its clusters.

    A cluster that lies inside another one adds nothing.

    Parameters
    ----------
    graph : GrainGraph
        The packing, one state.
    faces : Faces
        Its faces, from `find_faces`.

    Returns
    -------
    float
        Area (length squared); 0 for a packing without loops that is not periodic.

    Examples
    --------
    >>> from loops import GrainGraph, find_faces, outline_area
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
    >>> outline_area(square, find_faces(square))
    1.0
    """
    if graph.cell is not None:
        return float(np.abs(np.linalg.det(graph.cell)))
    outer = np.flatnonzero(faces.kind == FaceKind.OUTER)
    largest_first = outer[np.argsort(faces.area[outer])]
    kept: list[Floats] = []
    total = 0.0
    for face in largest_first.tolist():
        polygon = graph.x[faces.grains[faces.offsets[face] : faces.offsets[face + 1]]]
        if not any(_contains(other, polygon[0]) for other in kept):
            kept.append(polygon)
            total -= float(faces.area[face])
    return total


def _contains(polygon: Floats, point: Floats) -> bool:
    """Whether a ray from the point crosses the polygon an odd number of times."""
    if (point < polygon.min(axis=0)).any() or (point > polygon.max(axis=0)).any():
        return False
    a, b = polygon - point, np.roll(polygon, -1, axis=0) - point
    rising = (a[:, 1] > 0) != (b[:, 1] > 0)
    a, b = a[rising], b[rising]
    to_the_right = (a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1] > 0) == (b[:, 1] > a[:, 1])
    return bool(np.count_nonzero(to_the_right) % 2)


def _kind(area: Floats, winds: NDArray[np.bool_]) -> NDArray[np.int8]:
    kind = np.where(area > 0, np.int8(FaceKind.LOOP), np.int8(FaceKind.OUTER))
    kind[winds] = FaceKind.WINDING
    return kind


def next_half_edge(
    grains: int, contacts: Integers, numbers: Integers, branches: Floats
) -> Integers:
    """The half-edge that follows each one around the face on its left."""
    origin = contacts.ravel()
    # Sorted by origin, then by angle: those of both half-edges of a contact, monotone in [0, 4).
    dx, dy = branches.T
    cosine = dx / (np.abs(dx) + np.abs(dy))
    there = np.where(dy < 0, 3 + cosine, 1 - cosine)
    back = np.where(dy > 0, 3 - cosine, 1 + cosine)
    angle = (np.column_stack([there, back]) * ANGLE_STEPS).astype(np.int64)
    key = ((contacts << 32) | angle).ravel()
    # The stable sort is twice as fast where grains are numbered along space.
    order = np.argsort(key, kind="stable")
    # Rounding can put two directions in the wrong order only if their keys differ by at most 1.
    close = np.flatnonzero(np.diff(key[order]) <= 1)
    if close.size:
        for run in np.split(close, np.flatnonzero(np.diff(close) > 1) + 1):
            tied = slice(run[0], run[-1] + 2)
            order[tied] = _sorted_exactly(order[tied], branches, origin, numbers)
    degree = np.bincount(origin, minlength=grains)
    end = np.cumsum(degree)[degree > 0]
    begin = end - degree[degree > 0]
    clockwise = np.empty_like(order)
    clockwise[order[1:]] = order[:-1]
    clockwise[order[begin]] = order[end - 1]
    # At the end of half-edge h, the next one is clockwise from its opposite half-edge, h ^ 1.
    return clockwise.reshape(-1, 2)[:, ::-1].ravel()


def _sorted_exactly(
    tied: Integers, branches: Floats, origin: Integers, numbers: Integers
) -> list[int]:
    """Sort half-edges of one grain that point the same way to 30 bits, by exact arithmetic."""

    def direction(half_edge: int) -> tuple[Fraction, Fraction]:
        x, y = branches[half_edge >> 1].tolist()
        sign = -1 if half_edge & 1 else 1
        return Fraction(x) * sign, Fraction(y) * sign

    def compare(a: int, b: int) -> int:
        (ax, ay), (bx, by) = direction(a), direction(b)
        turn = ax * by - ay * bx
        if turn == 0:
            first, second = sorted(int(numbers[h >> 1]) for h in (a, b))
            raise InputError(
                f"contacts {first} and {second}",
                f"the same direction from grain {origin[a]}",
                "branches that leave a grain in different directions",
                "Drop one of the two: the contact graph is not planar.",
            )
        return -1 if turn > 0 else 1

    return sorted(tied.tolist(), key=cmp_to_key(compare))


def half_edges_by_grain(graph: GrainGraph, kept: Integers) -> Integers:
    """Half-edges of the kept contacts by first grain, second grain and image: no two are alike."""
    first = graph.contacts[kept].ravel()
    second = graph.contacts[kept, ::-1].ravel()
    if graph.images is None:
        return np.argsort(first * graph.grain_count + second)
    step = np.column_stack([graph.images[kept], -graph.images[kept]]).reshape(-1, 2)
    return np.lexsort((step[:, 1], step[:, 0], second, first))


def cycles(following: Integers) -> tuple[Integers, Integers]:
    """Offsets and members of the cycles of a permutation, each from its smallest element on.

    By doubling: in log2(length) passes each element knows the smallest one ahead, and how far.
    """
    smallest = np.arange(len(following))
    distance = np.zeros_like(following)
    jump, reach = following, 1
    while (smallest[following] != smallest).any():
        nearer = smallest[jump] < smallest
        ahead = jump[nearer]
        smallest[nearer], distance[nearer] = smallest[ahead], distance[ahead] + reach
        jump, reach = jump[jump], 2 * reach
    length = np.bincount(smallest, minlength=len(following))
    offsets = np.append(0, np.cumsum(length[length > 0]))
    begin = np.cumsum(length) - length
    position = -distance % length[smallest]
    members = np.empty_like(following)
    members[begin[smallest] + position] = np.arange(len(following))
    return offsets, members


def measured_faces(
    graph: GrainGraph,
    branches: Floats,
    grains: Integers,
    contacts: Integers,
    sign: Integers,
    offsets: Integers,
) -> tuple[Floats, Integers]:
    """Signed area of each face and the sum of images along it."""
    begin = offsets[:-1]
    first = np.repeat(begin, np.diff(offsets))
    # Corners relative to the first one of their face: no cancellation far from the origin.
    x, turn, winding = graph.x[grains], sign[:, None], np.zeros((len(begin), 2), dtype=np.int64)
    x -= x[first]
    if graph.images is not None and graph.cell is not None:
        image = graph.images[contacts] * turn
        passed = np.cumsum(image, axis=0) - image
        x += (passed - passed[first]) @ graph.cell.T
        winding = np.add.reduceat(image, begin)
    d = branches[contacts] * turn
    cross = x[:, 0] * d[:, 1] - x[:, 1] * d[:, 0]
    return 0.5 * np.add.reduceat(cross, begin), winding
