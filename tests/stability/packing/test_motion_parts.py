"""Parts of the equations of motion in closed form: unequal grains, stiffnesses that are not one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loops import InputError, LinearFrictional, RollingResistance
from stability import Programme, Stage
from stability.packing import equations_of_motion
from stability.packing.equations_of_motion import (
    Moving,
    _affine_stiffness,
    _span,
    duration_of,
    lasting,
    masses_of,
    require_upright,
    rests,
    servo_of,
    snap_through,
    steered,
    work_of,
)
from stability.programmes import MixedControl
from tests.packings import LAW, contacts_of, jammed, start_state
from tests.stability.packing.test_pairs import HERTZ, LINEAR, OVERLAP, RADII, triangle

NONE, ALL = np.zeros((4, 4)), np.eye(4)


def test_energy_of_each_spring_in_closed_form():
    """`N^2/(2 kn)`, of Hertz's springs `2/5 N overlap`; `T^2/(2 kt)`, `M^2/(2 k_r)`."""
    for law in (LINEAR, HERTZ):
        state = triangle(RollingResistance(law, [0.3, 0.5, 0.9]))
        M = np.array([0.1, -0.2, 0.3])
        state = replace(state, rolling_moment=M)
        N, T = state.normal_force, state.shear_force
        kt = state.law.stiffnesses(OVERLAP)[1]
        own = N**2 / (2 * LINEAR.kn) if law is LINEAR else 0.4 * N * OVERLAP
        wanted = np.sum(own + T**2 / (2 * kt) + M**2 / (2 * np.array([0.3, 0.5, 0.9])))
        assert state.stored_energy == pytest.approx(wanted, rel=1e-12)
        none = {"shear_force": np.zeros(3), "closed": np.zeros(3, dtype=bool)}
        nothing = replace(state, normal_force=np.zeros(3), **none)
        assert nothing.stored_energy == 0.0


def test_the_affine_stiffness_is_that_of_contacts_that_go_with_the_cell():
    """Force rates of the branches' rates, contact by contact; open ones add nothing."""
    state = triangle(LINEAR)
    state = replace(state, cell=np.array([[40.0, 3.0], [-2.0, 30.0]]))
    H = np.array([[0.3, -0.7], [0.2, 0.5]])
    for opened in (False, True):
        if opened:
            state = replace(state, x=state.x + np.array([[0, 0], [0, 0], [0.0, 1.0]]))
        P = np.zeros((2, 2))
        for c in range(1 if opened else 3):
            d = state.branches[c]
            n = d / np.hypot(*d)
            t = np.array([-n[1], n[0]])
            rate = H @ d
            f = LINEAR.kn[c] * (n @ rate) * n + LINEAR.kt[c] * (t @ rate) * t
            P += np.outer(f, d) / (40.0 * 30.0 + 6.0)
        found = _affine_stiffness(state) @ H.ravel()
        np.testing.assert_allclose(found, P.ravel(), rtol=1e-12)


def test_times_and_masses_in_closed_form():
    state = triangle(LINEAR)
    masses, inertias = masses_of(RADII)
    np.testing.assert_allclose(masses, np.pi * np.array([4.0, 9.0, 25.0]))
    np.testing.assert_allclose(inertias, 0.4 * np.pi * np.array([16.0, 81.0, 625.0]))
    np.testing.assert_allclose(masses_of(RADII, [1.0, 2.0, 3.0])[1], [1.6, 7.2, 30.0])
    H, p = np.array([[3.0, 0.0], [4.0, 0.0]]), 0.5 * np.trace(state.stress)
    wanted = 5.0 * np.sqrt(masses.mean() / p) / 1e-3
    assert duration_of(H, masses, state, 1e-3) == pytest.approx(wanted, rel=1e-12)
    servo = servo_of(state, masses)
    assert servo.lag == pytest.approx(5.0 * np.sqrt(masses.mean() / 4.0), rel=1e-12)
    assert not servo.on and np.isinf(servo.whole)
    spread = lasting(servo._replace(rate=np.array([2.0, 0, 0, 4.0])), 8.0)
    assert spread.rate.tolist() == [0.25, 0, 0, 0.5] and spread.whole == 8.0


