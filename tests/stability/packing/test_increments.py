"""Increments of a packing's path by themselves: closings, openings, energies, times to a target."""

import sys
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from loops import LinearFrictional, RollingResistance, Scene, find_faces
from stability import Event, Programme, Stage, follow
from stability.packing import path as past_module
from stability.packing import strain_increment, sustain
from stability.packing.equations_of_motion import (
    REST_FORCE_LOADED,
    STABLE,
    Moving,
    largest_step,
    masses_of,
    rests,
    work_of,
)
from stability.packing.path import PackingPathOptions, PackingPathSolver
from stability.packing.probe import stage_along
from stability.packing.regime_factor import (
    unstable_mode,
)
from stability.packing.response import rate_problem
from stability.packing.sustain import (
    CUT,
    FLOW_STRAIN,
    INERTIA,
    LEAST_PUSH,
    LOOK,
    MOST_CUTS,
    PUSH_STEPS,
    STILL,
    STRIDE,
    _along,
    _to_loss,
    motion_past,
    move,
)
from stability.programmes import component_control
from tests.packings import LAW, jammed, loop_changes, packing, start_state, strained
from tests.stability.packing.test_path import unaccounted

KN, KT, MU = 3.0, 0.7, 0.4
sustain_module = sys.modules[sustain.__module__]


def stiffer(grains, seed, mu, law=LAW):
    """A jammed packing in balance with stiffnesses that are not one."""
    graph = jammed(grains, seed, law)
    graph = graph.replace(normal_force=KN * graph.normal_force, shear_force=KN * graph.shear_force)
    return graph, LinearFrictional(KN, KT, mu, law.shear_increment)


def test_moments_of_contacts_that_open_become_work():
    graph, law = stiffer(24, 3, np.inf)
    law = RollingResistance(law, 0.07)
    shear = strained([[0.0, -8e-3], [0.0, 0.0]])
    path = follow(Scene(graph, law), shear, closure="packing", interval=2e-4)
    assert path.status == "finished" and path.of_kind("opening")
    # Less than the least moment's; overlaps that end between two points leave the rest.
    assert path.work[-1, 1] > 1e-3 * path.work[-1, 0] and unaccounted(path) < 1e-6


def comes_apart(runs_away, held_back):
    """A packing just before it comes apart, its grains that no contact stops held by springs."""
    apart, graph = strained(-1.926e-2 * np.eye(2)), jammed(36, 5, LAW)
    how = {"closure": "packing", "interval": 5e-4, "instabilities": 99}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(strain_increment, "RUNS_AWAY", runs_away)
        patch.setattr(strain_increment, "HELD_BACK", held_back)
        path = follow(Scene(graph, LAW), apart, **how)
    assert path.status == "finished" and path.balance_error < 1e-8
    return path


@pytest.mark.slow
def test_springs_of_grains_that_no_contact_stops_move_little():
    """Over decades of either number: .3 % of the work of slip, .3 % of the stress of the start.

    Without springs the friction of one contact turns a chain of grains, and its slip takes more
    than four times the work that all others take.
    """
    usual = comes_apart(strain_increment.RUNS_AWAY, strain_increment.HELD_BACK)
    stress = np.linalg.norm(usual.P[0])
    for runs_away, held_back in product((1e-3, 1e-2, 1e-1), (1e-6, 1e-5, 1e-4, 1e-3)):
        found = comes_apart(runs_away, held_back)
        np.testing.assert_allclose(found.work[-1, 0], usual.work[-1, 0], rtol=1e-4)
        np.testing.assert_allclose(found.work[-1, 1], usual.work[-1, 1], rtol=3e-3)
        np.testing.assert_allclose(found.P[-1], usual.P[-1], rtol=0, atol=3e-3 * stress)
    turned = comes_apart(1e9, strain_increment.HELD_BACK)
    assert turned.work[-1, 1] > 4.0 * usual.work[-1, 1] > 0.0


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
    path = follow(Scene(graph, LAW), turned, closure="packing", interval=1e-4)
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
        yielding = rate_problem(Scene(large, law), yield_band=0.99)
        control = component_control([[0.8, 0.3], [-0.1, -0.5]])
        found = yielding.solved(control).response
        assert found.sliding > 2 and found.candidates > found.sliding
        at_strength = replace(yielding, distance=0.0 * yielding.distance)
        forces = at_strength.forces_of_motion(found.branch_rate, found.spin)
        np.testing.assert_allclose(forces, found.force_rate, atol=1e-9)


