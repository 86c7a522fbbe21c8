"""Increments of a packing's path by themselves: closings, openings, energies, times to a target."""

from copy import copy
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from loops import LinearFrictional, RollingResistance, find_faces
from stability import Stage, follow
from stability.packing import loop_changes
from stability.packing import path as path_module
from stability.packing.equations_of_motion import Snap, masses_of
from stability.packing.incremental_packing import ELASTIC, SLIDING
from stability.packing.pairs import contact_pairs
from stability.packing.path import PackingPathSolver
from stability.packing.probe import stage_along
from stability.packing.response import PackingRates, forces_of_motion, yield_response
from stability.packing.state import start_state
from stability.packing.strain_increment import (
    InstabilityError,
    MixedControl,
    StrainIncrement,
    UnsolvedError,
    disagreeing,
    pivot,
)
from stability.packing.sustain import (
    APART,
    LOOK,
    PUSH,
    PUSH_STEPS,
    STRIDE,
    _LoadPathSolver,
    _Moved,
    keeps_growing,
)
from stability.programmes import Programme
from tests.packings import LAW, jammed, packing, strained
from tests.stability.packing.test_path import unaccounted

KN, KT, MU = 3.0, 0.7, 0.4


class Rows:
    """Pairs, then their springs against rolling, whose relative rates are given."""

    def __init__(self, rates, kt, mu):
        self.rates, self.regime, self.side = rates, [None] * len(rates), [None] * len(rates)
        self.frame = [
            {"kt": kt, "mu": mu, "kn": KN, "slides": True} for kt, mu in zip(kt, mu, strict=True)
        ]

    def set_regime(self, row, regime, side):
        self.regime[row], self.side[row] = regime, side

    def solve(self, *control):
        return self.rates

    def relative(self, rates, row):
        return rates[row]


@pytest.mark.parametrize("rolls", [False, True])
@pytest.mark.parametrize("ratio", [-1.01, -0.99, 0.0, 0.99, 1.01])
def test_a_closing_contact_slides_where_its_rates_leave_the_cone(ratio, rolls):
    """`T' = -kt ut`, `N' = -kn un`: it slides beyond `mu N'`, to the side of `T'`.

    A spring against rolling has a stiffness and a strength of its own.
    """
    un = -2.0
    edge = MU * KN * 2.0 / KT
    other = 0.2 * KN * 2.0 / 0.05
    rates = [(un, ratio * edge), (un, -ratio * other)][: 2 if rolls else 1]
    packing = Rows(rates, (KT, 0.05)[: len(rates)], (MU, 0.2)[: len(rates)])
    made = object.__new__(StrainIncrement)
    made.packing, made.control = packing, ()
    made.N, made.pairs = np.zeros(len(rates)), [None]
    made._close(0)
    wanted = (SLIDING, -np.sign(ratio)) if abs(ratio) > 1 else (ELASTIC, 0.0)
    assert (packing.regime[0], packing.side[0]) == wanted
    if rolls:
        assert (packing.regime[1], packing.side[1]) == (wanted[0], -wanted[1])


def stiffer(grains, seed, mu, law=LAW):
    """A jammed packing in balance with stiffnesses that are not one."""
    graph = jammed(grains, seed, law)
    graph = graph.replace(normal_force=KN * graph.normal_force, shear_force=KN * graph.shear_force)
    return graph, LinearFrictional(KN, KT, mu, law.shear_increment)


@pytest.mark.parametrize("mu", [0.5, np.inf])
def test_contacts_that_open_and_close_lose_the_energy_of_their_shear_springs(mu):
    """`T^2/(2 kt)` becomes work of slip: without friction's limit springs are loaded till then."""
    graph, law = stiffer(24, 3, mu)
    shear = strained([[0.0, -1e-2], [0.0, 0.0]])
    path = follow(graph, law, shear, closure="packing", interval=2e-4)
    assert path.status == "finished"
    assert len(path.of_kind("opening")) > 1 and len(path.of_kind("closing")) > 0
    assert unaccounted(path) < 1e-9 and path.work[-1, 1] > 1e-3 * path.work[-1, 0]