def test_a_servo_asks_for_the_strain_of_the_affine_stiffness():
    """`stress @ C H + strain @ H = rate`; the cell goes the other way: it is compressed."""
    state = triangle(LINEAR)
    stress, strain = np.diag([1.0, 0, 0, 0]), np.diag([0, 1.0, 1.0, 1.0])
    rate = np.array([0.02, 0.01, -0.03, 0.04])
    masses, inertias = masses_of(RADII)
    servo = steered(servo_of(state, masses), state, stress, strain, rate)
    H = servo.gain @ rate
    np.testing.assert_allclose(H[1:], rate[1:], atol=1e-15)
    assert (_affine_stiffness(state) @ H)[0] == pytest.approx(0.02, rel=1e-9)
    moving = Moving(state, masses, inertias, servo)
    np.testing.assert_allclose(moving.motion.gradient.ravel(), -H, rtol=1e-12)
    np.testing.assert_allclose(moving.lightness, [1 / masses, 1 / inertias], rtol=1e-14)
    before, load = moving.motion.resultant.copy(), np.arange(9.0).reshape(3, 3)
    moving.load(load)
    moving.load(load)
    np.testing.assert_allclose(moving.motion.resultant - before, 2 * load, atol=1e-12)
    np.testing.assert_allclose(moving.motion.load, 2 * load)
    with pytest.raises(InputError, match="no stiffness"):
        apart = replace(state, x=1.5 * state.x)
        steered(servo, apart, np.eye(4), NONE, rate)


def test_work_of_a_motion_in_closed_form():
    """Of the load in the motion beyond the cell's, of moments in the turning; the rest is lost."""
    state = triangle(LINEAR)
    F = np.array([[0.9, 0.1], [-0.2, 1.1]])
    rng = np.random.default_rng(1)
    u, turn, load = rng.normal(size=(3, 2)), rng.normal(size=3), rng.normal(size=(3, 3))
    end = replace(state, x=state.x @ F.T + u, cell=F @ state.cell, angle=state.angle + turn)
    motion = SimpleNamespace(work=np.array([3.0, 0.5, 0.25]), load=load)
    found = work_of(SimpleNamespace(start=state, motion=motion), end)
    whole = 3.0 + np.sum(load[:, :2] * u) + load[:, 2] @ turn
    stored = end.stored_energy - state.stored_energy
    np.testing.assert_allclose(found, [whole, 0.5, 0.25, whole - 0.75 - stored], rtol=1e-12)


@pytest.mark.parametrize(
    ("force", "speed", "rest"),
    [(0.9e-6, 0.9, True), (1.1e-6, 0.9, False), (0.9e-6, 1.1, False), (0.0, 0.0, True)],
)
def test_rest_is_a_small_resultant_and_a_slow_cell(force, speed, rest):
    """Mean resultant over the mean contact force below 1e-6, moments do not count."""
    state = triangle(LINEAR)
    resultant = np.zeros((3, 3))
    resultant[:, :2] = np.array([[3.0, 0.0], [0.0, 0.0], [0.0, 0.0]]) * force * state.mean_force
    resultant[:, 2] = 1e3
    gradient = speed * np.array([[0.3, 0.0], [0.0, 0.4]]) / 0.5
    moment = np.array([1.0, 0.0, 0.0, 1.0])
    motion = SimpleNamespace(resultant=resultant, gradient=gradient, moment=moment)
    moving = SimpleNamespace(motion=motion, state=lambda: state)
    moving.unbalanced = lambda state: Moving.unbalanced(moving, state)
    assert rests(moving, 1.0, 1e-6) is rest
    # Nothing to wait for where nothing carries.
    idle = replace(state, normal_force=np.zeros(3), closed=np.zeros(3, dtype=bool))
    moving.state = lambda: idle
    assert rests(moving, 1.0, 1e-6) is (speed < 1.0)
    motion.moment = np.zeros(4)
    assert rests(moving, 1.0, 1e-6)


