"""Point groups of loops: closed forms, states that break them, and their invariant fields."""

import numpy as np
import pytest

from loops import GrainGraph
from loops.symmetry import identity, invariant_fields, point_group
from patterns import diamond, random_loop, regular_polygon
from tests.oracles.symmetry import loop_symmetry


@pytest.mark.parametrize("orientation", ["vertex", "edge"])
@pytest.mark.parametrize("order", [3, 4, 5, 6, 12, 200])
def test_regular_polygons_are_dihedral(order, orientation):
    group = loop_symmetry(regular_polygon(order, orientation=orientation, strain=0.1))
    assert (group.name, group.order) == (f"D{order}", 2 * order)
    assert (group.grains[0] == np.arange(order)).all()
    axes = group.along_axes()
    assert axes.name == ("D2" if order % 2 == 0 else "D1")


def test_a_group_holds_products_and_inverses():
    group = loop_symmetry(regular_polygon(6))
    known = {tuple(row) for row in group.grains.tolist()}
    for a in group.grains:
        assert {tuple(a[b]) for b in group.grains} == known
    for s in range(group.order):
        x = regular_polygon(6).x
        assert x[group.grains[s]] == pytest.approx(x @ group.maps[s].T, abs=1e-14)


def test_a_rhombus_has_two_mirrors_and_a_half_turn():
    group = loop_symmetry(diamond(np.radians(35)))
    assert group.name == "D2"
    assert sorted(np.diagonal(group.maps, axis1=1, axis2=2).tolist()) == [
        [-1, -1], [-1, 1], [1, -1], [1, 1]
    ]  # fmt: skip
    assert group.contact_orbits.tolist() == [0, 0, 0, 0]
    # Opposite contacts turn alike, neighbours the other way: the signs of T on the paper's path.
    assert group.contact_parity.tolist() == [1, -1, 1, -1]


@pytest.mark.parametrize("seed", range(5))
def test_random_loops_have_none(seed):
    assert loop_symmetry(random_loop(7, seed, strain=0.02)).name == "C1"


def test_shear_forces_keep_the_rotations_or_the_mirrors():
    square = regular_polygon(4, strain=0.1)
    turned = square.replace(shear_force=[0.01] * 4)
    assert loop_symmetry(turned).name == "C4"
    sheared = square.replace(shear_force=[0.01, -0.01, 0.01, -0.01])
    assert loop_symmetry(sheared).name == "D2"
    assert loop_symmetry(square.replace(shear_force=[0.01, 0, 0, 0])).name == "C1"
    # A mirror through a contact turns its T: only T = 0 stays.
    edge = regular_polygon(4, strain=0.1, orientation="edge")
    assert loop_symmetry(edge.replace(shear_force=[0.01, -0.01, 0.01, -0.01])).name == "D2"


@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-3])
@pytest.mark.parametrize("what", ["x", "x0", "radii", "normal_force"])
def test_a_perturbation_is_no_rounding(what, size):
    loop = regular_polygon(6, strain=0.1)
    values = np.array(getattr(loop, what))
    values.flat[0] += size * np.abs(values).max()
    group = loop_symmetry(loop.replace(**{what: values}))
    assert group.order <= 2
    assert "D6" == loop_symmetry(loop).name


def test_numbers_of_the_contacts_are_compared():
    square = regular_polygon(4)
    assert loop_symmetry(square, even=[[1, 2, 1, 2]]).name == "D2"
    assert loop_symmetry(square, even=[[np.inf, 2, np.inf, 2]]).name == "D2"
    assert loop_symmetry(square, odd=[[1, 1, 1, 1]]).name == "C4"


def test_chords_are_contacts_too():
    square = regular_polygon(4, strain=0.1)
    ring = square.contacts.tolist()
    x = square.x
    one = point_group([x], np.array([*ring, [0, 2]]), square.radii)
    both = point_group([x], np.array([*ring, [0, 2], [3, 1]]), square.radii)
    assert (one.name, both.name) == ("D2", "D4")
    assert both.contact_orbits.tolist() == [0, 0, 0, 0, 4, 4]


def test_what_is_no_ring_has_none_looked_for():
    path = GrainGraph(x=[[0, 0], [1, 0], [2, 0]], radii=[0.5] * 3, contacts=[[0, 1], [1, 2]])
    assert loop_symmetry(path).order == 1
    assert loop_symmetry(regular_polygon(4, strain=[0.1, 0.2])).order == 1
    assert identity(5, 7).contacts.shape == (1, 7)


@pytest.mark.parametrize("order", [3, 4, 6, 9])
def test_a_ring_breathes_in_one_way_and_spins_in_none(order):
    group = loop_symmetry(regular_polygon(order))
    fields = invariant_fields(group.grains, group.maps)
    assert fields.shape == (order, 2, 1)
    x = regular_polygon(order).x
    assert np.abs(np.sum(fields[:, :, 0] * x)) == pytest.approx(np.linalg.norm(x), rel=1e-14)
    assert invariant_fields(group.grains, group.parity[:, None, None]).shape[-1] == 0


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("alpha0", [20.0, 45.0, 70.0])
def test_invariant_fields_are_the_range_of_the_group_average(alpha0, sign):
    """Dense oracle: the projector onto the fields that change by the character."""
    group = loop_symmetry(diamond(np.radians(alpha0))).along_axes()
    character = np.where(group.parity > 0, 1.0, sign)
    action = character[:, None, None] * group.maps
    n = group.grains.shape[1]
    dense = np.zeros((group.order, 2 * n, 2 * n))
    for s in range(group.order):
        for g in range(n):
            h = group.grains[s, g]
            dense[s, 2 * h : 2 * h + 2, 2 * g : 2 * g + 2] = action[s]
    projector = dense.mean(axis=0)
    fields = invariant_fields(group.grains, action).reshape(2 * n, -1)
    assert fields.T @ fields == pytest.approx(np.eye(fields.shape[1]), abs=1e-15)
    assert fields @ fields.T == pytest.approx(projector, abs=1e-15)
