"""Tangents of loops under both closures, one loop after the other, spins blocked.

A contact comes as a row of eight: branch vector, tangent block in its own frame (n, t) row by row,
N and T. Neither depends on the direction of the contact but the branch, which a loop that runs
against it turns round.
"""

from __future__ import annotations

import math

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.compiled.kernel import kernel


@kernel
def ring_tangents(
    rows: Floats, offsets: Integers, contacts: Integers, forward: Flags, loops: Integers
) -> tuple[Floats, Floats, Floats, Floats]:
    """Affine and traction tangents (L, 4, 4), by the sum and by the force method, (11, 12, 21, 22).

    Of the given faces, each counter-clockwise, with their conditions (L,), as `affine_tangent` and
    `force_method` have them; `rows` as in the module, `offsets`, `contacts`, `forward` as in
    `Faces`. Traction is not a number where it is singular.
    """
    count = len(loops)
    affine, traction = np.zeros((count, 4, 4)), np.empty((count, 4, 4))
    conditions = np.empty((2, count))
    c, work = np.empty((4, 4)), np.empty((4, 8))
    single, closure = np.empty((2, 2, 2)), np.empty((2, 2))
    k, s, sizes = np.empty((2, 2)), np.empty((2, 2)), np.empty(2)
    for loop in range(count):
        begin, end = offsets[loops[loop]], offsets[loops[loop] + 1]
        area, growth, centre_x, centre_y, scale_x, scale_y = _measure(
            rows, contacts, forward, begin, end
        )
        c[:], single[:], closure[:] = 0.0, 0.0, 0.0
        # Sums of what multiplies the powers 0, 1 and 2 of the size of m in the condition.
        power0, power1, power2, stiff = 0.0, 0.0, 0.0, 0.0
        x, y = -centre_x, -centre_y
        for h in range(begin, end):
            row = rows[contacts[h]]
            sign = 1.0 if forward[h] else -1.0
            dx, dy = sign * row[0], sign * row[1]
            m0, m1 = (y + 0.5 * dy) / scale_x, -(x + 0.5 * dx) / scale_y
            x += dx
            y += dy
            _block_and_inverse(row, k, s, sizes)
            for i in range(2):
                for j in range(2):
                    closure[i, j] += s[i, j]
                    single[i, j, 0] += s[i, j] * m0
                    single[i, j, 1] += s[i, j] * m1
                    _add_products(affine[loop], 2 * i, 2 * j, k[i, j], dx, dy)
                    _add_products(c, 2 * i, 2 * j, s[i, j], m0, m1)
            square, weight = m0 * m0 + m1 * m1, sizes[1]
            power0 += weight
            power1 += weight * math.sqrt(square)
            power2 += weight * square
            stiff += sizes[0] * (dx * dx + dy * dy)
        norm = 0.0
        for i in range(4):
            for j in range(4):
                affine[loop, i, j] /= area
                norm += affine[loop, i, j] ** 2
        lever = 1.0 + _release(c, single, closure, area)
        terms = power2 + lever * (2.0 * power1 + lever * power0)
        amplified = _solve(c, scale_x, scale_y, work, traction[loop]) * (terms / area)
        conditions[1, loop] = amplified + growth if math.isfinite(amplified) else np.inf
        share = 1.0 if stiff == 0.0 else np.inf
        if norm > 0.0:
            share = max(1.0, stiff / (area * math.sqrt(norm)))
        conditions[0, loop] = share + growth
    return affine, traction, conditions[0], conditions[1]


@kernel
def _measure(
    rows: Floats, contacts: Integers, forward: Flags, begin: int, end: int
) -> tuple[float, float, float, float, float, float]:
    """Area of a loop and its `area_growth`, centroid from the first corner, mean sizes of m."""
    x, y, double, terms, moment_x, moment_y = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    sum_x, sum_y, square_x, square_y = 0.0, 0.0, 0.0, 0.0
    for h in range(begin, end):
        sign = 1.0 if forward[h] else -1.0
        next_x, next_y = x + sign * rows[contacts[h], 0], y + sign * rows[contacts[h], 1]
        weight = x * next_y - y * next_x
        double += weight
        terms += abs(x * next_y) + abs(y * next_x)
        moment_x += weight * (x + next_x)
        moment_y += weight * (y + next_y)
        middle_x, middle_y = 0.5 * (x + next_x), 0.5 * (y + next_y)
        sum_x += middle_x
        sum_y += middle_y
        square_x += middle_x * middle_x
        square_y += middle_y * middle_y
        x, y = next_x, next_y
    n, centre_x, centre_y = end - begin, moment_x / (3.0 * double), moment_y / (3.0 * double)
    # m is the middle of an edge from the centroid, turned by a quarter: the axes change places.
    scale_x = math.sqrt(square_y / n - centre_y * (2.0 * sum_y / n - centre_y))
    scale_y = math.sqrt(square_x / n - centre_x * (2.0 * sum_x / n - centre_x))
    return 0.5 * double, terms / double, centre_x, centre_y, scale_x, scale_y


@kernel
def _solve(c: Floats, scale_x: float, scale_y: float, work: Floats, out: Floats) -> float:
    """Invert the scaled compliance; the factor of its terms in the condition."""
    size, norm = _inverse(c, work, out), 0.0
    for i in range(4):
        for j in range(4):
            out[i, j] /= (scale_y if i & 1 else scale_x) * (scale_y if j & 1 else scale_x)
            norm += out[i, j] * out[i, j]
    return size * size / (min(scale_x, scale_y) ** 2 * math.sqrt(norm))


