"""The diamond as a grain graph: balance, batch axes, and the generic operator."""

import numpy as np
import pytest

from loops import (
    LinearFrictional,
    Regime,
    affine_tangent,
    branch_vectors,
    contact_forces,
    nominal_stress,
    traction_tangent,
)
from patterns import diamond
from tests.oracles.diamond import (
    angle_from_strains,
    branch_from_sides,
    elastic_moduli,
    external_forces,
    side_lengths,
    sliding_moduli,
    stresses,
    tangent,
)


def random_graphs(seed, count):
    rng = np.random.default_rng(seed)
    alpha0 = rng.uniform(0.1, np.pi / 2 - 0.1, count)
    E1, E2 = rng.uniform(0.02, 0.5, size=(2, count))
    L10, L20 = side_lengths(1.0, alpha0)
    length, alpha = branch_from_sides((1 - E1) * L10, (1 - E2) * L20)
    return rng, alpha0, E1, E2, L10, L20, alpha, 1.0 - length


def net_forces(graph):
    """Sum of contact forces on every grain (..., 4, 2)."""
    f, net = contact_forces(graph), np.zeros(graph.x.shape)
    for c, (i, j) in enumerate(graph.contacts):
        net[..., i, :] -= f[..., c, :]
        net[..., j, :] += f[..., c, :]
    return net


def test_contacts_balance_the_external_forces():
    rng, alpha0, E1, E2, _, _, alpha, N = random_graphs(30, 200)
    T = 0.3 * rng.normal(size=200)
    graph = diamond(alpha0, E1=E1, E2=E2, T=T)
    F1, F2 = external_forces(N, T, alpha)
    zero = np.zeros(200)
    pushes = np.stack([[F1, zero], [zero, F2], [-F1, zero], [zero, -F2]])  # contacts push outward
    np.testing.assert_allclose(net_forces(graph), np.moveaxis(pushes, -1, 0), atol=1e-15)


def test_order_of_grains_and_signs_of_shear():
    graph = diamond(np.pi / 6, T=0.1)
    np.testing.assert_allclose(
        graph.x, [[0.75**0.5, 0], [0, 0.5], [-(0.75**0.5), 0], [0, -0.5]], atol=1e-16
    )
    assert graph.contacts.tolist() == [[0, 1], [1, 2], [2, 3], [3, 0]]
    assert graph.shear_force.tolist() == [0.1, -0.1, 0.1, -0.1]
    assert graph.normal_force.tolist() == [0.0] * 4


def test_units_and_reference():
    graph = diamond(0.7, E1=0.2, E2=0.1, radius=3.0, kn=50.0)
    unit = diamond(0.7, E1=0.2, E2=0.1)
    np.testing.assert_allclose(graph.x, 6.0 * unit.x, rtol=4e-16)
    np.testing.assert_allclose(graph.x0, 6.0 * unit.x0, rtol=4e-16)
    np.testing.assert_allclose(graph.normal_force, 300.0 * unit.normal_force, rtol=1e-15)
    np.testing.assert_allclose(
        np.linalg.norm(branch_vectors(graph), axis=-1),
        6.0 - 300.0 / 50.0 * unit.normal_force,
        rtol=1e-15,
    )
    np.testing.assert_allclose(np.linalg.norm(graph.reference_branches, axis=-1), 6.0, rtol=2e-16)


def test_batch_axes_broadcast():
    graph = diamond(
        np.radians([30.0, 45.0])[:, None], E1=[0.1, 0.2, 0.3], E2=0.1, radius=[[1.0], [2.0]]
    )
    assert graph.batch_shape == (2, 3)
    one = diamond(np.radians(45.0), E1=0.3, E2=0.1, radius=2.0)
    np.testing.assert_array_equal(graph.x[1, 2], one.x)
    np.testing.assert_array_equal(graph.normal_force[1, 2], one.normal_force)


def test_nominal_stress_is_the_papers_over_the_bounding_box():
    rng, alpha0, E1, E2, L10, L20, alpha, N = random_graphs(31, 200)
    T = 0.3 * rng.normal(size=200)
    P = nominal_stress(diamond(alpha0, E1=E1, E2=E2, T=T), volume=L10 * L20)
    s1, s2 = stresses(*external_forces(N, T, alpha), L10, L20)
    np.testing.assert_allclose(P[..., 0, 0], s1, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(P[..., 1, 1], s2, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(P[..., 0, 1], 0.0, atol=1e-15)
    np.testing.assert_allclose(P[..., 1, 0], 0.0, atol=1e-15)


@pytest.mark.parametrize("macroscopic", [affine_tangent, traction_tangent])
@pytest.mark.parametrize("regime", [Regime.ELASTIC, Regime.SLIDING])
def test_generic_operator_is_the_papers(macroscopic, regime):
    rng, alpha0, E1, E2, L10, L20, alpha, N = random_graphs(32, 1000)
    kappa, mu = 0.35, 0.3
    s = rng.choice([-1.0, 1.0], 1000)
    T = s * mu * N if regime == Regime.SLIDING else mu * N * rng.uniform(-1, 1, 1000)
    graph = diamond(alpha0, E1=E1, E2=E2, T=T)
    law = LinearFrictional(kn=1.0, kt=kappa, mu=mu)
    # The paper's stresses refer to the bounding box, twice the rhombus.
    whole = 0.5 * macroscopic(graph, law, regime=np.full((1000, 4), regime)).matrix
    A = whole[..., ::3, ::3]
    moduli = sliding_moduli(alpha, mu, s) if regime == Regime.SLIDING else elastic_moduli(kappa)
    s1, s2 = stresses(*external_forces(N, T, alpha), L10, L20)
    K = tangent(E1, E2, s1, s2, alpha0, *moduli)
    error = np.abs(A - K) / np.linalg.norm(K, axis=(-2, -1), keepdims=True)
    assert error.max() < 1e-13
    # The symmetric loop keeps (11, 22) apart from shear.
    assert np.abs(whole[..., ::3, 1:3]).max() < 1e-10


def test_stiff_grains_keep_their_forces():
    E = 1e-12
    np.testing.assert_allclose(diamond(0.6, E1=E, E2=E).normal_force, E, rtol=1e-15)
    # A rigid diamond that turns: the strains leave l at 2 radius up to rounding.
    alpha0, alpha = 0.6, 0.65
    E1, E2 = 1 - np.cos(alpha) / np.cos(alpha0), 1 - np.sin(alpha) / np.sin(alpha0)
    assert diamond(alpha0, E1=E1, E2=E2).normal_force.max() < 1e-15
    assert float(angle_from_strains(E1, E2, alpha0)) == pytest.approx(alpha, abs=1e-15)
