"""Regions of directions: their arcs and the zeros of W2 in them, by brute force over angles."""

import numpy as np
import pytest

from stability.packing.probe import probe_directions
from stability.packing.regime_regions import SAME_DIRECTION, RegimeRegions, _arc

TURN = 2 * np.pi


def unit(angle):
    return np.array([np.cos(angle), np.sin(angle)])


def test_an_arc_ends_where_a_row_changes_its_sign():
    rng = np.random.default_rng(4)
    for count in (1, 2, 5, 9):
        for _ in range(20):
            theta = rng.uniform(-9, 9)
            lines = rng.uniform(0.1, 10.0, (count, 1)) * rng.standard_normal((count, 2))
            lines *= np.sign(lines @ unit(theta))[:, None]
            low, high = _arc(lines, unit(theta))
            middle = np.arctan2(*unit(theta)[::-1])
            assert low < middle < high <= low + np.pi + 1e-12
            for inside in np.linspace(low + 1e-9, high - 1e-9, 50):
                assert (lines @ unit(inside) > 0).all()
            for beyond in (low - 1e-9, high + 1e-9):
                assert (lines @ unit(beyond) < 0).any()


def test_rows_without_a_rate_do_not_bound_an_arc():
    lines = np.array([[1.0, 0.0], [0.0, -1e-13]])
    np.testing.assert_allclose(_arc(lines, unit(0.3)), [-np.pi / 2, np.pi / 2], atol=1e-15)
    np.testing.assert_allclose(_arc(np.zeros((2, 2)), unit(0.3)), [0.3 - np.pi, 0.3 + np.pi])


def regions(tangent, arc, driven="strain"):
    made = object.__new__(RegimeRegions)
    made.tangents, made.arcs, made.driven = [tangent], [arc], driven
    return made


class Found:
    piece = 0


@pytest.mark.parametrize("driven", ["strain", "stress"])
def test_the_zero_of_w2_is_the_nearest_one_within_the_region(driven):
    """Angles far from zero too, forwards and backwards, in arcs that hold it or not."""
    rng, seen = np.random.default_rng(5), set()
    for _ in range(300):
        tangent = rng.standard_normal((2, 2))
        form = tangent if driven == "strain" else np.linalg.inv(tangent)
        begin = rng.uniform(-3, 3)
        arc = np.array([begin, begin + rng.uniform(0.2, 3.1)])
        a = rng.uniform(-7, 7)
        b = a + rng.uniform(-1.5, 1.5)
        grid = np.linspace(a, b, 20_001)
        work = np.einsum("ki,ij,kj->k", unit(grid).T, form, unit(grid).T)
        near = grid[np.flatnonzero(np.diff(np.sign(work)))]
        middle, half = arc.mean(), 0.5 * (arc[1] - arc[0])
        near = near[np.abs((near - middle + np.pi) % TURN - np.pi) <= half]
        found = regions(tangent, arc, driven).root(Found, a, b)
        seen.add(found is None)
        assert (found is None) == (len(near) == 0)
        if found is not None:
            assert found == pytest.approx(near[0], abs=2 * abs(b - a) / 20_000)
            work = unit(found) @ form @ unit(found)
            assert abs(work) < 1e-12 * np.linalg.norm(form)
    assert seen == {True, False}


@pytest.mark.parametrize("off", [0.5, 2.0])
def test_a_zero_at_an_end_counts_within_the_same_angle(off):
    """W2 vanishes at 0.3: just beyond the ends of the search, then of the region."""
    n = unit(0.3 + np.pi / 2)
    tangent = np.outer(n, unit(0.3))
    whole, part = np.array([-1.0, 1.0]), np.array([0.3 + off * SAME_DIRECTION, 1.0])
    zero = None if off > 1 else pytest.approx(0.3, abs=1e-14)
    for a, b in ((0.3 + off * SAME_DIRECTION, 0.8), (0.3 - off * SAME_DIRECTION, -0.2)):
        assert regions(tangent, whole).root(Found, a, b) == zero
    assert regions(tangent, part).root(Found, 0.0, 0.8) == zero
    assert regions(tangent, 0.6 - part[::-1]).root(Found, 0.8, 0.0) == zero


@pytest.mark.parametrize("count", [7, 500])
def test_directions_of_the_symmetric_subspace_are_spread_over_the_sphere(count):
    """Unit vectors; as many in each slice of height; the mean is next to nothing."""
    found = probe_directions(count, "symmetric")
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.diff(found[:, 2]), -2.0 / count, atol=1e-14)
    assert np.abs(found.mean(axis=0)).max() < 2.0 / count
    plane = probe_directions(count, "diagonal")
    angles = np.unwrap(np.arctan2(plane[:, 1], plane[:, 0]))
    np.testing.assert_allclose(angles, TURN * np.arange(count) / count, atol=1e-12)
