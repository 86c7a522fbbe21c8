import numpy as np
import pytest

from loops import (
    GrainGraph,
    InputError,
    boundary_vectors,
    contact_forces,
    love_weber_stress,
    nominal_stress,
    polygon_area,
    polygon_centroid,
    polygon_perimeter,
    polygon_shape,
)
from patterns import regular_polygon
from tests.oracles.rings import random_rings, ring


def grain_forces(graph):
    """External forces that balance the contact forces."""
    f = contact_forces(graph)
    out = np.zeros((*f.shape[:-2], graph.grain_count, 2))
    for c, (i, j) in enumerate(graph.contacts.tolist()):
        out[..., i, :] += f[..., c, :]
        out[..., j, :] -= f[..., c, :]
    return out


def test_love_weber_is_the_boundary_average():
    """sum f (x) d = -sum F_ext (x) x over the grains, whatever the forces."""
    graph = random_rings(np.random.default_rng(1), 50, 7)
    boundary = -np.swapaxes(grain_forces(graph), -1, -2) @ graph.x
    expected = boundary / polygon_area(graph.x)[:, None, None]
    np.testing.assert_allclose(love_weber_stress(graph), expected, atol=1e-14)


def test_uniform_traction_gives_back_its_stress():
    """Corner forces -P B in equilibrium with the contacts: the nominal stress is P."""
    rng = np.random.default_rng(2)
    x = random_rings(rng, 1, 6).x[0]
    p = rng.normal(size=(2, 2))
    external = -boundary_vectors(x) @ p.T
    # Ring forces f_c = f_{c-1} + F_c from any start, resolved on the contact frames.
    f = np.cumsum(external, axis=0) + rng.normal(size=2)
    edges = np.roll(x, -1, axis=0) - x
    n = edges / np.linalg.norm(edges, axis=1, keepdims=True)
    t = np.column_stack([-n[:, 1], n[:, 0]])
    graph = GrainGraph(
        x=x,
        radii=np.ones(6),
        contacts=ring(6),
        normal_force=np.sum(f * n, axis=1),
        shear_force=np.sum(f * t, axis=1),
    )
    np.testing.assert_allclose(nominal_stress(graph), p, atol=1e-14)


def test_isotropic_polygon_closed_form():
    """Regular n-gon under N: s = n N l / (2 V) on both axes."""
    for order in (3, 4, 5, 8):
        graph = regular_polygon(order, strain=0.1)
        area = order * 0.9**2 / (4 * np.tan(np.pi / order))
        expected = order * 0.1 * 0.9 / (2 * area) * np.eye(2)
        np.testing.assert_allclose(love_weber_stress(graph), expected, atol=1e-14)
        # Nominal: reference branches and area, 1/0.9 and 1/0.81 of the current ones.
        np.testing.assert_allclose(nominal_stress(graph), 0.9 * expected, atol=1e-14)


def test_stress_of_a_periodic_cell():
    """Square lattice with unit normal forces: N/l on both axes, images included."""
    graph = GrainGraph(
        x=[[0, 0]],
        radii=[0.55],
        contacts=[[0, 0], [0, 0]],
        images=[[1, 0], [0, 1]],
        normal_force=[2.0, 3.0],
        shear_force=[0.1, -0.1],
        cell=np.eye(2),
    )
    # f = N n + T t: (2, 0.1) over the branch (1, 0) and (0.1, 3) over (0, 1).
    expected = [[2.0, 0.1], [0.1, 3.0]]
    np.testing.assert_allclose(love_weber_stress(graph), expected, atol=1e-15)


def test_stress_needs_a_volume():
    chain = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.6, 0.6], contacts=[[0, 1]])
    with pytest.raises(InputError, match="contact 1 of a loop of 2 grains: got nothing"):
        love_weber_stress(chain)
    assert love_weber_stress(chain, volume=1.0).shape == (2, 2)
    with pytest.raises(InputError, match=r"contact 1 of a loop.*got grains \[2, 1\]"):
        love_weber_stress(
            GrainGraph(
                x=[[0, 0], [1, 0], [0, 1]], radii=[1, 1, 1], contacts=[[0, 1], [2, 1], [2, 0]]
            )
        )


def test_polygon_measures_far_from_the_origin_and_mirrored():
    rng = np.random.default_rng(3)
    x = random_rings(rng, 20, 9).x
    far = x + np.array([1e6, -1e6])
    np.testing.assert_allclose(polygon_area(far), polygon_area(x), rtol=1e-8)
    mirrored = x * [1, -1]
    np.testing.assert_allclose(polygon_area(mirrored), -polygon_area(x), rtol=1e-14)
    np.testing.assert_allclose(polygon_perimeter(mirrored), polygon_perimeter(x), rtol=1e-15)
    np.testing.assert_allclose(
        polygon_centroid(mirrored), polygon_centroid(x) * [1, -1], atol=1e-14
    )
    np.testing.assert_allclose(
        boundary_vectors(mirrored), boundary_vectors(x) * [1, -1], atol=1e-15
    )
    np.testing.assert_allclose(boundary_vectors(x).sum(axis=-2), 0.0, atol=1e-15)


def test_boundary_vectors_give_the_displacement_gradient():
    rng = np.random.default_rng(4)
    x, gradient = random_rings(rng, 1, 8).x[0], rng.normal(size=(2, 2))
    u = x @ gradient.T + rng.normal(size=2)
    measured = u.T @ boundary_vectors(x) / polygon_area(x)
    np.testing.assert_allclose(measured, gradient, atol=1e-13)


@pytest.mark.parametrize("turn", [0.0, 0.4, 1.5, -0.9])
def test_shape_of_a_rectangle(turn):
    corners = np.array([[0, 0], [3, 0], [3, 1.5], [0, 1.5]]) + 7.0
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for x in (corners @ rotation.T, (corners @ rotation.T)[::-1]):
        elongation, orientation = polygon_shape(x)
        np.testing.assert_allclose(elongation, 2.0, rtol=1e-12)
        np.testing.assert_allclose(orientation, turn, atol=1e-12)
