"""The map: pixels against polygons, and both ways to draw it."""

import numpy as np
import pytest
from matplotlib.path import Path as Outline

from loops import GrainGraph, find_faces, loop_batches
from patterns import synthetic_network
from studies.snapshot.paint import paint_loops


@pytest.mark.parametrize("periodic", [pytest.param(False, marks=pytest.mark.slow), True])
def test_every_pixel_belongs_to_the_loop_that_holds_its_centre(periodic):
    graph = synthetic_network(60, seed=3, periodic=periodic)
    faces = find_faces(graph)
    painting = paint_loops(graph, faces, 48)
    left, right, bottom, top = painting.extent
    rows, columns = painting.loop.shape
    x = left + (np.arange(columns) + 0.5) * (right - left) / columns
    y = bottom + (np.arange(rows) + 0.5) * (top - bottom) / rows
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(len(faces.loops))
    outlines = {}
    for batch in loop_batches(graph, faces):
        for face, corners in zip(batch.face, batch.origin[:, None] + batch.graph.x, strict=True):
            outlines[row[face]] = Outline([*corners, corners[0]])
    expected = np.full(len(centres), -1)
    for loop in range(len(outlines)):
        expected[outlines[loop].contains_points(centres)] = loop
    np.testing.assert_array_equal(painting.loop.ravel(), expected)


@pytest.mark.parametrize("pixels", [3, 5, 9])
def test_a_centre_on_a_side_belongs_to_the_loop_right_of_it_or_above(pixels):
    """Four squares, an odd number of pixels: the middle ones have their centres on the sides."""
    x = np.stack(np.meshgrid(range(3), range(3)), axis=-1).reshape(-1, 2).astype(float)
    number = np.arange(9).reshape(3, 3)
    contacts = np.concatenate(
        [
            np.stack([number[:, :-1], number[:, 1:]], axis=-1).reshape(-1, 2),
            np.stack([number[:-1], number[1:]], axis=-1).reshape(-1, 2),
        ]
    )
    graph = GrainGraph(x=x, radii=np.full(9, 0.5), contacts=contacts)
    faces = find_faces(graph)
    painting = paint_loops(graph, faces, pixels)
    assert painting.extent == (0.0, 2.0, 0.0, 2.0)
    assert painting.loop.shape == (pixels, pixels)
    less, more = pixels // 2, pixels - pixels // 2
    centre = {
        tuple(batch.graph.x.mean(axis=1)[k]): face
        for batch in loop_batches(graph, faces)
        for k, face in enumerate(batch.face.tolist())
    }
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(4)
    counts = np.bincount(painting.loop.ravel(), minlength=4)
    for (left, bottom), count in {
        (0.5, 0.5): less * less,
        (1.5, 0.5): more * less,
        (0.5, 1.5): less * more,
        (1.5, 1.5): more * more,
    }.items():
        assert counts[row[centre[left, bottom]]] == count
