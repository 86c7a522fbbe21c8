"""Steps of the equations of motion beside those of the kernel as it was (`motion_before`)."""

from time import process_time

import numpy as np
import pytest

from loops import HertzMindlin, LinearFrictional, RollingResistance
from loops.compiled import motion as now
from stability.packing.equations_of_motion import Moving, masses_of, servo_of, step_of
from stability.packing.pairs import contact_pairs
from stability.packing.state import start_state
from tests.oracles import motion_before as before
from tests.packings import jammed

LINEAR = LinearFrictional(1.0, 0.5, 0.5, "radii")
ROLLING = RollingResistance(LINEAR, 0.02, 0.1)
HERTZ = HertzMindlin(5.0, 0.2, 0.5)
HISTORY = HertzMindlin(5.0, 0.2, 0.5, shear_history="displacement")
# Share of the size of each quantity by which steps may differ; zero is bit by bit.
LAWS = {"linear": (LINEAR, 0.0), "rolling": (ROLLING, 1e-13), "hertz": (HERTZ, 1e-13),
        "displacement": (HISTORY, 1e-13)}  # fmt: skip


def in_motion(law):
    """A packing that is sheared, its step and constants of a run."""
    start = start_state(jammed(24, 3))
    pairs, (masses, inertias) = contact_pairs(start, law), masses_of(start.radii)
    servo = servo_of(start, pairs, masses)
    gradient = np.array([[-2e-5, 1e-5], [0.0, 1e-5]])
    by_radii = law.shear_increment == "radii"
    dt = step_of(masses, inertias, pairs, start, by_radii)
    return Moving(start, pairs, masses, inertias, servo, by_radii, gradient=gradient), dt


def steps_of(kernel, moving, steps, dt):
    """Steps of a kernel, as it takes them; the state that it changes."""
    how = (steps, dt, 0.3, 0.0, moving.by_radii, np.inf)
    if kernel is now:
        return moving.motion, lambda: now.run(
            moving.law, moving.motion, moving.discs, moving.servo, *how
        )
    motion, discs, pairs = moving.motion, moving.discs, moving.pairs
    then = {name: getattr(motion, name) for name in before.MovingDiscs._fields if name != "root"}
    root = np.sqrt(np.maximum(motion.overlap, 0.0)) * (motion.kt > 0)
    state = before.MovingDiscs(**then, root=root)
    kn, kt, mu = discs.constants
    shared = {name: getattr(discs, name) for name in before.Discs._fields if hasattr(discs, name)}
    of_law = {"kn": kn, "kt": kt, "mu": mu, "hertz": pairs.hertz, "own": np.zeros((0, 5))}
    listed = before.Discs(**shared, **of_law, by_displacement=pairs.by_displacement)
    return state, lambda: before.run(state, listed, moving.servo, *how)


@pytest.mark.parametrize("name", LAWS)
def test_five_hundred_steps_are_those_of_the_kernel_before(name):
    law, share = LAWS[name]
    one, dt = in_motion(law)
    other, _ = in_motion(law)
    states = []
    for moving, kernel in ((one, now), (other, before)):
        state, run = steps_of(kernel, moving, 500, dt)
        assert run() == 500
        states.append(state)
    first = one.start.shear_force
    assert np.count_nonzero(one.motion.shear[: len(first)] != first) > 20
    for field in ("x", "velocity", "angle", "spin", "cell", "shear", "resultant", "rolled"):
        a, b = (getattr(state, field) for state in states)
        size = np.abs(b).max(initial=0.0)
        np.testing.assert_allclose(a, b, rtol=0, atol=share * size, err_msg=field)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["linear", "hertz", "rolling"])
def test_a_step_takes_no_longer_than_that_of_the_kernel_before(name):
    """Smallest of 40 alternating runs in one process: at most 1.1 of it."""
    found = []
    for kernel in (now, before) * 40:
        moving, dt = in_motion(LAWS[name][0])
        steps_of(kernel, moving, 1, dt)[1]()
        run = steps_of(kernel, moving, 1500, dt)[1]
        begin = process_time()
        run()
        found.append(process_time() - begin)
    assert min(found[::2]) < 1.1 * min(found[1::2])