def test_moments_of_contacts_that_open_become_work():
    graph, law = stiffer(24, 3, np.inf)
    law = RollingResistance(law, 0.07)
    shear = strained([[0.0, -8e-3], [0.0, 0.0]])
    path = follow(graph, law, shear, closure="packing", interval=2e-4)
    assert path.status == "finished" and path.of_kind("opening")
    # Less than the least moment's; overlaps that end between two points leave the rest.
    assert path.work[-1, 1] > 1e-3 * path.work[-1, 0] and unaccounted(path) < 1e-6


@pytest.mark.parametrize("length", [1.0, 16.0])
def test_grains_turn_with_a_packing_that_turns(length):
    """Angles, forces and moments; whatever the unit of length of the spins."""
    graph, angle = jammed(16, 2), 1e-4
    graph = graph.replace(
        x=length * graph.x, x0=None, radii=length * graph.radii,
        cell=length * graph.cell, cell0=None,
        normal_force=length * graph.normal_force, shear_force=length * graph.shear_force,
    )  # fmt: skip
    turned = strained([[0.0, angle], [-angle, 0.0]])
    path = follow(graph, LAW, turned, closure="packing", interval=1e-4)
    start, end = path.states[0], path.states[-1]
    assert path.status == "finished" and not path.of_kind("opening")
    np.testing.assert_allclose(end.angle[: end.count], angle, rtol=1e-3)
    size = start.mean_force
    np.testing.assert_allclose(end.normal_force, start.normal_force, rtol=0, atol=1e-4 * size)
    np.testing.assert_allclose(end.shear_force, start.shear_force, rtol=0, atol=1e-4 * size)


def test_forces_of_a_motion_are_those_of_the_rate_problem():
    """The regimes follow from the motion: where a solution slides its motion slides."""
    graph, law = packing(24, 3, 0.9, 0.4), LinearFrictional(KN, KT, 0.5, "radii")
    for length in (1.0, 10.0):
        large = graph.replace(
            x=length * graph.x, x0=None, radii=length * graph.radii,
            cell=length * graph.cell, cell0=None,
        )  # fmt: skip
        yielding = yield_response(large, law, yield_band=0.99)
        found = PackingRates(yielding).response([[0.8, 0.3], [-0.1, -0.5]])
        assert found.sliding > 2 and found.candidates > found.sliding
        at_strength = replace(yielding, distance=0.0 * yielding.distance)
        forces = forces_of_motion(at_strength, found.branch_rate, found.spin)
        np.testing.assert_allclose(forces, found.force_rate, atol=1e-9)


@pytest.mark.parametrize("share", [0.3, 0.6, 2.0])
@pytest.mark.parametrize(("quantity", "unit"), [("parameter", 1.0), ("H22", -2e-3), ("H12", 0.0)])
def test_a_snap_strains_to_the_end_of_its_interval_or_to_the_target(
    quantity, unit, share, monkeypatch
):
    """In units of the loading parameter; a quantity that is not driven may be leapt over."""
    spans, graph, duration = [], jammed(12, 1), 0.01

    def at_once(state, pairs, load, control, span, by_radii):
        spans.append(span)
        np.testing.assert_array_equal(load, -state.resultants)
        assert by_radii
        return Snap(state, pairs, np.array([3.0, 2.0, 0.25, 0.75]))

    monkeypatch.setattr(path_module, "snap_through", at_once)
    programme = Programme("strain", np.zeros((4, 4)), np.eye(4), [1e-3, 0, 0, -2e-3])
    stage = Stage(programme, quantity, share * duration * unit)
    solver = PackingPathSolver(graph, LAW, [stage], 1e-4, "dynamic", None, None)
    met = InstabilityError(3, "why", np.zeros(0, dtype=int))
    assert solver._pass(met, duration, stage, stage.target) is None
    wanted = min(share, 1.0) * duration if unit else duration
    assert spans == [pytest.approx(wanted, rel=1e-12)] == [solver.parameter]
    assert solver.work.tolist() == [3.0, 2.0, 0.25, 0.75]
    (event,) = solver.events
    assert event.detail == "why; replayed; 0.75 released" and event.contacts == (3,)
    # Behind the target there is nothing left to strain.
    behind = -0.1 * duration * unit if unit else 0.0
    solver._pass(met, duration, stage, solver._quantity(stage) + behind)
    assert spans[1] == duration


