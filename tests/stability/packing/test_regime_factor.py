"""Changes of regime by columns against a factorisation in the new regimes."""

import numpy as np
import pytest

from loops import Scene, branch_vectors
from stability import Stage, follow, programmes
from stability.compiled.packing_system import stiffnesses
from stability.packing import regime_factor, strain_increment
from stability.packing.regime_factor import BATCH, ELASTIC, OPEN, SLIDING, RegimeFactor
from stability.programmes import MixedControl
from tests.packings import BRANCH, LAW, contacts_of, forces_after, jammed, packing, start_state
from tests.stability.packing.yade_rest import STATES, yade_rest

NONE, ALL = np.zeros((4, 4)), np.eye(4)
HELD = np.diag([1.0, 0, 0, 0])
# The first is under prescribed strain, the second holds P11.
CONTROLS = (
    MixedControl(NONE, ALL, np.array([1.0, 0.2, 0.1, -0.7])),
    MixedControl(HELD, ALL - HELD, np.array([0, 0, 0, 1.0])),
)
OPENS = 13
CHANGES = (
    (3, SLIDING, 1.0),
    (OPENS, OPEN, 0.0),
    (11, SLIDING, -1.0),
    (3, ELASTIC, 0.0),
    (20, SLIDING, 1.0),
)


def pieces_of(graph, changes=()):
    left = np.arange(graph.contact_count) != OPENS
    graph = graph.replace(
        normal_force=left * graph.normal_force, shear_force=left * graph.shear_force
    )
    state, count = contacts_of(start_state(graph), LAW), graph.contact_count
    regime, side = np.full(count, ELASTIC, dtype=np.int8), np.ones(count)
    for c, to, on in changes:
        regime[c], side[c] = to, on
    load = np.random.default_rng(0).normal(size=(graph.grain_count, 3))
    load = 1e-3 * (load - load.mean(axis=0)).ravel()
    factor = RegimeFactor(state, regime, side)
    factor.set_load(load)
    return factor


def stiffness(pieces):
    """Dense stiffness in the present regimes, without springs."""
    system, n = (pieces.frame, pieces.regime, pieces.side), 3 * pieces.count
    (ends, elements), K = stiffnesses(*system), np.zeros((n, n))
    at = (3 * ends[:, :, None] + np.arange(3)).reshape(-1, 6)
    np.add.at(K, (at[:, :, None], at[:, None, :]), elements)
    return K


def rates_of(pieces):
    """Resultants (3G + 4, 3G) and `V P'` under unit motions, then under unit strain rates."""
    factors, n = pieces.factors, 3 * pieces.count
    loads = np.vstack([-stiffness(pieces).T, factors.strained[0]])
    return loads, np.vstack([factors.stress(np.eye(n)).T, factors.affine.T])


@pytest.mark.parametrize("control", CONTROLS, ids=["strain", "stress"])
def test_columns_are_a_factorisation_of_the_changed_system(control):
    """One contact without force opens; its grains keep enough contacts."""
    graph = jammed(36, 5, LAW)
    changed, anew = pieces_of(graph), pieces_of(graph, CHANGES)
    for change in CHANGES:
        changed.set_regime(*change)
        changed.solve(control)
    found, wanted = (pieces.solve(control) for pieces in (changed, anew))
    np.testing.assert_allclose(found[:4], wanted[:4], rtol=0, atol=1e-11)
    motions = changed.motion(found), anew.motion(wanted)
    np.testing.assert_allclose(*motions, rtol=0, atol=1e-10 * np.abs(motions[1]).max())
    assert changed.sign(control) == 1.0


def test_columns_solved_ahead_are_those_solved_alone():
    """Columns of the next events are the same to the bit, and no more than a batch."""
    graph = jammed(36, 5, LAW)
    alone, ahead = pieces_of(graph), pieces_of(graph)
    ahead.time_to_event[:10] = np.arange(10.0)
    rows = [len(ahead.time_to_event) + c for c in range(BATCH + 2)]
    for pieces in (alone, ahead):
        for row in rows:
            pieces.column(row)
            if row == rows[0]:
                assert len(pieces.ready) == (BATCH - 1 if pieces is ahead else 0)
    np.testing.assert_array_equal(ahead.motions[: 5 + len(rows)], alone.motions[: 5 + len(rows)])


