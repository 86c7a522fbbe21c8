"""Eigenvalues of Ks in the symmetric subspace by Jacobi rotations, and the cone in its plane."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from loops.compiled import inlined, kernel

Floats = NDArray[np.float64]
Triple = tuple[float, float, float]
HALF = math.sqrt(0.5)
SWEEPS = 30  # four or five are enough
SPLITTER = 2.0**27 + 1.0
CONVERGED = (
    1e-18  # off-diagonal share at which the rotations end: it changes no digit of an eigenvalue
)


@kernel
def loop_modes(tangents: Floats) -> tuple[Floats, Floats, Floats]:
    """Spectrum, softest direction and plane cone of every tangent."""
    count = len(tangents)
    values, softest, opening = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
    for loop in range(count):
        a = tangents[loop]
        k00, k11 = a[0, 0], a[3, 3]
        k22 = 0.5 * (a[1, 1] + a[2, 2] + (a[1, 2] + a[2, 1]))
        k01 = 0.5 * (a[0, 3] + a[3, 0])
        k02 = 0.5 * HALF * ((a[0, 1] + a[1, 0]) + (a[0, 2] + a[2, 0]))
        k12 = 0.5 * HALF * ((a[3, 1] + a[1, 3]) + (a[3, 2] + a[2, 3]))
        if not math.isfinite(k00 + k11 + k22 + k01 + k02 + k12):
            values[loop], softest[loop], opening[loop] = np.nan, np.nan, np.nan
            continue
        (k00, k11, k22), modes = _jacobi(k00, k11, k22, k01, k02, k12)
        low, high = min(k00, k11, k22), max(k00, k11, k22)
        values[loop, 0], values[loop, 2] = low, high
        values[loop, 1] = max(min(k00, k11), min(max(k00, k11), k22))
        first = modes[0] if k00 == low else (modes[1] if k11 == low else modes[2])
        softest[loop, 0], softest[loop, 1], softest[loop, 2] = first
        opening[loop] = _opening(a[0, 0], a[3, 3], a[0, 3], a[3, 0])
    return values, softest, opening


@inlined
def _jacobi(
    k00: float, k11: float, k22: float, k01: float, k02: float, k12: float
) -> tuple[Triple, tuple[Triple, Triple, Triple]]:
    """Diagonalise a symmetric matrix in place, pair of axes by pair; return the turned axes."""
    v0, v1, v2 = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    size = abs(k00) + abs(k11) + abs(k22) + abs(k01) + abs(k02) + abs(k12)
    for _ in range(SWEEPS):
        if abs(k01) + abs(k02) + abs(k12) <= CONVERGED * size:
            break
        tangent, c, s = _rotation(k00, k11, k01)
        k00, k11, k01 = k00 - tangent * k01, k11 + tangent * k01, 0.0
        k02, k12 = c * k02 - s * k12, s * k02 + c * k12
        v0, v1 = _turned(v0, v1, c, s)
        tangent, c, s = _rotation(k00, k22, k02)
        k00, k22, k02 = k00 - tangent * k02, k22 + tangent * k02, 0.0
        k01, k12 = c * k01 - s * k12, s * k01 + c * k12
        v0, v2 = _turned(v0, v2, c, s)
        tangent, c, s = _rotation(k11, k22, k12)
        k11, k22, k12 = k11 - tangent * k12, k22 + tangent * k12, 0.0
        k01, k02 = c * k01 - s * k02, s * k01 + c * k02
        v1, v2 = _turned(v1, v2, c, s)
    return (k00, k11, k22), (v0, v1, v2)


@inlined
def _rotation(first: float, second: float, off: float) -> Triple:
    """Tangent, cosine and sine of the angle that uncouples two axes."""
    if off == 0.0:
        return 0.0, 1.0, 0.0
    ratio = 0.5 * (second - first) / off
    tangent = math.copysign(1.0, ratio) / (abs(ratio) + math.sqrt(1.0 + ratio * ratio))
    cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
    return tangent, cosine, tangent * cosine


@inlined
def _turned(a: Triple, b: Triple, c: float, s: float) -> tuple[Triple, Triple]:
    return (
        (c * a[0] - s * b[0], c * a[1] - s * b[1], c * a[2] - s * b[2]),
        (s * a[0] + c * b[0], s * a[1] + c * b[1], s * a[2] + c * b[2]),
    )


@inlined
def _opening(k11: float, k22: float, k12: float, k21: float) -> float:
    """Opening of the cone in the plane, the determinant without rounding errors (`plane_cone`)."""
    largest = max(max(abs(k11), abs(k22)), max(abs(k12), abs(k21)))
    if largest == 0.0:
        return 0.0
    # A power of two: exact, and products neither overflow nor vanish.
    scale = 2.0 ** -math.frexp(largest)[1]
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
    return 2.0 * math.atan2(math.sqrt(max(-low, 0.0)), math.sqrt(max(high, 0.0)))


@inlined
def _product_error(a: float, b: float, product: float) -> float:
    """Rounding error of a product, `a b - product` (Dekker), within `TINY` and `HUGE`."""
    high_a = SPLITTER * a - (SPLITTER * a - a)
    high_b = SPLITTER * b - (SPLITTER * b - b)
    low_a, low_b = a - high_a, b - high_b
    return low_a * low_b - (((product - high_a * high_b) - low_a * high_b) - high_a * low_b)