def test_a_snap_makes_good_the_error_of_the_control_before_it(monkeypatch):
    """The rate of a snap takes the strain to where the programme would be after it."""
    rates = []

    def kept(state, pairs, load, control, span, by_radii):
        rates.append((control.rate, span))
        return Snap(state, pairs, np.zeros(4))

    monkeypatch.setattr(path_module, "snap_through", kept)
    rate, duration = np.array([1e-3, 0.0, 0.0, -2e-3]), 0.01
    stage = Stage(Programme("strain", np.zeros((4, 4)), np.eye(4), rate), "parameter", 1.0)
    solver = PackingPathSolver(jammed(12, 1), LAW, [stage], 1e-4, "dynamic", None, None)
    # Ahead of the programme, and half an interval behind it.
    error, solver.parameter = np.array([2e-6, -1e-6, 3e-6, 4e-6]), 0.5 * duration
    solver.F = np.eye(2) - error.reshape(2, 2)
    solver._pass(InstabilityError(3, "why", np.zeros(0, dtype=int)), duration, stage, 1.0)
    ((found, span),) = rates
    assert span == duration
    np.testing.assert_allclose(found * span, 1.5 * rate * duration - error, rtol=1e-9)


def moved(graph, law, shift=0.0):
    """The packing as it starts to move under its own stress, and a little more."""
    start = start_state(graph)
    pairs = contact_pairs(start, law)
    rate = shift * start.stress.ravel()
    control = MixedControl(np.diag([1.0, 0, 0, 1.0]), np.diag([0, 1.0, 1.0, 0]), rate)
    args = start, pairs, -start.resultants, control, True, graph.contact_count, 0.3
    return _Moved(*args), start


def test_a_packing_at_rest_is_asked_once_its_load_is_on():
    """Looks of 100 steps, the load comes on over 500: rest is told after 600."""
    moving, start = moved(jammed(12, 1), LAW)
    assert moving.hold() == "at rest"
    assert moving.steps == PUSH_STEPS + LOOK and len(moving.strains) == 7
    # The mean stress is the mean mass times the squared strain rate of an inertial number of one.
    masses = masses_of(start.radii)[0]
    mean = 0.5 * np.trace(start.stress)
    assert moving.pace**2 * masses.mean() == pytest.approx(mean, rel=1e-12)
    smallest = 0.3 * np.sqrt(masses.min() / LAW.kn)
    assert moving.dt == pytest.approx(STRIDE * smallest, rel=1e-12)


