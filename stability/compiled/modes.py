"""Eigenvalues of Ks in the symmetric subspace by Jacobi rotations, and the cone in its plane."""

from __future__ import annotations

import math

import numpy as np

from loops.arrays import Floats
from loops.compiled import inlined, kernel

HALF = math.sqrt(0.5)
MATRICES_AT_ONCE = 32  # matrices side by side: loops over them become the processor's vectors
SWEEPS = 30  # four or five are enough
SPLITTER = 2.0**27 + 1.0
CONVERGED = (
    1e-18  # off-diagonal share at which the rotations end: it changes no digit of an eigenvalue
)


@kernel
def loop_modes(tangents: Floats, directions: bool) -> tuple[Floats, Floats, Floats]:
    """Spectrum of every tangent; its softest direction and plane cone if asked, else no rows."""
    count, asked = len(tangents), len(tangents) if directions else 0
    values, softest, opening = np.empty((count, 3)), np.empty((asked, 3)), np.empty(asked)
    k, axes, scratch = (
        np.empty((6, MATRICES_AT_ONCE)),
        np.empty((3 if directions else 0, 3, MATRICES_AT_ONCE)),
        np.empty((5, MATRICES_AT_ONCE)),
    )
    for start in range(0, count, MATRICES_AT_ONCE):
        some = tangents[start : start + MATRICES_AT_ONCE]
        _fill_symmetric_parts(some, k)
        _diagonalise(k, axes, scratch)
        for r in range(len(some)):
            loop, a = start + r, some[r]
            low = _fill_ascending(k[0, r], k[1, r], k[2, r], values[loop])
            if not directions:
                continue
            first = 0 if k[0, r] == low else (1 if k[1, r] == low else 2)
            for i in range(3):
                softest[loop, i] = axes[first, i, r] if low == low else np.nan
            opening[loop] = np.nan
            if low == low:
                opening[loop] = _opening(a[0, 0], a[3, 3], a[0, 3], a[3, 0])
    return values, softest, opening


@inlined
def _fill_symmetric_parts(some: Floats, k: Floats) -> None:
    """Fill in Ks in (11, 22, (12 + 21)/sqrt 2): diagonal, then 01, 02, 12; nan if not finite."""
    for r in range(MATRICES_AT_ONCE):
        a = some[min(r, len(some) - 1)]
        k[0, r], k[1, r] = a[0, 0], a[3, 3]
        k[2, r] = 0.5 * (a[1, 1] + a[2, 2] + (a[1, 2] + a[2, 1]))
        k[3, r] = 0.5 * (a[0, 3] + a[3, 0])
        k[4, r] = 0.5 * HALF * ((a[0, 1] + a[1, 0]) + (a[0, 2] + a[2, 0]))
        k[5, r] = 0.5 * HALF * ((a[3, 1] + a[1, 3]) + (a[3, 2] + a[2, 3]))
        if not math.isfinite(k[0, r] + k[1, r] + k[2, r] + k[3, r] + k[4, r] + k[5, r]):
            k[0, r], k[1, r], k[2, r] = np.nan, np.nan, np.nan
            k[3, r], k[4, r], k[5, r] = 0.0, 0.0, 0.0


@inlined
def _fill_ascending(a: float, b: float, c: float, out: Floats) -> float:
    """Sort three numbers; return the least, nan if they are none."""
    low = min(a, b, c) if a == a else a
    out[0], out[2] = low, max(a, b, c) if a == a else a
    out[1] = max(min(a, b), min(max(a, b), c)) if a == a else a
    return low