@pytest.mark.parametrize("share", [0.3, 0.6, 2.0])
@pytest.mark.parametrize(("quantity", "unit"), [("parameter", 1.0), ("H22", -2e-3), ("H12", 0.0)])
def test_a_snap_strains_to_the_end_of_its_interval_or_to_the_target(
    quantity, unit, share, monkeypatch
):
    """In units of the loading parameter; a quantity that is not driven may be leapt over."""
    spans, graph, duration = [], jammed(12, 1), 0.01

    def at_once(state, load, control, damping):
        spans.append(control.rate[0] / 1e-3)
        np.testing.assert_array_equal(load, -state.resultants)
        assert damping == 0.3
        return state, np.array([3.0, 2.0, 0.25, 0.75])

    monkeypatch.setattr(past_module, "snap_through", at_once)
    programme = Programme("strain", np.zeros((4, 4)), np.eye(4), [1e-3, 0, 0, -2e-3])
    stage = Stage(programme, quantity, share * duration * unit)
    solver = PackingPathSolver(Scene(graph, LAW), [stage], PackingPathOptions(1e-4, past="dynamic"))
    solver.point = replace(solver.point, targets=(stage.target,))
    met = Event("instability", 0.4, contacts=(3,), cause="chatters")
    assert solver._pass(met, duration) is None
    wanted = min(share, 1.0) * duration if unit else duration
    assert spans == [pytest.approx(wanted, rel=1e-12)]
    point = solver.point
    assert point.parameter == pytest.approx(wanted, rel=1e-12)
    assert point.work.tolist() == [3.0, 2.0, 0.25, 0.75]
    (event,) = point.events
    assert (event.passed, event.released) == ("replayed", 0.75)
    assert (event.cause, event.contacts) == ("chatters", (3,))
    # It is where the increment ended, whose time is in the parameter.
    assert event.parameter == 0.0
    # Behind the target there is nothing left to strain.
    behind = -0.1 * duration * unit if unit else 0.0
    solver.point = replace(point, targets=(point.quantity + behind,))
    solver._pass(met, duration)
    # Nothing has moved in the first motion: its strain is made good as well.
    assert spans[1] == pytest.approx(duration + wanted, rel=1e-12)


def test_a_snap_makes_good_the_error_of_the_control_before_it(monkeypatch):
    """The rate of a snap takes the strain to where the programme would be after it."""
    rates = []

    def kept(state, load, control, damping):
        rates.append(control.rate)
        return state, np.zeros(4)

    monkeypatch.setattr(past_module, "snap_through", kept)
    rate, duration = np.array([1e-3, 0.0, 0.0, -2e-3]), 0.01
    stage = Stage(Programme("strain", np.zeros((4, 4)), np.eye(4), rate), "parameter", 1.0)
    solver = PackingPathSolver(
        Scene(jammed(12, 1), LAW), [stage], PackingPathOptions(1e-4, past="dynamic")
    )
    # Ahead of the programme, and half an interval behind it.
    error = np.array([2e-6, -1e-6, 3e-6, 4e-6])
    F = np.eye(2) - error.reshape(2, 2)
    solver.point = replace(solver.point, parameter=0.5 * duration, F=F, targets=(1.0,))
    solver._pass(Event("instability", 0.0, contacts=(3,)), duration)
    (found,) = rates
    np.testing.assert_allclose(found, 1.5 * rate * duration - error, rtol=1e-9)


