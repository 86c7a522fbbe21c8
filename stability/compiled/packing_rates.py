"""Rates of the pairs of a packing with frozen geometry: stress, next event, work.

Freedoms are 3 a grain: `u`, and the spin times a length. Levers are over that length. Pairs are
records `loops.contacts.PAIR`; regimes are those of `loops.Regime`: 0 open, 1 stuck,
2 sliding. All kernels that a kernel calls stand in this file.

A change of regimes is a small system in columns `K^-1 p`. The first five motions are those under
unit strains and the load, the others those under unit forces on rows of pairs.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.compiled import inlined, kernel

# Gauss's first point of two on (0, 1): exact to the third power of time.
GAUSS = 0.5 - math.sqrt(3.0) / 6.0
# Columns of the rates of pairs: n . d', N', T' and the shear rate.
UN, DN, DT, UT = range(4)
# Strain rates of one component each, 11, 12, 21, 22, and none.
UNIT_STRAINS = np.eye(5, 4)


@kernel
def relative(pair: Any, v: Floats, h: Floats) -> tuple[float, float]:
    """`n . d'` and the shear rate."""
    i, j = 3 * pair["grains"][0], 3 * pair["grains"][1]
    d0, d1 = pair["d"][0], pair["d"][1]
    r0 = v[j] - v[i] - (h[0] * d0 + h[1] * d1)
    r1 = v[j + 1] - v[i + 1] - (h[2] * d0 + h[3] * d1)
    across = pair["t"][0] * r0 + pair["t"][1] * r1
    spins = pair["lever"]
    shear = pair["turning"] * across - spins[0] * v[i + 2] - spins[1] * v[j + 2]
    return pair["n"][0] * r0 + pair["n"][1] * r1, shear


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
    Pairs beyond the gaps are springs against rolling, which open and close with the first ones.
    """
    fastest, largest = 0.0, 0.0
    for p in range(len(pairs)):
        pair = pairs[p]
        un, ut = relative(pair, v, h)
        # Without a branch: regimes of pairs come in no order that could be predicted.
        dn = -pair["kn"] * un if regime[p] != 0 else 0.0
        stuck, slides = -pair["kt"] * ut - pair["coupling"] * un, side[p] * pair["mu"] * dn
        dt = stuck if regime[p] == 1 else slides
        rates[p, UN], rates[p, DN], rates[p, DT], rates[p, UT] = un, dn, dt, ut
        fastest, largest = max(fastest, abs(un)), max(largest, abs(dn))
    time, which, kind = math.inf, -1, 0
    for p in range(len(pairs)):
        time_to_event[p] = math.inf
        if held[p]:
            continue
        un, dn, dt = rates[p, UN], rates[p, DN], rates[p, DT]
        own = 0
        # Whether it comes in time is asked first: of nearly all pairs the answer is no.
        if p >= len(gap):
            pass
        elif regime[p] == 0:
            away = max(gap[p], 0.0)
            if away < -left * un and un < -rounding * fastest:
                time_to_event[p], own = away / -un, 2
        else:
            away = max(N[p] - pairs[p]["at_touch"], 0.0)
            if away < -left * dn and dn < -rounding * largest:
                time_to_event[p] = away / -dn
        if regime[p] == 1 and pairs[p]["slides"]:
            mu = pairs[p]["mu"]
            for k in range(2):
                s = 1 - 2 * k
                rate = s * dt - mu * dn
                away = max(mu * N[p] + pairs[p]["cohesion"] - s * T[p], 0.0)
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
        if regime[p] == 0 and p >= len(gap):
            continue
        if regime[p] == 0:
            gap[p] += step * rates[p, UN]
            continue
        mean, kt = T[p] + 0.5 * step * rates[p, DT], pairs[p]["kt"]
        coupling = pairs[p]["coupling"]
        # Without a shear stiffness all shear is slip.
        if regime[p] == 2 or kt == 0:
            slip = -rates[p, UT] - (rates[p, DT] / kt if kt > 0 else 0.0)
            work[1] += step * mean * slip
        elif coupling != 0.0:
            work[2] += step * mean * coupling * rates[p, UN] / kt
        N[p] += step * rates[p, DN]
        T[p] += step * rates[p, DT]