@inlined
def _diagonalise(k: Floats, axes: Floats, scratch: Floats) -> None:
    """Diagonalise symmetric matrices in place, pair of axes by pair; turn the axes, if any.

    Matrices lie side by side, for the processor's vectors; each is left alone once it is done.
    """
    least, going = scratch[0], scratch[1]
    axes[:] = 0.0
    for i in range(len(axes)):
        axes[i, i] = 1.0
    for r in range(MATRICES_AT_ONCE):
        size = abs(k[0, r]) + abs(k[1, r]) + abs(k[2, r]) + abs(k[3, r]) + abs(k[4, r])
        least[r] = CONVERGED * (size + abs(k[5, r]))
    for _ in range(SWEEPS):
        some = 0.0
        for r in range(MATRICES_AT_ONCE):
            off = abs(k[3, r]) + abs(k[4, r]) + abs(k[5, r])
            going[r] = 1.0 if off > least[r] else 0.0
            some += going[r]
        if some == 0.0:
            break
        _rotate(k[0], k[1], k[3], k[4], k[5], axes, 0, 1, scratch)
        _rotate(k[0], k[2], k[4], k[3], k[5], axes, 0, 2, scratch)
        _rotate(k[1], k[2], k[5], k[3], k[4], axes, 1, 2, scratch)


@inlined
def _rotate(
    one: Floats,
    two: Floats,
    off: Floats,
    first: Floats,
    second: Floats,
    axes: Floats,
    i: int,
    j: int,
    scratch: Floats,
) -> None:
    """Uncouple two axes of the matrices that are not done: turn them by the angle that does."""
    going, tangent, c, s = scratch[1], scratch[2], scratch[3], scratch[4]
    for r in range(MATRICES_AT_ONCE):
        ratio = 0.5 * (two[r] - one[r]) / off[r]
        value = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(1.0 + ratio * ratio))
        tangent[r] = value if (going[r] != 0.0) & (off[r] != 0.0) else 0.0
    for r in range(MATRICES_AT_ONCE):
        c[r] = 1.0 / math.sqrt(1.0 + tangent[r] * tangent[r])
        s[r] = tangent[r] * c[r]
    for r in range(MATRICES_AT_ONCE):
        change = tangent[r] * off[r]
        one[r], two[r] = one[r] - change, two[r] + change
    for r in range(MATRICES_AT_ONCE):
        off[r] = 0.0 if going[r] != 0.0 else off[r]
    _turn(first, second, c, s)
    for q in range(3 if len(axes) else 0):
        _turn(axes[i, q], axes[j, q], c, s)


@inlined
def _turn(a: Floats, b: Floats, c: Floats, s: Floats) -> None:
    for r in range(MATRICES_AT_ONCE):
        a[r], b[r] = c[r] * a[r] - s[r] * b[r], s[r] * a[r] + c[r] * b[r]


@inlined
def _opening(k11: float, k22: float, k12: float, k21: float) -> float:
    """Opening of the cone in the plane, the determinant without rounding errors (`plane_cone`)."""
    largest = max(max(abs(k11), abs(k22)), max(abs(k12), abs(k21)))
    if largest == 0.0:
        return 0.0
    # A power of two: exact, and products neither overflow nor vanish.
    scale = math.ldexp(1.0, -math.frexp(largest)[1])
    k11, k22, k12, k21 = k11 * scale, k22 * scale, k12 * scale, k21 * scale
    outer = 0.5 * (k11 + k22)
    outer += math.copysign(0.5 * math.hypot(k11 - k22, k12 + k21), outer)
    if outer == 0.0:
        return 0.0
    total = k12 + k21
    part = total - k12
    lost = (k12 - (total - part)) + (k21 - part)
    half = 0.5 * total
    product, square = k11 * k22, half * half
    errors = _product_error(k11, k22, product) - _product_error(half, half, square)
    inner = ((product - square) + (errors - half * lost)) / outer
    low, high = min(inner, outer), max(inner, outer)
    if low >= 0.0:
        return 0.0
    return 2.0 * math.atan2(math.sqrt(-low), math.sqrt(max(high, 0.0)))


@inlined
def _product_error(a: float, b: float, product: float) -> float:
    """Rounding error of a product, `a b - product` (Dekker), within `TINY` and `HUGE`."""
    high_a = SPLITTER * a - (SPLITTER * a - a)
    high_b = SPLITTER * b - (SPLITTER * b - b)
    low_a, low_b = a - high_a, b - high_b
    return low_a * low_b - (((product - high_a * high_b) - low_a * high_b) - high_a * low_b)
