"""Increments of a packing in one solve: closed forms, enumeration, paths by events, frames."""

from dataclasses import replace

import numpy as np
import pytest

from grainloops import probe
from loops import GrainGraph, InputError, LinearFrictional, Scene, contact_state, find_faces
from stability import Programme, Stage, follow
from stability.complementarity import _every_solution, raise_load, violation
from stability.packing import packing_increment, rate_problem
from stability.packing import response as increment_module
from stability.packing.probe import probe_by_increment
from stability.programmes import component_control
from tests.packings import BRANCH, LAW, jammed
from tests.stability.packing.test_plates import KN, KT, MU, OVERLAP, ROUGH, box, one_grain
from tests.stability.packing.walled_packings import between, jammed_in_box

H = np.array([[1.0, 0.0], [0.0, -0.6]])
SOME = [(12, 1), (16, 2), (24, 3), (36, 5)]


def increment(rates, strain):
    return rates.increment(component_control(strain))


def near_yield(grains, seed, law=LAW, share=0.9995):
    """A jammed packing with its larger shear forces just below their strength."""
    graph = jammed(grains, seed, law)
    most = law.strength(contact_state(graph))
    mobilised = np.abs(graph.shear_force) / most
    rank = np.argsort(np.argsort(-mobilised))
    left = 1.0 - (1.0 - share) * (1.0 + rank)
    T = np.where(rank < 8, np.sign(graph.shear_force) * left * most, graph.shear_force)
    return graph.replace(shear_force=T)


# ---- the load that is raised


def test_one_contact_slides_from_where_its_distance_is_used_up():
    found = raise_load(np.array([0.5]), np.array([-2.0]), np.array([[0.5]]))
    assert found.first == 1.0 and found.slip == pytest.approx([3.0]) and not found.held.any()
    assert raise_load(np.array([0.5]), np.array([-0.4]), np.array([[0.5]])).slip == [0.0]


def test_a_contact_that_softens_is_held():
    found = raise_load(np.array([0.5]), np.array([-2.0]), np.array([[-1.0]]))
    assert found.first == pytest.approx(0.25, abs=1e-6) and found.slip == [0.0] and found.held.all()


def test_the_others_go_on_beside_a_contact_that_softens():
    """The second one sticks until its distance of 3 is used up by a load of 6."""
    found = raise_load(
        np.array([0.5, 3.0]), np.array([-2.0, -6.0]), np.array([[-1.0, 0.5], [-8.0, 2.0]])
    )
    assert found.held.tolist() == [True, False] and found.first == pytest.approx(0.25, abs=1e-6)
    assert found.slip == pytest.approx([0.0, 1.5], abs=1e-6)


def test_a_contact_may_stick_again():
    """Slip of the second contact takes the load off the first one, which has slid before."""
    distance, q = np.array([1.0, 4.0]), np.array([-4.0, -8.0])
    M = np.array([[1.0, 2.0], [0.0, 1.0]])
    found = raise_load(distance, q, M)
    # The first one slides from a quarter of the load on; at half of it the second one begins.
    assert not found.held.any() and found.slip == pytest.approx([0.0, 4.0], abs=1e-6)
    assert (distance + q + M @ found.slip).min() > -1e-6


@pytest.mark.parametrize("seed", range(60))
def test_ends_are_among_the_solutions_that_enumeration_finds(seed):
    rng = np.random.default_rng(seed)
    m = int(rng.integers(2, 9))
    A = rng.standard_normal((m, m))
    M = A @ A.T / m + rng.standard_normal((m, m)) * rng.choice([0.0, 0.5, 1.5])
    distance, q = rng.random(m) * rng.choice([0.0, 1.0], m), rng.standard_normal(m)
    found = raise_load(distance, q, M)
    free = ~found.held
    # Without the contacts that are held it is a solution, and one of those of enumeration.
    q_of, M_of = (distance + q)[free], M[np.ix_(free, free)]
    assert violation(q_of, M_of, found.slip[free] > 0) <= 1e-6
    sets = _every_solution(q_of, M_of)[0]
    assert any(np.allclose(slip, found.slip[free], atol=1e-6) for _, slip in sets)
    if np.linalg.eigvalsh(M + M.T).min() > 0:
        assert found.first == 1.0 and free.all() and len(sets) == 1


# ---- packings


