"""Determinants, the isotropic path and the drained slope against the operator itself."""

import numpy as np
import pytest

from tests.oracles.diamond import (
    TABLE_1,
    TABLE_2,
    branch_from_sides,
    critical_strain,
    determinant,
    determinant_elastic,
    determinant_sliding,
    drained_slope,
    elastic_moduli,
    external_forces,
    geometric_softening,
    isotropic_determinant,
    isotropic_strain_of_stress,
    isotropic_tangent,
    side_lengths,
    sliding_moduli,
    stress_of_isotropic_strain,
    stresses,
    tangent,
)


def random_states(seed, count=1000):
    rng = np.random.default_rng(seed)
    alpha0 = rng.uniform(0.1, np.pi / 2 - 0.1, count)
    E1, E2 = rng.uniform(0.02, 0.5, size=(2, count))
    L10, L20 = side_lengths(1.0, alpha0)
    length, alpha = branch_from_sides((1 - E1) * L10, (1 - E2) * L20)
    N, T = 1 - length, 0.2 * rng.normal(size=count)
    s1, s2 = stresses(*external_forces(N, T, alpha), L10, L20)
    return rng, (E1, E2, s1, s2), alpha0, alpha, length, N, T


def test_determinant_is_the_operators():
    rng, state, alpha0, alpha, *_ = random_states(20)
    lambda1, lambda2 = rng.normal(size=(2, 1000))
    K = tangent(*state, alpha0, lambda1, lambda2)
    error = np.abs(determinant(*state, alpha, lambda1, lambda2) - np.linalg.det(K))
    np.testing.assert_array_less(error / np.linalg.norm(K, axis=(-2, -1)) ** 2, 1e-14)


def test_elastic_determinant():
    rng, state, alpha0, alpha, length, N, _ = random_states(21)
    kappa = rng.uniform(0, 2, 1000)
    K = tangent(*state, alpha0, *elastic_moduli(kappa))
    closed = determinant_elastic(*state, alpha, kappa)
    error = np.abs(closed - np.linalg.det(K)) / np.linalg.norm(K, axis=(-2, -1)) ** 2
    np.testing.assert_array_less(error, 1e-14)
    np.testing.assert_allclose(closed, kappa - N / length, atol=3e-15)


def test_sliding_determinant():
    rng, state, alpha0, alpha, *_ = random_states(22)
    mu, s = rng.uniform(0, 1, 1000), rng.choice([-1.0, 1.0], 1000)
    K = tangent(*state, alpha0, *sliding_moduli(alpha, mu, s))
    closed = determinant_sliding(*state, alpha, mu, s)
    error = np.abs(closed - np.linalg.det(K)) / np.linalg.norm(K, axis=(-2, -1)) ** 2
    np.testing.assert_array_less(error, 1e-14)


def test_determinant_at_yield_knows_only_the_length():
    """-(1 + mu^2) N/l, whatever angle and strains."""
    rng, (E1, E2, *_), alpha0, alpha, length, N, _ = random_states(22)
    mu, s = rng.uniform(0, 1, 1000), rng.choice([-1.0, 1.0], 1000)
    at_yield = stresses(*external_forces(N, s * mu * N, alpha), *side_lengths(1.0, alpha0))
    closed = determinant_sliding(E1, E2, *at_yield, alpha, mu, s)
    np.testing.assert_allclose(closed, -(1 + mu**2) * N / length, rtol=1e-12)


def test_softening_is_the_force_over_the_branch():
    _, state, _, alpha, length, N, _ = random_states(23)
    np.testing.assert_allclose(geometric_softening(*state, alpha), N / length, rtol=2e-14)


@pytest.mark.parametrize("kappa", [0.0, 1e-12, 0.2, 0.24, 0.5, 1.0, 7.0])
@pytest.mark.parametrize("alpha0_deg", [0.01, 20.0, 35.0, 45.0, 60.0, 89.99])
def test_critical_strain_on_the_isotropic_path(kappa, alpha0_deg):
    alpha0, E = np.radians(alpha0_deg), critical_strain(kappa)
    K = isotropic_tangent(E, alpha0, kappa)
    t0, product = np.tan(alpha0), np.cos(alpha0) * np.sin(alpha0)
    expected = product * np.array([[1 / t0**2, 1.0], [1.0, t0**2]])  # (42)
    np.testing.assert_allclose(K, expected, rtol=1e-14, atol=1e-15 * product * (1 + kappa))
    assert abs(isotropic_determinant(E, kappa)) < 1e-14 * (1 + kappa) ** 2


def test_isotropic_tangent_is_the_general_one():
    rng = np.random.default_rng(24)
    alpha0, E, kappa = rng.uniform(0.05, 1.5, 500), rng.uniform(0, 0.8, 500), rng.uniform(0, 3, 500)
    s1, s2 = stress_of_isotropic_strain(E, alpha0)
    K = tangent(E, E, s1, s2, alpha0, *elastic_moduli(kappa))
    special = isotropic_tangent(E, alpha0, kappa)
    error = np.abs(K - special) / np.abs(special).max(axis=(-2, -1), keepdims=True)
    np.testing.assert_array_less(error, 1e-14)
    np.testing.assert_array_equal(special, np.swapaxes(special, -1, -2))
    np.testing.assert_allclose(isotropic_strain_of_stress(s1, alpha0), E, rtol=4e-16)


def test_eigenvalues_at_45_degrees():
    E, kappa = np.array([0.0, 0.1, 0.3, 0.5]), 0.2
    eigenvalues = np.linalg.eigvalsh(isotropic_tangent(E, np.pi / 4, kappa))
    expected = np.sort(np.stack([np.ones(4), kappa - E / (1 - E)], axis=-1), axis=-1)
    np.testing.assert_allclose(eigenvalues, expected, atol=1e-15)


def test_paper_values():
    assert float(critical_strain(0.2)) == pytest.approx(1 / 6, abs=1e-16)
    assert float(critical_strain(0.24)) == pytest.approx(0.1935, abs=5e-5)
    assert float(critical_strain(0.5)) == pytest.approx(1 / 3, abs=1e-16)
    assert stress_of_isotropic_strain(TABLE_1.confinement, TABLE_1.alpha0) == pytest.approx(
        (0.3, 0.3)
    )
    assert stress_of_isotropic_strain(TABLE_2.confinement, TABLE_2.alpha0) == pytest.approx(
        (0.35, 0.17160), abs=5e-6
    )
    assert TABLE_2.confinement == pytest.approx(0.24507, abs=5e-6)
    assert TABLE_2.mu == pytest.approx(np.tan(np.radians(14.0)), abs=1e-16)


def test_drained_slope_holds_the_lateral_stress():
    _, state, alpha0, *_ = random_states(25)
    K = tangent(*state, alpha0, *elastic_moduli(0.3))
    E2_rate = -K[..., 1, 0] / K[..., 1, 1]
    direct = K[..., 0, 0] + K[..., 0, 1] * E2_rate
    scale = np.abs(K[..., 0, 0]) + np.abs(K[..., 0, 1] * E2_rate)
    np.testing.assert_array_less(np.abs(drained_slope(K) - direct) / scale, 1e-14)


def test_drained_slope_at_the_limit_of_strain_control():
    vertical = [[1.0, 1.0], [2.0, 0.0]]
    rising = [[1.0, -1.0], [2.0, -0.0]]
    dead = [[1.0, 0.0], [2.0, 0.0]]
    slopes = drained_slope([vertical, rising, dead])
    assert slopes[0] == -np.inf
    assert slopes[1] == np.inf
    assert np.isnan(slopes[2])