def load_solver(graph, interval=1e-4):
    """A path of loads along (-1, 0), up to a tenth of the stress."""
    largest = 0.1 * start_state(graph).stress[0, 0]
    stage = stage_along(np.array([-1.0, 0.0]), "diagonal", "stress", largest)
    solver = PackingPathSolver(
        Scene(graph, LAW), [stage], PackingPathOptions(interval, past="stop")
    )
    solver.start_stage(0, stage, 1)
    return solver, stage


class Watched(Moving):
    """A packing in motion that keeps its start, resultants, and kinetic energies at looks."""

    last = None

    def __init__(self, *given):
        super().__init__(*given)
        self.given, self.looks = given, []
        Watched.last = self

    def run(self, steps, dt, damping):
        if not self.looks:
            self.resultant, self.dt = self.motion.resultant.copy(), dt
        ran = super().run(steps, dt, damping)
        (_, masses, inertias, _), motion = self.given, self.motion
        square = (motion.velocity**2).sum(axis=1)
        self.looks.append(0.5 * np.sum(masses * square + inertias * motion.spin**2))
        return ran


TOLD = {"lost": 1.0, "load": 2.0, "cause": "", "contact": -1}


def moved(share, monkeypatch, shear=1.0):
    """What was found under a share of the largest load, the packing in motion and its path."""
    graph = jammed(12, 1)
    solver, stage = load_solver(graph.replace(shear_force=shear * graph.shear_force))
    monkeypatch.setattr(sustain_module, "Moving", Watched)
    control = solver.point.control_to(share * stage.target)
    motion, end, _ = move(solver.point, control, 0.3, find_faces(graph), **TOLD)
    return (motion, end), Watched.last, solver, stage


def test_a_packing_at_rest_is_asked_once_its_load_is_on(monkeypatch):
    """Looks of 100 steps, the load comes on over 500: rest is told after 600."""
    bounds = []
    resting = lambda moving, *bound: bounds.append(bound) or rests(moving, *bound)  # noqa: E731
    monkeypatch.setattr(sustain_module, "rests", resting)
    (found, _), moving, solver, _ = moved(0.0, monkeypatch)
    assert (found.status, found.steps) == ("at rest", PUSH_STEPS + LOOK)
    # The mean stress is the mean mass times the squared strain rate of an inertial number of one.
    radii = solver.point.state.radii
    masses = masses_of(radii)[0]
    mean = 0.5 * np.trace(solver.point.state.stress)
    ((slow, force),) = bounds
    assert (slow / STILL) ** 2 * masses.mean() == pytest.approx(mean, rel=1e-12)
    assert force == REST_FORCE_LOADED
    # All masses are the mean one; the step is short of the stable one.
    _, same, inertias, _ = moving.given
    np.testing.assert_allclose(same, masses.mean(), rtol=1e-12)
    np.testing.assert_allclose(inertias, INERTIA * masses.mean() * radii**2, rtol=1e-12)
    stable = largest_step(same, inertias, solver.point.state)
    usual = STRIDE * 0.3 * np.sqrt(masses.mean() / LAW.kn)
    assert moving.dt == pytest.approx(min(usual, STABLE * stable), rel=1e-2)


def test_a_motion_under_a_load_that_is_borne_ends_where_the_path_does(monkeypatch):
    """Real rest: forces as of the path by events, which comes to the same load."""
    (found, end), _, solver, stage = moved(0.3, monkeypatch)
    assert found.status == "at rest"
    start = solver.point.state
    F = end.cell @ np.linalg.inv(start.cell)
    P = np.linalg.det(F) * end.stress @ np.linalg.inv(F).T - start.stress
    assert P[0, 0] == pytest.approx(-0.3 * stage.target, rel=1e-5)
    assert abs(P[1, 1]) < 1e-5 * 0.3 * stage.target
    path = follow(
        Scene(jammed(12, 1), LAW),
        Stage(stage.programme, "parameter", 0.3 * stage.target),
        closure="packing",
        interval=1e-5,
    ).states[-1]
    count = jammed(12, 1).contact_count
    off = end.forces[:count] - path.forces[:count]
    assert np.linalg.norm(off) < 1e-4 * np.linalg.norm(path.forces[:count])