def test_what_is_told_of_a_motion():
    """Kinetic energy and strain at each look are those of the bodies; the mode that of a copy."""
    moving, start = moved(jammed(12, 1), LAW, -0.05)
    for _ in range(7):
        moving.look()
        motion = moving.moving.motion
        square = (motion.velocity**2).sum(axis=1)
        kinetic = 0.5 * np.sum(moving.masses * square + moving.inertias * motion.spin**2)
        assert moving.kinetic[-1] == pytest.approx(kinetic, rel=1e-12)
        grown = motion.cell @ np.linalg.inv(start.cell) - np.eye(2)
        assert moving.strains[-1] == pytest.approx(np.linalg.norm(grown), rel=1e-12)
    end, faces = moving.moving.state(), find_faces(jammed(12, 1))
    told = moving.told("at rest", 1.0, 2.0, faces)
    np.testing.assert_allclose(told.strain.reshape(2, 2), -grown, rtol=1e-9, atol=1e-15)
    assert told.kinetic == max(moving.kinetic) and told.steps == 700
    assert (told.lost, told.load) == (1.0, 2.0) and told.released > 0
    then = moving.mode[0] if moving.mode else end
    F = then.cell @ np.linalg.inv(start.cell)
    np.testing.assert_allclose(told.displacement, then.x - start.x @ F.T, rtol=0, atol=1e-15)
    work = loop_changes(jammed(12, 1), then, faces)
    np.testing.assert_allclose(told.loop_work, work.area * work.additive_work, rtol=1e-9)
    # Looks from here on count from here.
    moving.start_again()
    moving.look()
    again = moving.told("at rest", 1.0, 2.0, faces)
    assert again.steps == LOOK and len(moving.strains) == 2
    now = moving.moving.motion.cell @ np.linalg.inv(end.cell) - np.eye(2)
    np.testing.assert_allclose(again.strain.reshape(2, 2), -now, rtol=1e-6, atol=1e-15)
    assert moving.work()[3] == pytest.approx(told.released + again.released, rel=1e-9)


def test_growth_at_its_edges():
    """As fast as before is growth still; a single look beyond the strain of failure is."""
    even = np.linspace(0.0, 2e-3, 9)
    assert keeps_growing(even, np.ones(9)) and keeps_growing([0.0, 1e-3], [0.0, 1.0])
    assert not keeps_growing(even, np.linspace(1.0, 0.99, 9))


@pytest.mark.parametrize(("first", "last", "least"), [(0.2, 0.6, 0.0), (0.0, 0.1, 0.05)])
def test_a_load_that_grows_is_that_of_the_servo(first, last, least):
    """The stress goes with the load, and loads that are kept lie apart."""
    moving, start = moved(jammed(12, 1), LAW, 0.02)
    rate = moving.rate.copy()
    status, load, kept = moving.grow(first, last, least)
    assert (status, load) == ("at rest", last) and moving.since is moving.origin
    assert len(moving.strains) == PUSH_STEPS // LOOK + 2
    loads = [one for one, _ in kept]
    gaps = [(b - a) / max(b, least) for a, b in pairwise(loads)]
    # One step of the load at most beyond what lies between.
    assert len(kept) > 10 and APART * (1 - 1e-9) <= min(gaps) and max(gaps) < APART + PUSH
    assert last * (1 - APART - PUSH) < loads[-1] < last
    for load, trial in [*kept, (last, moving)]:
        state = trial.moving.state()
        F = state.cell @ np.linalg.inv(start.cell)
        P = np.linalg.det(F) * state.stress @ np.linalg.inv(F).T
        error = np.diag(P - start.stress) - (load - first) / (last - first) * rate[[0, 3]]
        # While it grows the packing is some steps behind the servo.
        late = 2e-3 if trial is moving else 0.05
        assert np.abs(error).max() < late * np.abs(rate).max()


def load_solver(graph, interval=1e-4):
    """A path of loads along (-1, 0), up to a tenth of the stress."""
    largest = 0.1 * start_state(graph).stress[0, 0]
    stage = stage_along(np.array([-1.0, 0.0]), "diagonal", "stress", largest)
    solver = _LoadPathSolver(graph, LAW, stage, interval, None, None)
    solver.faces, solver.most_snaps, solver.damping = find_faces(graph), 3, 0.3
    return solver, stage


def test_a_motion_starts_in_balance_under_its_load():
    """Forces out of balance at the start are kept as a load, the rise is that of the direction."""
    graph = jammed(12, 1)
    graph = graph.replace(shear_force=0.9 * graph.shear_force)
    solver, stage = load_solver(graph)
    assert np.abs(solver.state.resultants).max() > 1e-2 * solver.state.mean_force
    moving = solver._moved(stage, 0.4 * stage.target)
    assert np.abs(moving.moving.motion.resultant).max() < 1e-12 * solver.state.mean_force
    programme = stage.programme
    np.testing.assert_allclose(moving.rate, programme.rate * 0.4 * stage.target, rtol=1e-12)


