import numpy as np
import pytest
from scipy.optimize import brentq

from loops import (
    InputError,
    LinearFrictional,
    boundary_vectors,
    contact_forces,
    contact_state,
    nominal_stress,
    polygon_area,
)
from patterns import hexagon, regular_polygon
from tests.oracles.hexagon_balance import (
    HexagonForces,
    hexagon_contact_forces,
    hexagon_external_forces,
    hexagon_lengths,
    hexagon_stress,
)

COUNT = 200


def random_hexagons(seed):
    """Hexagons at random strains with random shear forces, and what they were made from."""
    rng = np.random.default_rng(seed)
    given = {
        "alpha0": np.radians(rng.uniform(15, 75, COUNT)),
        "E1": rng.uniform(0.05, 0.15, COUNT),
        "E2": rng.uniform(0.05, 0.15, COUNT),
        "E_axial": rng.uniform(0.06, 0.12, COUNT),
        "T": rng.uniform(-0.05, 0.05, COUNT),
    }
    given["E1"] = np.maximum(given["E1"], given["E_axial"])
    return hexagon(**given, radius=0.8, kn=3.0), given


def measured(graph):
    """Extent, angle and contact forces, read off the graph."""
    x, state = graph.x, contact_state(graph)
    alpha = np.arctan2(x[:, 1, 1], x[:, 0, 0] - x[:, 1, 0])
    return alpha, state.normal_force[:, 0], state.shear_force[:, 0], state.normal_force[:, 1]


def net_forces(graph):
    """External force on every grain that holds the contact forces."""
    force, f = np.zeros(graph.x.shape), contact_forces(graph)
    i, j = graph.contacts.T
    for c in range(6):
        force[:, i[c]] += f[:, c]
        force[:, j[c]] -= f[:, c]
    return force


def test_sixty_degrees_are_the_regular_hexagon():
    strain = np.array([0.0, 0.1, 0.4])
    one = hexagon(np.pi / 3, E1=strain, E2=strain, radius=0.7, kn=2.0)
    regular = regular_polygon(6, strain=strain, radius=0.7, kn=2.0)
    for name in ("x", "x0", "normal_force", "shear_force", "radii"):
        np.testing.assert_allclose(
            getattr(one, name), getattr(regular, name) + 0 * getattr(one, name), atol=1e-14
        )


def test_extent_and_branches_follow_the_strains():
    graph, given = random_hexagons(1)
    l0, x = 1.6, graph.x
    L10, L20 = hexagon_lengths(l0, l0, given["alpha0"])
    np.testing.assert_allclose(x[:, 0, 0] - x[:, 3, 0], L10 * (1 - given["E1"]), rtol=1e-14)
    np.testing.assert_allclose(x[:, 1, 1] - x[:, 4, 1], L20 * (1 - given["E2"]), rtol=1e-14)
    np.testing.assert_allclose(x[:, 1, 0] - x[:, 2, 0], l0 * (1 - given["E_axial"]), rtol=1e-14)
    state = contact_state(graph)
    expected = LinearFrictional(kn=3.0, kt=1.0).normal_force(state)
    np.testing.assert_allclose(graph.normal_force, expected, atol=1e-14)
    alpha, *_ = measured(graph)
    now = hexagon_lengths(state.length[:, 0], state.length[:, 1], alpha)
    np.testing.assert_allclose(now, [x[:, 0, 0] - x[:, 3, 0], x[:, 1, 1] - x[:, 4, 1]], rtol=1e-13)
    np.testing.assert_allclose(graph.x0[:, 1, 0] - graph.x0[:, 2, 0], l0, rtol=1e-15)


def test_balance_of_every_grain():
    """The closed form against the contact forces of the graph, summed grain by grain."""
    graph, _ = random_hexagons(2)
    alpha, N1, T1, N2 = measured(graph)
    F1, F2, G = hexagon_external_forces(N1, T1, N2, alpha)
    zero = np.zeros(COUNT)
    expected = np.array(
        [[-F1, zero], [-G, -F2 / 2], [G, -F2 / 2], [F1, zero], [G, F2 / 2], [-G, F2 / 2]]
    )
    np.testing.assert_allclose(np.moveaxis(net_forces(graph), 0, -1), expected, atol=1e-14)


