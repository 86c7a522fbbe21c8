"""Columns `K^-1 p` of a packing with frozen geometry, the rates of its pairs under them.

A change of regimes is a small system in the columns. Motions `V` (5, 3G) are those under unit
strains and the load, `U` (m, 3G) under unit forces on rows of pairs; rates under both are numbered
0 to 4 and from 5 on. Everything a kernel calls stands here.
"""

from __future__ import annotations

from loops.arrays import Floats, Integers
from loops.compiled.kernel import kernel


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
def solve_eight(
    lp: Integers,
    li: Integers,
    lx: Floats,
    up: Integers,
    ui: Integers,
    ux: Floats,
    x: Floats,
    first: int,
) -> None:
    """`L U x` in place of `x` (n, 8), zero before row `first`; columns sorted by row."""
    for j in range(first, len(x)):
        some = False
        for r in range(8):
            some = some or x[j, r] != 0.0
        if some:
            v = (x[j, 0], x[j, 1], x[j, 2], x[j, 3], x[j, 4], x[j, 5], x[j, 6], x[j, 7])
            for q in range(lp[j] + 1, lp[j + 1]):
                i, factor = li[q], lx[q]
                for r in range(8):
                    x[i, r] -= factor * v[r]
    for j in range(len(x) - 1, -1, -1):
        last = up[j + 1] - 1
        for r in range(8):
            x[j, r] /= ux[last]
        v = (x[j, 0], x[j, 1], x[j, 2], x[j, 3], x[j, 4], x[j, 5], x[j, 6], x[j, 7])
        for q in range(up[j], last):
            i, factor = ui[q], ux[q]
            for r in range(8):
                x[i, r] -= factor * v[r]


@kernel
def _pair_rates(
    grains: Integers, rows: Floats, p: int, V: Floats, U: Floats, c: int
) -> tuple[float, float]:
    """`n . d'` and the shear rate of a pair under one of the motions."""
    i, j = 3 * grains[p, 0], 3 * grains[p, 1]
    u = V[c] if c < 5 else U[c - 5]
    r0, r1 = u[j] - u[i], u[j + 1] - u[i + 1]
    if c < 2:
        r0 -= rows[p, c]
    elif c < 4:
        r1 -= rows[p, c - 2]
    turn = rows[p, 6] * (rows[p, 4] * r0 + rows[p, 5] * r1)
    spins = rows[p, 7] * u[i + 2] + rows[p, 8] * u[j + 2]
    return rows[p, 2] * r0 + rows[p, 3] * r1, turn - spins


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
    for c in range(5):
        un, ut = _pair_rates(grains, rows, pairs[last], V, U, c)
        base[0, last, c], base[1, last, c] = un, ut
    for k in range(m):
        un, ut = _pair_rates(grains, rows, pairs[last], V, U, 5 + k)
        mutual[0, last, k], mutual[1, last, k] = un, ut
        un, ut = _pair_rates(grains, rows, pairs[k], V, U, 5 + last)
        mutual[0, k, last], mutual[1, k, last] = un, ut


@kernel
def rates_of(
    grains: Integers, rows: Floats, p: int, V: Floats, U: Floats, h: Floats, w: Floats
) -> tuple[float, float]:
    """`n . d'` and the shear rate of a pair under `V h + U w`."""
    normal = shear = 0.0
    for c in range(5 + len(w)):
        un, ut = _pair_rates(grains, rows, p, V, U, c)
        share = h[c] if c < 5 else w[c - 5]
        normal += share * un
        shear += share * ut
    return normal, shear


@kernel
def edge_rates(
    grains: Integers,
    rows: Floats,
    side: Floats,
    chosen: Integers,
    V: Floats,
    U: Floats,
    table: Floats,
    known: Integers,
    sided: Floats,
    h: Floats,
    w: Floats,
    out: Floats,
) -> None:
    """How fast stuck pairs would leave their cones, minus the slip (k, r), under `V h + U w`.

    `table` (P, 5 + columns) keeps it under each motion, `known` of them with the side `sided`.
    """
    count, m = w.shape
    for k in range(len(chosen)):
        p = chosen[k]
        if sided[p] != side[p]:
            sided[p], known[p] = side[p], 0
        for c in range(known[p], 5 + m):
            un, ut = _pair_rates(grains, rows, p, V, U, c)
            table[p, c] = side[p] * rows[p, 15] * ut - rows[p, 16] * rows[p, 14] * un
        known[p] = 5 + m
        for r in range(count):
            value = 0.0
            for c in range(5):
                value += table[p, c] * h[r, c]
            for c in range(m):
                value += table[p, 5 + c] * w[r, c]
            out[k, r] = value


@kernel
def eliminate(a: Floats, order: Integers) -> float:
    """`L U` of `1 + a` in place of `a`, rows in the `order` of the pivots; sign of its det."""
    m, sign = len(a), 1.0
    for k in range(m):
        a[k, k] += 1.0
    for k in range(m):
        best = k
        for i in range(k + 1, m):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        if a[best, k] == 0.0:
            return 0.0
        if best != k:
            sign = -sign
            order[k], order[best] = order[best], order[k]
            for c in range(m):
                a[k, c], a[best, c] = a[best, c], a[k, c]
        if a[k, k] < 0:
            sign = -sign
        for i in range(k + 1, m):
            if a[i, k] != 0.0:
                factor = a[i, k] / a[k, k]
                a[i, k] = factor
                for c in range(k + 1, m):
                    a[i, c] -= factor * a[k, c]
    return sign


@kernel
def substitute(factors: Floats, x: Floats) -> None:
    """The solution in place of right-hand sides `x` (m, r), rows in the order of the factors."""
    m, count = x.shape
    for k in range(m):
        for i in range(k):
            factor = factors[k, i]
            if factor != 0.0:
                for c in range(count):
                    x[k, c] -= factor * x[i, c]
    for k in range(m - 1, -1, -1):
        for i in range(k + 1, m):
            factor = factors[k, i]
            if factor != 0.0:
                for c in range(count):
                    x[k, c] -= factor * x[i, c]
        for c in range(count):
            x[k, c] /= factors[k, k]
