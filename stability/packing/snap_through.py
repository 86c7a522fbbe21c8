"""Through an instability by the equations of motion: strained slowly, then held until at rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loops.arrays import Floats
from stability.packing.equations_of_motion import masses_of
from stability.packing.motion import Moving, duration_of, lasting, servo_of, steered, step_of
from stability.packing.pairs import Pairs
from stability.packing.pivots import Control
from stability.packing.state import PackingState

# Inertial number of the strain, as of a slow replay.
RATE = 2.5e-7
# At rest: mean resultant over the mean contact force, and rate of the cell over that of the strain.
REST, STILL = 1e-5, 1e-2
# Steps between looks at the rest, and how many looks it is given.
LOOK, PATIENCE = 1000, 200


class Snap(NamedTuple):
    """The packing at rest again, its pairs, and the work that it took, as `PackingPath.work`."""

    state: PackingState
    pairs: Pairs
    work: Floats


def snap_through(
    state: PackingState,
    pairs: Pairs,
    load: Floats,
    control: Control,
    span: float,
    by_radii: bool,
) -> Snap:
    """Go on by `span` of the loading parameter under a constant load (G, 3).

    Masses are those of discs of unit density, damping is Cundall's. `ArithmeticError` where grains
    run off, or don't come to rest.
    """
    masses, inertias = masses_of(state.radii)
    servo = servo_of(state, pairs, masses)
    servo = steered(servo, state, pairs, control.stress, control.strain, control.rate * span)
    H, dt = servo.gain @ servo.rate, step_of(masses, pairs)
    steps = max(1, round(duration_of(H, masses, state, RATE) / dt))
    moving = Moving(state, pairs, masses, inertias, lasting(servo, steps * dt), by_radii)
    moving.load(load)
    energy = stored(state, pairs)
    ran, looks = moving.run(steps, dt), 0
    slow = STILL * float(np.linalg.norm(H)) / (steps * dt)
    while ran and not _rests(moving, slow):
        if looks == PATIENCE:
            raise ArithmeticError(f"no rest in {PATIENCE * LOOK} steps after an instability")
        ran, looks = moving.run(LOOK, dt), looks + 1
    end = moving.state()
    if not ran or not np.isfinite(end.x).all():
        raise ArithmeticError("grains ran off at an instability")
    work = np.append(moving.motion.work, 0.0)
    moved = end.x - state.x @ (end.cell @ np.linalg.inv(state.cell)).T
    work[0] += float(np.sum(load[:, :2] * moved) + load[:, 2] @ (end.angle - state.angle))
    work[3] = work[0] - work[1] - work[2] - (stored(end, moving.pairs) - energy)
    return Snap(end, moving.pairs, work)


def stored(state: PackingState, pairs: Pairs) -> float:
    """Energy of the springs, `sum N^2/(2 kn) + T^2/(2 kt)`."""
    N, T = state.normal_force, state.shear_force
    shear = np.divide(T**2, pairs.kt, out=np.zeros(len(pairs)), where=pairs.kt > 0)
    return 0.5 * float(np.sum(N**2 / pairs.kn + shear))


def _rests(moving: Moving, slow: float) -> bool:
    state, motion = moving.state(), moving.motion
    force = np.hypot(state.normal_force, state.shear_force)[state.closed]
    if not len(force):
        return True
    left = np.linalg.norm(motion.resultant[:, :2], axis=1).mean() / force.mean()
    return bool(left < REST and np.linalg.norm(motion.gradient) < slow)
