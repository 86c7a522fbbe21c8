import numpy as np
import pytest

from loops import GrainGraph
from patterns import opposite_gap, regular_polygon


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