def test_contact_forces_are_the_inverse():
    rng = np.random.default_rng(3)
    F1, F2, G, alpha = rng.uniform(0.1, 1.4, (4, COUNT))
    found = hexagon_external_forces(*hexagon_contact_forces(F1, F2, alpha, G), alpha)
    np.testing.assert_allclose(found, [F1, F2, G], rtol=0, atol=1e-15)


def test_stress_is_love_webers():
    graph, given = random_hexagons(4)
    alpha, N1, T1, N2 = measured(graph)
    forces = hexagon_external_forces(N1, T1, N2, alpha)
    P11, P22 = hexagon_stress(forces, *hexagon_lengths(1.6, 1.6, given["alpha0"]), 1.6)
    expected = nominal_stress(graph)
    np.testing.assert_allclose(P11, expected[:, 0, 0], rtol=1e-13)
    np.testing.assert_allclose(P22, expected[:, 1, 1], rtol=1e-13)
    np.testing.assert_allclose(expected[:, 0, 1], 0.0, atol=1e-14)


def test_uniform_stress_pushes_half_as_much_on_the_inner_grains():
    """G = F1/2 puts -P B_i on every grain of the reference polygon."""
    graph, given = random_hexagons(5)
    alpha, N1, T1, _ = measured(graph)
    F1, F2, _ = hexagon_external_forces(N1, T1, 0.0, alpha)
    N2 = hexagon_contact_forces(F1, F2, alpha, G=F1 / 2)[2]
    normal = graph.normal_force.copy()
    normal[:, [1, 4]] = N2[:, None]
    balanced = graph.replace(normal_force=normal)
    P = nominal_stress(balanced)
    expected = -np.einsum("kij,kgj->kgi", P, boundary_vectors(graph.x0))
    np.testing.assert_allclose(net_forces(balanced), expected, atol=1e-14)
    L10, L20 = hexagon_lengths(1.6, 1.6, given["alpha0"])
    np.testing.assert_allclose(P[:, 0, 0], 2 * F1 / L20, rtol=1e-13)
    np.testing.assert_allclose(
        hexagon_stress(HexagonForces(F1, F2, F1 / 2), L10, L20, 1.6)[0], 2 * F1 / L20, rtol=1e-14
    )
    np.testing.assert_allclose(polygon_area(graph.x0), L20 * (L10 + 1.6) / 2, rtol=1e-14)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_the_inner_freedom_can_be_balanced(share):
    """An axial strain exists that leaves G = 0 (H-model) or G = F1/2 (uniform stress)."""

    def excess(axial):
        graph = hexagon(np.radians([50.0]), E1=0.1, E2=0.1, E_axial=axial)
        alpha, N1, T1, N2 = measured(graph)
        F1, _, G = hexagon_external_forces(N1, T1, N2, alpha)
        return float((G - share * F1)[0])

    axial = brentq(excess, 0.01, 0.15, xtol=1e-15)
    # The H-model's axial contacts carry half of the outer force, uniform stress all of it.
    graph = hexagon(np.radians([50.0]), E1=0.1, E2=0.1, E_axial=axial)
    outer = -net_forces(graph)[0, 0, 0]
    assert graph.normal_force[0, 1] == pytest.approx((0.5 + share) * outer, rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"alpha0": 0.0}, "alpha0"),
        ({"alpha0": np.pi / 2}, "alpha0"),
        ({"alpha0": 1.0, "E1": 1.0}, "E1"),
        ({"alpha0": 1.0, "E_axial": 1.0}, "E_axial"),
        ({"alpha0": 1.0, "E1": -0.1}, "part the grains"),
        ({"alpha0": 1.0, "E1": 0.01, "E2": 0.1, "E_axial": -0.01}, "part the grains"),
        ({"alpha0": 1.3, "E1": 0.5, "E2": 0.2, "E_axial": 0.1}, "room"),
        ({"alpha0": 1.0, "T": np.nan}, "T"),
        ({"alpha0": 1.0, "radius": 0.0}, "radius"),
        ({"alpha0": 1.0, "kn": -1.0}, "kn"),
    ],
)
def test_bad_hexagons(arguments, word):
    with pytest.raises(InputError, match=word):
        hexagon(**arguments)
