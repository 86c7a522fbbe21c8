"""Contacts that pull off: bonds that break for good, the energy let go, and the motion after it."""

from functools import cache

import numpy as np
import pytest

from grainloops import hold, replay
from loops import (
    CohesiveFrictional,
    GrainGraph,
    InputError,
    RollingResistance,
    Scene,
    contact_state,
)
from loops.laws.of_pairs import require_movable
from patterns import Snapshot
from stability import Stage, follow, programmes
from stability.packing import sustain
from stability.packing.equations_of_motion import Moving, masses_of, servo_of
from studies.series.evolution import track_loops
from studies.series.packing import Following, packing_predictions
from tests.packings import contacts_of, jammed, loop_changes, start_state, strained
from tests.stability.packing.test_sustain import SQUARE

EXTENSION = np.array([[-6e-3, 2e-3], [0.0, 2e-3]])
PULL, KN = 0.004, 1.0


@cache
def at_rest(share, bonded, rolls=False):
    """The packing of 12 held under a pull of this share of its mean force, and its law."""
    graph = jammed(12, 1)
    pull = share * graph.normal_force[graph.normal_force > 0].mean()
    law = CohesiveFrictional(1.0, 0.5, 0.5, pull, bonded=bonded, shear_increment="radii")
    law = RollingResistance(law, 0.02, 0.1) if rolls else law
    held = hold(
        Scene(graph.replace(normal_force=law.normal_force(contact_state(graph))), law),
        unbalanced=1e-8,
    )
    assert held.status == "at rest"
    return held.graph, held.law


def row(bonded=True):
    """Two discs of diameter 1 in a periodic row, overlapping by 0.01, and their law."""
    graph = GrainGraph(
        x=[[0, 0], [1, 0]], radii=[0.505] * 2, contacts=[[0, 1], [1, 0]], images=[[0, 0], [1, 0]],
        cell=[[2, 0], [0, 3]], normal_force=[0.01] * 2,
    )  # fmt: skip
    return graph, CohesiveFrictional(KN, 0.5, 0.5, PULL, bonded=bonded)


def left_over(path):
    """What the energy balance leaves, over the largest work."""
    work, *spent = path.work[-1]
    return (work - sum(spent) - (path.energy[-1] - path.energy[0])) / np.abs(path.work).max()


@pytest.mark.parametrize("way", ["path", "replay"])
def test_bonds_hold_across_a_gap_and_touch_again_without_cohesion(way):
    """Stretched to just before and just beyond the pull, then pushed together again."""
    graph, law = row()
    # The overlap of a contact is 0.01 - strain, its bond breaks at -0.004.
    for stretch, wanted in ((0.0139, -0.0039), (0.0141, 0.0)):
        H = np.array([[-stretch, 0.0], [0.0, 0.0]])
        if way == "path":
            path = follow(Scene(graph, law), strained(H), closure="packing", interval=5e-4)
            state = path.states[-1]
            if wanted:
                assert path.status == "finished"
            else:
                assert path.status == "no_load" and path.parameter[-1] == pytest.approx(
                    0.014 / 0.0141, abs=5e-4 / 0.0141
                )
                continue
        else:
            # Both grains stay where the affine strain takes them: no load is on them.
            state = replay(Scene(graph, law), H, duration=20).state
        np.testing.assert_allclose(state.normal_force, wanted, rtol=1e-8, atol=1e-12)
    if way == "replay":
        H = np.array([[[-0.02, 0.0], [0.0, 0.0]], [[0.002, 0.0], [0.0, 0.0]]])
        end = replay(Scene(graph, law), H, duration=40).state
        np.testing.assert_allclose(end.normal_force, 0.012, rtol=1e-8)
        end = replay(Scene(graph, law), np.array([H[0], -H[1]]), duration=40).state
        np.testing.assert_allclose(end.normal_force, 0.008, rtol=1e-8)
        # Attraction comes back with the touch.
        graph, law = row(bonded=False)
        end = replay(Scene(graph, law), H, duration=40).state
        np.testing.assert_allclose(end.normal_force, 0.012 - PULL, rtol=1e-8)


