"""Traction tangents of loops whose spins are free, one loop after the other.

Unknowns are the slip `y_c = b_i w_i + b_j w_j` that the spins make at every contact that feels it,
the redundant force `f^` and the stress `P`; contact forces are `f_c = f^ - P m_c`, and every motion
follows from force and slip. Equations: the moments of the grains, combined as the spins make slip,
`E_c = (b_i/r_i^2) M_i + (b_j/r_j^2) M_j`, which leaves standing what a gear mode would balance;
closure `sum d' = 0`; and `sum d' (x) m = V0 H`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from loops.compiled.kernel import kernel

Floats = NDArray[np.float64]
Long = NDArray[np.int64]
Mask = NDArray[np.bool_]

LONGEST = 48  # sides; the plain closure takes what is longer
GEAR = 1e-13  # the slips of a ring depend on one another if their ratios come back to one


@kernel
def rolling_tangents(
    rows: Floats,
    shear: Floats,
    radii: Floats,
    offsets: Long,
    grains: Long,
    contacts: Long,
    forward: Mask,
    by_radii: bool,
    loops: Long,
) -> tuple[Floats, Floats, Floats]:
    """Traction tangents (L, 4, 4), their condition (L,) and sensitivity (L,) to the arms of spins.

    `rows` as in `ring_tangents`, `shear` (C,) the shear stiffness, zero where a contact slides,
    `by_radii` whether spins shear by the radii or by the arms to the contact point. A condition
    that is infinite leaves the loop to the plain closure.
    """
    count = len(loops)
    tangent, condition = np.empty((count, 4, 4)), np.empty(count)
    sensitivity = np.zeros(count)
    size = LONGEST + 6
    system, other = np.empty((size, size + 4)), np.empty((4, 4))
    geometry, moment = np.empty((LONGEST, 13)), np.empty((LONGEST, 8))
    for loop in range(count):
        begin, end = offsets[loops[loop]], offsets[loops[loop] + 1]
        condition[loop] = np.inf
        tangent[loop] = np.nan
        n = end - begin
        if n > LONGEST:
            continue
        area, scale_x, scale_y, stiffness, good = _contacts(
            rows, shear, radii, grains, contacts, forward, begin, n, geometry
        )
        if not good:
            continue
        _moments(geometry, n, moment)
        slips = _system(geometry, moment, n, by_radii, system)
        pivot = _solve(system, slips + 6, tangent[loop])
        if not pivot > 0.0:
            continue
        if n % 2 == 0:
            _system(geometry, moment, n, not by_radii, system)
            second = _solve(system, slips + 6, other)
            if not second > 0.0:
                tangent[loop] = np.nan
                continue
            pivot = min(pivot, second)
        norm, change = 0.0, 0.0
        for i in range(4):
            for j in range(4):
                factor = stiffness * area
                factor /= (scale_y if i & 1 else scale_x) * (scale_y if j & 1 else scale_x)
                tangent[loop, i, j] *= factor
                norm += tangent[loop, i, j] ** 2
                if n % 2 == 0:
                    change += (tangent[loop, i, j] - other[i, j] * factor) ** 2
        condition[loop] = n / pivot
        sensitivity[loop] = math.sqrt(change)
    return tangent, condition, sensitivity


# Columns of `geometry`: per contact in units of the loop's length and stiffness.
NX, NY, MX, MY, S_NN, S_NT, S_TN, S_TT, TURN_N, TURN_T, FELT, LENGTH, RADIUS = range(13)


@kernel
def _contacts(
    rows: Floats,
    shear: Floats,
    radii: Floats,
    grains: Long,
    contacts: Long,
    forward: Mask,
    begin: int,
    n: int,
    out: Floats,
) -> tuple[float, float, float, float, bool]:
    """Fill the geometry of a ring; its area, the sizes of m, its stiffness, whether all is well."""
    x, y, double, moment_x, moment_y, stiffness = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(n):
        row, sign = rows[contacts[begin + c]], 1.0 if forward[begin + c] else -1.0
        dx, dy = sign * row[0], sign * row[1]
        next_x, next_y = x + dx, y + dy
        weight = x * next_y - y * next_x
        double += weight
        moment_x += weight * (x + next_x)
        moment_y += weight * (y + next_y)
        # m is the middle of an edge turned by a quarter.
        out[c, MX], out[c, MY] = y + 0.5 * dy, -(x + 0.5 * dx)
        out[c, NX], out[c, NY] = dx, dy
        stiffness = max(stiffness, abs(row[2]))
        x, y = next_x, next_y
    good = double > 0.0 and stiffness > 0.0
    if not good:
        return 0.0, 0.0, 0.0, 0.0, False
    centre_x, centre_y = moment_x / (3.0 * double), moment_y / (3.0 * double)
    scale_x, scale_y = 0.0, 0.0
    for c in range(n):
        out[c, MX] -= centre_y
        out[c, MY] += centre_x
        scale_x += out[c, MX] ** 2
        scale_y += out[c, MY] ** 2
    scale_x, scale_y = math.sqrt(scale_x / n), math.sqrt(scale_y / n)
    length = math.sqrt(0.5 * double)
    for c in range(n):
        row = rows[contacts[begin + c]]
        out[c, MX] /= scale_x
        out[c, MY] /= scale_y
        branch = math.hypot(row[0], row[1])
        out[c, NX] /= branch
        out[c, NY] /= branch
        nn, nt, tn, tt = row[2], row[3], row[4], row[5]
        det = nn * tt - nt * tn
        if det == 0.0:
            good = False
            continue
        out[c, S_NN], out[c, S_NT] = tt / det * stiffness, -nt / det * stiffness
        out[c, S_TN], out[c, S_TT] = -tn / det * stiffness, nn / det * stiffness
        out[c, TURN_N] = row[6] / (branch * stiffness)
        out[c, TURN_T] = 0.5 * row[7] / (length * stiffness)
        out[c, FELT] = shear[contacts[begin + c]] / stiffness
        out[c, LENGTH] = branch / length
        out[c, RADIUS] = radii[grains[begin + c]] / length
    return 0.5 * double, scale_x, scale_y, stiffness, good


@kernel
def _moments(geometry: Floats, n: int, moment: Floats) -> None:
    """Moment of every grain per slip of the contact before and of its own, and per f^ and P."""
    for grain in range(n):
        moment[grain] = 0.0
    for c in range(n):
        g = geometry[c]
        second = c + 1 if c + 1 < n else 0
        gap = g[RADIUS] - geometry[second, RADIUS]
        for side in range(2):
            grain = second if side else c
            arm = 0.5 * (g[LENGTH] - gap) if side else 0.5 * (g[LENGTH] + gap)
            moment[grain, 0 if side else 1] = g[FELT] * (
                arm * g[TURN_N] * g[S_TT] - g[TURN_T] * g[S_NT]
            )
            for k in range(2):
                nk, tk = (g[NY], g[NX]) if k else (g[NX], -g[NY])
                value = g[TURN_T] * (g[S_NN] * nk + g[S_NT] * tk)
                value -= arm * (g[TURN_N] * (g[S_TN] * nk + g[S_TT] * tk) + tk)
                moment[grain, 2 + k] += value
                moment[grain, 4 + 2 * k] -= value * g[MX]
                moment[grain, 5 + 2 * k] -= value * g[MY]


@kernel
def _system(geometry: Floats, moment: Floats, n: int, by_radii: bool, out: Floats) -> int:
    """Fill the equations, four unit gradients as right-hand sides; the number of slips."""
    slips = 0
    for c in range(n):
        slips += geometry[c, FELT] != 0.0
    size = slips + 6
    for i in range(size):
        out[i, : size + 4] = 0.0
    at, ratio = 0, 1.0
    for c in range(n):
        g = geometry[c]
        second, before = c + 1 if c + 1 < n else 0, c - 1 if c > 0 else n - 1
        _close(g, at, slips, out)
        if g[FELT] == 0.0:
            continue
        r_i, r_j = g[RADIUS], geometry[second, RADIUS]
        # Only their ratio matters: the slips have no scale.
        if by_radii:
            b_i, b_j = r_i / (r_i + r_j), r_j / (r_i + r_j)
        else:
            b_i = 0.5 * (g[LENGTH] + r_i - r_j) / g[LENGTH]
            b_j = 0.5 * (g[LENGTH] + r_j - r_i) / g[LENGTH]
        ratio *= b_j / b_i
        b_i, b_j = b_i / (r_i * r_i), b_j / (r_j * r_j)
        last = at - 1 if at > 0 else slips - 1
        following = at + 1 if at + 1 < slips else 0
        if geometry[before, FELT] != 0.0:
            out[at, last] += b_i * moment[c, 0]
        out[at, at] += b_i * moment[c, 1] + b_j * moment[second, 0]
        if geometry[second, FELT] != 0.0:
            out[at, following] += b_j * moment[second, 1]
        for column in range(6):
            out[at, slips + column] += (
                b_i * moment[c, 2 + column] + b_j * moment[second, 2 + column]
            )
        at += 1
    for i in range(4):
        out[slips + 2 + i, size + i] = 1.0
    if slips == n and n % 2 == 0 and abs(ratio - 1.0) <= GEAR * n:
        # A gear mode: the slips add up to nothing with alternating signs, and so do the equations.
        out[n - 1, :size] = 0.0
        weight = 1.0
        for c in range(n):
            out[n - 1, c] = weight
            weight = -weight
    return slips


@kernel
def _close(g: Floats, at: int, slips: int, out: Floats) -> None:
    """Add the branch rate of a contact to the closure and, times m, to the gradient."""
    m = (1.0, g[MX], g[MY])
    for i in range(2):
        ni, ti = (g[NY], g[NX]) if i else (g[NX], -g[NY])
        place = (slips + i, slips + 2 + 2 * i, slips + 3 + 2 * i)
        if g[FELT] != 0.0:
            rate = g[FELT] * (g[S_NT] * ni + g[S_TT] * ti)
            for q in range(3):
                out[place[q], at] += rate * m[q]
        for k in range(2):
            nk, tk = (g[NY], g[NX]) if k else (g[NX], -g[NY])
            rate = ni * (g[S_NN] * nk + g[S_NT] * tk) + ti * (g[S_TN] * nk + g[S_TT] * tk)
            column = (slips + k, slips + 2 + 2 * k, slips + 3 + 2 * k)
            for p in range(3):
                value = -rate * m[p] if p == 0 else rate * m[p]
                for q in range(3):
                    out[place[q], column[p]] += value * m[q]


@kernel
def _solve(a: Floats, size: int, stress: Floats) -> float:
    """Last four unknowns for the four right-hand sides; the smallest pivot of rows of size one."""
    columns = size + 4
    for i in range(size):
        largest = 0.0
        for j in range(size):
            largest = max(largest, abs(a[i, j]))
        if not largest > 0.0 or not largest < np.inf:
            return 0.0
        for j in range(columns):
            a[i, j] /= largest
    smallest = 1.0
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        pivot = abs(a[best, k])
        if not pivot > 0.0:
            return 0.0
        smallest = min(smallest, pivot)
        if best != k:
            for j in range(k, columns):
                a[k, j], a[best, j] = a[best, j], a[k, j]
        for i in range(k + 1, size):
            factor = a[i, k] / a[k, k]
            if factor != 0.0:
                for j in range(k + 1, columns):
                    a[i, j] -= factor * a[k, j]
    for column in range(4):
        for i in range(3, -1, -1):
            row = size - 4 + i
            value = a[row, size + column]
            for j in range(i + 1, 4):
                value -= a[row, size - 4 + j] * stress[j, column]
            stress[i, column] = value / a[row, row]
    return smallest
