"""Which grains carry, which are held, and solves of what they carry."""

import numpy as np
import pytest

from loops import GrainGraph, InputError, LinearFrictional, PlaneContacts, Scene, find_faces
from loops.system import carrying_grains
from tests.packings import loops_in_place, packing_system
from tests.stability.packing.walled_packings import between

LAW = LinearFrictional(1.0, 0.5)


def strips(count):
    """Bands of triangles that wind around a cell in one direction, one above the other."""
    steps, width = 6, 6.0
    number = np.arange(2 * steps * count).reshape(count, 2, steps)
    x = np.array(
        [
            [k + 0.5 * row, 3.0 * band + 0.8 * row]
            for band in range(count)
            for row in range(2)
            for k in range(steps)
        ]
    )
    contacts, images = [], []
    for low, high in number:
        for k in range(steps):
            after, image = (k + 1) % steps, [(k + 1) // steps, 0]
            for a, b, over in (
                (low[k], low[after], image),
                (high[k], high[after], image),
                (low[k], high[k], [0, 0]),
                (high[k], low[after], image),
            ):
                contacts.append([a, b])
                images.append(over)
    radii = np.full(len(x), 0.51)
    cell = [[width, 0.0], [0.0, 3.0 * count]]
    return GrainGraph(x, radii, contacts, images=images, cell=cell)


def test_a_band_that_winds_one_way_carries():
    """It floats across, so one of its grains is held there: each band has its own."""
    for count in (1, 2):
        graph = strips(count)
        found = carrying_grains(
            graph, np.ones(graph.contact_count, bool), np.zeros(12 * count, int)
        )
        assert found.grains.all() and found.clusters == found.rattlers == 0
        assert found.anchors.tolist() == [12 * band for band in range(count)]


def test_every_band_is_held_by_a_grain_of_its_own():
    one, two = (
        loops_in_place(Scene(graph, LAW), find_faces(graph)) for graph in (strips(1), strips(2))
    )
    twice = np.repeat(np.sort(one.matrix[:, 0, 0]), 2)
    assert np.allclose(np.sort(two.matrix[:, 0, 0]), twice, rtol=1e-9)
    # Nothing is left for the regularisation of singular fronts, which would leave doubt.
    assert np.isfinite(two.matrix).all() and two.error.max() < 1e-10


def test_contacts_with_walls_count_as_contacts():
    """A chain between two walls: its ends have one contact with a grain and one with a wall."""
    graph = GrainGraph([[0, 0], [1, 0], [2, 0]], [0.5] * 3, [[0, 1], [1, 2]])
    closed = np.ones(2, dtype=bool)
    held = carrying_grains(graph, closed, np.array([1, 0, 1]))
    assert held.grains.all() and held.contacts.all() and len(held.anchors) == 0
    # With a wall at one end alone the other end is loose, then the next grain, then all.
    with pytest.raises(InputError, match="float"):
        carrying_grains(graph, closed, np.array([1, 0, 0]))
    planes = PlaneContacts(
        np.array([0, 2]), np.array([[-0.5, 0.0], [0.5, 0.0]]), np.ones(2), np.zeros(2)
    )
    system = packing_system(Scene(graph, LAW, between(planes, volume=3.0)))
    assert system.carrying.grains.all() and system.boundary == "2 wall contacts"


def test_walls_slide_without_shear_stiffness_and_stick_with_any():
    kt = np.array([0.0, 1e-12, 0.5])
    planes = PlaneContacts(np.arange(3), np.tile([0.5, 0.0], (3, 1)), np.ones(3), kt)
    assert planes.regime.tolist() == [2, 1, 1]