@kernel
def add_work(
    pairs: NDArray[Any],
    regime: Regimes,
    touching: Floats,
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
    force = np.empty((2, len(u)))
    times = step * GAUSS, step * (1.0 - GAUSS)
    turns = (_velocity_gradient(strain, h, times[0]), _velocity_gradient(strain, h, times[1]))
    for k in range(len(u)):
        force[:, k] = -load[k]
    cell, shear, pressed, half_unit = 0.0, 0.0, 0.0, 0.5 / unit
    # Springs against rolling: moments alone, whose work the motion at the contact is.
    for p in range(len(touching), len(pairs)):
        i, j = 3 * pairs[p]["grains"][0], 3 * pairs[p]["grains"][1]
        for q in range(2):
            S = T[p] + times[q] * rates[p, DT] if regime[p] != 0 else 0.0
            force[q, i + 2] -= S
            force[q, j + 2] += S
    for p in range(len(touching)):
        pair = pairs[p]
        i, j = 3 * pair["grains"][0], 3 * pair["grains"][1]
        start0, start1, r0, r1 = _branch(pair, strain, u, h, v)
        half = 0.5 * (pair["arm"][0] + pair["arm"][1])
        for q in range(2):
            b0, b1 = start0 + times[q] * r0, start1 + times[q] * r1
            e0, e1 = b0, b1
            if pair["turns"] == 0.0:
                n0, n1 = pair["n"][0], pair["n"][1]
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
            S = T[p] + times[q] * rates[p, DT] if regime[p] != 0 else 0.0
            f0, f1 = N * n0 - S * n1, N * n1 + S * n0
            t = turns[q]
            cell += f0 * (t[0] * e0 + t[1] * e1) + f1 * (t[2] * e0 + t[3] * e1)
            longer = half_unit * length - half
            arm_i, arm_j = pair["arm"][0] + longer, pair["arm"][1] + longer
            spins = arm_i * v[i + 2] + arm_j * v[j + 2]
            shear += S * (n0 * r1 - n1 * r0 - spins - rates[p, UT])
            force[q, j] += f0
            force[q, j + 1] += f1
            force[q, i] -= f0
            force[q, i + 1] -= f1
            force[q, i + 2] -= arm_i * S
            force[q, j + 2] -= arm_j * S
    held = _release(force, load, turns, times, u, v, step, released)
    work[0] += 0.5 * step * (cell - held + pressed)
    work[2] -= 0.5 * step * shear


@kernel
def _release(
    force: Floats,
    load: Floats,
    turns: tuple[tuple[float, float, float, float], tuple[float, float, float, float]],
    times: tuple[float, float],
    u: Floats,
    v: Floats,
    step: float,
    released: Floats,
) -> float:
    """Add the work of the resultants `force` to `released`; return the power of the load."""
    held = 0.0
    for q in range(2):
        t = turns[q]
        for g in range(len(released)):
            k = 3 * g
            u0, u1 = u[k] + times[q] * v[k], u[k + 1] + times[q] * v[k + 1]
            v0, v1 = v[k] + t[0] * u0 + t[1] * u1, v[k + 1] + t[2] * u0 + t[3] * u1
            power = force[q, k] * v0 + force[q, k + 1] * v1 + force[q, k + 2] * v[k + 2]
            released[g] += 0.5 * step * power
            held += load[k] * v0 + load[k + 1] * v1 + load[k + 2] * v[k + 2]
    return held


@inlined
def _branch(
    pair: Any, strain: Floats, u: Floats, h: Floats, v: Floats
) -> tuple[float, float, float, float]:
    """Return a pair's branch at `strain` and `u`, and its rate under `h` and `v`."""
    i, j = 3 * pair["grains"][0], 3 * pair["grains"][1]
    d0, d1 = pair["d"][0], pair["d"][1]
    return (
        d0 - strain[0] * d0 - strain[1] * d1 + u[j] - u[i],
        d1 - strain[2] * d0 - strain[3] * d1 + u[j + 1] - u[i + 1],
        v[j] - v[i] - h[0] * d0 - h[1] * d1,
        v[j + 1] - v[i + 1] - h[2] * d0 - h[3] * d1,
    )


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


@kernel
def pair_rates(
    pairs: NDArray[Any], chosen: Integers, motions: Floats, known: Floats, count: Integers
) -> None:
    """Complete `n . d'` and shear rates `known` (2, P, k) of the chosen pairs under the motions.

    Of each pair those under the first `count` (P,) of them are known.
    """
    for p in chosen:
        for c in range(count[p], len(motions)):
            strain = UNIT_STRAINS[min(c, 4)]
            known[0, p, c], known[1, p, c] = relative(pairs[p], motions[c], strain)
        count[p] = max(count[p], len(motions))
