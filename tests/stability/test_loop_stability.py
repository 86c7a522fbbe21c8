"""Loops judged in one go: the compiled way against numpy and 50 digits, soft directions."""

import mpmath as mp
import numpy as np
import pytest

from stability import (
    operator_norm,
    plane_cone,
    restrict,
    symmetric_modes,
    symmetric_part,
    unstable_fraction,
)
from stability.compiled.modes import loop_modes
from stability.verdict import loop_stability, soft_angle


def tangents():
    """Definite, indefinite, nearly round, singular, of all sizes."""
    rng = np.random.default_rng(0)
    a = rng.normal(size=(2000, 4, 4))
    a[:500] += 3 * np.eye(4)
    a[500:1000] *= 10.0 ** rng.uniform(-12, 12, (500, 1, 1))
    a[1000:1300] = 2 * np.eye(4) + 1e-9 * a[1000:1300]
    a[1300:1600] = np.einsum("ni,nj->nij", a[1300:1600, 0], a[1300:1600, 1])
    stretch = 10.0 ** rng.uniform(-8, 0, (400, 4))
    a[1600:] *= stretch[:, :, None] * stretch[:, None, :]
    return a


def test_modes_against_numpy():
    a = tangents()
    values, softest, opening = loop_modes(a, True)
    k = restrict(a, "symmetric")
    size = operator_norm(k)
    expected, _ = symmetric_modes(k)
    assert np.abs((values - expected) / size[:, None]).max() < 2e-15
    rest = np.einsum("nij,nj->ni", symmetric_part(k), softest) - values[:, :1] * softest
    assert (np.linalg.norm(rest, axis=1) / size).max() < 2e-15
    np.testing.assert_allclose(np.linalg.norm(softest, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(opening, plane_cone(restrict(a, "diagonal")).opening, atol=1e-14)
    np.testing.assert_array_equal(loop_modes(a, False)[0], values)


@pytest.mark.parametrize("count", [0, 1, 31, 33])
def test_a_tangent_has_one_spectrum_whatever_stands_beside_it(count):
    a = tangents()[500 : 500 + count]
    a[::3] = np.nan
    alone = [loop_modes(one[None], True) for one in a]
    for together, each in zip(loop_modes(a, True), zip(*alone, strict=True), strict=False):
        np.testing.assert_array_equal(together, np.concatenate(each))
    np.testing.assert_array_equal(
        np.isnan(loop_modes(a, False)[0]).all(axis=1), np.isnan(a).any(axis=(1, 2))
    )


def test_eigenvalues_against_fifty_digits():
    a = tangents()[::97]
    values, _, _ = loop_modes(a, True)
    for k, found in zip(restrict(a, "symmetric"), values, strict=True):
        with mp.workdps(50):
            exact = mp.eigsy(mp.matrix(((k + k.T) / 2).tolist()), eigvals_only=True)
            exact = sorted(float(value) for value in exact)
        assert np.abs(found - exact).max() < 2e-15 * np.linalg.norm(k)


def test_either_way_gives_the_same():
    a = tangents()
    plain, fast = loop_stability(a), loop_stability(a, compiled=True)
    size = operator_norm(restrict(a, "symmetric"))[:, None]
    assert (np.abs(fast.eigenvalues - plain.eigenvalues) / size).max() < 2e-15
    # A semi-definite form has a fraction of order sqrt(eps), from rounding alone.
    np.testing.assert_allclose(fast.unstable_fraction, plain.unstable_fraction, atol=1e-7)
    regular = np.abs(plain.eigenvalues).min(axis=1) > 1e-6 * size[:, 0]
    np.testing.assert_allclose(
        fast.unstable_fraction[regular], unstable_fraction(plain.eigenvalues[regular]), atol=1e-10
    )
    gap = np.diff(plain.eigenvalues, axis=1)[:, 0] > 1e-3 * size[:, 0]
    turn = np.abs(fast.soft_angle - plain.soft_angle)[gap]
    # The axes of a pure shear are told apart by the sign of a trace that is nearly nothing.
    assert np.median(turn) < 1e-14
    assert (np.minimum(turn, np.pi - turn) < 1e-10).mean() > 0.99


@pytest.mark.parametrize("compiled", [False, True])
def test_what_is_not_finite_stays_so(compiled):
    a = np.stack([np.eye(4), np.full((4, 4), np.nan), np.zeros((4, 4))])
    found = loop_stability(a, compiled=compiled)
    assert np.isnan(found.eigenvalues[1]).all()
    for values in (found.unstable_fraction, found.cone_opening, found.soft_angle):
        assert np.isnan(values).tolist() == [False, True, False]
    assert found.eigenvalues[2].tolist() == [0.0, 0.0, 0.0]
    assert found.cone_opening[[0, 2]].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("angle", [-89.0, -45.0, -10.0, 0.0, 30.0, 90.0])
def test_soft_angle_of_a_uniaxial_strain(angle, sign):
    """The axis of compression of `e n (x) n` is n, whatever the sign of the mode."""
    n = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    for lateral in (0.0, 0.3, -0.9):
        strain = np.outer(n, n) + lateral * (np.eye(2) - np.outer(n, n))
        mode = sign * np.array([strain[0, 0], strain[1, 1], np.sqrt(2.0) * strain[0, 1]])
        found = float(np.degrees(soft_angle(mode)))
        assert abs((found - angle + 90) % 180 - 90) < 1e-12
        assert -90 < found <= 90


def test_soft_direction_of_a_soft_axis():
    """A tangent that is softest against uniaxial strain along 25 degrees says so."""
    n = np.array([np.cos(np.radians(25)), np.sin(np.radians(25))])
    soft = np.outer(n, n).ravel()
    a = np.eye(4) - 1.5 * np.outer(soft, soft)
    for compiled in (False, True):
        found = loop_stability(a[None], compiled=compiled)
        assert found.eigenvalues[0] == pytest.approx([-0.5, 1.0, 1.0], abs=1e-15)
        assert np.degrees(found.soft_angle) == pytest.approx(25, abs=1e-12)
