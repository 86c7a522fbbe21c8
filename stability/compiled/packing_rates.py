"""Pairs of a packing with frozen geometry: their rates, their part of the stiffness, their events.

Freedoms are 3 a grain: `u`, and the spin times a length. Lever arms are over that length. Regimes
are those of `loops.Regime`: 0 open, 1 stuck, 2 sliding. Everything a kernel calls stands here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.compiled.kernel import kernel


class PairFrame(NamedTuple):
    """Pairs at one geometry: what their motion is of the freedoms, and what their forces do.

    `rows` (P, 18): branch vector, `n`, `t`; share of `t . d'` in the shear rate and the levers of
    the spins in it; levers of the shear force; force rates as the pair turns, per `t . d'`, moment
    rates as its arms grow, per `n . d'`; `kn`, `kt`, `mu` (0 where nothing slides), and whether
    there is a finite strength.
    """

    grains: Integers  # (P, 2)
    rows: Floats


@kernel
def _relative(
    grains: Integers, rows: Floats, p: int, v: Floats, h: Floats
) -> tuple[float, float, float]:
    """`n . d'`, the shear rate, and `t . d'`."""
    i, j = 3 * grains[p, 0], 3 * grains[p, 1]
    d0, d1 = rows[p, 0], rows[p, 1]
    r0 = v[j] - v[i] - (h[0] * d0 + h[1] * d1)
    r1 = v[j + 1] - v[i + 1] - (h[2] * d0 + h[3] * d1)
    across = rows[p, 4] * r0 + rows[p, 5] * r1
    shear = rows[p, 6] * across - rows[p, 7] * v[i + 2] - rows[p, 8] * v[j + 2]
    return rows[p, 2] * r0 + rows[p, 3] * r1, shear, across


@kernel
def _force_rates(
    grains: Integers, rows: Floats, regime: Regimes, side: Floats, p: int, un: float, ut: float
) -> tuple[float, float]:
    """`N'` and `T'`."""
    # Without a branch: regimes of pairs come in no order that could be foreseen.
    dn = -rows[p, 14] * un
    stuck, slides = -rows[p, 15] * ut, side[p] * rows[p, 16] * dn
    closed = regime[p] != 0
    return (dn if closed else 0.0), ((stuck if regime[p] == 1 else slides) if closed else 0.0)


@kernel
def _add_forces(
    grains: Integers,
    rows: Floats,
    p: int,
    dn: float,
    dt: float,
    un: float,
    across: float,
    out: Floats,
) -> None:
    """Resultants on both grains of force rates, and of forces that turn with the pair."""
    i, j = 3 * grains[p, 0], 3 * grains[p, 1]
    f0 = dn * rows[p, 2] + dt * rows[p, 4] + rows[p, 11] * across
    f1 = dn * rows[p, 3] + dt * rows[p, 5] + rows[p, 12] * across
    out[j] += f0
    out[j + 1] += f1
    out[i] -= f0
    out[i + 1] -= f1
    out[i + 2] -= rows[p, 9] * dt + rows[p, 13] * un
    out[j + 2] -= rows[p, 10] * dt + rows[p, 13] * un


@kernel
def resultants(
    grains: Integers, rows: Floats, regime: Regimes, side: Floats, v: Floats, h: Floats, out: Floats
) -> None:
    """Add the resultants of the force rates under a motion."""
    for p in range(len(rows)):
        if regime[p] != 0:
            un, ut, across = _relative(grains, rows, p, v, h)
            dn, dt = _force_rates(grains, rows, regime, side, p, un, ut)
            _add_forces(grains, rows, p, dn, dt, un, across, out)


@kernel
def blocks(
    grains: Integers,
    rows: Floats,
    regime: Regimes,
    side: Floats,
    place: Integers,
    at: Integers,
    values: Floats,
) -> int:
    """Entries of the stiffness, at (row, column), freedoms numbered by `place`; how many."""
    k = 0
    for p in range(len(rows)):
        if regime[p] == 0:
            continue
        i, j = 3 * grains[p, 0], 3 * grains[p, 1]
        for a in range(6):
            # Motions one after the other: of i, then of j.
            s = -1.0 if a < 3 else 1.0
            b = a % 3
            un = s * rows[p, 2 + b] if b < 2 else 0.0
            across = s * rows[p, 4 + b] if b < 2 else 0.0
            ut = rows[p, 6] * across if b < 2 else -rows[p, 7 + a // 3]
            dn, dt = _force_rates(grains, rows, regime, side, p, un, ut)
            f0 = dn * rows[p, 2] + dt * rows[p, 4] + rows[p, 11] * across
            f1 = dn * rows[p, 3] + dt * rows[p, 5] + rows[p, 12] * across
            column = place[(i if a < 3 else j) + b]
            for c in range(6):
                force = f0 if c % 3 == 0 else f1
                if c % 3 == 2:
                    force = -rows[p, 9 + c // 3] * dt - rows[p, 13] * un
                elif c < 3:
                    force = -force
                at[0, k] = place[(i if c < 3 else j) + c % 3]
                at[1, k] = column
                values[k] = -force
                k += 1
    return k


@kernel
def at_yield(
    rows: Floats, regime: Regimes, held: Flags, N: Floats, T: Floats, share: float
) -> Integers:
    """Pairs that slide, or that stand on their cone."""
    found, k = np.empty(len(rows), dtype=np.int64), 0
    for p in range(len(rows)):
        if rows[p, 16] > 0 and not held[p]:
            stuck = regime[p] == 1 and N[p] > 0 and abs(T[p]) >= share * rows[p, 16] * N[p]
            if stuck or regime[p] == 2:
                found[k] = p
                k += 1
    return found[:k]


@kernel
def stress_rate(
    grains: Integers, rows: Floats, regime: Regimes, side: Floats, v: Floats, h: Floats, out: Floats
) -> None:
    """`V P'`."""
    out[:] = 0.0
    for p in range(len(rows)):
        if regime[p] != 0:
            un, ut, across = _relative(grains, rows, p, v, h)
            dn, dt = _force_rates(grains, rows, regime, side, p, un, ut)
            _add_stress(grains, rows, p, dn, dt, across, out)


@kernel
def _add_stress(
    grains: Integers, rows: Floats, p: int, dn: float, dt: float, across: float, out: Floats
) -> None:
    for a in range(2):
        f = dn * rows[p, 2 + a] + dt * rows[p, 4 + a] + rows[p, 11 + a] * across
        out[2 * a] += f * rows[p, 0]
        out[2 * a + 1] += f * rows[p, 1]


@kernel
def earliest(
    grains: Integers,
    rows: Floats,
    regime: Regimes,
    side: Floats,
    held: Flags,
    N: Floats,
    T: Floats,
    gap: Floats,
    v: Floats,
    h: Floats,
    tiny: float,
    left: float,
    rates: Floats,
    due: Floats,
) -> tuple[float, int, int]:
    """The next event: time from now, pair, and 0 for opening, 1 and -1 for yield, 2 for closing.

    `rates` (P, 4): `n . d'`, `N'`, `T'` and shear; `due` the time of every pair's next, infinite
    beyond what is `left`. Beneath `tiny` of the largest a rate has no sign.
    """
    fastest, largest = 0.0, 0.0
    for p in range(len(rows)):
        un, ut, _ = _relative(grains, rows, p, v, h)
        dn, dt = _force_rates(grains, rows, regime, side, p, un, ut)
        rates[p, 0], rates[p, 1], rates[p, 2], rates[p, 3] = un, dn, dt, ut
        fastest, largest = max(fastest, abs(un)), max(largest, abs(dn))
    time, which, kind = math.inf, -1, 0
    for p in range(len(rows)):
        due[p] = math.inf
        if held[p]:
            continue
        un, dn, dt = rates[p, 0], rates[p, 1], rates[p, 2]
        own = 0
        # Whether it comes in time is asked first: of nearly all pairs the answer is no.
        if regime[p] == 0:
            away = max(gap[p], 0.0)
            if away < -left * un and un < -tiny * fastest:
                due[p], own = away / -un, 2
        else:
            away = max(N[p], 0.0)
            if away < -left * dn and dn < -tiny * largest:
                due[p] = away / -dn
        if regime[p] == 1 and rows[p, 17]:
            for k in range(2):
                s = 1 - 2 * k
                rate = s * dt - rows[p, 16] * dn
                away = max(rows[p, 16] * N[p] - s * T[p], 0.0)
                in_time = away < left * rate and rate > tiny * largest
                if in_time and away / rate < due[p]:
                    due[p], own = away / rate, s
        if due[p] < time:
            time, which, kind = due[p], p, own
    return time, which, kind


@kernel
def advance(
    grains: Integers,
    rows: Floats,
    regime: Regimes,
    step: float,
    rates: Floats,
    N: Floats,
    T: Floats,
    gap: Floats,
    work: Floats,
) -> None:
    """Go on by a time; `work` gains what slip takes."""
    for p in range(len(rows)):
        if regime[p] == 0:
            gap[p] += step * rates[p, 0]
            continue
        mean = T[p] + 0.5 * step * rates[p, 2]
        # Without a shear stiffness all shear is slip.
        if regime[p] == 2 or rows[p, 15] == 0:
            slip = -rates[p, 3] - (rates[p, 2] / rows[p, 15] if rows[p, 15] > 0 else 0.0)
            work[1] += step * mean * slip
        N[p] += step * rates[p, 1]
        T[p] += step * rates[p, 2]