def test_right_hand_sides_solved_at_once_change_nothing():
    """Twenty-four at once left sixteen unsolved without a word."""
    pieces, rows = pieces_of(jammed(36, 5, LAW)), np.arange(22)
    alone = [pieces.factors.motions_of_rows(pieces.frame, rows[[k]])[0] for k in rows]
    together = pieces.factors.motions_of_rows(pieces.frame, rows)
    np.testing.assert_array_equal(together, alone)


def test_little_room_for_columns_changes_no_path(monkeypatch):
    """With room for 16 and a new factorisation from 96 on the path was lost."""
    graph, law, _ = yade_rest("slow")
    paths = []
    for room in (regime_factor.ROOM, 16):
        for module in (regime_factor, strain_increment):
            monkeypatch.setattr(module, "ROOM", room)
        stage = Stage(programmes.drained_biaxial(axis=2), "H22", 5e-6)
        paths.append(follow(Scene(graph, law), stage, closure="packing", rows=1))
    assert [path.status for path in paths] == ["finished"] * 2
    events = [[event.kind for event in path.events] for path in paths]
    assert events[0] == events[1] and len(events[0]) > 32
    change = paths[0].P[-1] - paths[0].P[0]
    np.testing.assert_allclose(
        paths[1].P[-1], paths[0].P[-1], rtol=0, atol=1e-4 * np.abs(change).max()
    )


@pytest.mark.parametrize(
    ("state", "strain"),
    [("slow", 1e-6), *(pytest.param(name, 1e-5, marks=pytest.mark.slow) for name in STATES)],
)
def test_paths_are_those_of_weaker_springs(state, strain, monkeypatch):
    """At 1e-7 strain and work of the slow state were off by 1e-5."""
    graph, law, _ = yade_rest(state)
    stage, paths = Stage(programmes.drained_biaxial(axis=2), "H22", strain), []
    for spring in (regime_factor.REGULARISATION, 1e-12):
        monkeypatch.setattr(regime_factor, "REGULARISATION", spring)
        paths.append(follow(Scene(graph, law), stage, closure="packing", rows=1))
    one, other = paths
    assert one.status == other.status == "finished" and len(one.events) > 5
    events = [[(event.kind, event.contacts) for event in path.events] for path in paths]
    assert events[0] == events[1]
    # A grain of the dense state that is caught between two others has the rounding of its cage.
    rtol = 2e-6 if state == "dense" else 2e-8
    for part in ("H", "P"):
        a, b = (getattr(path, part)[-1] - getattr(path, part)[0] for path in paths)
        np.testing.assert_allclose(a, b, rtol=0, atol=rtol * np.abs(b).max())
    np.testing.assert_allclose(one.work[-1, 0], other.work[-1, 0], rtol=rtol)


@pytest.mark.parametrize("control", CONTROLS, ids=["strain", "stress"])
def test_slips_of_the_condensed_problem_are_those_of_sliding_contacts(control):
    """With `w = 0` on the contacts that slide `w - z` is that of the packing in these regimes."""
    graph, some = jammed(36, 5, LAW), np.array([3, 5, 11, 20, 30])
    slides = np.array([True, False, True, True, False])
    sides = np.where(some % 2, 1.0, -1.0)
    pieces = pieces_of(
        graph, list(zip(some, np.where(slides, SLIDING, ELASTIC), sides, strict=True))
    )
    wanted = pieces.edge((pieces.solve(control),), some)[:, 0]
    q, M = pieces.problem(control, some)
    z = np.zeros(len(some))
    z[slides] = -np.linalg.solve(M[np.ix_(slides, slides)], q[slides])
    assert (pieces.regime[some] == np.where(slides, SLIDING, ELASTIC)).all()
    size = np.abs(wanted).max()
    np.testing.assert_allclose(q + M @ z - z, wanted, rtol=0, atol=1e-9 * size)


def test_rows_that_change_next_are_solved_ahead():
    """Yield changes the shear row alone, opening and closing change both."""
    pieces = pieces_of(jammed(36, 5, LAW), [(7, OPEN, 0.0), (9, SLIDING, 1.0)])
    pieces.time_to_event[[5, 7, 9]], pairs = (2.0, 1.0, 3.0), len(pieces.time_to_event)
    pieces.column(20)
    assert sorted(pieces.ready) == [7, 9, pairs + 5, pairs + 7, pairs + 9]


