"""The closed forms of the tangent against sympy, finite differences and each other."""

import numpy as np
import pytest

from tests.oracles import diamond_symbolic as symbolic
from tests.oracles.diamond import (
    angle_from_strains,
    branch_from_sides,
    congruence,
    elastic_moduli,
    external_forces,
    force_geometric_tangent,
    force_material_tangent,
    force_tangent,
    geometric_asymmetry,
    geometric_tangent,
    lagrangian_tangent,
    material_asymmetry,
    material_tangent,
    side_lengths,
    sliding_moduli,
    strains,
    stresses,
    tangent,
)

STEPS = np.array([4e-3, 2e-3, 1e-3, 5e-4])


def random_diamonds(seed, count):
    """Reference angle, strains, T, kappa, mu, s of random compressed diamonds."""
    rng = np.random.default_rng(seed)
    alpha0 = rng.uniform(0.1, np.pi / 2 - 0.1, count)
    E1, E2 = rng.uniform(-0.1, 0.5, size=(2, count))
    T, kappa, mu = rng.normal(size=count), rng.uniform(0, 2, count), rng.uniform(0, 1, count)
    return alpha0, E1, E2, T, kappa, mu, rng.choice([-1.0, 1.0], count)


def sides_and_forces(alpha0, E1, E2, T):
    L10, L20 = side_lengths(1.0, alpha0)
    L1, L2 = (1 - E1) * L10, (1 - E2) * L20
    length, alpha = branch_from_sides(L1, L2)
    return L1, L2, L10, L20, alpha, *external_forces(1.0 - length, T, alpha)


def moduli_of(regime, alpha, kappa, mu, s):
    return elastic_moduli(kappa) if regime == "elastic" else sliding_moduli(alpha, mu, s)


def symbolic_operator(operator, L1, L2, L10, L20, alpha, F1, F2, kn, kappa, mu, s):
    o = symbolic
    function = o.numeric(operator, o.L1, o.L2, o.L10, o.L20, o.N, o.T, o.kn, o.kappa, o.mu, o.sign)
    N = 0.5 * (F1 * np.cos(alpha) + F2 * np.sin(alpha))
    T = 0.5 * (F1 * np.sin(alpha) - F2 * np.cos(alpha))
    rows = zip(*np.broadcast_arrays(L1, L2, L10, L20, N, T, kn, kappa, mu, s), strict=True)
    return np.array([function(*row) for row in rows])


@pytest.mark.parametrize("regime", ["elastic", "sliding"])
def test_force_tangent_equals_the_derivative_by_sympy(regime):
    alpha0, E1, E2, T, kappa, mu, s = random_diamonds(10, 1000)
    L1, L2, L10, L20, alpha, F1, F2 = sides_and_forces(alpha0, E1, E2, T)
    kn = np.linspace(0.5, 3.0, 1000)
    K = force_tangent(L1, L2, F1, F2, *moduli_of(regime, alpha, kappa, mu, s), kn=kn)
    exact = symbolic_operator(
        symbolic.force_tangent(regime), L1, L2, L10, L20, alpha, F1, F2, kn, kappa, mu, s
    )
    scale = np.abs(exact).max(axis=(-2, -1), keepdims=True)
    np.testing.assert_array_less(np.abs(K - exact) / scale, 1e-14)


@pytest.mark.parametrize("regime", ["elastic", "sliding"])
def test_tangent_equals_the_derivative_by_sympy(regime):
    alpha0, E1, E2, T, kappa, mu, s = random_diamonds(11, 1000)
    L1, L2, L10, L20, alpha, F1, F2 = sides_and_forces(alpha0, E1, E2, T)
    s1, s2 = stresses(F1, F2, L10, L20)
    K = tangent(E1, E2, s1, s2, alpha0, *moduli_of(regime, alpha, kappa, mu, s))
    exact = symbolic_operator(
        symbolic.lagrangian_tangent(regime), L1, L2, L10, L20, alpha, F1, F2, 1.0, kappa, mu, s
    )
    scale = np.abs(exact).max(axis=(-2, -1), keepdims=True)
    np.testing.assert_array_less(np.abs(K - exact) / scale, 1e-14)


