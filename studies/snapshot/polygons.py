"""The loops of a snapshot as polygons, one after the other."""

from __future__ import annotations

import numpy as np

from loops import Faces, GrainGraph
from loops.arrays import Floats, Integers


def half_edges_of_loops(
    faces: Faces, picked: Integers | slice = slice(None)
) -> tuple[Integers, Integers]:
    """The half-edges of the loops alone, or of those picked among them."""
    loops = faces.loops[picked]
    order = faces.order[loops]
    offsets = np.concatenate([[0], np.cumsum(order)])
    first = faces.offsets[loops] - offsets[:-1]
    return offsets, np.repeat(first, order) + np.arange(offsets[-1])


def loop_corners(graph: GrainGraph, faces: Faces, offsets: Integers, at: Integers) -> Floats:
    """Corners of the loops, unrolled through periodic images from each loop's first grain."""
    x = graph.x[faces.grains[at]]
    if graph.cell is None or graph.images is None or len(at) == 0:
        return x
    image = graph.images[faces.contacts[at]] * np.where(faces.forward[at], 1, -1)[:, None]
    passed = np.cumsum(image, axis=0) - image
    passed -= np.repeat(passed[offsets[:-1]], np.diff(offsets), axis=0)
    return x + passed @ graph.cell.T
