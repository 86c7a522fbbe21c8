"""Columns `K^-1 p` of a packing with frozen geometry, and the rates of its pairs under them.

A change of regimes is a small system in the columns. Motions `V` (5, 3G) are those under unit
strains and the load, `U` (m, 3G) under unit forces on rows of pairs; rates under both are numbered
0 to 4 and from 5 on. Pairs are records `loops.contacts.PAIR`. All kernels that a kernel
calls stand in this file.
"""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from loops.arrays import Floats, Integers
from loops.compiled import kernel


@kernel
def _pair_rates(pair: Any, V: Floats, U: Floats, c: int) -> tuple[float, float]:
    """`n . d'` and the shear rate of a pair under one of the motions."""
    i, j = 3 * pair["grains"][0], 3 * pair["grains"][1]
    u = V[c] if c < 5 else U[c - 5]
    r0, r1 = u[j] - u[i], u[j + 1] - u[i + 1]
    if c < 2:
        r0 -= pair["d"][c]
    elif c < 4:
        r1 -= pair["d"][c - 2]
    turn = pair["turning"] * (pair["t"][0] * r0 + pair["t"][1] * r1)
    spins = pair["lever"][0] * u[i + 2] + pair["lever"][1] * u[j + 2]
    return pair["n"][0] * r0 + pair["n"][1] * r1, turn - spins


@kernel
def mutual_rates(
    pairs: NDArray[Any],
    chosen: Integers,
    V: Floats,
    U: Floats,
    base: Floats,
    mutual: Floats,
) -> None:
    """Rates of the last chosen pair under all motions, and of all chosen under the last column."""
    m = len(chosen)
    last = m - 1
    for c in range(5):
        un, ut = _pair_rates(pairs[chosen[last]], V, U, c)
        base[0, last, c], base[1, last, c] = un, ut
    for k in range(m):
        un, ut = _pair_rates(pairs[chosen[last]], V, U, 5 + k)
        mutual[0, last, k], mutual[1, last, k] = un, ut
        un, ut = _pair_rates(pairs[chosen[k]], V, U, 5 + last)
        mutual[0, k, last], mutual[1, k, last] = un, ut


@kernel
def rates_of(
    pairs: NDArray[Any], p: int, V: Floats, U: Floats, h: Floats, w: Floats
) -> tuple[float, float]:
    """`n . d'` and the shear rate of a pair under `V h + U w`."""
    normal = shear = 0.0
    for c in range(5 + len(w)):
        un, ut = _pair_rates(pairs[p], V, U, c)
        share = h[c] if c < 5 else w[c - 5]
        normal += share * un
        shear += share * ut
    return normal, shear


@kernel
def yield_rates(
    pairs: NDArray[Any],
    side: Floats,
    chosen: Integers,
    V: Floats,
    U: Floats,
    known: Floats,
    motion_count: Integers,
    slip_sign: Floats,
    h: Floats,
    w: Floats,
    out: Floats,
) -> None:
    """Rates of the yield function of stuck pairs, minus the slip (k, r), under `V h + U w`.

    `known` (P, 5 + columns) keeps that under each motion, for the first `motion_count` of them
    and a pair that slides on the side `slip_sign`.
    """
    count, m = w.shape
    for k in range(len(chosen)):
        p = chosen[k]
        pair = pairs[p]
        if slip_sign[p] != side[p]:
            slip_sign[p], motion_count[p] = side[p], 0
        for c in range(motion_count[p], 5 + m):
            un, ut = _pair_rates(pair, V, U, c)
            shear = pair["kt"] * ut + pair["coupling"] * un
            known[p, c] = side[p] * shear - pair["mu"] * pair["kn"] * un
        motion_count[p] = 5 + m
        for r in range(count):
            value = 0.0
            for c in range(5):
                value += known[p, c] * h[r, c]
            for c in range(m):
                value += known[p, 5 + c] * w[r, c]
            out[k, r] = value
