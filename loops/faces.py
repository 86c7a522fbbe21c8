"""The loops of a plane or periodic contact graph: faces as cycles of half-edges.

Every contact is two half-edges, one each way. A half-edge is followed, at the grain where it
ends, by the next one clockwise from its own way back; the cycles of this permutation are the
faces, each on the left of its half-edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Floats, Integers
from loops.compiled import use_compiled
from loops.graph import GrainGraph, branch_vectors, require_one_state
from loops.half_edges import cycles, half_edges_by_grain, measured_faces, next_half_edge
from loops.pruning import component_counts, component_labels, prune_dangling
from loops.shown import Shown

# Orders that the prompt shows.
MOST_ORDERS = 8


class FaceKind(IntEnum):
    """What a half-edge cycle bounds."""

    LOOP = 0
    OUTER = 1
    WINDING = 2


@dataclass(frozen=True, eq=False, repr=False)
class Faces(Shown):
    """Every half-edge cycle of the pruned contact graph.

    Face f holds the half-edges `offsets[f]` to `offsets[f + 1]`, in order, itself on their left:
    counter-clockwise around a loop. It starts at its smallest grain (where it passes it twice, on
    the way to the smaller next one), and faces are numbered by that grain, then by the next: the
    order of the contacts and their directions do not matter.

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

    def facts(self) -> dict[str, object]:
        """What the prompt and a notebook show."""
        orders, counts = np.unique(self.order[self.loops], return_counts=True)
        shown = dict(zip(orders[:MOST_ORDERS].tolist(), counts[:MOST_ORDERS].tolist(), strict=True))
        return {"loops": len(self.loops), "other faces": len(self.kind) - len(self.loops),
                "loops by order": shown}  # fmt: skip


def find_faces(graph: GrainGraph, *, compiled: bool | None = None) -> Faces:
    """Find the loops of a contact graph, and the other faces with them.

    Dangling grains are pruned first. A loop may pass a grain twice (a pinch) or a contact twice,
    once each way (a bridge). A cluster that lies inside a loop without touching it leaves the
    loop as it is. Crossing branches are not looked for: `find_crossings` does that, and without
    it the faces of a graph that is not planar mean nothing.

    Parameters
    ----------
    graph : GrainGraph
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
    require_one_state(graph)
    if use_compiled(compiled, graph.contact_count):
        faces = _compiled_faces(graph)
        if faces is not None:
            return faces
    kept_grains, kept_contacts = prune_dangling(graph)
    kept = np.flatnonzero(kept_contacts)
    branches = branch_vectors(graph)
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


def _compiled_faces(graph: GrainGraph) -> Faces | None:
    """Faces by the kernel; None where two directions are the same, or too close for doubles."""
    from loops.compiled.kernel import given
    from loops.compiled.network import plane_faces

    images = np.zeros((0, 2)) if graph.images is None else graph.images
    cell = np.zeros((2, 2)) if graph.cell is None else graph.cell
    good, offsets, grains, contacts, forward, area, winds, component = plane_faces(
        given(graph.x, np.float64),
        given(graph.contacts, np.int64),
        given(images, np.int64),
        given(cell, np.float64),
    )
    if not good:
        return None
    return Faces(offsets, grains, contacts, forward, area, _kind(area, winds), component)


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


@dataclass(frozen=True, eq=False)
class EulerCheck:
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
        vertices, edges, ranks = _compiled_counts(graph)
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


def _compiled_counts(graph: GrainGraph) -> tuple[Integers, Integers, Integers]:
    """`component_counts` by the kernel."""
    from loops.compiled.kernel import given
    from loops.compiled.network import component_counts as kernel

    images = np.zeros((0, 2)) if graph.images is None else graph.images
    vertices, edges, ranks = kernel(
        given(graph.x, np.float64), given(graph.contacts, np.int64), given(images, np.int64)
    )
    return vertices, edges, ranks


def _kind(area: Floats, winds: NDArray[np.bool_]) -> NDArray[np.int8]:
    kind = np.where(area > 0, np.int8(FaceKind.LOOP), np.int8(FaceKind.OUTER))
    kind[winds] = FaceKind.WINDING
    return kind
