"""The equations of motion of a DEM code: discs, linear springs with Coulomb friction, damping.

A step is Cundall and Strack's as Yade does it: forces at positions, velocities half a step later
(symplectic), shear forces from the increments of the step. Centres move by `x' = L x + c`, the
cell by `h' = L h`; `c` is what inertia belongs to. Everything a kernel calls stands in this file.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from loops.arrays import Floats, Integers
from loops.compiled.kernel import kernel


class Motion(NamedTuple):
    """What moves, changed in place: centres, `c`, angles, spins, cell, and `T` of every pair."""

    x: Floats  # (G, 2)
    velocity: Floats  # (G, 2)
    angle: Floats  # (G,)
    spin: Floats  # (G,)
    cell: Floats  # (2, 2)
    shear: Floats  # (P,)


class Discs(NamedTuple):
    """What stays: grains, pairs that touch or might, their springs and friction."""

    radii: Floats
    mass: Floats
    inertia: Floats
    pairs: Integers  # (P, 2)
    images: Integers  # (P, 2)
    kn: Floats
    kt: Floats
    mu: Floats


@kernel
def run(
    motion: Motion,
    discs: Discs,
    gradient: Floats,
    steps: int,
    dt: float,
    cundall: float,
    viscous: float,
    by_radii: bool,
    reach: float,
    resultant: Floats,
) -> int:
    """Go on for some steps, fewer where grains have come `reach` closer; the steps made.

    `cundall` damps every resultant against the motion by that share, `viscous` pulls with `viscous
    m c`. `resultant` (G, 3) holds forces and moments of the state: given, and again at the end.
    """
    closer = 0.0
    stretch = 0.0
    for a in range(2):
        for b in range(2):
            stretch += abs(gradient[a, b])
    widest = 2.0 * discs.radii.max()
    for step in range(steps):
        fastest = _move(motion, discs, gradient, dt, cundall, viscous, resultant)
        _contact_forces(motion, discs, gradient, dt, by_radii, resultant)
        closer += dt * (2.0 * fastest + stretch * widest)
        if closer > reach:
            return step + 1
    return steps


@kernel
def _damped(force: float, mass: float, speed: float, dt: float, cundall: float) -> float:
    """Acceleration, less by `cundall` where it goes with the motion, more where against it."""
    a = force / mass
    along = a * (speed + 0.5 * dt * a)
    if along > 0:
        return a * (1.0 - cundall)
    if along < 0:
        return a * (1.0 + cundall)
    return a


@kernel
def _move(
    motion: Motion,
    discs: Discs,
    gradient: Floats,
    dt: float,
    cundall: float,
    viscous: float,
    resultant: Floats,
) -> float:
    """Velocities, then positions; the largest `|c|`."""
    x, c, cell = motion.x, motion.velocity, motion.cell
    fastest = 0.0
    for g in range(len(x)):
        for a in range(2):
            force = resultant[g, a] - viscous * discs.mass[g] * c[g, a]
            c[g, a] += dt * _damped(force, discs.mass[g], c[g, a], dt, cundall)
        moment = resultant[g, 2] - viscous * discs.inertia[g] * motion.spin[g]
        motion.spin[g] += dt * _damped(moment, discs.inertia[g], motion.spin[g], dt, cundall)
        motion.angle[g] += dt * motion.spin[g]
        x0, x1 = x[g, 0], x[g, 1]
        x[g, 0] += dt * (gradient[0, 0] * x0 + gradient[0, 1] * x1 + c[g, 0])
        x[g, 1] += dt * (gradient[1, 0] * x0 + gradient[1, 1] * x1 + c[g, 1])
        fastest = max(fastest, c[g, 0] * c[g, 0] + c[g, 1] * c[g, 1])
    for b in range(2):
        h0, h1 = cell[0, b], cell[1, b]
        cell[0, b] += dt * (gradient[0, 0] * h0 + gradient[0, 1] * h1)
        cell[1, b] += dt * (gradient[1, 0] * h0 + gradient[1, 1] * h1)
    return math.sqrt(fastest)


@kernel
def _contact_forces(
    motion: Motion, discs: Discs, gradient: Floats, dt: float, by_radii: bool, resultant: Floats
) -> None:
    """Shear forces after a step of `dt` (none if zero), and the resultants on all grains."""
    x, c, cell = motion.x, motion.velocity, motion.cell
    resultant[:] = 0.0
    for p in range(len(discs.pairs)):
        i, j = discs.pairs[p, 0], discs.pairs[p, 1]
        m0, m1 = discs.images[p, 0], discs.images[p, 1]
        d0 = x[j, 0] - x[i, 0] + cell[0, 0] * m0 + cell[0, 1] * m1
        d1 = x[j, 1] - x[i, 1] + cell[1, 0] * m0 + cell[1, 1] * m1
        touching = discs.radii[i] + discs.radii[j]
        square = d0 * d0 + d1 * d1
        if square >= touching * touching:
            motion.shear[p] = 0.0
            continue
        length = math.sqrt(square)
        n0, n1 = d0 / length, d1 / length
        arm_i = 0.5 * (length + discs.radii[i] - discs.radii[j])
        arm_j = length - arm_i
        normal = discs.kn[p] * (touching - length)
        v0 = c[j, 0] - c[i, 0] + gradient[0, 0] * d0 + gradient[0, 1] * d1
        v1 = c[j, 1] - c[i, 1] + gradient[1, 0] * d0 + gradient[1, 1] * d1
        across = n0 * v1 - n1 * v0
        if by_radii:
            slip = touching / length * across
            slip -= discs.radii[i] * motion.spin[i] + discs.radii[j] * motion.spin[j]
        else:
            slip = across - arm_i * motion.spin[i] - arm_j * motion.spin[j]
        most = discs.mu[p] * normal
        shear = min(max(motion.shear[p] - discs.kt[p] * slip * dt, -most), most)
        motion.shear[p] = shear
        f0, f1 = normal * n0 - shear * n1, normal * n1 + shear * n0
        resultant[j, 0] += f0
        resultant[j, 1] += f1
        resultant[i, 0] -= f0
        resultant[i, 1] -= f1
        resultant[i, 2] -= arm_i * shear
        resultant[j, 2] -= arm_j * shear


@kernel
def resultants(motion: Motion, discs: Discs, by_radii: bool, resultant: Floats) -> None:
    """Forces and moments on all grains in a state as it stands."""
    _contact_forces(motion, discs, motion.cell * 0.0, 0.0, by_radii, resultant)
