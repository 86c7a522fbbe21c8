"""Regions of directions: their arcs and the zeros of W2 in them, by brute force over angles."""

from types import SimpleNamespace

import numpy as np
import pytest

from stability.packing.probe import probe_directions
from stability.packing.regime_regions import (
    SAME_DIRECTION,
    RegimeRegions,
    _arc,
    _end,
    cones,
)

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


class Circle:
    """Regions of a W2 that changes its sign at some angles; each zero is known near one of them."""

    def __init__(self, zeros, near=np.inf, turned=0.0, known=(-1.0, 1.0)):
        self.zeros, self.near, self.turned = np.asarray(zeros), near, turned
        self.known, self.asked = known, []

    def answer(self, angle, piece=0):
        """Negative from the first zero to the second, from the third to the fourth, and so on."""
        angle = (angle - self.turned) % TURN
        return SimpleNamespace(
            normalised=1.0 - 2.0 * (np.count_nonzero(self.zeros <= angle) % 2),
            piece=piece,
            angle=angle,
        )

    def root(self, found, a, b):
        for zero in (self.zeros + TURN * np.arange(-2, 4)[:, None]).ravel():
            off = abs((found.angle - zero + np.pi) % TURN - np.pi)
            near = off <= self.near and found.normalised in self.known
            if near and min(a, b) <= zero + self.turned <= max(a, b):
                return float(zero + self.turned)
        return None

    def at(self, direction):
        self.asked.append(direction)
        return self.answer(np.arctan2(direction[1], direction[0]))


def cones_of(circle, angles):
    directions = np.array([unit(angle) for angle in angles])
    return cones(circle, directions, [circle.answer(angle) for angle in angles])


@pytest.mark.parametrize(
    "zeros", [(1.0, 2.0), (0.5, 3.9), (1.0, 1.9, 4.0, 5.5), (1.2, 2.0, 3.0, 3.6, 4.8, 6.1)]
)
@pytest.mark.parametrize("known", [-1.0, 1.0])
def test_cones_lie_between_the_zeros_beside_their_directions(zeros, known):
    """Turned by any angle, across zero as well; the direction on one side of a zero knows it."""
    rng = np.random.default_rng(6)
    gap = 0.3
    angles = np.arange(0.0, TURN, gap) + rng.uniform(0.0, 0.01, 21)
    for turn in np.linspace(0.0, TURN, 9):
        circle = Circle(zeros, near=1.04 * gap, turned=turn, known=(known,))
        found = cones_of(circle, turn + rng.permutation(angles))
        assert found.refined.all() and not circle.asked
        begin = (found.ends[:, 0] - turn) % TURN
        order = np.argsort(begin)
        np.testing.assert_allclose(begin[order], zeros[::2], rtol=0, atol=1e-12)
        widths = (found.ends[:, 1] - found.ends[:, 0])[order]
        np.testing.assert_allclose(widths, np.subtract(zeros[1::2], zeros[::2]), atol=1e-12)


def test_a_cone_all_around_is_one_turn_from_the_first_direction():
    angles = np.array([2.0, 0.7, 4.0, 5.5, 3.0])
    circle = Circle([0.0])
    found = cones_of(circle, angles)
    np.testing.assert_allclose(found.ends, [[0.7, 0.7 + TURN]], rtol=0, atol=1e-15)
    assert not found.refined.any()
    # Nothing is said where half a turn is left out.
    assert cones_of(circle, [0.1, 0.1 + 1.0001 * np.pi, 5.0]) is None
    assert cones_of(circle, [0.1, 0.1 + 0.9999 * np.pi, 5.0]) is not None
    assert cones(circle, np.ones((3, 3)), [circle.answer(0.0)] * 3) is None


def test_work_within_rounding_of_zero_has_no_sign():
    circle = Circle([1.0, 2.0])
    angles = np.linspace(0.0, TURN, 7)[:-1]
    for size, count in ((0.5e-9, 0), (2e-9, 1)):
        answers = [circle.answer(angle) for angle in angles]
        for answer in answers:
            answer.normalised = min(answer.normalised, 0.0) * size
        found = cones(circle, np.array([unit(angle) for angle in angles]), answers)
        assert len(found.ends) == count


@pytest.mark.parametrize(("a", "b"), [(1.5, 2.5), (1.5, 0.5), (1.5, 2.1)])
def test_an_end_without_a_zero_is_found_by_halving(a, b):
    """To 1e-10 and no further; the side on which W2 is negative is told."""
    circle = Circle([1.0, 2.0], near=-1.0)
    found, sure = _end(circle, circle.answer(a), circle.answer(b), a, b)
    zero = 2.0 if b > a else 1.0
    assert not sure and 0.0 <= (zero - found) * np.sign(b - a) < SAME_DIRECTION
    assert len(circle.asked) == np.ceil(np.log2(abs(b - a) / SAME_DIRECTION))
    # Where there is no answer the last one of the directions stands.
    assert _end(circle, circle.answer(a), circle.answer(b, piece=-1), a, b) == (a, False)


@pytest.mark.parametrize("turns", [-1, 0, 1, 2, 2.5])
def test_zeros_are_found_as_many_turns_away_as_cones_may_reach(turns):
    n = unit(0.3 + np.pi / 2)
    tangent, zero = np.outer(n, unit(0.3)), 0.3 + turns * TURN
    made = regions(tangent, zero + np.array([-1.0, 1.0]))
    assert made.root(Found, zero - 0.1, zero + 0.2) == pytest.approx(zero, abs=1e-13)


@pytest.mark.parametrize("size", [1.0, 2.0**-70, 2.0**70])
def test_rows_that_are_zero_bound_no_arc_in_any_unit(size):
    """Within a right angle of every other row."""
    lines = size * np.array([[1.0, 0.0], [0.6, 0.8], [-1e-14, 0.0]])
    first, last = np.arctan2(0.8, 0.6) - 0.5 * np.pi, 0.5 * np.pi
    np.testing.assert_allclose(_arc(lines, unit(0.4)), [first, last], rtol=1e-12)
    np.testing.assert_allclose(_arc(0.0 * lines, unit(0.4)), 0.4 + np.pi * np.array([-1, 1]))
