"""Packings that are refused, with the whole text of each error; small solves by hand."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import sparse

from loops import Boundary, GrainGraph, InputError, LinearFrictional, Scene, find_faces
from loops.multifrontal import Front, _tasks, frontal_lu
from loops.system import carrying_grains
from tests.loops.packing.scenes import CASES
from tests.packings import loops_in_place, outline_grains, packing, packing_system, plane_contacts

LAW = LinearFrictional(1.0, 0.5)


def triangles(count):
    """Triangles that touch nothing else."""
    corner = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.8]])
    x = np.vstack([corner + np.array([3.0 * k, 0.0]) for k in range(count)])
    contacts = np.vstack([3 * k + np.array([[0, 1], [1, 2], [2, 0]]) for k in range(count)])
    return GrainGraph(x, np.full(len(x), 0.5), contacts)


def refusal(call):
    with pytest.raises(InputError) as error:
        call()
    return str(error.value)


def test_floating_packings_are_refused_with_their_clusters():
    two, none = triangles(2), GrainGraph([[0, 0], [1, 0]], [0.5] * 2, [[0, 1]])
    for graph, received in ((two, "2 floating clusters"), (none, "grains that all float")):
        closed, supports = np.ones(graph.contact_count, bool), np.zeros(graph.grain_count, int)
        assert refusal(lambda: carrying_grains(graph, closed, supports)) == (  # noqa: B023
            f"packing: got {received}, expected contacts that span the periodic cell, walls, or "
            "grains that are held. Give the cell or the walls, or hold the outline's grains."
        )
    # A cluster that a wall holds carries, the other one floats.
    found = carrying_grains(two, np.ones(6, bool), np.array([1, 0, 0, 0, 0, 0]))
    assert found.grains.tolist() == [True] * 3 + [False] * 3 and len(found.anchors) == 0
    assert (found.rattlers, found.clusters, found.clustered) == (0, 1, 3)


@pytest.mark.parametrize(
    ("force", "away", "wrong"),
    [
        ([[0.3, 0], [-0.2, 0]], [[0.4, 0], [0.45, 0]], (1, -0.2, 0.05)),
        ([[0.3, 0], [0.2, 0]], [[0.4, 0], [0.5, 0]], (1, 0.2, 0.0)),
        ([[0.3, 0], [0.2, 0]], [[0.625, 0], [0.4, 0]], (0, 0.3, -0.125)),
    ],
)
def test_wall_contacts_that_pull_or_stand_off_are_refused(force, away, wrong):
    graph = GrainGraph([[0, 0], [1, 0]], [0.5, 0.5], [[0, 1]])
    contact, normal, overlap = wrong
    assert refusal(lambda: plane_contacts(graph, [0, 1], force, away)) == (
        f"wall contact {contact}: got normal force {normal:g} at an overlap of {overlap:g}, "
        "expected compression where the grain overlaps the wall. Check the sign of forces and "
        "branches."
    )


def test_a_wall_contact_without_force_may_stand_off():
    graph = GrainGraph([[0, 0], [1, 0]], [0.5, 0.5], [[0, 1]])
    found = plane_contacts(graph, [0, 1], [[0.0, 0], [0.2, 0]], [[0.625, 0], [0.4, 0]])
    assert found.grain.tolist() == [1] and found.kn.tolist() == pytest.approx([2.0])


def test_a_system_needs_an_area():
    graph = triangles(1)
    held = np.array([True, False, False])
    for volume in (None, 0.0, -1.0, np.inf):
        boundary = Boundary(held=held, volume=volume)
        assert refusal(partial(packing_system, Scene(graph, LAW, boundary))) == (
            f"volume: got {volume!r}, expected a positive area. Give the sample's area."
        )
    assert packing_system(Scene(graph, LAW, replace(boundary, volume=2.0))).volume == 2.0
    # The cell's area, of a cell whose vectors turn either way.
    skewed = packing(16)
    assert packing_system(Scene(skewed, LAW)).volume == pytest.approx(4.0 * 3.7 + 0.3 * 0.2)
    turned = skewed.replace(cell=skewed.cell[:, ::-1], images=skewed.images[:, ::-1])
    assert packing_system(Scene(turned, LAW)).volume == pytest.approx(4.0 * 3.7 + 0.3 * 0.2)


def test_methods_are_named_where_one_is_unknown():
    graph = packing(16)
    assert refusal(
        lambda: loops_in_place(Scene(graph, LAW), find_faces(graph), method="patch")
    ) == ("method: got 'patch', expected 'auto', 'whole', 'blocks'. Pick one.")


def test_the_boundary_names_all_that_drives():
    graph, law, options = CASES["rough walls"]
    held = np.zeros(graph.grain_count, bool)
    held[4] = True
    system = packing_system(Scene(graph, law, replace(options["boundary"], held=held)))
    assert system.boundary == "14 wall contacts, 1 grain held to the affine motion"


def test_the_outline_is_the_outer_cycle_of_the_largest_cluster():
    graph = triangles(2)
    x = graph.x.copy()
    x[3:] = 3.0 + 2.0 * (x[3:] - x[3])
    large = graph.replace(x=x, radii=np.repeat([0.5, 1.0], 3))
    assert outline_grains(large, find_faces(large)).tolist() == [False] * 3 + [True] * 3
    some = CASES["held"][0]
    held = outline_grains(some, find_faces(some))
    assert held[np.argmax(some.x, axis=0)].all() and held[np.argmin(some.x, axis=0)].all()
    assert 0.1 < held.mean() < 0.6


def test_small_subtrees_are_one_task_and_those_above_wait_for_them():
    """A chain of leaves: 64 fronts of a grain under one of 32 and a root of 64."""
    none = np.zeros(0, int)
    fronts = [Front(np.array([k]), none, (k - 1,) if k % 4 else ()) for k in range(64)]
    tops = tuple(range(3, 64, 4))
    fronts.append(Front(np.arange(64, 96), none, tops[:8]))
    fronts.append(Front(np.arange(96, 160), none, (64, *tops[8:])))
    # A share of 1/32 of 160 grains is five: each chain of four is a task, the others alone.
    expected = [(k, k - 3) for k in tops] + [(64, 64), (65, 65)]
    assert _tasks(fronts) == expected


def test_a_singular_front_is_held_by_a_small_share_of_the_largest_entry():
    """Loads on a freedom that nothing resists move it by load over `1e-12` of the largest entry."""
    dense = sparse.csr_array(np.diag([2.0, 0.0, 4.0]))
    fronts = [Front(np.arange(3), np.zeros(0, int), ())]
    found = frontal_lu(dense, fronts, np.arange(3)[:, None]).solve(np.ones((3, 1)))
    assert found.ravel() == pytest.approx([0.5, 1.0 / 4e-12, 0.25], rel=1e-10)
