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


class Frame(NamedTuple):
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
) -> tuple[float, float, float, float]:
    """`n . d'`, the shear rate, `t . d'`, and the shear rate by the arms of the force."""
    i, j = 3 * grains[p, 0], 3 * grains[p, 1]
    d0, d1 = rows[p, 0], rows[p, 1]
    r0 = v[j] - v[i] - (h[0] * d0 + h[1] * d1)
    r1 = v[j + 1] - v[i + 1] - (h[2] * d0 + h[3] * d1)
    across = rows[p, 4] * r0 + rows[p, 5] * r1
    w_i, w_j = v[i + 2], v[j + 2]
    shear = rows[p, 6] * across - rows[p, 7] * w_i - rows[p, 8] * w_j
    by_arms = across - rows[p, 9] * w_i - rows[p, 10] * w_j
    return rows[p, 2] * r0 + rows[p, 3] * r1, shear, across, by_arms


@kernel
def _force_rates(
    grains: Integers, rows: Floats, regime: Regimes, side: Floats, p: int, un: float, ut: float
) -> tuple[float, float]:
    """`N'` and `T'`."""
    if regime[p] == 0:
        return 0.0, 0.0
    dn = -rows[p, 14] * un
    return dn, (-rows[p, 15] * ut if regime[p] == 1 else side[p] * rows[p, 16] * dn)


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
            un, ut, across, _ = _relative(grains, rows, p, v, h)
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
def solve_triangular(
    lp: Integers,
    li: Integers,
    lx: Floats,
    up: Integers,
    ui: Integers,
    ux: Floats,
    x: Floats,
    first: int,
) -> None:
    """`L U x` in place of `x`, whose entries before `first` are zero; columns sorted by row."""
    n = len(x)
    for j in range(first, n):
        v = x[j]
        if v != 0.0:
            for q in range(lp[j] + 1, lp[j + 1]):
                x[li[q]] -= lx[q] * v
    for j in range(n - 1, -1, -1):
        if x[j] != 0.0:
            last = up[j + 1] - 1
            x[j] /= ux[last]
            v = x[j]
            for q in range(up[j], last):
                x[ui[q]] -= ux[q] * v


@kernel
def unit_force(grains: Integers, rows: Floats, row: int, place: Integers, out: Floats) -> int:
    """A unit of normal force, or of shear in rows after these, at its `place`; the first of it."""
    pairs = len(rows)
    shear, p = row >= pairs, row % pairs
    first = len(out)
    for s in range(2):
        at = 3 * grains[p, s]
        for b in range(2):
            f = rows[p, 4 + b] if shear else rows[p, 2 + b]
            out[place[at + b]] += f if s else -f
            first = min(first, place[at + b])
        if shear:
            out[place[at + 2]] -= rows[p, 9 + s]
            first = min(first, place[at + 2])
    return first


@kernel
def mutual_rates(
    grains: Integers,
    rows: Floats,
    pairs: Integers,
    V: Floats,
    U: Floats,
    base: Floats,
    mutual: Floats,
) -> None:
    """Rates of the last of the pairs under all that moves, and of all under the last column."""
    m = len(pairs)
    last = m - 1
    base[:, last] = 0.0
    mutual[:, last, :m] = 0.0
    rates = np.zeros((2, m))
    _add_rates(grains, rows, pairs[last], V, base[:, last])
    for k in range(4):
        h = np.zeros(4)
        h[k] = 1.0
        un, ut = _affine_rates(rows, pairs[last], h)
        base[0, last, k] += un
        base[1, last, k] += ut
    _add_rates(grains, rows, pairs[last], U[:, :m], mutual[:, last, :m])
    for k in range(m):
        rates[:] = 0.0
        _add_rates(grains, rows, pairs[k], U[:, last:m], rates[:, :1])
        mutual[0, k, last], mutual[1, k, last] = rates[0, 0], rates[1, 0]


@kernel
def _affine_rates(rows: Floats, p: int, h: Floats) -> tuple[float, float]:
    """`n . d'` and the shear rate of the affine motion."""
    r0 = -(h[0] * rows[p, 0] + h[1] * rows[p, 1])
    r1 = -(h[2] * rows[p, 0] + h[3] * rows[p, 1])
    return rows[p, 2] * r0 + rows[p, 3] * r1, rows[p, 6] * (rows[p, 4] * r0 + rows[p, 5] * r1)


@kernel
def _add_rates(grains: Integers, rows: Floats, p: int, motions: Floats, out: Floats) -> None:
    """`n . d'` and the shear rate of a pair under columns of motions."""
    i, j = 3 * grains[p, 0], 3 * grains[p, 1]
    n0, n1, turn = rows[p, 2], rows[p, 3], rows[p, 6]
    s0, s1 = turn * rows[p, 4], turn * rows[p, 5]
    for k in range(motions.shape[1]):
        r0 = motions[j, k] - motions[i, k]
        r1 = motions[j + 1, k] - motions[i + 1, k]
        out[0, k] += n0 * r0 + n1 * r1
        spins = rows[p, 7] * motions[i + 2, k] + rows[p, 8] * motions[j + 2, k]
        out[1, k] += s0 * r0 + s1 * r1 - spins