def test_a_grain_at_its_plates_sticks_then_slides():
    """The lower plate holds the disc until the distance to Coulomb's limit is used up."""
    limit = MU * KN * OVERLAP
    T = np.array([0.9 * limit, 0.1 * limit])
    graph, planes = one_grain(T)
    low, high = box(graph, planes)
    plates = between(planes, volume=float(np.prod(high - low)))
    scene, how = Scene(graph, LinearFrictional(1.0, 0.5), plates), {"candidates": 0.8}
    # Sticking, both plates carry the same and there is no spin.
    slope = 2.0 * 0.98 / (4.0 + 2.0 * KT)
    at = (limit - T[0]) / (KT * slope)
    before = packing_increment(scene, np.diag([0.9 * at, 0.0]), **how)
    assert before.sliding == 0 and before.status == "unique"
    whole = at + 0.02
    found = packing_increment(scene, np.diag([whole, 0.0]), **how)
    # Beyond, the lower plate carries no more, and the disc rolls along the upper one.
    v = -slope * at - 2.0 * 0.98 * 0.02 / 4.0
    moved = found.motion[0, 0] - whole * graph.x[0, 0]
    assert found.sliding == 1 and found.status == "unique" and moved == pytest.approx(v, rel=1e-9)


@pytest.mark.parametrize("which", SOME)
def test_without_distances_it_is_the_rate_problem(which):
    graph = near_yield(*which)
    yielding = rate_problem(Scene(graph, LAW), yield_band=0.95)
    rates = yielding.solved(component_control(H)).response
    found = increment(replace(yielding, distance=0.0 * yielding.distance), H)
    if found.status != "nearest" and rates.status == "unique":
        size = np.abs(rates.stress_rate).max()
        assert found.sliding == rates.sliding
        assert np.allclose(found.stress_rate, rates.stress_rate, rtol=0, atol=1e-6 * size)
    assert rates.candidates > 4


@pytest.mark.parametrize("law", [LAW, BRANCH])
@pytest.mark.parametrize("which", SOME)
def test_increments_are_those_of_the_path_by_events(which, law):
    """Where the path slides and never sticks again, as far as geometry stays what it was."""
    graph = near_yield(*which, law)
    errors = []
    for size in (4e-6, 2e-6):
        stage = Stage(Programme("line", np.zeros((4, 4)), np.eye(4), H.ravel()), "parameter", size)
        path = follow(Scene(graph, law), stage, closure="packing", past="stop")
        found = packing_increment(Scene(graph, law), size * H, candidates=0.9)
        if path.status != "finished" or found.status == "nearest":
            pytest.skip("an instability on the way")
        change = path.P[-1] - path.P[0]
        errors.append(np.abs(found.stress_rate.ravel() - change).max() / np.abs(change).max())
        assert len(path.of_kind("yield")) > 0
    assert max(errors) < 6e-4 and found.sliding > 0


def test_more_candidates_change_nothing_that_stays_inside():
    graph = near_yield(24, 3)
    few, many = (packing_increment(Scene(graph, LAW), 1e-5 * H, candidates=c) for c in (0.9, 0.2))
    assert many.candidates > few.candidates and few.beyond == many.beyond == 0
    size = np.abs(few.stress_rate).max()
    assert np.allclose(few.stress_rate, many.stress_rate, rtol=0, atol=1e-9 * size)


def test_contacts_that_end_beyond_their_strength_are_counted():
    graph = near_yield(24, 3)
    found = packing_increment(Scene(graph, LAW), 3e-3 * H, candidates=0.99)
    state = contact_state(graph)
    N = graph.normal_force + np.sum(found.force_rate * state.n, axis=1)
    T = graph.shear_force + np.sum(found.force_rate * state.t, axis=1)
    # In the frame that turns with each branch.
    turn = np.sum(found.branch_rate * state.t, axis=1) / state.length
    N, T = N + graph.shear_force * turn, T - graph.normal_force * turn
    beyond = np.abs(T) > 0.5 * N + 1e-6 * graph.normal_force
    assert found.beyond > 0
    assert found.beyond == np.count_nonzero(beyond & (found.regime == 1))


def test_stress_control_gives_back_the_strain():
    graph = near_yield(24, 3)
    given = packing_increment(Scene(graph, LAW), 1e-5 * H)
    strain, stress = np.array([[1e-5, 0], [0, np.nan]]), given.stress_rate
    found = packing_increment(Scene(graph, LAW), strain, stress=stress)
    assert found.sliding == given.sliding > 0
    assert np.allclose(found.strain_rate, 1e-5 * H, rtol=0, atol=1e-12)
    assert np.allclose(found.force_rate, given.force_rate, rtol=0, atol=1e-11)