def test_a_snap_takes_as_long_as_its_inertial_number_says(monkeypatch):
    """Then a thousand steps at a time until rest, that of the strain rate of the snap."""
    graph = jammed(12, 1)
    state = contacts_of(start_state(graph), LAW)
    rate, span = np.array([3e-3, 0, 0, -1e-3]), 0.02
    ran, asked, answers = [], [], [False, False, True]

    def run(self, steps, dt, damping=0.3, viscous=0.0):
        ran.append((steps, dt))
        return True

    def asks(moving, slow, force):
        asked.append((slow, force))
        return answers.pop(0)

    monkeypatch.setattr(Moving, "run", run)
    monkeypatch.setattr(equations_of_motion, "rests", asks)
    snap_through(state, -state.resultants, MixedControl(NONE, ALL, rate * span), 0.3)
    (steps, dt), *others = ran
    masses = masses_of(state.radii)[0]
    wanted = duration_of(span * rate, masses, state, 2.5e-7)
    assert steps == round(wanted / dt) and others == [(1000, dt)] * 2
    slow = 1e-2 * np.linalg.norm(span * rate) / (steps * dt)
    assert asked == [(pytest.approx(slow, rel=1e-12), 1e-6)] * 3


def strains(rate):
    return Programme("strains", NONE, ALL, rate)


def test_the_span_of_a_stage_is_its_target_over_its_rate():
    assert _span(Stage(strains([2e-3, 0, 0, 1.0]), "H11", 1e-2)) == pytest.approx(5.0)
    assert _span(Stage(strains([-2e-3, 0, 0, 1.0]), "H11", -1e-2)) == pytest.approx(5.0)
    assert _span(Stage(strains([2e-3, 0, 0, 1.0]), "parameter", 0.3)) == pytest.approx(0.3)
    for rate, target in ((-2e-3, 1e-2), (2e-3, -1e-2)):
        with pytest.raises(InputError, match="lies ahead"):
            _span(Stage(strains([rate, 0, 0, 1.0]), "H11", target))
    with pytest.raises(InputError, match="stage"):
        _span(Stage(strains([0, 1.0, 0, 0]), "H11", 1e-2))


@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_equations_that_keep_a_box_upright(scale):
    """Rows are mixed and of any size: what counts is whether `H12' = H21' = 0` follows."""
    start = SimpleNamespace(walls=np.zeros((4, 2)))
    mix = np.random.default_rng(1).normal(size=(4, 4))
    good = np.array([1.0, 0.0, 0.0, -2.0]) * scale
    require_upright(start, NONE, mix, mix @ good)
    stress = np.diag([1.0, 0, 0, 0])
    require_upright(start, stress, np.diag([0, 1.0, 1.0, 1.0]), good)
    for rate in ([0, 1.0, 0, 0], [0, 0, -1.0, 0]):
        with pytest.raises(InputError, match="box"):
            require_upright(start, NONE, mix, mix @ np.array(rate) * scale)
    with pytest.raises(InputError, match="box"):
        require_upright(start, np.diag([0, 1.0, 0, 0]), np.diag([1.0, 0, 1.0, 1.0]), good)
    require_upright(SimpleNamespace(walls=np.zeros((0, 2))), NONE, ALL, np.ones(4))


def test_time_goes_on_while_pairs_are_listed_anew():
    """One run of many steps is many runs of one; grains that run off end it."""
    law = LinearFrictional(3.0, 0.7, 0.5, "radii")
    graph = jammed(12, 1).replace(normal_force=3 * jammed(12, 1).normal_force)
    state = contacts_of(start_state(graph), law)
    ends = []
    for parts in ([60], [1] * 60, [7, 53]):
        masses, inertias = masses_of(state.radii)
        servo = servo_of(state, masses)
        kick = 0.05 * np.random.default_rng(1).normal(size=(12, 2))
        moving = Moving(state, masses, inertias, servo, velocity=kick)
        assert all(moving.run(part, 0.1) for part in parts)
        ends.append(moving.state())
    for end in ends[1:]:
        np.testing.assert_allclose(end.x, ends[0].x, rtol=0, atol=1e-12)
    assert np.abs(ends[0].x - state.x).max() > 0.01
    assert len(ends[0].contacts) > len(state.contacts) + 1
