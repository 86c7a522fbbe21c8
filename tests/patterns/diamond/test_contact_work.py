"""The two routes of Fig. 4 against the integral of force over displacement."""

from itertools import pairwise

import numpy as np
import pytest

from tests.oracles.diamond import work_compress_then_shear, work_shear_then_compress


def integrated_work(route, kn, kt, steps=200_000):
    """Midpoint sum of `N |l'| + T l alpha'` along a route of corners `(length, alpha)`."""
    corners = np.array(route)
    l0, work, T = corners[0, 0], 0.0, 0.0
    for (la, aa), (lb, ab) in pairwise(corners):
        x = (np.arange(steps) + 0.5) / steps
        length = la + x * (lb - la)
        dT = kt * length * (ab - aa) / steps
        shear = T + np.cumsum(dT) - 0.5 * dT
        work += np.sum(-kn * (l0 - length) * (lb - la) + shear * length * (ab - aa)) / steps
        T += dT.sum()
    return work


@pytest.mark.parametrize("seed", range(3))
def test_works_are_the_integrals(seed):
    rng = np.random.default_rng(seed)
    length, alpha, D, kn, kt = rng.uniform(0.2, 1.0, 5) * [1.0, 1.0, 0.2, 1.0, 1.0]
    start, end = (length, 0.0), (length - D, alpha)
    first = integrated_work([start, (length, alpha), end], kn, kt)
    second = integrated_work([start, (length - D, 0.0), end], kn, kt)
    assert float(work_shear_then_compress(length, alpha, D, kn, kt)) == pytest.approx(
        first, rel=1e-10
    )
    assert float(work_compress_then_shear(length, alpha, D, kn, kt)) == pytest.approx(
        second, rel=1e-10
    )


def test_routes_differ_by_the_shear_at_two_lengths():
    length, alpha, D, kt = 1.0, 0.2, np.array([0.0, 0.1, 0.3]), 0.7
    gap = work_shear_then_compress(length, alpha, D, 1.0, kt) - work_compress_then_shear(
        length, alpha, D, 1.0, kt
    )
    np.testing.assert_allclose(
        gap, 0.5 * kt * alpha**2 * (length**2 - (length - D) ** 2), atol=1e-17
    )
    assert gap[0] == 0.0
    assert gap[2] > 0.007
