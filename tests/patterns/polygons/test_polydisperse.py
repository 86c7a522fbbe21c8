import mpmath
import numpy as np
import pytest

from loops import (
    InputError,
    LinearFrictional,
    contact_frame,
    contact_state,
    polygon_area,
    polygon_centroid,
)
from patterns import polydisperse_polygon, regular_polygon


def circle_of(corners):
    """Centre and radius of the circle through three corners, far apart along the ring."""
    a, b, c = corners[0], corners[len(corners) // 3], corners[(2 * len(corners)) // 3]
    centre = np.linalg.solve(2 * np.array([b - a, c - a]), [b @ b - a @ a, c @ c - a @ a])
    return centre, np.linalg.norm(a - centre)


def exact_area(radii):
    """Area of the polygon on a circle to 40 digits, by bisection for the circle's radius."""
    with mpmath.workdps(40):
        sizes = [mpmath.mpf(float(r)) for r in radii]
        sides = [a + b for a, b in zip(sizes, sizes[1:] + sizes[:1], strict=True)]
        longest = max(sides)
        rest = list(sides)
        rest.remove(longest)

        def turn(half):
            return sum(mpmath.asin(s / longest * mpmath.sin(half)) for s in rest) + half - mpmath.pi

        low, high = mpmath.mpf("1e-9"), mpmath.pi - mpmath.mpf("1e-12")
        half = mpmath.findroot(turn, (low, high), solver="anderson", tol=1e-60)
        radius = longest / (2 * mpmath.sin(half))
        halves = [*(mpmath.asin(s / longest * mpmath.sin(half)) for s in rest), half]
        return float(sum(radius**2 * mpmath.sin(2 * h) / 2 for h in halves))


@pytest.mark.parametrize("order", [3, 4, 5, 6, 11, 200])
def test_equal_radii_give_the_regular_polygon(order):
    loop = polydisperse_polygon(np.full(order, 0.7), strain=[0.0, 0.2], kn=3.0)
    regular = regular_polygon(order, strain=[0.0, 0.2], radius=0.7, kn=3.0)
    for name in ("x", "x0", "normal_force", "shear_force"):
        np.testing.assert_allclose(
            getattr(loop, name), getattr(regular, name), rtol=0, atol=1e-14 * order
        )


@pytest.mark.parametrize("order", [3, 4, 5, 8, 30])
@pytest.mark.parametrize("ratio", [1.5, 1e3])
def test_corners_lie_on_a_circle_and_branches_touch(order, ratio):
    radii = ratio ** np.random.default_rng(order).uniform(0, 1, (40, order))
    loops = polydisperse_polygon(radii)
    # The last branch closes the ring: it carries the rounding of all the others.
    atol = 2e-15 * order * ratio
    np.testing.assert_allclose(
        contact_frame(loops)[0], radii + np.roll(radii, -1, axis=1), rtol=0, atol=atol
    )
    assert (polygon_area(loops.x) > 0).all()
    np.testing.assert_allclose(polygon_centroid(loops.x), 0.0, atol=1e-12 * ratio)
    for corners in loops.x:
        centre, radius = circle_of(corners)
        distance = np.linalg.norm(corners - centre, axis=1)
        np.testing.assert_allclose(distance, radius, rtol=1e-8)


@pytest.mark.parametrize("seed", range(8))
def test_area_against_forty_digits(seed):
    rng = np.random.default_rng(seed)
    radii = 30.0 ** rng.uniform(0, 1, int(rng.integers(3, 9)))
    assert polygon_area(polydisperse_polygon(radii).x) == pytest.approx(
        exact_area(radii), rel=1e-12
    )


def test_three_discs_are_herons_triangle():
    radii = np.random.default_rng(1).uniform(0.1, 1.0, (50, 3))
    area = np.sqrt(radii.prod(axis=1) * radii.sum(axis=1))
    np.testing.assert_allclose(polygon_area(polydisperse_polygon(radii).x), area, rtol=1e-13)


@pytest.mark.parametrize(
    ("radii", "outside"), [([1.0, 2.0, 1.0, 3.0], False), ([1.0, 1.0, 0.05, 0.05], True)]
)
def test_four_discs_are_brahmaguptas_quadrilateral(radii, outside):
    loop = polydisperse_polygon(radii)
    sides = np.add(radii, np.roll(radii, -1))
    expected = np.sqrt(np.prod(0.5 * sides.sum() - sides))
    assert polygon_area(loop.x) == pytest.approx(expected, rel=1e-13)
    centre, _ = circle_of(loop.x)
    d = np.roll(loop.x, -1, axis=0) - loop.x
    to = centre - loop.x
    assert (d[:, 0] * to[:, 1] - d[:, 1] * to[:, 0] < 0).any() == outside


def test_grain_zero_is_seen_along_axis_one():
    loop = polydisperse_polygon([1.0, 2.0, 0.5, 1.5, 1.0])
    centre, radius = circle_of(loop.x)
    np.testing.assert_allclose(loop.x[0] - centre, [radius, 0.0], atol=1e-13)


def test_normal_forces_are_the_overlaps():
    radii = np.random.default_rng(4).uniform(0.2, 1.0, (20, 6))
    loop = polydisperse_polygon(radii, strain=np.linspace(0, 0.3, 20), kn=2.0)
    expected = LinearFrictional(kn=2.0, kt=1.0).normal_force(contact_state(loop))
    np.testing.assert_allclose(loop.normal_force, expected, rtol=1e-13, atol=1e-14)
    assert not loop.normal_force[0].any()


@pytest.mark.parametrize("radii", [[1.0, 1.0], [1.0, 0.0, 1.0], [1.0, np.inf, 1.0], 1.0])
def test_bad_radii(radii):
    with pytest.raises(InputError, match="radii"):
        polydisperse_polygon(radii)