def test_intervals_are_cut_before_an_equilibrium_is_given_up(monkeypatch):
    """A quarter of the interval, three times; twice as long again after each that goes well."""
    solver, stage = load_solver(jammed(12, 1))
    whole, sizes, moves, answers = solver.size, [], [], []

    def step(self, stage, target, instabilities):
        sizes.append(self.size)
        self.events.append(None)
        return answers.pop(0)

    def move(self, stage, contact, cause):
        moves.append((contact, cause, len(self.events)))

    monkeypatch.setattr(PackingPathSolver, "_step", step)
    monkeypatch.setattr(_LoadPathSolver, "_move", move)
    answers += [("lost", str(k)) for k in range(4)]
    solver._step(stage, 1.0, 1)
    assert sizes == [whole, whole / 4, whole / 16, whole / 64] and moves == [(-1, "3", 0)]
    sizes.clear()
    answers += [None] * 8
    for _ in range(8):
        solver._step(stage, 1.0, 1)
    assert sizes == [whole / 2**k for k in (6, 5, 4, 3, 2, 1, 0, 0)] and len(moves) == 1


class Edges:
    """Contacts at yield: rates of the yield function, and their change per unit of slip of one."""

    def __init__(self, value, along, regime, side):
        self.value, self.along = np.array(value), np.array(along)
        self.regime, self.side = np.array(regime), np.array(side)
        self.frame, self.flipped = [None] * len(value), []

    def edge(self, rates, contacts):
        return np.column_stack([self.value, self.along])[contacts][:, : len(rates)]

    def column(self, row):
        return row

    def solve(self, *control):
        return "base"

    def driven(self, stress, strain, column):
        return "unit"

    def flip(self, c):
        self.flipped.append(c)
        self.regime[c] = SLIDING if self.regime[c] == ELASTIC else ELASTIC


CONTROL = MixedControl(np.zeros((4, 4)), np.eye(4), np.ones(4))


@pytest.mark.parametrize(("value", "agrees"), [(-0.9e-9, True), (-1.1e-9, False)])
def test_a_contact_that_agrees_to_rounding_is_flipped_at_once(value, agrees):
    """One that slip takes further from agreement has no other regime."""
    packing = Edges([value], [3.0], [ELASTIC], [1.0])
    packing.motion, packing.sign = lambda unit: np.ones(6), lambda *control: 1.0
    if agrees:
        assert pivot(packing, CONTROL, 0, np.array([0]), 1e-9) == packing.flipped == [0]
    else:
        with pytest.raises(UnsolvedError) as stop:
            pivot(packing, CONTROL, 0, np.array([0]), 1e-9, search=False)
        assert not stop.value.turns and packing.flipped == [0, 0]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_contact_that_slip_reaches_first_changes_its_regime(side):
    """Slip of contact 0 agrees at 2; contact 1 is reached at 1.5, contact 2 at 3, 3 never."""
    value, along = [-2.0, 3.0, 6.0, 1.0], [0.0, 2.0 * side, 2.0 * side, -1.0 * side]
    packing = Edges(value, along, [ELASTIC] * 4, [side, 1.0, 1.0, 1.0])
    # The rate of contact 0 itself does not change: it agrees once its slip is its excess.
    found = pivot(packing, CONTROL, 0, np.arange(4), 1e-9)
    assert found == [1, 0] and packing.flipped == [1, 0]
    packing = Edges(value, along, [ELASTIC] * 4, [side, 1.0, 1.0, 1.0])
    packing.value[1] = 4.1
    assert pivot(packing, CONTROL, 0, np.arange(4), 1e-9) == [0]
    # Reached at 1.75, with what the slip before has left of it.
    packing = Edges(value, along, [ELASTIC] * 4, [side, 1.0, 1.0, 1.0])
    packing.value[2] = 3.5
    assert pivot(packing, CONTROL, 0, np.arange(4), 1e-9) == [1, 2, 0]


