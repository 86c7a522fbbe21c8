"""The area that a packing fills."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from loops.faces import FaceKind, Faces
from loops.graph import GrainGraph

Floats = NDArray[np.float64]


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