def test_lagrangian_operators_are_kn_times_the_dimensionless_ones():
    # (23), (24), (26), and the same for the two parts: (56), (57) against (27), (28).
    alpha0, E1, E2, T, kappa, _, _ = random_diamonds(12, 1000)
    L1, L2, L10, L20, _, F1, F2 = sides_and_forces(alpha0, E1, E2, T)
    kn, moduli = 2.5, elastic_moduli(kappa)
    s1, s2 = np.array(stresses(F1, F2, L10, L20)) / kn
    pairs = [
        (
            force_tangent(L1, L2, F1, F2, *moduli, kn=kn),
            tangent(E1, E2, s1, s2, alpha0, *moduli),
        ),
        (
            force_material_tangent(L1, L2, *moduli, kn=kn),
            material_tangent(E1, E2, alpha0, *moduli),
        ),
        (force_geometric_tangent(L1, L2, F1, F2), geometric_tangent(E1, E2, s1, s2, alpha0)),
    ]
    for K_force, K in pairs:
        error = np.abs(lagrangian_tangent(K_force, alpha0) - kn * K)
        scale = kn * np.abs(K).max(axis=(-2, -1), keepdims=True)
        np.testing.assert_array_less(error / scale, 1e-14)


def forces_along_a_line(start, direction, h, alpha0, T, kappa, mu, s, regime):
    """Stresses after the strain `start + h direction`, contact law integrated exactly.

    Along a straight strain path `l^2 alpha'` is constant, so `T' = kappa l alpha'` has the
    logarithm of a quadratic's root as its integral; Gauss-Legendre has it to round-off.
    """
    L10, L20 = side_lengths(1.0, alpha0)
    nodes, weights = np.polynomial.legendre.leggauss(12)

    def sides(x):
        E1, E2 = start[0] + x * direction[0], start[1] + x * direction[1]
        return (1 - E1) * L10, (1 - E2) * L20

    L1, L2 = sides(h)
    length, alpha = branch_from_sides(L1, L2)
    if regime == "sliding":
        shear = T + s * mu * (branch_from_sides(*sides(0.0))[0] - length)
    else:
        x1, x2 = sides(0.5 * h * (nodes + 1))
        turn = (x2 * direction[0] * L10 - x1 * direction[1] * L20) / (2 * np.hypot(x1, x2))
        shear = T + kappa * 0.5 * h * np.sum(weights * turn)
    return np.array(stresses(*external_forces(1 - length, shear, alpha), L10, L20))


@pytest.mark.parametrize("regime", ["elastic", "sliding"])
@pytest.mark.parametrize("seed", range(4))
def test_tangent_is_the_slope_of_the_law(regime, seed):
    rng = np.random.default_rng(100 + seed)
    alpha0, T, kappa, mu = rng.uniform(0.4, 1.2), rng.normal(), rng.uniform(0.1, 1), 0.4
    start, direction, s = rng.uniform(0.05, 0.4, 2), rng.normal(size=2), np.sign(T)

    def stress(h):
        return forces_along_a_line(start, direction, h, alpha0, T, kappa, mu, s, regime)

    alpha = angle_from_strains(*start, alpha0)
    K = tangent(*start, *stress(0.0), alpha0, *moduli_of(regime, alpha, kappa, mu, s))
    errors = [np.abs((stress(h) - stress(-h)) / (2 * h) - K @ direction).max() for h in STEPS]
    assert errors[-1] < 1e-4
    assert np.polyfit(np.log(STEPS), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.02)


def test_material_asymmetry_is_the_friction():
    alpha0, E1, E2, _, kappa, mu, s = random_diamonds(13, 1000)
    alpha = angle_from_strains(E1, E2, alpha0)
    elastic = material_tangent(E1, E2, alpha0, *elastic_moduli(kappa))
    sliding = material_tangent(E1, E2, alpha0, *sliding_moduli(alpha, mu, s))
    np.testing.assert_array_equal(elastic[..., 0, 1], elastic[..., 1, 0])
    asymmetry = sliding[..., 0, 1] - sliding[..., 1, 0]
    np.testing.assert_allclose(asymmetry, material_asymmetry(mu, s), atol=1e-15)


