"""Ways past an instability: seven of twelve grains snap through, whatever the way."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from grainloops import replay
from loops import InputError, Scene
from stability import Programme, Stage, follow
from stability.packing import equations_of_motion
from stability.packing import path as past_module
from stability.packing.equations_of_motion import (
    Moving,
    lasting,
    masses_of,
    servo_of,
    steered,
    step_of,
)
from stability.packing.path import OTHER_WAYS, Dynamic, past_of
from tests.packings import BRANCH, contacts_of, jammed, start_state, strained
from tests.stability.packing.test_path import H, followed, unaccounted

GRAPH = jammed(12, 1, BRANCH)
STRAIN = 7.7 * H
INTERVAL = 1e-4
HELD = np.diag([1.0, 0, 0, 0]), np.diag([0, 1.0, 1.0, 1.0])


@functools.cache
def passed(past):
    return followed(Scene(GRAPH, BRANCH), strained(STRAIN), interval=INTERVAL, past=past)


@pytest.mark.parametrize("past", ["viscous", "dynamic", "stop"])
def test_each_way_meets_the_instability(past):
    first = passed(past).of_kind("instability")[0]
    # As the events before it: to the interval, and to the replay's rounding in the stored packing.
    assert first.contacts == (7,) and first.parameter == pytest.approx(0.98477, abs=1e-4)
    assert round(first.taking_part) == 7 and first.sign_changes
    assert unaccounted(passed(past)) < 1e-9


def test_stop_ends_with_the_state_before():
    path = passed("stop")
    (event,) = path.of_kind("instability")
    assert path.status == "instabilities" and path.message.startswith("contact 7: no regimes")
    assert event.passed == "stopped" and path.events[-1] is event
    assert path.parameter[-1] == event.parameter
    # A path that ends a thousandth of an interval earlier meets none and has the same forces.
    less = event.parameter - 1e-3 * INTERVAL / np.linalg.norm(STRAIN)
    before = followed(Scene(GRAPH, BRANCH), strained(less * STRAIN), interval=INTERVAL)
    assert before.status == "finished" and not before.of_kind("instability")
    forces = [one.states[-1].forces[: GRAPH.contact_count] for one in (before, path)]
    assert np.linalg.norm(forces[1] - forces[0]) < 1e-5 * np.linalg.norm(forces[0])


def test_dynamic_ends_where_a_slow_replay_ends():
    """The viscous way ends 20 times as far from it; replays at these two rates differ by 1e-3."""
    ends = [
        replay(Scene(GRAPH, BRANCH), STRAIN, duration=t, balanced=True).state for t in (2e4, 2e5)
    ]
    slower, slow = (end.forces[: GRAPH.contact_count] for end in reversed(ends))
    size = np.linalg.norm(slower)
    assert np.linalg.norm(slow - slower) < 2e-3 * size
    off = {
        past: np.linalg.norm(passed(past).states[-1].forces[: GRAPH.contact_count] - slower) / size
        for past in ("dynamic", "viscous")
    }
    assert passed("dynamic").status == "finished"
    assert off["dynamic"] < 8e-4 and off["viscous"] > 4e-3


def snapped(steps, damping, drag):
    """Energy lost in motion when an interval is strained and held: by the works, by the drag."""
    graph = passed("stop").states[-1].graph()
    start = contacts_of(start_state(graph), BRANCH)
    masses, inertias = masses_of(start.radii)
    dt = step_of(masses, inertias, start)
    rate = INTERVAL * STRAIN.ravel() / np.linalg.norm(STRAIN)
    servo = steered(servo_of(start, masses), start, np.zeros((4, 4)), np.eye(4), rate)
    moving = Moving(start, masses, inertias, lasting(servo, steps * dt))
    moving.load(-moving.motion.resultant)
    motion, powers = moving.motion, [0.0]
    for _ in range(2 * steps // 20):
        moving.run(20, dt, damping, drag)
        powers.append(drag * (masses @ motion.velocity**2 @ [1, 1] + inertias @ motion.spin**2))
    work, slip, left = motion.work
    own = work - slip - left - (moving.state().stored_energy - start.stored_energy)
    return own, 20 * dt * np.sum(powers), powers[-1] * steps * dt


def test_released_energy_is_that_of_a_slower_replay():
    (event,) = passed("dynamic").of_kind("instability")
    told = event.released
    own, _, _ = snapped(100_000, 0.3, 0.0)
    # Told by two digits; the rate's share besides.
    assert 0 < told == pytest.approx(own, rel=0.05)
    assert passed("dynamic").work[-1, 3] == pytest.approx(own, rel=0.05)


def test_dynamic_under_held_stress():
    """The servo keeps P11 through the snap, the strain jumps, and the energy balance closes."""
    mixed = Programme("mixed", *HELD, [0, STRAIN[0, 1], 0, STRAIN[1, 1]])
    stages = [strained(0.98 * STRAIN), Stage(mixed, "parameter", 0.03)]
    path = followed(Scene(GRAPH, BRANCH), stages, interval=INTERVAL, past="dynamic")
    (event,) = path.of_kind("instability")
    assert path.status == "finished" and event.passed == "replayed"
    np.testing.assert_allclose(path.P[-1, 0], path.P[1, 0], rtol=1e-5)
    wanted = 1.01 * STRAIN.ravel()[1:]
    np.testing.assert_allclose(path.H[-1, 1:], wanted, rtol=0, atol=1e-9)
    assert unaccounted(path) < 1e-9 and path.work[-1, 3] > 1e-7


@pytest.mark.parametrize("why", ["no rest", "jumped", "leapt"])
def test_a_snap_that_finds_no_rest_loses_the_path(why, monkeypatch):
    if why == "no rest":
        monkeypatch.setattr(equations_of_motion, "REST_FORCE", 0.0)
        monkeypatch.setattr(equations_of_motion, "MAX_CHECKS", 2)
    else:

        def off(state, *_):
            far = state.x + [[5.0, 0.0]] * (np.arange(12)[:, None] == 3)
            end = replace(state, x=far if why == "leapt" else state.x)
            return (replace(end, shear_force=9.0 * (why == "jumped") + end.shear_force),
                        np.zeros(4))  # fmt: skip

        monkeypatch.setattr(past_module, "snap_through", off)
    path = followed(Scene(GRAPH, BRANCH), strained(STRAIN), interval=INTERVAL, past="dynamic")
    assert path.status == "lost" and (why in path.message or "jumped" in path.message)
    assert path.events[-1].passed == "lost"
    before = passed("stop").states[-1]
    np.testing.assert_array_equal(path.states[-1].forces, before.forces)


def test_bad_input():
    with pytest.raises(InputError, match="past"):
        followed(Scene(GRAPH, BRANCH), strained(STRAIN), past="on")
    with pytest.raises(InputError, match="past: got 'stop' with the affine closure"):
        follow(Scene(GRAPH, BRANCH), strained(STRAIN), closure="affine", past="stop")


def test_a_way_of_ones_own_passes_an_instability():
    """It meets the state at the end of the interval, and sends the path where it says."""
    met = []

    def own(here, instability, control):
        met.append((here, instability, control))
        return Dynamic()(here, instability, control)

    path, wanted = passed(own), passed("dynamic")
    (event,) = path.of_kind("instability")
    np.testing.assert_array_equal(path.states[-1].forces, wanted.states[-1].forces)
    ((here, instability, control),) = met
    assert instability.contacts == event.contacts and instability.passed == ""
    assert len(here.state.law) == len(here.state.contacts)
    assert np.linalg.norm(control.rate) > 0


@pytest.mark.slow
@pytest.mark.parametrize("past", ["viscous", "dynamic"])
def test_the_spread_is_the_distance_to_the_other_choice(past):
    """Of springs three times as stiff, or a third of the damping; 0 without an instability."""
    scene, how = Scene(GRAPH, BRANCH), {"interval": INTERVAL, "rows": 4}
    one = followed(scene, strained(STRAIN), **how, past=past, spread=True)
    two = followed(scene, strained(STRAIN), **how, past=OTHER_WAYS[past_of(past)])
    apart = max(map(np.linalg.norm, one.P - two.P)) / max(map(np.linalg.norm, one.P - one.P[0]))
    assert one.stress_spread == pytest.approx(apart, rel=1e-12)
    assert apart > 0
    before = followed(scene, strained(0.1 * STRAIN), **how, past=past, spread=True)
    assert before.events and before.stress_spread == 0
    assert np.isnan(followed(scene, strained(STRAIN), **how, past=past).stress_spread)


def test_a_path_that_stops_at_an_instability_has_no_spread():
    scene = Scene(GRAPH, BRANCH)
    with pytest.raises(InputError, match="spread"):
        followed(scene, strained(0.1 * STRAIN), interval=INTERVAL, past="stop", spread=True)
