"""Work in a packing whose centres move in straight lines: exact geometry, by Gauss's rule.

Freedoms, pairs and regimes are those of `packing_rates`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Floats, Regimes
from loops.compiled import kernel

# Two points on (0, 1): exact to the third power of time.
FIRST = 0.5 - math.sqrt(3.0) / 6.0


@kernel
def add_work(
    pairs: NDArray[Any],
    regime: Regimes,
    touching: Floats,
    walls: Floats,
    normal: Floats,
    load: Floats,
    unit: float,
    strain: Floats,
    u: Floats,
    h: Floats,
    v: Floats,
    step: float,
    T: Floats,
    rates: Floats,
    work: Floats,
    released: Floats,
) -> None:
    """Add the work of a time `step`, in which `strain` and `u` go on at the rates `h` and `v`.

    `work[0]` gains the work of the cell and of the load that balances the resultants `load`,
    `work[2]` the work of `T` in the law's shear minus that in the motion at the contact, `released`
    (G,) the work of all other resultants.
    Normal forces that are not linear in the overlap are given, `normal` (2, P) at the two points.
    """
    if step <= 0.0:
        return
    count = len(released)
    force = np.empty((2, len(u)))
    times = step * FIRST, step * (1.0 - FIRST)
    turns = (
        _velocity_gradient(strain, h, times[0]),
        _velocity_gradient(strain, h, times[1]),
    )
    for k in range(len(u)):
        force[:, k] = -load[k]
    cell, shear, held, pressed, half_unit = 0.0, 0.0, 0.0, 0.0, 0.5 / unit
    first_wall = count - len(walls)
    for p in range(len(pairs)):
        pair = pairs[p]
        i, j = 3 * pair["grains"][0], 3 * pair["grains"][1]
        d0, d1 = pair["d"][0], pair["d"][1]
        start0 = d0 - strain[0] * d0 - strain[1] * d1 + u[j] - u[i]
        start1 = d1 - strain[2] * d0 - strain[3] * d1 + u[j + 1] - u[i + 1]
        r0 = v[j] - v[i] - h[0] * d0 - h[1] * d1
        r1 = v[j + 1] - v[i + 1] - h[2] * d0 - h[3] * d1
        half = 0.5 * (pair["arm"][0] + pair["arm"][1])
        for q in range(2):
            b0, b1 = start0 + times[q] * r0, start1 + times[q] * r1
            e0, e1 = b0, b1
            if pair["grains"][1] >= first_wall:
                wall = pair["grains"][1] - first_wall
                n0, n1 = walls[wall, 0], walls[wall, 1]
                away = n0 * b0 + n1 * b1
                b0, b1 = away * n0, away * n1
            square = b0 * b0 + b1 * b1
            if regime[p] == 0 and square >= touching[p] * touching[p]:
                continue
            length = math.sqrt(square)
            inverse = 1.0 / length
            n0, n1 = inverse * b0, inverse * b1
            if len(normal):
                N = normal[q, p]
                pressed += N * (n0 * r0 + n1 * r1)
            else:
                N = pair["kn"] * max(touching[p] - length, 0.0)
            S = T[p] + times[q] * rates[p, 2] if regime[p] != 0 else 0.0
            f0, f1 = N * n0 - S * n1, N * n1 + S * n0
            t = turns[q]
            cell += f0 * (t[0] * e0 + t[1] * e1) + f1 * (t[2] * e0 + t[3] * e1)
            longer = half_unit * length - half
            arm_i, arm_j = pair["arm"][0] + longer, pair["arm"][1] + longer
            spins = arm_i * v[i + 2] + arm_j * v[j + 2]
            shear += S * (n0 * r1 - n1 * r0 - spins - rates[p, 3])
            force[q, j] += f0
            force[q, j + 1] += f1
            force[q, i] -= f0
            force[q, i + 1] -= f1
            force[q, i + 2] -= arm_i * S
            force[q, j + 2] -= arm_j * S
    for q in range(2):
        t = turns[q]
        for g in range(count):
            k = 3 * g
            u0, u1 = u[k] + times[q] * v[k], u[k + 1] + times[q] * v[k + 1]
            v0, v1 = v[k] + t[0] * u0 + t[1] * u1, v[k + 1] + t[2] * u0 + t[3] * u1
            power = force[q, k] * v0 + force[q, k + 1] * v1 + force[q, k + 2] * v[k + 2]
            released[g] += 0.5 * step * power
            held += load[k] * v0 + load[k + 1] * v1 + load[k + 2] * v[k + 2]
    work[0] += 0.5 * step * (cell - held + pressed)
    work[2] -= 0.5 * step * shear


@kernel
def overlaps_on_the_way(
    pairs: NDArray[Any],
    touching: Floats,
    walls: Floats,
    first_wall: int,
    strain: Floats,
    u: Floats,
    h: Floats,
    v: Floats,
    step: float,
    out: Floats,
) -> None:
    """Overlaps (4, P) at the start of a step, at the two points of `add_work`, and at the end."""
    times = 0.0, step * FIRST, step * (1.0 - FIRST), step
    for p in range(len(pairs)):
        pair = pairs[p]
        i, j = 3 * pair["grains"][0], 3 * pair["grains"][1]
        d0, d1 = pair["d"][0], pair["d"][1]
        b0 = d0 - strain[0] * d0 - strain[1] * d1 + u[j] - u[i]
        b1 = d1 - strain[2] * d0 - strain[3] * d1 + u[j + 1] - u[i + 1]
        r0 = v[j] - v[i] - h[0] * d0 - h[1] * d1
        r1 = v[j + 1] - v[i + 1] - h[2] * d0 - h[3] * d1
        if pair["grains"][1] >= first_wall:
            wall = pair["grains"][1] - first_wall
            n0, n1 = walls[wall, 0], walls[wall, 1]
            away, rate = n0 * b0 + n1 * b1, n0 * r0 + n1 * r1
            b0, b1, r0, r1 = away * n0, away * n1, rate * n0, rate * n1
        for q in range(4):
            c0, c1 = b0 + times[q] * r0, b1 + times[q] * r1
            out[q, p] = max(touching[p] - math.sqrt(c0 * c0 + c1 * c1), 0.0)


@kernel
def _velocity_gradient(strain: Floats, h: Floats, time: float) -> tuple[float, float, float, float]:
    """Velocity gradient of the cell, compression positive: `H' F^-1` with `F = 1 - H`."""
    e0, e1 = strain[0] + time * h[0], strain[1] + time * h[1]
    e2, e3 = strain[2] + time * h[2], strain[3] + time * h[3]
    det = (1.0 - e0) * (1.0 - e3) - e1 * e2
    return (
        (h[0] * (1.0 - e3) + h[1] * e2) / det,
        (h[0] * e1 + h[1] * (1.0 - e0)) / det,
        (h[2] * (1.0 - e3) + h[3] * e2) / det,
        (h[2] * e1 + h[3] * (1.0 - e0)) / det,
    )
