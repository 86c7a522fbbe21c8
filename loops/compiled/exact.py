"""Rounding errors of sums and products, and turns decided without any."""

from __future__ import annotations

from loops.compiled.kernel import kernel

SPLITTER = 2.0**27 + 1.0
# Within these sizes neither a product nor its rounding error leaves the range of doubles.
TINY, HUGE = 1e-250, 1e150
UNDECIDED = 2


@kernel
def product_error(a: float, b: float, product: float) -> float:
    """Rounding error of a product, `a b - product` (Dekker), within `TINY` and `HUGE`."""
    high_a = SPLITTER * a - (SPLITTER * a - a)
    high_b = SPLITTER * b - (SPLITTER * b - b)
    low_a, low_b = a - high_a, b - high_b
    return low_a * low_b - (((product - high_a * high_b) - low_a * high_b) - high_a * low_b)


@kernel
def turn(ax: float, ay: float, bx: float, by: float) -> int:
    """Sign of `ax by - ay bx`, exactly; `UNDECIDED` where doubles do not reach."""
    left, right = ax * by, ay * bx
    if left > right:
        return 1
    if left < right:
        return -1
    if (ax == 0.0 or by == 0.0) and (ay == 0.0 or bx == 0.0):
        return 0
    largest = max(max(abs(ax), abs(ay)), max(abs(bx), abs(by)))
    if not (abs(left) > TINY and largest < HUGE):
        return UNDECIDED
    left_error, right_error = product_error(ax, by, left), product_error(ay, bx, right)
    if left_error == right_error:
        return 0
    return 1 if left_error > right_error else -1