def test_contacts_that_disagree_come_worst_first():
    """Sticking ones by rates below zero, sliding ones above it, beyond rounding."""
    regime = [ELASTIC, SLIDING, ELASTIC, SLIDING, ELASTIC, SLIDING]
    packing = Edges([-2.0, 3.0, 1.0, -1.0, -0.9e-9, 0.9e-9], np.zeros(6), regime, np.ones(6))
    assert disagreeing(packing, None, np.arange(6), 1e-9).tolist() == [1, 0]
    assert disagreeing(packing, None, np.array([0, 2]), 1e-9).tolist() == [0]


def test_rates_below_rounding_are_a_share_of_the_stiffest_spring():
    """1e-9 of what it gains where a pair of mean grains goes with the cell."""
    made = object.__new__(StrainIncrement)
    made.packing = SimpleNamespace(stiffest=3.0, length=0.25)
    rates = SimpleNamespace(h=np.array([0.5, -4.0, 1.0, 0.0, 99.0]))
    assert made._rounding(rates) == pytest.approx(1e-9 * 4.0 * 3.0 * 0.5, rel=1e-12)


@pytest.mark.parametrize(("speeds", "number"), [([3, 3, 3, 0], 3), ([3, 0, 0, 0], 1), ([0] * 4, 0)])
def test_the_participation_number_of_an_unstable_mode(speeds, number):
    """Equal speeds count whole, spins do not count."""
    motion = np.zeros((4, 3))
    motion[:, 0], motion[:, 1], motion[:, 2] = 0.6 * np.array(speeds), 0.8 * np.array(speeds), 7.0
    found = UnsolvedError(2, motion.ravel(), True, "enumeration")
    assert found.mode == f"no regimes agree: {number} grains take part, det K changes sign"
    found = UnsolvedError(2, 1e-3 * motion.ravel(), False, "")
    assert f"were found: {number} grains" in found.mode and "keeps its sign" in found.mode


@pytest.mark.parametrize("resting", [0, 1, 7, 15, 16, 19, 20])
def test_the_limit_is_the_largest_kept_load_that_comes_to_rest(resting, monkeypatch):
    """Of twenty: from the last but three back by four, eight, ... and then between the two."""
    graph, asked = jammed(12, 1), []

    def grow(self, first, last, least):
        kept = []
        for number in range(20):
            one = copy(self)
            one.number = number
            kept.append((first + 1e-9 * (1 + number), one))
        return "failed", first + 21e-9, kept

    def hold(self):
        asked.append(self.number)
        return "at rest" if self.number < resting else "failed"

    monkeypatch.setattr(_Moved, "grow", grow)
    monkeypatch.setattr(_Moved, "hold", hold)
    stage = stage_along(np.array([-1.0, 0.0]), "diagonal", "stress", 1e-6)
    solver = _LoadPathSolver(graph, LAW, stage, 1e-5, None, None)
    solver.faces, solver.most_snaps, solver.damping = find_faces(graph), 30, 0.3
    stop, why = solver._grow(stage)
    assert stop == "lost" and "after 3 motions; strain rate and kinetic energy keep growing" in why
    assert solver.parameter == pytest.approx(1e-9 * resting, abs=1e-15) and solver.ended
    assert [motion.status for motion in solver.motions] == ["at rest"] * (resting > 0) + ["failed"]
    assert solver.motions[-1].lost == solver.parameter
    assert solver.motions[-1].load == pytest.approx(1e-9 * (resting + 1), rel=1e-9)
    back = [k for k in (16, 8, 0) if k >= resting]
    assert asked[: len(back)] == back and len(set(asked)) == len(asked) <= 6
