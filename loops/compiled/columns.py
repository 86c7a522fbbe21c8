"""Solutions of small dense systems."""

from __future__ import annotations

from loops.arrays import Floats, Integers
from loops.compiled import kernel


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
