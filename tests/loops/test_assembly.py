import numpy as np
import pytest

from loops import (
    GrainGraph,
    LinearFrictional,
    assemble_tangent,
    contact_forces,
    contact_state,
)
from patterns import regular_polygon
from tests.oracles.finite_motion import assert_slope, external_forces
from tests.oracles.rings import member, random_rings, slide

KN, KT, MU = 1.3, 0.4, 0.5


def with_chord(graph):
    """A hexagon with a fifth wheel: a chord between grains 0 and 2."""
    return member(
        graph,
        0,
        contacts=np.vstack([graph.contacts, [[0, 2]]]),
        normal_force=np.append(graph.normal_force[0], 0.07),
        shear_force=np.append(graph.shear_force[0], -0.02),
    )


@pytest.mark.parametrize("rule", ["branch", "radii"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_tangent_is_the_slope_of_the_law(rule, share):
    """Finite differences of the exactly integrated law."""
    rng = np.random.default_rng(5)
    graph, regime = slide(rng, random_rings(rng, 1, 6, overlap=0.1), share)
    graph = with_chord(graph)
    regime = np.append(regime[0], 1)
    law = LinearFrictional(kn=KN, kt=KT, mu=MU, shear_increment=rule)
    tangent = assemble_tangent(graph, law, spins=True, regime=regime)
    v, w = rng.normal(size=(6, 2)), rng.normal(size=6)
    rate = tangent @ np.append(v.ravel(), w)

    def forces(step):
        return external_forces(graph, KN, KT, MU, regime, v, w, step, rule)

    assert_slope(forces, rate, 2.0 ** -np.arange(8, 13), atol=0.02)


def test_blocked_tangent_is_the_translational_part():
    rng = np.random.default_rng(6)
    graph, regime = slide(rng, random_rings(rng, 5, 7), 0.3)
    law = LinearFrictional(kn=KN, kt=KT, mu=MU)
    blocked = assemble_tangent(graph, law, regime=regime)
    full = assemble_tangent(graph, law, spins=True, regime=regime)
    np.testing.assert_array_equal(full[..., :14, :14], blocked)


@pytest.mark.parametrize("rule", ["branch", "radii"])
def test_rigid_motions_do_no_more_than_turn_the_forces(rule):
    """Translation gives nothing; a rotation, spins included, turns dead forces with the loop."""
    rng = np.random.default_rng(8)
    graph, regime = slide(rng, random_rings(rng, 1, 5, overlap=0.1), 0.4)
    graph, regime = member(graph, 0), regime[0]
    law = LinearFrictional(kn=KN, kt=KT, mu=MU, shear_increment=rule)
    tangent = assemble_tangent(graph, law, spins=True, regime=regime)
    still = np.concatenate([np.tile([1.0, -2.0], 5), np.zeros(5)])
    assert np.abs(tangent @ still).max() < 1e-14
    # A rigid turn: v = e_z x X, w = 1. Each external force turns; the moments stay.
    turn = np.concatenate([np.column_stack([-graph.x[:, 1], graph.x[:, 0]]).ravel(), np.ones(5)])
    force = np.zeros((5, 2))
    f = contact_forces(graph)
    np.add.at(force, graph.contacts[:, 0], f)
    np.add.at(force, graph.contacts[:, 1], -f)
    turned = np.column_stack([-force[:, 1], force[:, 0]])
    np.testing.assert_allclose(tangent @ turn, np.append(turned.ravel(), np.zeros(5)), atol=1e-14)


def test_action_equals_reaction():
    """The external forces of every motion add up to nothing, and so do their moments."""
    rng = np.random.default_rng(9)
    graph = with_chord(random_rings(rng, 1, 6, overlap=0.1))
    law = LinearFrictional(kn=KN, kt=KT, mu=MU)
    tangent = assemble_tangent(graph, law, spins=True)
    v, w = rng.normal(size=(6, 2)), rng.normal(size=6)
    rate = tangent @ np.append(v.ravel(), w)
    forces, moments = rate[:12].reshape(6, 2), rate[12:]
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-14)
    # d/dt (sum x cross F + M) = 0: dead forces F move with the grains.
    f = contact_forces(graph)
    dead = np.zeros((6, 2))
    np.add.at(dead, graph.contacts[:, 0], f)
    np.add.at(dead, graph.contacts[:, 1], -f)
    total = np.sum(graph.x[:, 0] * forces[:, 1] - graph.x[:, 1] * forces[:, 0])
    total += np.sum(v[:, 0] * dead[:, 1] - v[:, 1] * dead[:, 0]) + moments.sum()
    assert abs(total) < 1e-14


@pytest.mark.parametrize("order", [3, 4, 5, 6, 7, 12, 31])
def test_null_space_of_an_unloaded_sticking_loop(order):
    """3 rigid motions and n - 3 rolling mechanisms; frictionless 2 n."""
    graph = regular_polygon(order)
    for kt, nullity in ((0.4, order), (0.0, 2 * order)):
        tangent = assemble_tangent(graph, LinearFrictional(kn=1.0, kt=kt), spins=True)
        values = np.linalg.svd(tangent, compute_uv=False)
        assert np.count_nonzero(values < 1e-12) == nullity
        assert values[-nullity - 1] > 1e-4


@pytest.mark.parametrize("order", [3, 4, 5, 6, 9, 12, 31, 200])
def test_smallest_eigenvalue_of_the_spin_block(order):
    """2 (1 - cos(pi/n)) in units of kt R^2 for odd n; zero, the gear mode, for even n."""
    radius, kt = 0.7, 0.4
    graph = regular_polygon(order, radius=radius)
    tangent = assemble_tangent(graph, LinearFrictional(kn=1.0, kt=kt), spins=True)
    block = tangent[2 * order :, 2 * order :] / (kt * radius**2)
    smallest = np.linalg.eigvalsh(block)[0]
    expected = 2 * (1 - np.cos(np.pi / order)) if order % 2 else 0.0
    assert abs(smallest - expected) < 1e-13


def test_gear_mode_is_a_null_vector_of_a_loaded_even_loop():
    graph = regular_polygon(6, strain=0.2)
    tangent = assemble_tangent(graph, LinearFrictional(kn=1.0, kt=0.4), spins=True)
    gear = np.concatenate([np.zeros(12), np.tile([1.0, -1.0], 3)])
    assert np.abs(tangent @ gear).max() < 1e-15


def test_periodic_contact_with_own_image_loads_no_grain():
    graph = GrainGraph(
        x=[[0, 0]], radii=[0.5], contacts=[[0, 0]], images=[[1, 0]], cell=[[0.9, 0], [0, 0.9]]
    )
    law = LinearFrictional(kn=1.0, kt=0.5)
    assert not assemble_tangent(graph, law).any()


def test_arms_share_the_overlap_equally():
    state = contact_state(GrainGraph(x=[[0, 0], [1.0, 0]], radii=[0.7, 0.4], contacts=[[0, 1]]))
    np.testing.assert_allclose([state.arm_i[0], state.arm_j[0]], [0.65, 0.35], rtol=1e-15)
