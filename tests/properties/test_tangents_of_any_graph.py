"""What every contact graph obeys, whatever its forces, regimes and stiffness."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from loops import (
    GrainGraph,
    LinearFrictional,
    affine_tangent,
    assemble_tangent,
    branch_vectors,
    contact_forces,
    love_weber_stress,
)
from patterns import synthetic_network

SPINS = st.sampled_from(["blocked", "affine", "free"])
RULES = st.sampled_from(["branch", "radii"])
ANGLES = st.floats(-3.0, 3.0)


@st.composite
def networks(draw, periodic=None):
    """A planar network, one contact in five at yield, and a law that differs by contact."""
    graph = synthetic_network(
        draw(st.integers(4, 25)),
        seed=draw(st.integers(0, 10_000)),
        periodic=draw(st.booleans()) if periodic is None else periodic,
        coordination=draw(st.floats(2.0, 5.0)),
    )
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    kn = rng.uniform(0.5, 2.0, graph.contact_count)
    kt = kn * rng.uniform(0.0, 1.2, graph.contact_count)
    return graph, LinearFrictional(kn=kn, kt=kt, mu=0.5, shear_increment=draw(RULES))


def moved(graph, matrix, factor=1.0, force=1.0):
    """The graph in another frame and other units of length and force."""
    return GrainGraph(
        x=factor * graph.x @ matrix.T,
        radii=factor * graph.radii,
        contacts=graph.contacts,
        normal_force=force * graph.normal_force,
        shear_force=force * np.linalg.det(matrix) * graph.shear_force,
        images=graph.images,
        cell=None if graph.cell is None else factor * matrix @ graph.cell,
    )


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def area(graph):
    return 1.0 if graph.cell is None else float(np.abs(np.linalg.det(graph.cell)))


def resultants(graph):
    """(G, 2) force that each grain needs from outside."""
    needed, f = np.zeros((graph.grain_count, 2)), contact_forces(graph)
    np.add.at(needed, graph.contacts[:, 0], f)
    np.add.at(needed, graph.contacts[:, 1], -f)
    return needed


@settings(max_examples=40)
@given(networks(), ANGLES, st.booleans(), SPINS)
def test_objectivity(scene, angle, mirrored, spins):
    graph, law = scene
    matrix = turn(angle) @ np.diag([1.0, -1.0 if mirrored else 1.0])
    image = moved(graph, matrix)
    A, found = (affine_tangent(g, law, spins=spins, volume=area(graph)) for g in (graph, image))
    both = np.kron(matrix, matrix)
    assert found.trusted == A.trusted
    if A.trusted:
        wanted = both @ A.matrix @ both.T
        assert np.abs(found.matrix - wanted).max() < 1e-13 * np.linalg.norm(wanted) * A.condition
    K, Km = (assemble_tangent(g, law) for g in (graph, image))
    place = np.kron(np.eye(graph.grain_count), matrix)
    np.testing.assert_allclose(Km, place @ K @ place.T, rtol=0, atol=1e-12 * np.abs(K).max())


@settings(max_examples=30)
@given(networks(), st.integers(0, 10_000), st.booleans())
def test_action_is_reaction(scene, seed, spins):
    """A contact listed from j to i is the same contact."""
    graph, law = scene
    back = np.random.default_rng(seed).random(graph.contact_count) < 0.5
    reversed_graph = graph.replace(
        contacts=np.where(back[:, None], graph.contacts[:, ::-1], graph.contacts),
        images=None if graph.images is None else np.where(back[:, None], -1, 1) * graph.images,
    )
    K, other = (assemble_tangent(g, law, spins=spins) for g in (graph, reversed_graph))
    np.testing.assert_allclose(other, K, rtol=0, atol=1e-14 * np.abs(K).max())
    V = area(graph)
    stress = love_weber_stress(graph, volume=V)
    np.testing.assert_allclose(love_weber_stress(reversed_graph, volume=V), stress, atol=1e-15)


@settings(max_examples=30)
@given(networks(periodic=False), st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2))
def test_balance_under_rigid_motion(scene, vx, vy, w):
    """Translations cost nothing; a rotation turns the forces that were there, moments stay."""
    graph, law = scene
    K = assemble_tangent(graph, law, spins=True)
    count = graph.grain_count
    velocity = np.array([vx, vy]) + w * np.column_stack([-graph.x[:, 1], graph.x[:, 0]])
    rate = K @ np.append(velocity.ravel(), np.full(count, w))
    outside = resultants(graph)
    expected = w * np.column_stack([-outside[:, 1], outside[:, 0]])
    scale = np.abs(K).max() * max(1.0, np.abs(velocity).max())
    assert np.abs(rate[: 2 * count] - expected.ravel()).max() < 1e-13 * scale * count
    assert np.abs(rate[2 * count :]).max() < 1e-13 * scale * count


@settings(max_examples=30)
@given(networks(), SPINS)
def test_no_motion_needs_a_resultant(scene, spins):
    """Whatever the motion, the forces of all grains together add up to nothing."""
    graph, law = scene
    K = assemble_tangent(graph, law)
    assert np.abs(K[0::2].sum(axis=0)).max() < 1e-13 * np.abs(K).max() * graph.grain_count
    assert np.abs(K[1::2].sum(axis=0)).max() < 1e-13 * np.abs(K).max() * graph.grain_count


@settings(max_examples=30)
@given(networks(periodic=False), st.floats(-1e3, 1e3))
def test_love_weber_is_the_boundary_average(scene, shift):
    """Of the forces that hold the grains, from any origin: they add up to nothing."""
    graph, _ = scene
    outside = resultants(graph)
    average = -outside.T @ (graph.x + shift)
    f, d = contact_forces(graph), branch_vectors(graph)
    size = np.abs(f).max(initial=0.0) * (1.0 + abs(shift)) * graph.contact_count
    np.testing.assert_allclose(f.T @ d, average, rtol=0, atol=1e-13 * size + 1e-300)
    assert np.abs(outside.sum(axis=0)).max() < 1e-14 * size + 1e-300