@pytest.mark.parametrize("which", ROUGH)
def test_frame_numbers_and_units_change_nothing(which):
    graph, planes, force = jammed_in_box(*which)
    low, high = box(graph, planes)
    planes = replace(planes, force=force, fixed=low)
    volume = float(np.prod(high - low))
    first = packing_increment(Scene(graph, which[2], between(planes, volume=volume)), 2e-3 * H)
    R = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    order = np.random.default_rng(1).permutation(graph.grain_count)
    back, rows = np.argsort(order), np.random.default_rng(2).permutation(graph.contact_count)
    turned = GrainGraph(
        x=3.0 * (graph.x @ R.T)[order], radii=3.0 * graph.radii[order],
        contacts=back[graph.contacts[rows]], normal_force=0.06 * graph.normal_force[rows],
        shear_force=0.06 * graph.shear_force[rows],
    )  # fmt: skip
    plates = replace(
        planes, grain=back[planes.grain], branch=3.0 * planes.branch @ R.T, kn=0.02 * planes.kn,
        kt=0.02 * planes.kt, force=0.06 * force @ R.T, fixed=3.0 * R @ low,
    )  # fmt: skip
    law = LinearFrictional(0.02, 0.01, which[2].mu, which[2].shear_increment)
    found = packing_increment(
        Scene(turned, law, between(plates, volume=9.0 * volume)), 2e-3 * R @ H @ R.T
    )
    assert (found.status, found.sliding) == (first.status, first.sliding)
    size = np.abs(first.stress_rate).max()
    stress = R.T @ found.stress_rate @ R / 0.02
    assert first.sliding > 1 and np.allclose(stress, first.stress_rate, rtol=0, atol=1e-6 * size)


def test_forces_of_the_motion_are_those_of_the_increment():
    yielding = rate_problem(Scene(near_yield(24, 3), LAW), yield_band=0.5)
    found = increment(yielding, 1e-5 * H)
    forces = yielding.forces_of_motion(found.branch_rate, found.spin)
    size = np.abs(found.force_rate).max()
    assert found.sliding > 0 and np.allclose(forces, found.force_rate, rtol=0, atol=1e-7 * size)


def test_too_many_candidates_leave_the_nearest(monkeypatch):
    yielding = rate_problem(Scene(near_yield(24, 3), LAW), yield_band=0.3)
    monkeypatch.setattr(increment_module, "CONDENSED", 4)
    few = yielding.nearest
    assert len(few.rows) == 4 < len(yielding.rows)
    assert few.distance.max() <= np.sort(yielding.distance)[3]
    one, all_of_them = (increment(y, 1e-6 * H) for y in (yielding, few))
    assert np.allclose(one.stress_rate, all_of_them.stress_rate, rtol=1e-6)


def test_an_increment_beyond_any_solution_says_so():
    yielding = rate_problem(Scene(near_yield(24, 3), LAW), yield_band=0.5)
    q, M = yielding.problem(component_control(0.05 * H))
    raised = raise_load(yielding.distance, q, M)
    found = increment(yielding, 0.05 * H)
    assert found.reached == raised.first and found.disagreeing == np.count_nonzero(raised.held)
    assert (found.status == "nearest") == raised.held.any()
    assert found.reached < 1.0 or not raised.held.any()


def test_candidates_are_a_share():
    with pytest.raises(InputError, match="expected a finite number above 0, at most 1"):
        packing_increment(Scene(jammed(16, 2), LAW), H, candidates=1.5)


@pytest.mark.parametrize("control", ["strain", "stress"])
def test_a_probe_by_increment_has_the_increment_of_every_direction(control):
    graph, size = near_yield(24, 3), {"strain": 1e-5, "stress": 1e-6}[control]
    faces, yielding = find_faces(graph), rate_problem(Scene(graph, LAW), yield_band=0.7)
    rates = probe(Scene(graph, LAW), 6, control=control, yield_band=0.99)
    found = probe_by_increment(rates, yielding, faces, size)
    slid = 0
    for k, direction in enumerate(found.directions):
        driven = np.diag(size * direction)
        asked = {"strain": driven}
        if control == "stress":
            asked = {"strain": np.array([[np.nan, 0], [0, np.nan]]), "stress": driven}
        one = packing_increment(Scene(graph, LAW), **asked)
        assert found.status[k] == one.status and found.sliding[k] == one.sliding
        slid += one.sliding
        for name in ("strain_rate", "stress_rate"):
            values = getattr(one, name) / size
            near = 1e-9 * np.abs(values).max()
            assert np.allclose(getattr(found, name)[k], values, rtol=0, atol=near)
        assert found.work[k] == pytest.approx(np.sum(one.strain_rate * one.stress_rate) / size**2)
    assert slid > 0 and found.determined.all()
    # Every contact of the cell is in two loops: their parts sum to the sample's work.
    assert np.allclose(found.loop_work.sum(axis=1), found.work, rtol=1e-6)
    with pytest.raises(InputError, match="amplitude"):
        probe_by_increment(rates, yielding, faces, 0.0)