@kernel
def _block_and_inverse(row: Floats, k: Floats, s: Floats, sizes: Floats) -> None:
    """Tangent block of a contact in the global frame, and its inverse taken in the contact's.

    `sizes`: of the terms of the block, and of the inverse times `compliance_growth`.
    """
    length = math.hypot(row[0], row[1])
    n0, n1 = row[0] / length, row[1] / length
    size3 = abs(row[3] - row[7] / length) + abs(row[7] / length)
    size5 = abs(row[5] + row[6] / length) + abs(row[6] / length)
    sizes[0] = math.sqrt(row[2] ** 2 + size3**2 + row[4] ** 2 + size5**2)
    det = row[2] * row[5] - row[3] * row[4]
    _to_global(row[2], row[3], row[4], row[5], n0, n1, k)
    if det == 0.0:
        s[:] = np.nan
        sizes[1] = math.inf
        return
    _to_global(row[5] / det, -row[3] / det, -row[4] / det, row[2] / det, n0, n1, s)
    terms = abs(row[2]) * size5 + size3 * abs(row[4])
    size = math.sqrt(s[0, 0] ** 2 + s[0, 1] ** 2 + s[1, 0] ** 2 + s[1, 1] ** 2)
    sizes[1] = size * terms / abs(det)


@kernel
def block_and_sizes(row: Floats, k: Floats, out: Floats) -> None:
    """Tangent block of a contact in the global frame, and the sizes of the terms of its entries."""
    length = math.hypot(row[0], row[1])
    n0, n1 = row[0] / length, row[1] / length
    _to_global(row[2], row[3], row[4], row[5], n0, n1, k)
    nt = abs(row[3] - row[7] / length) + abs(row[7] / length)
    tt = abs(row[5] + row[6] / length) + abs(row[6] / length)
    nn, tn, n0, n1 = abs(row[2]), abs(row[4]), abs(n0), abs(n1)
    out[0, 0] = nn * n0 * n0 + (nt + tn) * n0 * n1 + tt * n1 * n1
    out[0, 1] = nn * n0 * n1 + nt * n0 * n0 + tn * n1 * n1 + tt * n0 * n1
    out[1, 0] = nn * n0 * n1 + nt * n1 * n1 + tn * n0 * n0 + tt * n0 * n1
    out[1, 1] = nn * n1 * n1 + (nt + tn) * n0 * n1 + tt * n0 * n0


@kernel
def _to_global(nn: float, nt: float, tn: float, tt: float, x: float, y: float, out: Floats) -> None:
    """Block from the frame n = (x, y), t = (-y, x)."""
    out[0, 0] = nn * x * x - (nt + tn) * x * y + tt * y * y
    out[0, 1] = nn * x * y + nt * x * x - tn * y * y - tt * x * y
    out[1, 0] = nn * x * y - nt * y * y + tn * x * x - tt * x * y
    out[1, 1] = nn * y * y + (nt + tn) * x * y + tt * x * x


@kernel
def _add_products(out: Floats, p: int, q: int, factor: float, a: float, b: float) -> None:
    """Add `factor v (x) v`, v = (a, b), to the 2x2 block at (p, q)."""
    out[p, q] += factor * a * a
    out[p, q + 1] += factor * a * b
    out[p + 1, q] += factor * a * b
    out[p + 1, q + 1] += factor * b * b


@kernel
def _release(c: Floats, single: Floats, closure: Floats, area: float) -> float:
    """Take from the compliance what the redundant force spends on closing the ring.

    Returns the change of that force per stress, in size.
    """
    det = closure[0, 0] * closure[1, 1] - closure[0, 1] * closure[1, 0]
    inverse = 1.0 / det if det != 0.0 else np.nan
    for i in range(2):
        for j in range(2):
            left0 = single[i, 0, j] * closure[1, 1] - single[i, 1, j] * closure[1, 0]
            left1 = single[i, 1, j] * closure[0, 0] - single[i, 0, j] * closure[0, 1]
            for p in range(2):
                for q in range(2):
                    spent = (left0 * single[0, p, q] + left1 * single[1, p, q]) * inverse
                    c[2 * i + j, 2 * p + q] = (c[2 * i + j, 2 * p + q] - spent) / area
    return math.sqrt((closure * closure).sum() * (single * single).sum()) * abs(inverse)


@kernel
def _inverse(c: Floats, work: Floats, out: Floats) -> float:
    """Inverse by elimination with pivots; its Frobenius norm, not a number if there is none."""
    work[:] = 0.0
    for i in range(4):
        work[i, :4] = c[i]
        work[i, 4 + i] = 1.0
    for column in range(4):
        pivot = column
        for i in range(column + 1, 4):
            if abs(work[i, column]) > abs(work[pivot, column]):
                pivot = i
        if not abs(work[pivot, column]) > 0.0:
            out[:] = np.nan
            return math.nan
        if pivot != column:
            for j in range(column, 8):
                work[column, j], work[pivot, j] = work[pivot, j], work[column, j]
        for i in range(4):
            if i != column:
                factor = work[i, column] / work[column, column]
                for j in range(column + 1, 8):
                    work[i, j] -= factor * work[column, j]
    square = 0.0
    for i in range(4):
        for j in range(4):
            out[i, j] = work[i, 4 + j] / work[i, i]
            square += out[i, j] * out[i, j]
    return math.sqrt(square)
