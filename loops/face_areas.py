"""Signed areas of faces, and how they wind around a periodic cell."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from loops.graph import GrainGraph

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

BLOCK = 2**16  # half-edges measured at a time


def measured_faces(
    graph: GrainGraph,
    branches: Floats,
    grains: Integers,
    contacts: Integers,
    sign: Integers,
    offsets: Integers,
) -> tuple[Floats, Integers]:
    """Signed area of each face and the sum of images along it.

    Parameters
    ----------
    graph : GrainGraph
        The contact graph.
    branches : (C, 2) array
        Its branch vectors.
    grains, contacts, sign : (H,) array of int
        Half-edges face by face: grain at the start, contact, 1 from i to j or -1 back.
    offsets : (F + 1,) array of int
        Where each face starts.

    Returns
    -------
    area : (F,) array
        Area on the left (length squared).
    winding : (F, 2) array of int
        Sum of the images.
    """
    faces = len(offsets) - 1
    area, winding = np.zeros(faces), np.zeros((faces, 2), dtype=np.int64)
    # In blocks that stay in the cache.
    cuts = np.searchsorted(offsets, np.arange(0, offsets[-1], BLOCK))
    for start, stop in pairwise(np.unique(np.append(cuts, faces)).tolist()):
        block = slice(offsets[start], offsets[stop])
        begin = offsets[start:stop] - offsets[start]
        first = np.repeat(begin, np.diff(offsets[start : stop + 1]))
        # Corners relative to the first one of their face: no cancellation far from the origin.
        x = graph.x[grains[block]]
        x -= x[first]
        turn = sign[block, None]
        if graph.images is not None and graph.cell is not None:
            image = graph.images[contacts[block]] * turn
            passed = np.cumsum(image, axis=0) - image
            x += (passed - passed[first]) @ graph.cell.T
            winding[start:stop] = np.add.reduceat(image, begin)
        d = branches[contacts[block]] * turn
        cross = x[:, 0] * d[:, 1] - x[:, 1] * d[:, 0]
        area[start:stop] = 0.5 * np.add.reduceat(cross, begin)
    return area, winding