def differences(graph, law, regime, size=1e-6):
    """Slopes of loads and stress under unit motions and strains, by central differences."""
    count = graph.grain_count
    found = []
    for k in range(3 * count + 4):
        ends = []
        for sign in (size, -size):
            v = np.zeros(3 * count + 4)
            v[k] = sign
            u, H = v[:-4].reshape(-1, 3), v[-4:].reshape(2, 2)
            _, force, load, _ = forces_after(graph, law, regime, H, u[:, :2], u[:, 2])
            stress = np.einsum("ci,cj->ij", force, branch_vectors(graph))
            ends.append(np.append(load, stress))
        found.append((ends[0] - ends[1]) / (2 * size))
    return np.array(found).T


@pytest.mark.parametrize("law", [LAW, BRANCH], ids=["radii", "branch"])
def test_stiffness_and_stress_are_slopes_of_the_forces(law):
    """With large forces and unequal grains the geometric terms are a tenth of the slopes."""
    graph = packing(8, seed=3, share=0.9, sliding=0.4, law=law)
    graph = graph.replace(
        normal_force=20 * graph.normal_force,
        shear_force=20 * graph.shear_force,
        radii=graph.radii * np.linspace(0.8, 1.2, 8),
    )
    state, count = contacts_of(start_state(graph), law), graph.contact_count
    slides = np.abs(graph.shear_force) >= (1 - 1e-9) * law.mu * graph.normal_force
    assert 3 < np.count_nonzero(slides) < count - 3
    regime, side = np.where(slides, SLIDING, ELASTIC).astype(np.int8), np.sign(graph.shear_force)
    pieces = RegimeFactor(state, regime, side)
    wanted = differences(graph, law, regime)
    # Freedoms of the rates are spins times a length, loads are moments over it.
    scale = np.tile([1.0, 1.0, pieces.length], 8)
    motions, strains = wanted[:, :-4] / scale, wanted[:, -4:]
    motions[:-4] /= scale[:, None]
    strains[:-4] /= scale[:, None]
    exact = {"rtol": 0, "atol": 1e-8}
    loads, stress = rates_of(pieces)
    np.testing.assert_allclose(loads.T, np.hstack([motions, strains])[:-4], **exact)
    np.testing.assert_allclose(stress.T, np.hstack([motions, strains])[-4:], **exact)


@pytest.mark.parametrize("control", CONTROLS, ids=["strain", "stress"])
@pytest.mark.parametrize(("which", "most"), [((16, 2), 1e-11), ((36, 5), 1e-9)], ids=["16", "36"])
def test_rates_are_those_of_a_dense_solve(which, most, control):
    """Ground springs of 1e-11 change rates by that over the softest stiffness of the packing.

    Nothing stays of the rates without a load that were solved for first.
    """
    graph = jammed(*which)
    state, count = contacts_of(start_state(graph), LAW), graph.contact_count
    regime, side = np.full(count, ELASTIC, dtype=np.int8), np.ones(count)
    load = np.random.default_rng(0).normal(size=(graph.grain_count, 3))
    load = 1e-3 * (load - load.mean(axis=0)).ravel()
    pieces, every = RegimeFactor(state, regime, side), np.arange(count)
    unloaded = pieces.edge((pieces.solve(control),), every)
    pieces.set_load(load)
    rates = pieces.solve(control)
    motion, n = pieces.motion(rates), len(load)
    force, stress = rates_of(pieces)
    stress = stress.T / pieces.volume
    system = np.vstack([-force.T, control[0] @ stress])
    system[n:, n:] += control[1]
    found = np.linalg.lstsq(system, np.append(load, control[2]), rcond=1e-11)[0]
    wanted = stress @ found
    np.testing.assert_allclose(rates[:4], found[n:], rtol=0, atol=most)
    size = np.abs(wanted).max()
    np.testing.assert_allclose(
        stress @ np.append(motion, rates[:4]), wanted, rtol=0, atol=most * size
    )
    pair, size = [pieces.relative(rates, c) for c in range(count)], np.abs(unloaded).max()
    yielding = LAW.kt * np.array(pair)[:, 1] - LAW.mu * LAW.kn * np.array(pair)[:, 0]
    loaded = pieces.edge((rates,), every)[:, 0]
    np.testing.assert_allclose(loaded, yielding, rtol=0, atol=1e-12 * size)
    assert np.abs(loaded - unloaded[:, 0]).max() > 1e-6 * size
    # Nothing holds the packing as a whole: its grains stay in place on average.
    moved = motion.reshape(-1, 3)[:, :2]
    assert np.linalg.norm(moved.mean(axis=0)) < 1e-15 * np.abs(moved).max()