@kernel
def small_system(
    coefficients: Floats, base: Floats, mutual: Floats, m: int, driven: int
) -> tuple[Floats, float]:
    """`(1 + C) X = [C0, C e]` by elimination, and the sign of the determinant."""
    a, x = np.empty((m, m)), np.zeros((m, 6))
    for i in range(m):
        p, q = coefficients[0, i], coefficients[1, i]
        for k in range(m):
            a[i, k] = p * mutual[0, i, k] + q * mutual[1, i, k]
        for k in range(5):
            x[i, k] = p * base[0, i, k] + q * base[1, i, k]
        if driven >= 0:
            x[i, 5] = a[i, driven]
        a[i, i] += 1.0
    sign = 1.0
    for k in range(m):
        best = k
        for i in range(k + 1, m):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        if a[best, k] == 0.0:
            return x, 0.0
        if best != k:
            sign = -sign
            for c in range(k, m):
                a[k, c], a[best, c] = a[best, c], a[k, c]
            for c in range(6):
                x[k, c], x[best, c] = x[best, c], x[k, c]
        if a[k, k] < 0:
            sign = -sign
        for i in range(k + 1, m):
            if a[i, k] != 0.0:
                f = a[i, k] / a[k, k]
                for c in range(k + 1, m):
                    a[i, c] -= f * a[k, c]
                for c in range(6):
                    x[i, c] -= f * x[k, c]
    for k in range(m - 1, -1, -1):
        for c in range(6):
            x[k, c] /= a[k, k]
        for i in range(k):
            if a[i, k] != 0.0:
                for c in range(6):
                    x[i, c] -= a[i, k] * x[k, c]
    return x, sign


@kernel
def pair_rates(
    grains: Integers,
    rows: Floats,
    chosen: Integers,
    h: Floats,
    w: Floats,
    V: Floats,
    U: Floats,
    out: Floats,
) -> None:
    """`n . d'` and shear rates (2, k, r) of some pairs under the motions `V h + U w`, (5, r)."""
    m, count = len(w), h.shape[1]
    rates = np.empty((2, 5 + m))
    for k in range(len(chosen)):
        p = chosen[k]
        rates[:] = 0.0
        _add_rates(grains, rows, p, V, rates[:, :5])
        _add_rates(grains, rows, p, U[:, :m], rates[:, 5:])
        for r in range(count):
            for s in range(2):
                value = 0.0
                for c in range(5):
                    value += rates[s, c] * h[c, r]
                for c in range(m):
                    value += rates[s, 5 + c] * w[c, r]
                out[s, k, r] = value
            un, ut = _affine_rates(rows, p, h[:, r])
            out[0, k, r] += un
            out[1, k, r] += ut


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
            un, ut, across, _ = _relative(grains, rows, p, v, h)
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
    rates: Floats,
    stress: Floats,
) -> tuple[float, int, int]:
    """The next event: time from now, pair, and 0 for opening, 1 and -1 for yield, 2 for closing.

    `rates` (P, 5): `n . d'`, `N'`, `T'`, shear, and what shear by the arms has more; `stress` is
    `V P'`. Beneath `tiny` of the largest a rate has no sign.
    """
    fastest, largest = 0.0, 0.0
    stress[:] = 0.0
    for p in range(len(rows)):
        un, ut, across, by_arms = _relative(grains, rows, p, v, h)
        dn, dt = _force_rates(grains, rows, regime, side, p, un, ut)
        rates[p, 0], rates[p, 1], rates[p, 2] = un, dn, dt
        rates[p, 3], rates[p, 4] = ut, by_arms - ut
        fastest, largest = max(fastest, abs(un)), max(largest, abs(dn))
        if regime[p] != 0:
            _add_stress(grains, rows, p, dn, dt, across, stress)
    time, which, kind = math.inf, -1, 0
    for p in range(len(rows)):
        if held[p]:
            continue
        un, dn, dt = rates[p, 0], rates[p, 1], rates[p, 2]
        if regime[p] == 0:
            if un < -tiny * fastest and max(gap[p], 0.0) / -un < time:
                time, which, kind = max(gap[p], 0.0) / -un, p, 2
            continue
        if dn < -tiny * largest and max(N[p], 0.0) / -dn < time:
            time, which, kind = max(N[p], 0.0) / -dn, p, 0
        if regime[p] == 1 and rows[p, 17]:
            for s in (1, -1):
                rate = s * dt - rows[p, 16] * dn
                away = max(rows[p, 16] * N[p] - s * T[p], 0.0)
                if rate > tiny * largest and away / rate < time:
                    time, which, kind = away / rate, p, s
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
    """Go on by a time; `work` gains what slip takes and what shear by the arms does beyond it."""
    for p in range(len(rows)):
        if regime[p] == 0:
            gap[p] += step * rates[p, 0]
            continue
        mean = T[p] + 0.5 * step * rates[p, 2]
        if regime[p] == 2:
            slip = -rates[p, 3] - (rates[p, 2] / rows[p, 15] if rows[p, 15] > 0 else 0.0)
            work[0] += step * mean * slip
        work[1] -= step * mean * rates[p, 4]
        N[p] += step * rates[p, 1]
        T[p] += step * rates[p, 2]
