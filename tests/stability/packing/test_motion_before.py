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


@pytest.mark.parametrize("name", LAWS)
def test_five_hundred_steps_are_those_of_the_kernel_before(name):
    law, share = LAWS[name]
    one, dt = in_motion(law)
    other, _ = in_motion(law)
    for moving, kernel in ((one, now), (other, before)):
        how = (500, dt, 0.3, 0.0, moving.by_radii, np.inf)
        assert kernel.run(moving.motion, moving.discs, moving.servo, *how) == 500
    first = one.start.shear_force
    assert np.count_nonzero(one.motion.shear[: len(first)] != first) > 20
    for field in ("x", "velocity", "angle", "spin", "cell", "shear", "resultant", "rolled"):
        a, b = (getattr(moving.motion, field) for moving in (one, other))
        size = np.abs(b).max(initial=0.0)
        np.testing.assert_allclose(a, b, rtol=0, atol=share * size, err_msg=field)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["linear", "hertz", "rolling"])
def test_a_step_takes_no_longer_than_that_of_the_kernel_before(name):
    """Smallest of 40 alternating runs in one process: at most 1.1 of it."""
    found = []
    for kernel in (now, before) * 40:
        moving, dt = in_motion(LAWS[name][0])
        how = (dt, 0.3, 0.0, moving.by_radii, np.inf)
        kernel.run(moving.motion, moving.discs, moving.servo, 1, *how)
        begin = process_time()
        kernel.run(moving.motion, moving.discs, moving.servo, 1500, *how)
        found.append(process_time() - begin)
    assert min(found[::2]) < 1.1 * min(found[1::2])
