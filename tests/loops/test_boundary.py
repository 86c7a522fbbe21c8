"""What a packing ends at: kinds of boundaries, walls that move or stand still, former arguments."""

from dataclasses import replace

import numpy as np
import pytest

import grainloops as gl
from loops import Boundary, GrainGraph, PlaneContacts, Scene, boundary_of
from tests.packings import jammed, plane_contacts
from tests.stability.packing.walled_packings import JAMMED, between, jammed_in_box

H = np.diag([1.0, -0.4])
SQUARE = GrainGraph([[0.5, 0.5], [1.4, 0.5]], [0.5, 0.5], [[0, 1]], normal_force=[0.1])


def test_kinds():
    held, walls = np.array([True, False]), PlaneContacts(*np.zeros((4, 0)))
    some = PlaneContacts(np.array([0]), np.array([[-0.5, 0.0]]), np.ones(1), np.zeros(1))
    assert boundary_of(jammed(12, 1)).kind == "cell"
    assert boundary_of(jammed(12, 1), walls=some).kind == "cell"
    assert boundary_of(SQUARE, walls=some).kind == boundary_of(SQUARE, walls=some, held=held).kind
    assert boundary_of(SQUARE, walls=some).kind == "walls"
    assert boundary_of(SQUARE, held=held).kind == "outline"
    for free in (Boundary(), boundary_of(SQUARE), boundary_of(SQUARE, walls=walls)):
        assert free.kind == "free"
    assert boundary_of(SQUARE, held=[False, False]).kind == "free"


def test_the_volume_is_that_of_the_cell_or_the_given_one():
    graph = jammed(12, 1)
    assert boundary_of(graph).volume == abs(np.linalg.det(graph.cell))
    assert boundary_of(graph, volume=3.0).volume == 3.0 and boundary_of(SQUARE).volume is None


def test_contacts_with_walls_are_rows_behind_those_of_grains():
    """Each ends at a body beyond the grains, which carries; its frame keeps its direction."""
    some = PlaneContacts(np.array([1, 1]), np.array([[0.5, 0], [0, -0.4]]), np.ones(2), np.zeros(2))
    rows = Scene(SQUARE, gl.LinearFrictional(1.0, 0.5, 0.2), boundary_of(SQUARE, walls=some)).rows
    assert rows.ends.tolist() == [[0, 1], [1, 2], [1, 3]]
    assert rows.state.turns.tolist() == [1, 0, 0] and rows.state.regime.tolist() == [1, 2, 2]
    # Without forces they push by their overlap.
    np.testing.assert_allclose(rows.state.normal_force, [0.1, 0.0, 0.1], atol=1e-15)
    (kn,) = rows.each(lambda law, state: (law.kn * state.length,))
    np.testing.assert_allclose(kn, [0.9, 0.5, 0.4])


@pytest.mark.parametrize("which", JAMMED[:2])
def test_a_box_has_the_corners_of_its_walls(which):
    graph, planes, _ = jammed_in_box(*which)
    normals, points, wall, cell = between(planes).box(graph)
    feet = graph.x[planes.grain] + planes.branch
    low, high = feet.min(axis=0), feet.max(axis=0)
    np.testing.assert_allclose(cell, np.diag(high - low), atol=1e-12)
    # Each foot lies on its wall.
    away = np.sum((feet - points[wall]) * normals[wall], axis=1)
    np.testing.assert_allclose(away, 0.0, atol=1e-12)
    still = between(planes, volume=7.0).standing(graph)
    assert np.linalg.det(still.cell) == pytest.approx(7.0)
    np.testing.assert_array_equal(still.normals, normals)


def test_smooth_walls_have_no_shear_force_in_the_rate_problem():
    """A file's force may lean; what is known is that the wall is smooth."""
    graph = GrainGraph([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], [[0, 1]])
    walls = plane_contacts(graph, [0], [[0.3, 0.2]], [[0.4, 0.0]])
    assert walls.force.tolist() == [[0.3, 0.2]] and walls.state(graph.radii).shear_force == [0.0]
    rough = replace(walls, mu=np.ones(1))
    assert abs(rough.state(graph.radii).shear_force[0]) == pytest.approx(0.2)


def test_the_volume_of_a_loop_is_that_of_its_boundary():
    ring, law = gl.regular_polygon(4), gl.LinearFrictional(1.0, 0.5)
    stage = gl.Stage("isotropic_strain", "H11", 0.01)
    paths = [
        gl.follow(Scene(ring, law, boundary_of(ring, volume=v)), stage, closure="affine")
        for v in (2.0, 4.0)
    ]
    np.testing.assert_allclose(paths[0].P[-1], 2.0 * paths[1].P[-1], rtol=1e-9, atol=1e-15)
    with pytest.raises(gl.InputError, match="volume"):
        gl.follow(Scene(ring, law), stage, closure="affine", volume=2.0)


def test_contacts_with_walls_have_the_stiffness_of_their_force_over_their_overlap():
    """Two grains on a floor and a slope; the third contact carries nothing."""
    graph = GrainGraph([[0.0, 0.9], [3.0, 2.0], [6.0, 0.5]], [1.0, 2.5, 0.5], [[0, 1]])
    slope = np.array([-0.6, 0.8])
    away = np.array([[0.0, 0.9], 2.0 * slope, [0.0, 0.5]])
    force = np.array([[0.0, 0.3], 1.5 * slope, [0.0, 0.0]])
    found = plane_contacts(graph, [0, 1, 2], force, away)
    assert found.grain.tolist() == [0, 1] and not found.kt.any() and not found.mu.any()
    np.testing.assert_allclose(found.kn, [0.3 / 0.1, 1.5 / 0.5], rtol=1e-12)
    np.testing.assert_array_equal(found.branch, -away[:2])
    with pytest.raises(gl.InputError, match=r"wall contact 1: got normal force -1\.5"):
        plane_contacts(graph, [0, 1, 2], force * [[1], [-1], [1]], away)


def test_the_points_of_plates_lie_on_them_beside_the_corner():
    """From a grain's centre to its plate, then along it to where the corner stands."""
    x, corner = np.array([[0.4, 2.0], [5.0, 0.7]]), np.array([-1.0, -2.0])
    branch = np.array([[-0.4, 0.0], [0.0, -0.7]])
    walls = PlaneContacts(np.array([0, 1]), branch, np.ones(2), np.zeros(2), fixed=corner)
    np.testing.assert_allclose(x + walls.to_plates(x), [[0.0, -2.0], [-1.0, 0.0]], atol=1e-12)
    # Without a corner it is that of the contacts, (0, 0) here.
    free = PlaneContacts(np.array([0, 1]), branch, np.ones(2), np.zeros(2))
    np.testing.assert_allclose(x + free.to_plates(x), [[0.0, 0.0], [0.0, 0.0]], atol=1e-12)