def test_geometric_asymmetry_is_the_shear_force():
    alpha0, E1, E2, T, *_ = random_diamonds(14, 1000)
    L1, L2, L10, L20, alpha, F1, F2 = sides_and_forces(alpha0, E1, E2, T)
    s1, s2 = stresses(F1, F2, L10, L20)
    K = geometric_tangent(E1, E2, s1, s2, alpha0)
    expected = -T / branch_from_sides(L1, L2)[0]
    np.testing.assert_allclose(K[..., 0, 1] - K[..., 1, 0], expected, rtol=1e-13, atol=1e-14)
    closed = geometric_asymmetry(E1, E2, s1, s2, alpha)
    np.testing.assert_allclose(closed, expected, rtol=1e-13, atol=1e-14)


def test_geometric_part_is_symmetric_without_shear():
    alpha0, E1, E2, *_ = random_diamonds(15, 1000)
    _, _, L10, L20, _, F1, F2 = sides_and_forces(alpha0, E1, E2, 0.0)
    K = geometric_tangent(E1, E2, *stresses(F1, F2, L10, L20), alpha0)
    np.testing.assert_allclose(K[..., 0, 1], K[..., 1, 0], atol=1e-16)


def test_appendix_is_a_congruence_and_no_similarity():
    alpha0, E1, E2, T, kappa, *_ = random_diamonds(16, 1000)
    alpha0[0] = np.pi / 4
    L1, L2, _, _, _, F1, F2 = sides_and_forces(alpha0, E1, E2, T)
    K_force = force_tangent(L1, L2, F1, F2, *elastic_moduli(kappa))
    K, D = lagrangian_tangent(K_force, alpha0), congruence(alpha0)
    np.testing.assert_allclose(D @ K_force @ D, K, rtol=2e-15)
    np.testing.assert_allclose(np.linalg.det(D), 1.0, rtol=1e-14)
    symmetric = [np.linalg.eigvalsh(M + np.swapaxes(M, -1, -2)) for M in (K_force, K)]
    np.testing.assert_array_equal(np.sign(symmetric[0]), np.sign(symmetric[1]))
    np.testing.assert_allclose(np.linalg.det(K), np.linalg.det(K_force), rtol=1e-10, atol=1e-13)
    gap = np.abs(np.trace(K, axis1=-2, axis2=-1) - np.trace(K_force, axis1=-2, axis2=-1))
    assert gap[0] < 1e-14
    assert np.count_nonzero(gap > 1e-3) > 900


@pytest.mark.parametrize("alpha0", [1e-6, np.pi / 2 - 1e-6])
@pytest.mark.parametrize("kappa", [0.0, 1e-12, 5.0])
def test_flat_and_tall_diamonds(alpha0, kappa):
    # The operator over its own scale t0^(+-1): K~ stays of order one in these limits.
    E1, E2 = 0.2, 0.1
    L1, L2, L10, L20, _, F1, F2 = sides_and_forces(alpha0, E1, E2, 0.01)
    K = tangent(E1, E2, *stresses(F1, F2, L10, L20), alpha0, kappa, kappa)
    K_force = force_tangent(L1, L2, F1, F2, kappa, kappa)
    back = np.linalg.inv(congruence(alpha0))
    assert np.abs(K_force).max() < 10.0
    np.testing.assert_allclose(back @ K @ back, K_force, rtol=1e-9, atol=1e-14)


def test_strains_of_sides_give_the_same_tangent_in_any_unit():
    L10, L20 = side_lengths(2.5, 0.7)
    L1, L2 = 0.8 * L10, 0.9 * L20
    E1, E2 = strains(L1, L2, L10, L20)
    K = tangent(E1, E2, 0.3, 0.2, 0.7, 0.4, 0.4)
    K_force = force_tangent(L1, L2, 0.3 * L20, 0.2 * L10, 0.4, 0.4)
    np.testing.assert_allclose(lagrangian_tangent(K_force, 0.7), K, rtol=2e-15)
