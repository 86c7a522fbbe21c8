"""A packing in motion under the equations of a DEM code, and the servo that steers its cell."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from loops.arrays import Floats
from loops.errors import InputError
from stability.packing.pairs import Pairs, with_near
from stability.packing.state import PackingState

if TYPE_CHECKING:
    from loops.compiled.replay import Servo

# Pairs closer than this share of the mean diameter stand in the list.
NEAR = 0.02
# Of the smallest sqrt(m/kn), as Yade's samples were made.
TIME_STEP = 0.3
# In `sqrt(m/kn)`, of the means: what a servo lags behind. An affine strain needs no waves.
LAG = 5.0
# Steps one after the other in each of which the pairs had to be listed anew.
SINGLES = 100


def step_of(masses: Floats, pairs: Pairs) -> float:
    """Length of a step."""
    return TIME_STEP * math.sqrt(float(masses.min() / pairs.kn.max()))


def duration_of(H: Floats, masses: Floats, state: PackingState, inertial_number: float) -> float:
    """Time that a strain takes at a rate."""
    pressure = 0.5 * float(np.trace(state.stress))
    if not pressure > 0:
        raise InputError("pressure", f"{pressure:g}", "forces", "Give the duration of the strain.")
    return float(np.linalg.norm(H)) * math.sqrt(masses.mean() / pressure) / inertial_number


def servo_of(state: PackingState, pairs: Pairs, masses: Floats) -> Servo:
    """A servo that is off, with the first cell and its lag."""
    from loops.compiled.replay import Servo

    back = np.ascontiguousarray(np.linalg.inv(state.cell))
    lag = LAG * math.sqrt(masses.mean() / pairs.kn.mean())
    none, nothing = np.zeros((4, 4)), np.zeros(4)
    start, z, ask = np.zeros((3, 4))
    steering = (none, none, nothing, none)
    return Servo(False, back, *steering, lag, -1, start, z, ask, np.inf, np.zeros(1))


def steered(
    servo: Servo, state: PackingState, pairs: Pairs, stress: Floats, strain: Floats, rate: Floats
) -> Servo:
    """The servo for `stress @ P' + strain @ H' = rate`, as stiff as the affine estimate."""
    matrix = stress @ _affine_stiffness(state, pairs) + strain
    if not np.linalg.cond(matrix) < 1e16:
        remedy = "Hold strains, or start from a packing that carries."
        raise InputError("packing", "no stiffness", "one that a servo can load", remedy)
    gain = np.array(np.linalg.inv(matrix), dtype=float)
    return servo._replace(on=True, stress=stress, strain=strain, rate=rate, gain=gain)


def lasting(servo: Servo, duration: float) -> Servo:
    """What is driven spread over a time, then held."""
    return servo._replace(rate=servo.rate / duration, whole=duration)


def _affine_stiffness(state: PackingState, pairs: Pairs) -> Floats:
    """`P' = C H'` (4, 4) if all grains went with the cell and none turned: too stiff."""
    d = state.branches
    length = np.linalg.norm(d, axis=1)
    touch = length <= state.radii[pairs.grains].sum(axis=1)
    n = d / length[:, None]
    frames = (n, np.column_stack([-n[:, 1], n[:, 0]]))
    K = sum(
        k[:, None, None] * a[:, :, None] * a[:, None, :]
        for k, a in zip((touch * pairs.kn, touch * pairs.kt), frames, strict=True)
    )
    C = np.einsum("kac,kb,kd->abcd", K, d, d) / abs(np.linalg.det(state.cell))
    return np.asarray(C.reshape(4, 4))


class Moving:
    """A packing in motion, from rest; its pairs are listed anew where grains come closer.

    Its load, velocities and the velocity gradient of its cell are set in `motion`.
    """

    def __init__(
        self,
        start: PackingState,
        pairs: Pairs,
        masses: Floats,
        inertias: Floats,
        servo: Servo,
        by_radii: bool,
    ) -> None:
        from loops.compiled.replay import Motion, contact_forces

        self.start, self.pairs, self.servo, self.by_radii = start, pairs, servo, by_radii
        self.lightness = 1.0 / masses, 1.0 / inertias
        self.gap = NEAR * 2.0 * float(start.radii.mean())
        count = len(start.radii)
        self.motion = Motion(
            x=np.array(start.x),
            velocity=np.zeros((count, 2)),
            angle=np.array(start.angle),
            spin=np.zeros(count),
            cell=np.array(start.cell),
            shear=np.array(start.shear_force),
            resultant=np.zeros((count, 3)),
            speed=np.zeros((count, 2)),
            gradient=-(servo.gain @ servo.rate).reshape(2, 2),
            load=np.zeros((count, 3)),
            moment=np.zeros(4),
            work=np.zeros(3),
            closer=np.zeros(1),
        )
        self._list()
        contact_forces(self.motion, self.discs, 0.0, by_radii, servo.on)
        servo.start[:] = self.motion.moment / abs(np.linalg.det(start.cell))

    def _list(self) -> None:
        from loops.compiled.replay import Discs

        motion = self.motion
        self.pairs = with_near(self.pairs, motion.x, motion.cell, self.start.radii, self.gap)
        fresh = np.zeros(len(self.pairs) - len(motion.shear))
        self.motion = motion._replace(shear=np.append(motion.shear, fresh))
        self.motion.closer[:] = 0.0
        images = self.pairs.images.astype(float)
        wraps = np.asarray(images.any(axis=1))
        grains = self.pairs.grains.astype(np.uint32)
        radii = np.array(self.start.radii)
        self.discs = Discs(radii, *self.lightness, grains, images, wraps, *self.pairs[2:])

    def load(self, load: Floats) -> None:
        """Pull and turn the grains besides, from now on."""
        self.motion.load[:] += load
        self.motion.resultant[:] += load

    def run(self, steps: int, dt: float, damping: float = 0.3, viscous: float = 0.0) -> bool:
        """Go on; False where grains come too far in every step."""
        from loops.compiled.replay import run

        done = singles = 0
        while done < steps:
            if self.motion.closer[0] > self.gap:
                self._list()
            how = (steps - done, dt, damping, viscous, self.by_radii, self.gap)
            made = run(self.motion, self.discs, self.servo, *how)
            singles = singles + 1 if made == 1 < steps - done else 0
            if singles > SINGLES:
                return False
            done += made
        return True

    def state(self) -> PackingState:
        """The packing as it is, its first pairs those of the start."""
        motion, kn = self.motion, self.pairs.kn
        state = replace(
            self.start,
            x=motion.x.copy(),
            angle=motion.angle.copy(),
            cell=motion.cell.copy(),
            contacts=self.pairs.grains,
            images=self.pairs.images,
            normal_force=np.zeros(len(kn)),
            shear_force=motion.shear.copy(),
        )
        overlap = state.radii[self.pairs.grains].sum(axis=1) - np.linalg.norm(
            state.branches, axis=1
        )
        return replace(state, normal_force=np.maximum(kn * overlap, 0.0))