@pytest.mark.parametrize(("share", "most"), [(5.0, 700), (9.5, 60_000)])
def test_a_sample_that_flows_or_moves_too_long_has_no_rest(share, most, monkeypatch):
    """Under a twentieth of its stress it strains by 0.02; under half of it the steps are over."""
    monkeypatch.setattr(sustain_module, "MOST_STEPS", most)
    (found, end), _, solver, _ = moved(share, monkeypatch)
    assert found.status == "no rest"
    grown = end.cell @ np.linalg.inv(solver.point.state.cell) - np.eye(2)
    if most == 700:
        assert found.steps == most
    else:
        assert np.linalg.norm(grown) > FLOW_STRAIN and found.steps < most


def test_what_is_told_of_a_motion(monkeypatch):
    """Largest kinetic energy at a look, strain, energy lost; the mode is that of a copy."""
    modes = []
    keeping = lambda *given, **told: modes.append(given[1]) or motion_past(*given, **told)  # noqa: E731
    monkeypatch.setattr(sustain_module, "motion_past", keeping)
    (told, end), moving, solver, _ = moved(5.0, monkeypatch)
    start, (then,), faces = solver.point.state, modes, find_faces(jammed(12, 1))
    assert told.kinetic == pytest.approx(max(moving.looks), rel=1e-12)
    assert told.steps == LOOK * len(moving.looks) and (told.lost, told.load) == (1.0, 2.0)
    grown = end.cell @ np.linalg.inv(start.cell) - np.eye(2)
    np.testing.assert_allclose(told.strain.reshape(2, 2), -grown, rtol=1e-9, atol=1e-15)
    assert told.released == work_of(moving, end)[3] > 0
    F = then.cell @ np.linalg.inv(start.cell)
    assert 0 < np.linalg.norm(F - np.eye(2)) < np.linalg.norm(grown)
    np.testing.assert_allclose(told.displacement, then.x - start.x @ F.T, rtol=0, atol=1e-15)
    work = loop_changes(jammed(12, 1), then, faces)
    np.testing.assert_allclose(told.loop_work, work.area * work.additive_work, rtol=1e-9)


def test_a_motion_starts_in_balance_under_its_load(monkeypatch):
    """Forces out of balance at the start are kept as a load, the rise is that of the direction."""
    _, moving, solver, stage = moved(0.4, monkeypatch, shear=0.9)
    assert np.abs(solver.point.state.resultants).max() > 1e-2 * solver.point.state.mean_force
    assert np.abs(moving.resultant).max() < 1e-12 * solver.point.state.mean_force
    servo = moving.servo
    rise = stage.programme.rate * 0.4 * stage.target
    np.testing.assert_allclose(servo.rate * servo.whole, rise, rtol=1e-12)
    assert servo.whole == pytest.approx(PUSH_STEPS * moving.dt, rel=1e-12)


def stepping(monkeypatch, answers, ahead=lambda self: 0.0):
    """Steps of a path that answer in turn, and the intervals with which they were asked."""
    sizes = []

    def step(self, size):
        sizes.append(size)
        self.point = replace(self.point, parameter=self.point.parameter + 1e-6)
        return answers.pop(0) if answers else None

    monkeypatch.setattr(PackingPathSolver, "step", step)
    along = lambda point: point.parameter + ahead(point)  # noqa: E731
    monkeypatch.setattr(sustain_module, "_along", along)
    return sizes


