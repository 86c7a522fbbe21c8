"""Rates of the pairs of a packing with frozen geometry, their stiffness and their next event.

Freedoms are 3 a grain: `u`, and the spin times a length. Levers are over that length. Pairs are
records `stability.packing.pairs.PAIR`; regimes are those of `loops.Regime`: 0 open, 1 stuck,
2 sliding. All kernels that a kernel calls stand in this file.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.compiled import kernel


@kernel
def _relative(pair: Any, v: Floats, h: Floats) -> tuple[float, float, float]:
    """`n . d'`, the shear rate, and `t . d'`."""
    i, j = 3 * pair["grains"][0], 3 * pair["grains"][1]
    d0, d1 = pair["d"][0], pair["d"][1]
    r0 = v[j] - v[i] - (h[0] * d0 + h[1] * d1)
    r1 = v[j + 1] - v[i + 1] - (h[2] * d0 + h[3] * d1)
    across = pair["t"][0] * r0 + pair["t"][1] * r1
    spins = pair["lever"]
    shear = pair["turning"] * across - spins[0] * v[i + 2] - spins[1] * v[j + 2]
    return pair["n"][0] * r0 + pair["n"][1] * r1, shear, across


@kernel
def _force_rates(pair: Any, regime: int, side: float, un: float, ut: float) -> tuple[float, float]:
    """`N'` and `T'`."""
    # Without a branch: regimes of pairs come in no order that could be predicted.
    dn = -pair["kn"] * un
    stuck, slides = -pair["kt"] * ut - pair["coupling"] * un, side * pair["mu"] * dn
    closed = regime != 0
    return (dn if closed else 0.0), ((stuck if regime == 1 else slides) if closed else 0.0)


@kernel
def _add_forces(pair: Any, dn: float, dt: float, un: float, across: float, out: Floats) -> None:
    """Add the resultants on both grains of force rates, and of forces that turn with the pair."""
    i, j = 3 * pair["grains"][0], 3 * pair["grains"][1]
    f0 = dn * pair["n"][0] + dt * pair["t"][0] + pair["rotation"][0] * across
    f1 = dn * pair["n"][1] + dt * pair["t"][1] + pair["rotation"][1] * across
    out[j] += f0
    out[j + 1] += f1
    out[i] -= f0
    out[i + 1] -= f1
    out[i + 2] -= pair["arm"][0] * dt + pair["growth"] * un
    out[j + 2] -= pair["arm"][1] * dt + pair["growth"] * un


@kernel
def resultants(
    pairs: NDArray[Any], regime: Regimes, side: Floats, v: Floats, h: Floats, out: Floats
) -> None:
    """Add the resultants of the force rates under a motion."""
    for p in range(len(pairs)):
        if regime[p] != 0:
            pair = pairs[p]
            un, ut, across = _relative(pair, v, h)
            dn, dt = _force_rates(pair, regime[p], side[p], un, ut)
            _add_forces(pair, dn, dt, un, across, out)


@kernel
def blocks(
    pairs: NDArray[Any],
    regime: Regimes,
    side: Floats,
    place: Integers,
    at: Integers,
    values: Floats,
) -> int:
    """Entries of the stiffness, at (row, column), freedoms numbered by `place`; their count."""
    k = 0
    for p in range(len(pairs)):
        if regime[p] == 0:
            continue
        pair = pairs[p]
        i, j = 3 * pair["grains"][0], 3 * pair["grains"][1]
        for a in range(6):
            # Unit motions one after the other: of i, then of j.
            s = -1.0 if a < 3 else 1.0
            b = a % 3
            un = s * pair["n"][b] if b < 2 else 0.0
            across = s * pair["t"][b] if b < 2 else 0.0
            ut = pair["turning"] * across if b < 2 else -pair["lever"][a // 3]
            dn, dt = _force_rates(pair, regime[p], side[p], un, ut)
            f0 = dn * pair["n"][0] + dt * pair["t"][0] + pair["rotation"][0] * across
            f1 = dn * pair["n"][1] + dt * pair["t"][1] + pair["rotation"][1] * across
            column = place[(i if a < 3 else j) + b]
            for c in range(6):
                force = f0 if c % 3 == 0 else f1
                if c % 3 == 2:
                    force = -pair["arm"][c // 3] * dt - pair["growth"] * un
                elif c < 3:
                    force = -force
                at[0, k] = place[(i if c < 3 else j) + c % 3]
                at[1, k] = column
                values[k] = -force
                k += 1
    return k


@kernel
def at_yield(
    pairs: NDArray[Any], regime: Regimes, held: Flags, N: Floats, T: Floats, share: float
) -> Integers:
    """Pairs that slide or carry at least `share` of their strength, but for held ones."""
    found, k = np.empty(len(pairs), dtype=np.int64), 0
    for p in range(len(pairs)):
        mu = pairs[p]["mu"]
        if mu > 0 and not held[p]:
            stuck = regime[p] == 1 and N[p] > 0 and abs(T[p]) >= share * mu * N[p]
            if stuck or regime[p] == 2:
                found[k] = p
                k += 1
    return found[:k]


@kernel
def stress_rate(
    pairs: NDArray[Any], regime: Regimes, side: Floats, v: Floats, h: Floats, out: Floats
) -> None:
    """`V P'` under a motion."""
    out[:] = 0.0
    for p in range(len(pairs)):
        if regime[p] != 0:
            pair = pairs[p]
            un, ut, across = _relative(pair, v, h)
            dn, dt = _force_rates(pair, regime[p], side[p], un, ut)
            for a in range(2):
                f = dn * pair["n"][a] + dt * pair["t"][a] + pair["rotation"][a] * across
                out[2 * a] += f * pair["d"][0]
                out[2 * a + 1] += f * pair["d"][1]


@kernel
def earliest(
    pairs: NDArray[Any],
    regime: Regimes,
    side: Floats,
    held: Flags,
    N: Floats,
    T: Floats,
    gap: Floats,
    v: Floats,
    h: Floats,
    rounding: float,
    left: float,
    rates: Floats,
    time_to_event: Floats,
) -> tuple[float, int, int]:
    """The next event: time from now, pair, and 0 for opening, 1 and -1 for yield, 2 for closing.

    `rates` (P, 4) becomes `n . d'`, `N'`, `T'` and the shear rate, `time_to_event` that of every
    pair, infinite beyond what is `left`. Rates below `rounding` of the largest lead to no event.
    """
    fastest, largest = 0.0, 0.0
    for p in range(len(pairs)):
        un, ut, _ = _relative(pairs[p], v, h)
        dn, dt = _force_rates(pairs[p], regime[p], side[p], un, ut)
        rates[p, 0], rates[p, 1], rates[p, 2], rates[p, 3] = un, dn, dt, ut
        fastest, largest = max(fastest, abs(un)), max(largest, abs(dn))
    time, which, kind = math.inf, -1, 0
    for p in range(len(pairs)):
        time_to_event[p] = math.inf
        if held[p]:
            continue
        un, dn, dt = rates[p, 0], rates[p, 1], rates[p, 2]
        own = 0
        # Whether it comes in time is asked first: of nearly all pairs the answer is no.
        if regime[p] == 0:
            away = max(gap[p], 0.0)
            if away < -left * un and un < -rounding * fastest:
                time_to_event[p], own = away / -un, 2
        else:
            away = max(N[p], 0.0)
            if away < -left * dn and dn < -rounding * largest:
                time_to_event[p] = away / -dn
        if regime[p] == 1 and pairs[p]["slides"]:
            mu = pairs[p]["mu"]
            for k in range(2):
                s = 1 - 2 * k
                rate = s * dt - mu * dn
                away = max(mu * N[p] - s * T[p], 0.0)
                in_time = away < left * rate and rate > rounding * largest
                if in_time and away / rate < time_to_event[p]:
                    time_to_event[p], own = away / rate, s
        if time_to_event[p] < time:
            time, which, kind = time_to_event[p], p, own
    return time, which, kind


@kernel
def advance(
    pairs: NDArray[Any],
    regime: Regimes,
    step: float,
    rates: Floats,
    N: Floats,
    T: Floats,
    gap: Floats,
    work: Floats,
) -> None:
    """Change forces and gaps by the rates over a time; add the work of slip to `work[1]`.

    Energy that a shear spring loses as it goes with its stiffness is added to `work[2]`.
    """
    for p in range(len(pairs)):
        if regime[p] == 0:
            gap[p] += step * rates[p, 0]
            continue
        mean, kt = T[p] + 0.5 * step * rates[p, 2], pairs[p]["kt"]
        coupling = pairs[p]["coupling"]
        # Without a shear stiffness all shear is slip.
        if regime[p] == 2 or kt == 0:
            slip = -rates[p, 3] - (rates[p, 2] / kt if kt > 0 else 0.0)
            work[1] += step * mean * slip
        elif coupling != 0.0:
            work[2] += step * mean * coupling * rates[p, 0] / kt
        N[p] += step * rates[p, 1]
        T[p] += step * rates[p, 2]
