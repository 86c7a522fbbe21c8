import numpy as np
import pytest
import shapely

from loops import GrainGraph
from patterns import opposite_gap, regular_polygon
from patterns.polygons import is_simple


@pytest.mark.parametrize("order", [3, 4, 5, 6, 8])
def test_simple_polygons_are_shapelys(order):
    x = np.random.default_rng(order).normal(size=(400, order, 2))
    expected = shapely.is_valid(shapely.polygons(x))
    assert order == 3 or 0 < expected.sum() < 400
    np.testing.assert_array_equal(is_simple(x), expected)


@pytest.mark.parametrize(
    ("corners", "simple"),
    [
        ([[0, 0], [1, 0], [2, 0], [2, 1], [0, 1]], True),  # a straight corner
        ([[0, 0], [2, 0], [1, 0], [1, 1]], False),  # folds back
        ([[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]], False),  # a corner on a side
        ([[0, 0], [1, 0], [1, 1], [2, 1], [2, 0], [3, 0], [3, 2], [0, 2]], True),  # sides in line
        ([[0, 0], [2, 0], [1, 1], [2, 2], [0, 2], [1, 1]], False),  # pinched
    ],
)
def test_degenerate_outlines(corners, simple):
    x = np.array(corners, dtype=float)
    for k in range(len(x)):
        assert is_simple(np.roll(x, k, axis=0)) == simple
        assert is_simple(np.roll(x, k, axis=0)[::-1] * 1e-6) == simple


def test_opposite_gap_of_the_square_and_the_hexagon():
    strain = np.array([0.0, 0.1, 0.5])
    for order, apart in ((4, np.sqrt(2.0)), (6, np.sqrt(3.0))):
        found = opposite_gap(regular_polygon(order, strain=strain, radius=2.0))
        np.testing.assert_allclose(found, 4.0 * (apart * (1 - strain) - 1), atol=1e-14)


def test_opposite_gap_sees_no_contacts():
    assert opposite_gap(regular_polygon(3)) == np.inf
    square = GrainGraph(
        x=[[0, 0], [1, 0], [1, 1], [0, 1]],
        radii=[0.6, 0.5, 0.7, 0.5],
        contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [2, 0]],
    )
    assert opposite_gap(square) == pytest.approx(np.sqrt(2) - 1.0, rel=1e-15)