def test_intervals_are_cut_before_an_equilibrium_is_given_up(monkeypatch):
    """A quarter of the interval, three times; twice as long again after each that goes well."""
    solver, _ = load_solver(jammed(12, 1))
    whole = solver.options.interval
    sizes = stepping(monkeypatch, [("lost", str(k)) for k in range(4)])
    assert _to_loss(solver, whole) == ("lost", "3")
    assert sizes == [whole / CUT**k for k in range(MOST_CUTS + 1)]
    # Cut intervals left nothing behind, the last one its row.
    assert solver.point.parameter == 1e-6 and len(solver.point.rows) == 2
    answers = [("lost", "")] * MOST_CUTS + [None] * 8 + [("instabilities", "met")]
    sizes = stepping(monkeypatch, answers)
    assert _to_loss(solver, whole) == ("instabilities", "met")
    # An instability is believed at once.
    cuts = [whole / CUT**k for k in range(MOST_CUTS)]
    assert sizes == cuts + [whole / 2**k for k in (6, 5, 4, 3, 2, 1, 0, 0, 0)]


def test_intervals_are_cut_where_the_stress_leaves_the_load(monkeypatch):
    """By more than half a per cent, or of the least rise where the load is smaller."""
    solver, _ = load_solver(jammed(12, 1))
    whole, least = solver.options.interval, LEAST_PUSH * solver.point.first_stress
    for off, cut in ((0.004, False), (0.006, True)):
        large = lambda point, off=off: off * max(point.parameter, least)  # noqa: E731
        sizes = stepping(monkeypatch, [("instabilities", "met")] * 4, large)
        _to_loss(solver, whole)
        assert sizes == ([whole / CUT**k for k in range(MOST_CUTS + 1)] if cut else [whole])


def test_the_stress_along_a_direction():
    """Of a packing that is strained: `(P - P0) . direction`."""
    solver, _ = load_solver(jammed(12, 1))
    assert _along(solver.point) == 0.0
    assert solver.step(solver.options.interval) is None
    rise = solver.point.P - solver.point.leg.P
    assert _along(solver.point) == pytest.approx(-rise[0], rel=1e-12) != 0.0


def test_an_interval_leaves_the_point_that_it_replaces():
    """From one point two intervals are the same to the last bit; openings and yields on the way."""
    graph, stage = jammed(24, 3, LAW), strained(-1e-2 * np.eye(2))
    solver = PackingPathSolver(Scene(graph, LAW), [stage], PackingPathOptions(5e-4, past="viscous"))
    solver.start_stage(0, stage, 40)
    for _ in range(20):
        before = solver.point
        every = [*vars(before).values(), *vars(before.state).values()]
        arrays = [part for part in every if isinstance(part, np.ndarray)]
        copies = [part.copy() for part in arrays]
        ends = []
        for _ in range(2):
            solver.point = before
            assert solver.step(5e-4) is None
            ends.append(solver.point)
        one, two = ends
        assert one.events == two.events and len(one.rows) == len(two.rows)
        for name in ("x", "normal_force", "shear_force", "contacts", "cell"):
            np.testing.assert_array_equal(getattr(one.state, name), getattr(two.state, name))
        np.testing.assert_array_equal(one.work, two.work)
        for part, copy in zip(arrays, copies, strict=True):
            np.testing.assert_array_equal(part, copy)
    assert {"opening", "yield"} <= {event.kind for event in one.events} and len(one.rows) > 10


@pytest.mark.parametrize(("speeds", "number"), [([3, 3, 3, 0], 3), ([3, 0, 0, 0], 1), ([0] * 4, 0)])
def test_the_participation_number_of_an_unstable_mode(speeds, number):
    """Equal speeds count whole, spins do not count."""
    motion = np.zeros((4, 3))
    motion[:, 0], motion[:, 1], motion[:, 2] = 0.6 * np.array(speeds), 0.8 * np.array(speeds), 7.0
    for size, turns in ((1.0, True), (1e-3, False)):
        found = unstable_mode(size * motion.ravel(), turns)
        assert found["sign_changes"] == turns
        assert found["taking_part"] == pytest.approx(number, rel=1e-12)
