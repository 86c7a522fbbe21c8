"""What loops do under a packing's response: sums over loops, rotations, straight motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import polar

from grainloops import replay
from loops import (
    LinearFrictional,
    Scene,
    branch_vectors,
    contact_forces,
    find_faces,
    love_weber_stress,
)
from loops.contacts import contacts_at_start
from loops.loop_batches import loop_batches
from stability import rates_at
from tests.packings import (
    LAW,
    balanced,
    jammed,
    loop_changes,
    loop_rates,
    packing,
    touching_lattice,
    with_idle_triangle,
)

H = np.array([[0.8, 0.3], [-0.1, -0.5]])


@pytest.mark.parametrize("seed", range(3))
def test_additive_work_sums_to_the_samples(seed):
    graph = packing(30, seed=seed, sliding=0.2)
    found = rates_at(Scene(graph, LAW), H=H)
    loops = loop_rates(found, find_faces(graph))
    assert not np.isnan(loops.additive_work).any()
    whole = found.system.volume * np.sum(found.stress_rate * H)
    assert np.sum(loops.area * loops.additive_work) == pytest.approx(whole, rel=1e-12)
    # Products of the loops' means don't.
    means = np.sum(loops.stress * loops.strain, axis=(1, 2))
    assert abs(np.sum(loops.area * means) - whole) > 1e-3 * abs(whole)


def test_loops_tile_the_strain_and_the_stress():
    graph = packing(30, seed=4)
    found = rates_at(Scene(graph, LAW), H=H)
    loops = loop_rates(found, find_faces(graph))
    share = loops.area / found.system.volume
    assert share.sum() == pytest.approx(1.0, abs=1e-12)
    assert np.allclose(np.tensordot(share, loops.strain, 1), H, atol=1e-12)
    assert np.allclose(np.tensordot(share, loops.stress, 1), found.stress_rate, atol=1e-12)


def test_a_rotation_does_no_corotated_work():
    graph = balanced(packing(24, seed=5))
    law = LinearFrictional(1.0, 0.5, np.inf, "radii")
    found = rates_at(Scene(graph, law), H=[[0.0, 1.0], [-1.0, 0.0]])
    loops = loop_rates(found, find_faces(graph))
    nominal = np.sum(loops.stress * loops.strain, axis=(1, 2))
    assert np.abs(nominal).min() > 1e-5 and abs(love_weber_stress(graph)).max() > 1e-3
    assert np.abs(loops.second_order_work).max() < 1e-12


def test_nonaffinity_is_told_by_strains_whatever_the_sample_turns_by():
    graph = balanced(packing(24, seed=5))
    turned = H + np.array([[0.0, 0.7], [-0.7, 0.0]])
    law = LinearFrictional(1.0, 0.5, np.inf, "radii")
    one, two = (
        loop_rates(rates_at(Scene(graph, law), H=h), find_faces(graph)).nonaffinity
        for h in (H, turned)
    )
    assert np.ptp(one) > 0.1
    np.testing.assert_allclose(two, one, rtol=1e-10)


@pytest.mark.parametrize("angle", [0.0, 0.3, -2.5])
def test_changes_are_those_in_the_frame_that_turns_with_the_loop(angle):
    """Work and non-affinity of a finite motion, by the polar decomposition of scipy."""
    graph = balanced(packing(24, seed=5))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    F = turn @ np.array([[0.97, 0.01], [0.01, 1.02]])
    forces = {"normal_force": 1.3 * graph.normal_force, "shear_force": 0.5 * graph.shear_force}
    moved = graph.replace(x=graph.x @ F.T, cell=F @ graph.cell, **forces)
    after = replace(contacts_at_start(Scene(moved, LAW)), cell0=graph.cell)
    changes = loop_changes(graph, after, find_faces(graph))
    R, U = polar(np.eye(2) - changes.strain[0])
    assert np.allclose([R, R @ U], [turn, F], atol=1e-12)
    assert np.abs(changes.nonaffinity).max() < 1e-12
    before = np.empty_like(changes.stress)
    for loops in loop_batches(graph, find_faces(graph)):
        before[loops.row] = 0.5 * love_weber_stress(loops.graph)
    turned = R.T @ (before + changes.stress) - before
    work = np.sum(turned * (np.eye(2) - U), axis=(1, 2))
    np.testing.assert_allclose(changes.second_order_work, work, rtol=1e-12)


def test_times_of_opening_and_closing_are_those_of_straight_motion():
    graph = packing(30, seed=3)
    shrunk = graph.replace(radii=0.6 * graph.radii)
    found = rates_at(Scene(shrunk, LAW), H=H)
    faces = find_faces(shrunk)
    loops = loop_rates(found, faces)
    d, rate = branch_vectors(graph), found.branch_rate
    lengthening = np.sum(d * rate, axis=1) / np.linalg.norm(d, axis=1)
    for row, face in enumerate(faces.loops):
        part = slice(faces.offsets[face], faces.offsets[face + 1])
        c, along = faces.contacts[part], np.where(faces.forward[part], 1.0, -1.0)[:, None]
        losing = graph.normal_force[c] / lengthening[c]
        assert loops.opening[row] == pytest.approx(losing[lengthening[c] > 0].min(initial=np.inf))
        if len(c) == 4:
            grains, sides, turns = faces.grains[part], along * d[c], along * rate[c]
            times = [np.inf]
            for k in (0, 1):
                across, growth = sides[k] + sides[k + 1], turns[k] + turns[k + 1]
                length = np.linalg.norm(across)
                gap = length - shrunk.radii[grains[k]] - shrunk.radii[grains[k + 2]]
                closing = -across @ growth / length
                times += [gap / closing] if gap > 0 and closing > 0 else []
            assert loops.closing[row] == pytest.approx(min(times))
            assert len(times) > 1 or gap < 0 or np.isinf(loops.closing[row])
    assert np.isfinite(loops.closing).sum() > 3 and np.isfinite(loops.opening).sum() > 3
    assert np.isinf(loops.closing[np.diff(faces.offsets)[faces.loops] == 3]).all()


@pytest.mark.parametrize(("degrees", "closes"), [(35.0, True), (29.0, False)])
def test_grains_that_overlap_without_a_contact_have_no_gap_to_close(degrees, closes):
    half = np.radians(degrees)
    sides = [[np.cos(half)] * 2, [np.sin(half), -np.sin(half)]]
    graph = touching_lattice(sides, [(1, 0), (0, 1)], (2, 2))
    found = rates_at(Scene(graph, LAW), H=np.diag([-1.0, 1.0]))
    closing = loop_rates(found, find_faces(graph)).closing
    height = 2 * 0.99 * np.sin(half)
    # Affine: the height of the diamond shrinks by its own length in the unit of time.
    assert np.allclose(closing, (height - 1.0) / height if closes else np.inf)


def test_loops_of_what_carries_nothing_have_no_rates():
    more = with_idle_triangle(packing(24, seed=3))
    found = rates_at(Scene(more, LAW), H=H)
    loops = loop_rates(found, find_faces(more))
    assert (found.system.carrying.clusters, found.system.carrying.clustered) == (1, 3)
    assert np.flatnonzero(np.isnan(loops.second_order_work)).size == 1
    assert np.isfinite(loops.area).all()


def test_changes_up_to_a_later_state_contact_by_contact():
    """Forces, openings by the overlaps, and the work, after a short replay."""
    graph = jammed(24, 3, LAW)
    after = replay(Scene(graph, LAW), 1e-3 * H, inertial_number=1e-3).state
    faces = find_faces(graph)
    found = loop_changes(graph, after, faces)
    start, end = branch_vectors(graph), after.branches[: graph.contact_count]
    lengths = np.hypot(*start.T), np.hypot(*end.T)
    change = after.forces[: graph.contact_count] - contact_forces(graph)
    finite = 0
    for row, face in enumerate(faces.loops):
        part = slice(faces.offsets[face], faces.offsets[face + 1])
        first, work = np.inf, 0.0
        for c in faces.contacts[part]:
            i, j = graph.contacts[c]
            overlap = graph.radii[i] + graph.radii[j] - lengths[0][c]
            if lengths[1][c] > lengths[0][c]:
                first = min(first, max(overlap, 0.0) / (lengths[1][c] - lengths[0][c]))
            work -= 0.5 * change[c] @ (end[c] - start[c])
        assert found.opening[row] == pytest.approx(first, rel=1e-9)
        assert found.additive_work[row] == pytest.approx(work / found.area[row], rel=1e-9)
        finite += np.isfinite(first)
    assert finite > 10
    share = found.area / abs(np.linalg.det(graph.cell))
    np.testing.assert_allclose(np.tensordot(share, found.strain, 1), after.strain, atol=1e-12)


def test_contacts_that_carry_nothing_follow_the_strain():
    graph = with_idle_triangle(packing(16, seed=1))
    found = rates_at(Scene(graph, LAW), H=H)
    idle = np.arange(graph.contact_count - 3, graph.contact_count)
    expected = [-H @ d for d in branch_vectors(graph)[idle]]
    np.testing.assert_allclose(found.branch_rate[idle], expected, atol=1e-15)
    assert (found.force_rate[idle] == 0).all()
