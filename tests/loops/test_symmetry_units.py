"""Symmetry of loops off the origin, and own images given twice."""

import numpy as np
import pytest

from loops import GrainGraph, InputError
from patterns import regular_polygon
from tests.oracles.symmetry import loop_symmetry


@pytest.mark.parametrize("order", [3, 4, 6, 9])
def test_a_loop_off_the_origin_has_the_same_symmetry(order):
    loop = regular_polygon(order)
    moved = GrainGraph(x=loop.x + np.array([3.0, -2.0]), radii=loop.radii, contacts=loop.contacts)
    assert loop_symmetry(moved).name == f"D{order}"


@pytest.mark.parametrize("image", [(1, 0), (0, 1), (0, 2), (1, -1), (2, 1)])
def test_an_own_image_given_twice_is_a_duplicate(image):
    row = {"x": [[0, 0]], "radii": [0.5], "cell": [[1, 0], [0, 1]]}
    opposite = [-k for k in image]
    for images in ([image, opposite], [opposite, image], [image, image]):
        with pytest.raises(InputError, match="same as contact 0"):
            GrainGraph(**row, contacts=[[0, 0]] * 2, images=images)


@pytest.mark.parametrize("pair", [[(1, 1), (1, -1)], [(1, 0), (0, 1)], [(0, 1), (0, -2)]])
def test_other_own_images_are_other_contacts(pair):
    row = {"x": [[0, 0]], "radii": [0.5], "cell": [[1, 0], [0, 1]]}
    assert len(GrainGraph(**row, contacts=[[0, 0]] * 2, images=pair).contacts) == 2
