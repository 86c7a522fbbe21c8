"""Geometry, balance and measures against their inverses and finite differences."""

import numpy as np
import pytest
from mpmath import mp, mpf

from tests.oracles.diamond import (
    angle_from_strains,
    branch_from_sides,
    contact_displacement_rates,
    contact_forces,
    external_forces,
    force_rates,
    opposite_contact_strain,
    opposite_gaps,
    overlap_ratio,
    side_lengths,
    side_rates,
    strains,
    stress_of_isotropic_strain,
    stresses,
)

SMALL_STEPS = np.array([1e-2, 5e-3, 2.5e-3, 1.25e-3])


def slope(steps, errors):
    """Order of convergence by least squares on the logarithms."""
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def test_sides_and_branch_are_inverse():
    rng = np.random.default_rng(1)
    length, alpha = rng.uniform(0.1, 3.0, 1000), rng.uniform(1e-6, np.pi / 2 - 1e-6, 1000)
    back = branch_from_sides(*side_lengths(length, alpha))
    np.testing.assert_allclose(back[0], length, rtol=4e-16)
    np.testing.assert_allclose(back[1], alpha, rtol=4e-16)


def test_external_and_contact_forces_are_inverse():
    rng = np.random.default_rng(2)
    N, T, alpha = rng.normal(size=(3, 1000))
    back = contact_forces(*external_forces(N, T, alpha), alpha)
    np.testing.assert_allclose(back, (N, T), atol=1e-15)


def test_external_forces_do_the_contacts_work():
    # Virtual work over half the diamond: F1 D1' + F2 D2' = -4 (N un' + T ut'), any rates.
    rng = np.random.default_rng(3)
    N, T, alpha, D1, D2 = rng.normal(size=(5, 1000))
    F1, F2 = external_forces(N, T, alpha)
    un, ut = contact_displacement_rates(D1, D2, alpha)
    np.testing.assert_allclose(F1 * D1 + F2 * D2, -4 * (N * un + T * ut), atol=3e-14)


@pytest.mark.parametrize("seed", range(5))
def test_rates_are_the_derivatives(seed):
    rng = np.random.default_rng(seed)
    length, alpha, dl, da, N, T, dN, dT = rng.uniform(0.3, 1.0, 8)

    def sides(h):
        return np.array(side_lengths(length + h * dl, alpha + h * da))

    def forces(h):
        return np.array(external_forces(N + h * dN, T + h * dT, alpha + h * da))

    F1, F2 = forces(0.0)
    for function, rate in (
        (sides, np.array(side_rates(length, alpha, dl, da))),
        (forces, np.array(force_rates(dN, dT, da, F1, F2, alpha))),
    ):
        central = [np.abs((function(h) - function(-h)) / (2 * h) - rate).max() for h in SMALL_STEPS]
        assert central[-1] < 1e-5
        assert slope(SMALL_STEPS, central) == pytest.approx(2.0, abs=0.02)


def test_displacement_rates_follow_the_branch():
    # un' = l', ut' = -l alpha' with D' = -L' (15), (16).
    rng = np.random.default_rng(4)
    length, alpha, dl, da = rng.uniform(0.1, 1.4, size=(4, 1000))
    L1_rate, L2_rate = side_rates(length, alpha, dl, da)
    un, ut = contact_displacement_rates(-L1_rate, -L2_rate, alpha)
    np.testing.assert_allclose(un, dl, atol=1e-15)
    np.testing.assert_allclose(ut, -length * da, atol=1e-15)


def test_measures_of_a_loaded_diamond():
    rng = np.random.default_rng(5)
    l0, alpha0 = rng.uniform(0.5, 2.0, 500), rng.uniform(0.1, 1.4, 500)
    length, alpha = l0 * rng.uniform(0.6, 1.0, 500), alpha0 * rng.uniform(0.8, 1.1, 500)
    L10, L20 = side_lengths(l0, alpha0)
    E1, E2 = strains(*side_lengths(length, alpha), L10, L20)
    np.testing.assert_allclose(angle_from_strains(E1, E2, alpha0), alpha, atol=1e-15)
    np.testing.assert_allclose(overlap_ratio(E1, E2, alpha0), 1 - length / l0, atol=1e-15)
    N, T = rng.normal(size=(2, 500))
    F1, F2 = external_forces(N, T, alpha)
    S1, S2 = stresses(F1, F2, L10, L20)
    # Work per reference box: S.E' L10 L20 = F.Delta'.
    np.testing.assert_allclose(
        (S1 * E1 + S2 * E2) * L10 * L20, F1 * L10 * E1 + F2 * L20 * E2, rtol=1e-12, atol=1e-13
    )


@pytest.mark.parametrize("size", [1e-3, 1e-8, 1e-14])
def test_overlap_keeps_its_digits_at_stiff_grains(size):
    rng = np.random.default_rng(6)
    E1, E2 = size * rng.uniform(0.2, 1.0, size=(2, 200))
    alpha0 = rng.uniform(0.01, 1.56, 200)
    with mp.workdps(50):
        exact = [
            float(1 - mp.hypot((1 - mpf(e1)) * mp.cos(mpf(a)), (1 - mpf(e2)) * mp.sin(mpf(a))))
            for e1, e2, a in zip(E1.tolist(), E2.tolist(), alpha0.tolist(), strict=True)
        ]
    np.testing.assert_allclose(overlap_ratio(E1, E2, alpha0), exact, rtol=2e-15)


@pytest.mark.parametrize("alpha0", [1e-9, 0.1, np.pi / 4, 1.5, np.pi / 2 - 1e-9])
def test_isotropic_strain_keeps_the_angle(alpha0):
    E = np.linspace(0.0, 0.9, 10)
    np.testing.assert_allclose(angle_from_strains(E, E, alpha0), alpha0, rtol=1e-15)
    np.testing.assert_allclose(overlap_ratio(E, E, alpha0), E, rtol=4e-16)
    S = stresses(*external_forces(E, 0.0, alpha0), *side_lengths(1.0, alpha0))
    np.testing.assert_allclose(stress_of_isotropic_strain(E, alpha0), S, rtol=1e-15)


def test_opposite_grains_touch_where_the_gap_closes():
    alpha0 = np.radians([20.0, 35.0, 45.0, 55.0, 70.0])
    E = opposite_contact_strain(alpha0)
    gap = np.minimum(*opposite_gaps(E, E, alpha0))
    np.testing.assert_allclose(gap, 0.0, atol=2e-16)
    assert E[2] == pytest.approx(1 - 1 / np.sqrt(2), abs=1e-15)
    assert E[1] == pytest.approx(0.128, abs=5e-4)
    np.testing.assert_allclose(E, E[::-1], rtol=1e-14)
    assert E[0] < 0.0


def test_opposite_gaps_are_distances_between_surfaces():
    L1, L2 = side_lengths(0.8, 0.7)
    L10, L20 = side_lengths(1.0, 0.6)
    gaps = opposite_gaps(*strains(L1, L2, L10, L20), 0.6)
    np.testing.assert_allclose(gaps, (L1 - 1.0, L2 - 1.0), atol=4e-16)
