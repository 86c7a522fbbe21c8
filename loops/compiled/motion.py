"""The equations of motion of a DEM code: springs that a law gives, friction, damping.

A step is Cundall and Strack's as Yade does it: forces at positions, velocities half a step later
(symplectic), shear forces from the increments of the step. Centres move by `x' = L x + c`, the
cell by `h' = L h`; inertia belongs to `c` alone. `L` is given, or a servo steers it. A step places
all pairs, has the law fill in its answers (`loops.compiled.laws`), and adds up the forces. All
kernels that a kernel calls stand in this file, but for the law, which comes as a pointer.

Matrices are read by index, not unpacked, and the law is called in a kernel of its own: where
something may raise numba counts references to every array in every call, which takes as long as
some twenty pairs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Flags, Floats
from loops.compiled import inlined, kernel

# Overlap over the sum of the radii that pairs apart are handed to the law at: nothing reads it.
APART = 1e-4


class MovingDiscs(NamedTuple):
    """State of the motion, changed in place."""

    x: Floats  # (G, 2)
    velocity: Floats  # (G, 2) `c`
    angle: Floats  # (G,)
    spin: Floats  # (G,)
    cell: Floats  # (2, 2)
    shear: Floats  # (P,) `T`
    kt: Floats  # (P,) shear stiffness, zero where open
    overlap: Floats  # (P,)
    before: Floats  # (P,) a step ago
    # (3, P) from the first centre to the second, or to the wall's point, and the length, negative
    # where the pair is apart
    place: Floats
    answer: Floats  # (4, P) the law's `N`, `kt`, strength, and `T` before the shear of the step
    rolled: Floats  # (P,) moment of the rolling spring on the second grain
    resultant: Floats  # (G, 3) forces and moments of the state
    speed: Floats  # (G, 2) `L x + c` in the last step
    gradient: Floats  # (2, 2) `L`
    load: Floats  # (G, 3) constant forces and moments on the grains
    # Under a servo, else zero:
    moment: Floats  # (4,) forces times branches, 11, 12, 21, 22: stress times area
    # (3,) of the cell's strain, of slip, of `T` in the law's shear less the motion's with the
    # energy `T^2/(2 kt)` that goes as `kt` changes
    work: Floats
    closer: Floats  # (1,) largest possible approach of grains since the pairs were listed


class Discs(NamedTuple):
    """Constants: grains, pairs that touch or might touch, their springs and friction.

    Walls are the last bodies: points that go with the cell, without radius and lightness.
    """

    radii: Floats
    widest: float  # largest diameter
    walls: Floats  # (W, 2) normals, which stay
    lightness: Floats  # one over masses
    slenderness: Floats  # one over moments of inertia
    pairs: NDArray[np.uint32]  # (P, 2) unsigned: no index counts from the end
    images: Floats  # (P, 2)
    wraps: Flags  # (P,) whether an image isn't zero, or the second one is a wall
    spans: Floats  # (2, P) radii of the pairs
    reach: Floats  # (P,) gap across which a closed pair holds: a bond
    constants: Floats  # (n, P) of the law
    remembers: bool  # whether the law asks for the overlap before
    k_r: Floats  # (P,) of rolling springs, zero where there is none
    rolling_reach: Floats  # (P,) `|M|` at the limit over `N - at_touch`
    at_touch: Floats  # (P,) `N` where the pair opens


class Servo(NamedTuple):
    """Servo that steers `L` so that `stress @ (P - start) + strain @ H = rate t`.

    With the error `r` of that, `H' = gain @ (rate - r / lag - z)`, `z' = r / (2 lag)^2`, critically
    damped where `gain` is the inverse of the true `stress @ C + strain`. With `on` False `L` is
    constant. `isochoric` is a row whose `r` is the loss of area, -1 for none; `cauchy` a row, 0 or
    3, whose `r` is the change of the Cauchy stress 11 or 22 and of the pressure of a fluid of
    modulus `fluid` in the pores, -1 for none.
    """

    on: bool
    back: Floats  # (2, 2) inverse of the first cell
    stress: Floats  # (4, 4)
    strain: Floats  # (4, 4)
    rate: Floats  # (4,)
    gain: Floats  # (4, 4)
    lag: float
    isochoric: int
    cauchy: int
    fluid: float
    start: Floats  # (4,) nominal
    z: Floats  # (4,) changed in place
    ask: Floats  # (4,) changed in place
    whole: float  # time at which the rate ends
    clock: Floats  # (1,) changed in place


@kernel
def run(
    law: Callable[..., Any],
    motion: MovingDiscs,
    discs: Discs,
    servo: Servo,
    steps: int,
    dt: float,
    cundall: float,
    viscous: float,
    by_radii: bool,
    reach: float,
) -> int:
    """Make some steps, fewer where grains have come `reach` closer; the number of steps made.

    `cundall` is the share by which every resultant is damped, `viscous` the drag over `m c`. The
    number is negative where a bond has parted in the last step.
    """
    for step in range(steps):
        motion.closer[0] += dt * (2.0 * move(motion, discs, dt, cundall, viscous))
        if finish(law, motion, discs, servo, dt, by_radii):
            return -(step + 1)
        if motion.closer[0] > reach:
            return step + 1
    return steps


@kernel
def finish(
    law: Callable[..., Any],
    motion: MovingDiscs,
    discs: Discs,
    servo: Servo,
    dt: float,
    by_radii: bool,
) -> bool:
    """Forces where a step has moved the grains, work of the cell, and its gradient of the next.

    Whether a bond has parted.
    """
    stretch = work = 0.0
    for k in range(4):
        part = motion.gradient[k // 2, k % 2]
        stretch += abs(part)
        work -= part * motion.moment[k]
    motion.closer[0] += dt * stretch * discs.widest
    parted = update_forces(law, motion, discs, dt, by_radii, servo.on)
    for k in range(4):
        work -= motion.gradient[k // 2, k % 2] * motion.moment[k]
    motion.work[0] += 0.5 * dt * work
    if servo.on:
        _steer(motion, servo, dt)
    return parted


@kernel
def _damped(a: float, speed: float, dt: float, cundall: float) -> float:
    """Change of a speed, less by the share `cundall` if along the motion, more if against it."""
    along = a * (speed + 0.5 * dt * a)
    # Without a branch: the sign is as good as random.
    return dt * a * (1.0 - math.copysign(cundall, along))


@kernel
def move(motion: MovingDiscs, discs: Discs, dt: float, cundall: float, viscous: float) -> float:
    """Update velocities, then positions and cell; the largest `|c|`."""
    x, c, w, cell = motion.x, motion.velocity, motion.spin, motion.cell
    resultant, L = motion.resultant, motion.gradient
    fastest = 0.0
    for g in range(len(x)):
        light = discs.lightness[g]
        for a in range(2):
            c[g, a] += _damped(resultant[g, a] * light - viscous * c[g, a], c[g, a], dt, cundall)
        turning = resultant[g, 2] * discs.slenderness[g] - viscous * w[g]
        w[g] += _damped(turning, w[g], dt, cundall)
        motion.angle[g] += dt * w[g]
        x0, x1 = x[g, 0], x[g, 1]
        motion.speed[g, 0] = v0 = L[0, 0] * x0 + L[0, 1] * x1 + c[g, 0]
        motion.speed[g, 1] = v1 = L[1, 0] * x0 + L[1, 1] * x1 + c[g, 1]
        x[g, 0] = x0 + dt * v0
        x[g, 1] = x1 + dt * v1
        fastest = max(fastest, c[g, 0] * c[g, 0] + c[g, 1] * c[g, 1])
    for b in range(2):
        h0, h1 = cell[0, b], cell[1, b]
        cell[0, b] += dt * (L[0, 0] * h0 + L[0, 1] * h1)
        cell[1, b] += dt * (L[1, 0] * h0 + L[1, 1] * h1)
    return math.sqrt(fastest)


@inlined
def _along(n0: float, n1: float, d0: float, d1: float) -> tuple[float, float]:
    """Return the part of a branch along the normal of a wall."""
    away = n0 * d0 + n1 * d1
    return away * n0, away * n1


@kernel
def place(motion: MovingDiscs, discs: Discs) -> bool:
    """Update branches and overlaps of the pairs; whether one has parted across a gap."""
    x, parted = motion.x, False
    cell = motion.cell
    h00, h01, h10, h11 = cell[0, 0], cell[0, 1], cell[1, 0], cell[1, 1]
    first_wall = len(x) - len(discs.walls)
    for p in range(len(discs.pairs)):
        i, j = discs.pairs[p, 0], discs.pairs[p, 1]
        d0, d1 = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1]
        if discs.wraps[p]:
            m0, m1 = discs.images[p, 0], discs.images[p, 1]
            d0, d1 = d0 + h00 * m0 + h01 * m1, d1 + h10 * m0 + h11 * m1
            motion.place[0, p], motion.place[1, p] = d0, d1
            if j >= first_wall:
                wall = j - first_wall
                d0, d1 = _along(discs.walls[wall, 0], discs.walls[wall, 1], d0, d1)
        else:
            motion.place[0, p], motion.place[1, p] = d0, d1
        length, touching = math.sqrt(d0 * d0 + d1 * d1), discs.radii[i] + discs.radii[j]
        if discs.remembers:
            motion.before[p] = motion.overlap[p]
        reach = discs.reach[p]
        if length < touching + reach:
            motion.place[2, p], motion.overlap[p] = length, touching - length
        else:
            motion.place[2, p], motion.overlap[p] = -length, APART * touching
            parted |= reach > 0.0
    return parted


@kernel
def update_forces(
    law: Callable[..., Any],
    motion: MovingDiscs,
    discs: Discs,
    dt: float,
    by_radii: bool,
    summed: bool,
) -> bool:
    """Update shear forces over a step of `dt`, and the resultants on all grains.

    If `summed`, moments and works as well: mean forces times increments, closed to `dt` squared.
    Whether a bond has parted.
    """
    parted = place(motion, discs)
    now = motion.overlap, motion.before, motion.shear
    law(discs.constants, discs.spans, *now, motion.answer)
    _add_forces(motion, discs, dt, by_radii, summed)
    return parted


@inlined
def _product(a: Floats, b: Floats) -> tuple[float, float, float, float]:
    """Return the entries 11, 12, 21, 22 of the product of two matrices (2, 2)."""
    a00, a01, a10, a11 = a[0, 0], a[0, 1], a[1, 0], a[1, 1]
    b00, b01, b10, b11 = b[0, 0], b[0, 1], b[1, 0], b[1, 1]
    first, second = a00 * b00 + a01 * b10, a00 * b01 + a01 * b11
    return first, second, a10 * b00 + a11 * b10, a10 * b01 + a11 * b11


@inlined
def _let_go(force: float, stiffness: float, lost: float) -> float:
    """Return the energy lost so far, that of a spring which lets go added."""
    if force != 0.0 and stiffness > 0.0:
        lost += 0.5 * force**2 / stiffness
    return lost


@inlined
def _added(
    work: float, first: float, before: float, shear: float, was: float, kt: float, slip: float,
    turned: float, dt: float,
) -> float:  # fmt: skip
    """Return the work of the law's shear beyond the motion's, and what is lost as `kt` changes.

    `turned` is what the law's shear rate has beyond that of the motion.
    """
    if first != 0.0 and kt > 0.0 and (kt != was or before != first):
        work += 0.5 * (first * first / was - before * before / kt)
    # The motion did its work on the force that the step began with.
    work -= 0.5 * (first - before) * slip * dt
    return work + 0.5 * (first + shear) * turned * dt


@inlined
def _rolled(before: float, turn: float, k_r: float, dt: float, most: float) -> tuple[float, float]:
    """Return the moment of a rolling spring after a turn, and the energy that its slip takes."""
    elastic = before - k_r * turn * dt
    if abs(elastic) > most:
        moment = math.copysign(most, elastic)
        return moment, 0.5 * (before + moment) * (elastic - moment) / k_r
    return elastic, 0.0


@kernel
def _add_forces(motion: MovingDiscs, discs: Discs, dt: float, by_radii: bool, summed: bool) -> None:
    """Add up the forces of pairs that are placed and filled in."""
    v, w, resultant, answer = motion.speed, motion.spin, motion.resultant, motion.answer
    # Periodic images of a grain are faster by this, times the image.
    g00, g01, g10, g11 = _product(motion.gradient, motion.cell)
    s00 = s01 = s10 = s11 = slipped = beyond = 0.0
    first_wall = len(motion.x) - len(discs.walls)
    resultant[:] = motion.load
    for p in range(len(discs.pairs)):
        i, j, length = discs.pairs[p, 0], discs.pairs[p, 1], motion.place[2, p]
        if length < 0.0:
            slipped = _let_go(motion.shear[p], motion.kt[p], slipped)
            slipped = _let_go(motion.rolled[p], discs.k_r[p], slipped)
            motion.shear[p] = motion.rolled[p] = motion.kt[p] = 0.0
            continue
        radius_i, radius_j = discs.radii[i], discs.radii[j]
        e0, e1 = d0, d1 = motion.place[0, p], motion.place[1, p]
        v0, v1 = v[j, 0] - v[i, 0], v[j, 1] - v[i, 1]
        if discs.wraps[p]:
            m0, m1 = discs.images[p, 0], discs.images[p, 1]
            v0, v1 = v0 + g00 * m0 + g01 * m1, v1 + g10 * m0 + g11 * m1
            if j >= first_wall:
                wall = j - first_wall
                d0, d1 = _along(discs.walls[wall, 0], discs.walls[wall, 1], d0, d1)
        over = 1.0 / length
        n0, n1 = d0 * over, d1 * over
        arm_i = 0.5 * (length + radius_i - radius_j)
        arm_j = length - arm_i
        across = n0 * v1 - n1 * v0
        if by_radii:
            slip = (radius_i + radius_j) * over * across - radius_i * w[i] - radius_j * w[j]
        else:
            slip = across - arm_i * w[i] - arm_j * w[j]
        normal, kt, most, before = answer[0, p], answer[1, p], answer[2, p], answer[3, p]
        first, was = motion.shear[p], motion.kt[p]
        stuck = before - kt * slip * dt
        shear = min(max(stuck, -most), most)
        motion.shear[p], motion.kt[p] = shear, kt
        f0, f1 = normal * n0 - shear * n1, normal * n1 + shear * n0
        resultant[j, 0] += f0
        resultant[j, 1] += f1
        resultant[j, 2] -= arm_j * shear
        resultant[i, 0] -= f0
        resultant[i, 1] -= f1
        resultant[i, 2] -= arm_i * shear
        if discs.k_r[p] > 0.0:
            limit = discs.rolling_reach[p] * (normal - discs.at_touch[p])
            moment, lost = _rolled(motion.rolled[p], w[j] - w[i], discs.k_r[p], dt, limit)
            slipped, motion.rolled[p] = slipped + lost, moment
            resultant[j, 2] += moment
            resultant[i, 2] -= moment
        if summed:
            s00, s01 = s00 + f0 * e0, s01 + f0 * e1
            s10, s11 = s10 + f1 * e0, s11 + f1 * e1
            if shear != stuck and kt > 0.0:
                slipped += 0.5 * (before + shear) * (stuck - shear) / kt
            turned = slip - across + arm_i * w[i] + arm_j * w[j] if by_radii else 0.0
            beyond = _added(beyond, first, before, shear, was, kt, slip, turned, dt)
    motion.moment[0], motion.moment[1], motion.moment[2], motion.moment[3] = s00, s01, s10, s11
    if summed:
        motion.work[1] += slipped
        motion.work[2] += beyond


@kernel
def _steer(motion: MovingDiscs, servo: Servo, dt: float) -> None:
    """The velocity gradient of the next step."""
    h00, h01, h10, h11 = motion.cell.flat
    b00, b01, b10, b11 = servo.back.flat
    F = (h00 * b00 + h01 * b10, h00 * b01 + h01 * b11, h10 * b00 + h11 * b10, h10 * b01 + h11 * b11)
    det = F[0] * F[3] - F[1] * F[2]
    share = abs(b00 * b11 - b01 * b10) / det
    H = (1.0 - F[0], -F[1], -F[2], 1.0 - F[3])
    m00, m01, m10, m11 = motion.moment.flat
    P = (
        share * (m00 * F[3] - m01 * F[1]),
        share * (m01 * F[0] - m00 * F[2]),
        share * (m10 * F[3] - m11 * F[1]),
        share * (m11 * F[0] - m10 * F[2]),
    )
    servo.clock[0] = min(servo.clock[0] + dt, servo.whole)
    # A sum of steps is rounded.
    pace = 1.0 if servo.clock[0] < (1.0 - 1e-9) * servo.whole else 0.0
    for row in range(4):
        left = -servo.rate[row] * servo.clock[0]
        for k in range(4):
            left += servo.stress[row, k] * (P[k] - servo.start[k]) + servo.strain[row, k] * H[k]
        if row == servo.isochoric:
            left = 1.0 - det
        if row == servo.cauchy:
            # sigma = P F^T / det F, by the row of P and of F.
            k = row - row % 2
            sigma = (P[k] * F[k] + P[k + 1] * F[k + 1]) / det
            left = sigma - servo.start[row] - servo.fluid * math.log(det)
        servo.z[row] += left * dt / (4.0 * servo.lag * servo.lag)
        servo.ask[row] = pace * servo.rate[row] - left / servo.lag - servo.z[row]
    L = motion.gradient
    for a in range(2):
        one = two = 0.0
        for k in range(4):
            one -= servo.gain[2 * a, k] * servo.ask[k]
            two -= servo.gain[2 * a + 1, k] * servo.ask[k]
        L[a, 0] = (one * F[3] - two * F[2]) / det
        L[a, 1] = (two * F[0] - one * F[1]) / det
