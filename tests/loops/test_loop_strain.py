"""Loop strain: affine motions, an integral over the boundary, rotations in 40 digits."""

import numpy as np
import pytest
from mpmath import matrix, mp

from loops import InputError, best_fit_strain, loop_strain, rotation_and_stretch
from patterns import random_loop


def polygons(order, count=20):
    return np.stack([random_loop(order, seed).x for seed in range(count)])


@pytest.mark.parametrize("order", [3, 4, 5, 12])
@pytest.mark.parametrize("clockwise", [False, True])
def test_exact_for_affine_motions(order, clockwise):
    x0 = polygons(order)
    if clockwise:
        x0 = x0[:, ::-1]
    H = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 2, 2))
    x = x0 @ np.swapaxes(np.eye(2) - H, 1, 2) + [3.0, -7.0]
    np.testing.assert_allclose(loop_strain(x0, x), H, rtol=0, atol=1e-13)
    np.testing.assert_allclose(best_fit_strain(x0, x), H, rtol=0, atol=1e-13)


def test_is_the_boundary_integral_of_the_displacement():
    """`H = -(1/V0) Int u (x) n ds`, u linear along the sides, n outward; Simpson is exact."""
    rng = np.random.default_rng(2)
    x0 = random_loop(7, 5).x
    u = 0.1 * rng.standard_normal((7, 2))
    total = np.zeros((2, 2))
    area = 0.0
    for k in range(7):
        a, b = x0[k], x0[(k + 1) % 7]
        outward = np.array([b[1] - a[1], a[0] - b[0]])
        ends = u[k], u[(k + 1) % 7]
        mean = (ends[0] + 4 * (0.5 * (ends[0] + ends[1])) + ends[1]) / 6
        total += np.outer(mean, outward)
        area += 0.5 * (a[0] * b[1] - a[1] * b[0])
    np.testing.assert_allclose(loop_strain(x0, x0 + u), -total / area, rtol=0, atol=1e-14)


def test_strains_of_two_halves_add_up_by_area():
    """A square cut along its diagonal: what makes loop strains average to the sample's."""
    x0 = np.array([[0.0, 0], [1, 0], [1.2, 1.1], [0, 1]])
    x = x0 + 0.1 * np.random.default_rng(3).standard_normal((4, 2))
    parts = [[0, 1, 2], [0, 2, 3]]
    areas = [0.5 * (1 * 1.1), 0.5 * (1.2 * 1)]
    mean = sum(a * loop_strain(x0[p], x[p]) for a, p in zip(areas, parts, strict=True))
    np.testing.assert_allclose(mean / sum(areas), loop_strain(x0, x), rtol=0, atol=1e-14)


def test_far_from_the_origin_no_digits_are_lost():
    x0 = polygons(5)
    H = np.full((2, 2), 1e-3)
    near = loop_strain(x0, x0 - x0 @ H.T)
    # Coordinates of 1e6 are rounded to 1e-10; the strain of a unit loop can't be better.
    far = loop_strain(x0 + 1e6, x0 + 1e6 - x0 @ H.T)
    np.testing.assert_allclose(far, near, rtol=0, atol=5e-9)


def test_best_fit_minimises_the_residual():
    """Against numpy's least squares of the same problem, for a motion that is not affine."""
    rng = np.random.default_rng(4)
    x0 = rng.uniform([35, -5], [45, 5], (300, 2))
    x = x0 + 0.1 * rng.standard_normal((300, 2))
    design = np.column_stack([x0, np.ones(300)])
    F = np.linalg.lstsq(design, x, rcond=None)[0][:2].T
    np.testing.assert_allclose(best_fit_strain(x0, x), np.eye(2) - F, rtol=0, atol=1e-13)


@pytest.mark.parametrize("size", [1e-9, 1e-3, 0.3])
def test_polar_decomposition_against_forty_digits(size):
    H = size * np.random.default_rng(5).uniform(-1, 1, (20, 2, 2))
    angle, strain = rotation_and_stretch(H)
    with mp.workdps(40):
        for k in range(20):
            F = mp.eye(2) - matrix(H[k].tolist())
            c, e = F.T * F, mp.sqrt(mp.det(F.T * F))
            # Square root of a 2x2 matrix: (C + sqrt(det C)) / sqrt(tr C + 2 sqrt(det C)).
            U = (c + e * mp.eye(2)) / mp.sqrt(c[0, 0] + c[1, 1] + 2 * e)
            R = F * U**-1
            exact = np.array((mp.eye(2) - U).tolist(), dtype=float)
            assert np.abs(strain[k] - exact).max() < 4e-16 * size
            assert abs(angle[k] - float(mp.atan2(R[1, 0], R[0, 0]))) < 4e-16 * size


def test_pure_rotation_has_no_stretch():
    angle = np.array([-3.0, -1.0, 1e-8, 0.0, 2.0])
    half = np.sin(angle / 2)
    # R - 1 without the cancellation of 1 - cos.
    diagonal, off = -2 * half**2, 2 * half * np.cos(angle / 2)
    R = np.moveaxis(np.array([[diagonal, -off], [off, diagonal]]), -1, 0)
    found, strain = rotation_and_stretch(-R)
    np.testing.assert_allclose(found, angle, rtol=1e-15)
    # Terms of size 2 cancel, each rounded once or twice.
    np.testing.assert_allclose(strain, 0, atol=1e-15)


def test_bad_input_is_named():
    x0 = random_loop(5, 0).x
    with pytest.raises(InputError, match="corners of the loops"):
        loop_strain(x0, x0[:4])
    line = np.column_stack([np.arange(4.0), np.zeros(4)])
    with pytest.raises(InputError, match="area"):
        loop_strain(line, line)
    with pytest.raises(InputError, match="all on a line"):
        best_fit_strain(line, line)
    with pytest.raises(InputError, match="at least 3"):
        best_fit_strain(x0[:2], x0[:2])
    with pytest.raises(InputError, match=r"got shape .* expected shape"):
        best_fit_strain(x0, x0[:3])