def test_a_bond_keeps_its_energy_until_it_parts():
    graph, law = row()
    state = contacts_of(start_state(graph), law)
    np.testing.assert_allclose(state.law.reach, PULL / KN)
    np.testing.assert_allclose(state.law.at_touch, -PULL)
    # Overlaps are measured from where the bond breaks.
    np.testing.assert_allclose(state.overlap, 0.01 + PULL / KN)
    at = np.array([0.0, PULL / KN])
    np.testing.assert_allclose(state.law.normal_energy(at), [PULL**2 / 2, 0.0], atol=1e-18)
    broken = state.parted(np.array([True, False]))
    assert broken.law.reach.tolist() == [0.0, state.law.reach[1]]
    np.testing.assert_allclose(broken.law.normal_energy(at), 0.0, atol=1e-18)
    assert state.parted(np.zeros(2, dtype=bool)) is state


CASES = [
    *((share, bonded, 1) for share in (0.02, 0.3) for bonded in (False, True)),
    (1.0, False, 3), (1.0, True, 5), (3.0, False, 6), (3.0, True, 12),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("past", ["viscous", "dynamic"])
@pytest.mark.parametrize(("share", "bonded", "times"), CASES)
def test_the_energy_closes_through_contacts_that_pull_off(share, bonded, times, past):
    graph, law = at_rest(share, bonded)
    path = follow(
        Scene(graph, law), strained(times * EXTENSION), closure="packing", past=past, interval=4e-5
    )
    torn = [event for event in path.of_kind("opening") if event.cause == "pulls_off"]
    passed = {"viscous": "dragged", "dynamic": "replayed"}[past]
    assert torn and all(event.passed == passed and np.isfinite(event.released) for event in torn)
    assert path.work[-1, 3] > 0 and abs(left_over(path)) < 2e-12


@pytest.mark.slow
def test_energy_of_a_weak_pull_that_is_passed_by_a_motion():
    graph, law = at_rest(0.3, True, rolls=True)
    path = follow(
        Scene(graph, law), strained(EXTENSION), closure="packing", past="dynamic", interval=1e-4
    )
    assert path.of_kind("opening") and abs(left_over(path)) < 2e-12


def test_a_path_that_stops_names_the_contact_that_pulls_off():
    graph, law = at_rest(0.3, True)
    path = follow(
        Scene(graph, law), strained(EXTENSION), closure="packing", past="stop", interval=1e-3
    )
    event = path.events[-1]
    assert path.status == "instabilities" and event.kind == "opening"
    assert path.message.startswith(f"contact {event.contacts[0]}: it pulls off")
    N = path.states[-1].normal_force[event.contacts[0]]
    # Zero, since it has opened; until then no contact pulls more than it may.
    assert N == 0.0 and path.states[-1].normal_force.min() >= -float(law.adhesion.max())


def test_a_held_packing_keeps_its_broken_bonds():
    graph, law = row()
    apart = graph.replace(cell=[[2.03, 0], [0, 3]], x=[[0, 0], [1.0, 0]], normal_force=[0.01, 0.0])
    # The second contact is open by more than its bond reaches: it is broken from the start.
    state = contacts_of(start_state(apart), law)
    assert state.law.law.adhesion.tolist() == [PULL, 0.0]


def test_a_gap_that_is_no_length_is_refused():
    class Odd(CohesiveFrictional):
        def gap(self, state):
            return -2.0 * state.overlap

    graph, _ = row()
    with pytest.raises(InputError, match="Odd with gap"):
        require_movable(Odd(KN, 0.5, 0.5, PULL), contact_state(graph))


@pytest.mark.slow
@pytest.mark.parametrize("bonded", [False, True])
def test_slow_replays_come_to_a_path_through_openings(bonded):
    """Half the rate has about half the distance; the path goes through its openings by motions."""
    graph, law = at_rest(0.3, bonded)
    path = follow(
        Scene(graph, law), strained(EXTENSION), closure="packing", past="dynamic", interval=1e-5
    )
    assert path.of_kind("opening")
    first = slice(graph.contact_count)
    wanted = path.states[-1].forces[first]
    ends = [
        replay(Scene(graph, law), EXTENSION, duration=t, viscous=0.02).state for t in (2e3, 4e3)
    ]
    fast, slow = (np.linalg.norm(end.forces[first] - wanted) for end in ends)
    assert slow < 0.7 * fast and slow < 1e-3 * np.linalg.norm(wanted)


@pytest.mark.slow
def test_a_programme_with_a_held_stress_passes_a_bond_that_breaks():
    graph, law = at_rest(0.3, True)
    stage = Stage(programmes.drained_biaxial(), "H11", 5e-3)
    path = follow(Scene(graph, law), stage, closure="packing", past="dynamic", interval=1e-4)
    assert abs(left_over(path)) < 2e-12 or path.status != "finished"


@pytest.mark.slow
@pytest.mark.parametrize("bonded", [False, True])
def test_a_square_lattice_that_pulls_fails_where_its_contacts_pull_off(bonded):
    """The stress of an axis is its force over the spacing: from 0.01 to minus the pull."""
    kn = 1.0 if bonded else (0.01 + PULL) / 0.01
    law = CohesiveFrictional(kn, 0.5, 0.5, PULL, bonded=bonded, shear_increment="radii")
    found = sustain(Scene(SQUARE, law), [[-1, 0], [1, 0]], largest=0.03, interval=1e-4)
    assert found.status.tolist() == ["large motion, no rest", "held"]
    np.testing.assert_allclose(found.limit, [0.01 + PULL, np.nan], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("bonded", [False, True])
def test_a_slow_replay_moves_where_a_packing_that_pulls_no_longer_sustains(bonded):
    """Below the load of the large motion it strains as the path does, above it by far more."""
    graph, law = at_rest(0.3, bonded)
    scene, how = Scene(graph, law), {"largest": 0.02, "interval": 2e-5, "spread": False}
    (path,) = sustain(scene, [[-1, 1]], **how).paths
    assert path.status.startswith("large")
    strain = []
    for load in (0.98 * path.motions[-1].lost, 1.02 * path.first_large_load):
        stage = Stage(programmes.proportional_stress(*path.direction), "parameter", load)
        strain.append(np.linalg.norm(replay(scene, stage, duration=1e5).state.strain))
    before = np.linalg.norm(path.H, axis=1)[path.parameter <= path.motions[-1].lost].max()
    assert strain[0] < 1.05 * before and strain[1] > 1.5 * before


@pytest.mark.slow
@pytest.mark.parametrize("bonded", [False, True])
def test_a_series_under_bonds_predicts_what_the_equations_of_motion_do(bonded):
    """Work of the loops along the path of events, beside that of a slow replay to the same cell."""
    graph, law = at_rest(0.3, bonded)
    ids, regime = np.arange(12), np.ones(graph.contact_count, dtype=np.int8)
    one = Snapshot(graph, law, regime, ids, 0, (), rotation=0.0 * ids)
    H = 2e-4 * np.array([[1.0, 0.3], [0.0, -1.0]])
    end = replay(one.scene, H, inertial_number=1e-6).state
    later = end.graph()
    two = Snapshot(later, law, np.ones(later.contact_count, dtype=np.int8), ids, 0, (),
                   rotation=end.angle)  # fmt: skip
    columns, *_ = packing_predictions(one, two, track_loops(one, two), following=Following())
    wanted = loop_changes(graph, end, one.faces).normalised_work
    found = np.asarray(columns["path_w2"])
    assert np.isfinite(found).sum() > 5
    np.testing.assert_allclose(found, wanted, atol=0.02 * np.nanmax(np.abs(wanted)))


@pytest.mark.parametrize("bonded", [False, True])
def test_the_kernel_of_motion_has_the_forces_of_the_law_and_new_pairs_no_bond(bonded):
    """An attraction pulls at any overlap, a bond alone beyond touch; what comes near is free."""
    graph, law = row(bonded)
    state = contacts_of(start_state(graph), law)
    masses, inertias = masses_of(graph.radii)
    moving = Moving(state, masses, inertias, servo_of(state, masses), gradient=np.zeros((2, 2)))
    wanted = law.normal_force(contact_state(graph))
    np.testing.assert_allclose(moving.motion.answer[0, :2], wanted, rtol=1e-12)
    near = state.with_near(3.0)
    assert len(near.contacts) > 2
    adhesion = np.broadcast_to(near.law.law.adhesion, len(near.contacts))
    np.testing.assert_array_equal(adhesion[:2], PULL)
    np.testing.assert_array_equal(adhesion[2:], 0.0 if bonded else PULL)
