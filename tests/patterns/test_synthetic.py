"""Synthetic networks: what their recipe promises."""

import numpy as np
import pytest

from loops import InputError, branch_vectors, euler_check, find_faces
from patterns import synthetic_network

FIELDS = ("x", "radii", "contacts", "normal_force", "shear_force", "images", "cell")


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("grains", [2, 3, 10, 11, 97, 1000, 20_000])
def test_number_of_grains_and_coordination(grains, periodic):
    graph = synthetic_network(grains, seed=5, periodic=periodic)
    assert graph.grain_count == grains
    assert (graph.cell is not None) == periodic
    if grains >= 97:
        assert graph.contact_count == round(3.7 * grains / 2)
    assert euler_check(graph, find_faces(graph)).ok


@pytest.mark.parametrize("coordination", [0, 1.5, 3.0, 5.0])
def test_coordination_is_as_asked(coordination):
    graph = synthetic_network(4000, seed=1, periodic=True, coordination=coordination)
    assert 2 * graph.contact_count / graph.grain_count == pytest.approx(coordination, abs=2.6e-4)


def test_the_whole_lattice_is_a_triangulation():
    graph = synthetic_network(56 * 48, periodic=True, coordination=6, jitter=0.4)
    faces = find_faces(graph)
    assert faces.order.tolist() == [3] * (2 * graph.grain_count)
    assert faces.area.min() > 0
    assert faces.area.sum() == pytest.approx(np.linalg.det(graph.cell), rel=1e-13)


def test_without_jitter_branches_are_those_of_the_lattice():
    d = branch_vectors(synthetic_network(500, periodic=True, jitter=0))
    assert np.hypot(d[:, 0], d[:, 1]) == pytest.approx(1.0, abs=1e-13)
    turns = np.arctan2(d[:, 1], d[:, 0]) / (np.pi / 3)
    assert turns == pytest.approx(np.round(turns), abs=1e-12)
    assert set(np.round(turns)) == {0, 1, 2}


@pytest.mark.parametrize("cell", [None, [[30.0, 9.0], [-4.0, 12.0]]])
def test_overlaps_forces_and_coulomb(cell):
    mu = 0.3
    graph = synthetic_network(5000, seed=2, periodic=True, cell=cell, friction=mu)
    d = branch_vectors(graph)
    branch = np.hypot(d[:, 0], d[:, 1])
    i, j = graph.contacts.T
    assert (graph.radii[i] + graph.radii[j] > branch).all()
    normal, shear = graph.normal_force, np.abs(graph.shear_force)
    assert (normal >= 0).all()
    assert (shear <= mu * normal).all()
    # Four standard errors of a mean of 9250 draws.
    assert normal.mean() == pytest.approx(1e-3 * branch.mean(), rel=4 / np.sqrt(9250))
    assert np.mean(shear == mu * normal) == pytest.approx(0.2, abs=4 * 0.4 / np.sqrt(9250))
    assert shear.min() < 0.01 * normal.mean()


def test_given_cell_is_kept_and_grains_stay_near_it():
    cell = np.array([[40.0, 15.0], [3.0, 25.0]])
    graph = synthetic_network(3000, seed=4, cell=cell)
    assert graph.cell.tolist() == cell.tolist()
    u = np.linalg.solve(cell, graph.x.T)
    assert u.min() > -0.02 and u.max() < 1.02
    # The lattice follows the cell's aspect: mean branches along and across do not differ much.
    d = np.abs(np.linalg.solve(cell, branch_vectors(graph).T) * np.hypot(*cell)[:, None])
    assert 0.5 < d[0].mean() / d[1].mean() < 2


def test_dangling_grains_and_larger_loops_occur():
    graph = synthetic_network(3000, seed=6)
    degree = np.bincount(graph.contacts.ravel(), minlength=graph.grain_count)
    assert {0, 1, 2, 3, 4, 5, 6} <= set(degree.tolist())
    faces = find_faces(graph)
    assert {3, 4, 5, 6, 7, 8} <= set(faces.order[faces.loops].tolist())


@pytest.mark.parametrize("periodic", [False, True])
def test_the_seed_decides(periodic):
    one, same, other = (synthetic_network(200, seed=s, periodic=periodic) for s in (8, 8, 9))
    for name in FIELDS:
        assert np.array_equal(getattr(one, name), getattr(same, name))
    assert not np.array_equal(one.x, other.x)
    assert not np.array_equal(one.contacts, other.contacts)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"grains": 1}, "grains: got 1, expected a whole number, 2 or more"),
        ({"grains": 10, "jitter": 0.5}, "jitter: got 0.5"),
        ({"grains": 10, "jitter": -0.1}, "jitter: got -0.1"),
        ({"grains": 10, "coordination": 6.5}, "coordination: got 6.5"),
        ({"grains": 10, "coordination": float("nan")}, "coordination: got nan"),
        ({"grains": 10, "friction": -1}, "friction: got -1"),
        ({"grains": 10, "friction": float("inf")}, "friction: got inf"),
        ({"grains": 10, "cell": [[1, 2], [2, 4]]}, "cell: got"),
        ({"grains": 10, "cell": [1, 2]}, "cell: got"),
        ({"grains": 10, "cell": [[1, 0], [0, float("nan")]]}, "cell[1, 1]: got nan"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(InputError) as error:
        synthetic_network(**arguments)
    assert message in str(error.value)
