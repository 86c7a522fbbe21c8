"""Kernels of loops, one loop after the other: shape, stress and the tangents of both closures.

A contact is a row of eight: branch vector, tangent block in its own frame (n, t) row by row, N and
T. Only the branch depends on the direction of the contact: its sign is turned for a loop that
passes the contact from j to i.

Under the traction closure, motions that a compliance would make large are unknowns of their own,
slips. Unknowns are the slips, the redundant force `f^` and the stress `P`; contact forces are
`f_c = f^ - P m_c`, and the motion of a contact in its frame is `e = -s f_c + h z`, z its slip:

- of a soft contact, such as a sliding one: `z = e_t`, and `f_t + k_tn e_n + k_tt e_t = 0`;
- of one that resists the spins, if these are free: `z = b_i w_i + b_j w_j`, and the moments in the
  same combination as the spins, `(b_i/r_i^2) M_i + (b_j/r_j^2) M_j = 0`; the moment that a gear
  mode would have to balance is left out.

Closure, `sum d' = 0`, and `sum d' (x) m = V0 H` complete the system.
"""

from __future__ import annotations

import math

import numpy as np

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.compiled import kernel

# Columns of `loop_shapes`.
X, Y, AREA, PERIMETER, ELONGATION, ORIENTATION = range(6)
S11, S12, S21, S22, SLIDING = range(6, 11)
COLUMNS = 11
ROUNDING = 8 * float(np.finfo(np.float64).eps)
LONGEST_LOOP = 60  # sides; longer loops are left to `macroscopic_tangent`
# A contact has a slip below this determinant of its block over its normal stiffness squared.
SOFT = 0.05
GEAR = 1e-13  # tolerance of the product of the slip ratios around a ring that makes it a gear mode
# Columns of `geometry`, per contact, in units of the loop's length and stiffness.
NX, NY, MX, MY, S_NN, S_NT, S_TN, S_TT, H_N, H_T, K_N, K_Z, TURN_N, TURN_T, LENGTH, RADIUS = range(
    16
)
NONE, ROLLS, SLIDES = 0, 1, 2
# Columns of a contact's row: branch vector, tangent block, forces.
DX, DY, KNN, KNT, KTN, KTT, FN, FT = range(8)
# Columns of a grain's moments: per slip of the contact before, of its own, then per f^ and P.
BEFORE, OWN, REST = range(3)


@kernel
def loop_shapes(
    rows: Floats,
    x: Floats,
    regime: Regimes,
    offsets: Integers,
    grains: Integers,
    contacts: Integers,
    forward: Flags,
    loops: Integers,
) -> Floats:
    """(L, 11) of the given faces, each counter-clockwise; arrays as in `CompiledPacking`.

    Centroid, area, perimeter, elongation, orientation (radians), the stress 11, 12, 21, 22 over the
    polygon with contacts counted whole, number of sliding contacts.
    """
    out = np.empty((len(loops), COLUMNS))
    for loop in range(len(loops)):
        begin, end = offsets[loops[loop]], offsets[loops[loop] + 1]
        for column in range(COLUMNS):
            out[loop, column] = 0.0
        x0, y0, double = 0.0, 0.0, 0.0
        for h in range(begin, end):
            sign = 1.0 if forward[h] else -1.0
            x1, y1 = x0 + sign * rows[contacts[h], DX], y0 + sign * rows[contacts[h], DY]
            weight = x0 * y1 - y0 * x1
            double += weight
            out[loop, X] += weight * (x0 + x1)
            out[loop, Y] += weight * (y0 + y1)
            x0, y0 = x1, y1
            row = rows[contacts[h]]
            length = math.hypot(row[DX], row[DY])
            f0 = (row[FN] * row[DX] - row[FT] * row[DY]) / length
            f1 = (row[FN] * row[DY] + row[FT] * row[DX]) / length
            out[loop, S11] += f0 * row[DX]
            out[loop, S12] += f0 * row[DY]
            out[loop, S21] += f1 * row[DX]
            out[loop, S22] += f1 * row[DY]
            out[loop, PERIMETER] += length
            out[loop, SLIDING] += regime[contacts[h]] == 2
        out[loop, AREA] = 0.5 * double
        out[loop, X] /= 3.0 * double
        out[loop, Y] /= 3.0 * double
        for column in range(S11, S22 + 1):
            out[loop, column] /= out[loop, AREA]
        _add_moments(rows, contacts, forward, begin, end, out[loop])
        out[loop, X] += x[grains[begin], 0]
        out[loop, Y] += x[grains[begin], 1]
    return out


@kernel
def _add_moments(
    rows: Floats, contacts: Integers, forward: Flags, begin: int, end: int, out: Floats
) -> None:
    """Elongation and orientation from the second moment of the area about the centroid."""
    xx, xy, yy = 0.0, 0.0, 0.0
    x0, y0 = -out[X], -out[Y]
    for h in range(begin, end):
        sign = 1.0 if forward[h] else -1.0
        x1, y1 = x0 + sign * rows[contacts[h], DX], y0 + sign * rows[contacts[h], DY]
        weight = (x0 * y1 - y0 * x1) / 12.0
        xx += weight * (x0 * x0 + x1 * x1 + x0 * x1)
        yy += weight * (y0 * y0 + y1 * y1 + y0 * y1)
        xy += weight * (x0 * y0 + x1 * y1 + 0.5 * (x0 * y1 + y0 * x1))
        x0, y0 = x1, y1
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    radius = math.hypot(half, xy)
    gap = mean - radius
    out[ELONGATION] = math.sqrt((mean + radius) / gap) if gap > 0.0 else np.inf
    out[ORIENTATION] = 0.5 * math.atan2(xy, half)


@kernel
def tangents_of_faces(
    rows: Floats,
    shear: Floats,
    radii: Floats,
    offsets: Integers,
    grains: Integers,
    contacts: Integers,
    forward: Flags,
    loops: Integers,
    by_radii: bool,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Tangents of the given faces: affine and traction with spins blocked, traction with them free.

    `shear` (C,) is the shear stiffness, zero where a contact slides; `by_radii` tells whether spins
    shear by the radii or by the arms to the contact point. Returns the tangents (3, L, 4, 4) in the
    order (11, 12, 21, 22), their conditions (3, L), infinite where `macroscopic_tangent` is needed,
    the smallest eigenvalues of Ks in the symmetric subspace (3, L), the sensitivity of the third
    (L,), and the areas (L,).
    """
    count = len(loops)
    tangents, other = np.full((3, count, 4, 4), np.nan), np.empty((4, 4))
    conditions, smallest = np.full((3, count), np.inf), np.full((3, count), np.nan)
    sensitivity, area = np.zeros(count), np.empty(count)
    system = np.empty((LONGEST_LOOP + 6, LONGEST_LOOP + 10))
    geometry, moment = np.empty((LONGEST_LOOP, 16)), np.empty((LONGEST_LOOP, 8))
    slip = np.empty(LONGEST_LOOP, dtype=np.int64)
    for loop in range(count):
        begin, end = offsets[loops[loop]], offsets[loops[loop] + 1]
        area[loop], growth, stiff = _affine(rows, contacts, forward, begin, end, tangents[0, loop])
        smallest[0, loop] = _smallest(tangents[0, loop])
        norm = _norm(tangents[0, loop])
        none = 1.0 if stiff == 0.0 else np.inf
        conditions[0, loop] = (max(1.0, stiff / norm) if norm > 0.0 else none) + growth
        n = end - begin
        if n > LONGEST_LOOP:
            continue
        scale_x, scale_y, stiffness = _ring(rows, contacts, forward, begin, n, geometry)
        if not stiffness > 0.0:
            continue
        for free in range(2):
            k = 1 + free
            if not _contacts(rows, shear, contacts, begin, n, free == 1, stiffness, geometry, slip):
                continue
            if n == 3 and not free:
                # Three contact forces have as many components as f^ and P: the motion is affine.
                tangents[1, loop] = tangents[0, loop]
                conditions[1, loop], smallest[1, loop] = conditions[0, loop], smallest[0, loop]
                continue
            if free:
                for c in range(n):
                    geometry[c, RADIUS] = radii[grains[begin + c]] / math.sqrt(area[loop])
                _moments(geometry, n, moment)
            factor = stiffness * area[loop]
            slips, gear = _system(geometry, moment, slip, n, free == 1, by_radii, system)
            pivot = _solve(system, slips + 6, tangents[k, loop])
            if not pivot > 0.0:
                continue
            _unscale(tangents[k, loop], factor, scale_x, scale_y)
            if gear < 1.0:
                # Digits are lost by the ratio of the arms, and again where only rotation resists.
                turn = 0.0
                for c in range(n):
                    turn = max(turn, abs(geometry[c, TURN_N]))
                gear *= min(turn, 1.0)
            conditions[k, loop] = n / (pivot * gear) + growth
            smallest[k, loop] = _smallest(tangents[k, loop])
            if not free or n % 2 == 1:
                continue
            slips, gear = _system(geometry, moment, slip, n, True, not by_radii, system)
            pivot = _solve(system, slips + 6, other)
            if not pivot > 0.0:
                conditions[k, loop] = np.inf
                continue
            _unscale(other, factor, scale_x, scale_y)
            doubt = ROUNDING * n / (pivot * gear) * _norm(other)
            sensitivity[loop] = _change(tangents[k, loop], other, smallest[k, loop]) + doubt
    return tangents, conditions, smallest, sensitivity, area


@kernel
def _affine(
    rows: Floats, contacts: Integers, forward: Flags, begin: int, end: int, out: Floats
) -> tuple[float, float, float]:
    """`A = (1/V0) sum k_ik d0_j d0_l`; V0, its `area_growth`, the sizes of the terms of A."""
    x, y, double, terms, stiff = 0.0, 0.0, 0.0, 0.0, 0.0
    out[:] = 0.0
    for h in range(begin, end):
        row = rows[contacts[h]]
        sign = 1.0 if forward[h] else -1.0
        next_x, next_y = x + sign * row[DX], y + sign * row[DY]
        double += x * next_y - y * next_x
        terms += abs(x * next_y) + abs(y * next_x)
        x, y = next_x, next_y
        length = math.hypot(row[DX], row[DY])
        dx, dy = row[DX] / length, row[DY] / length
        nn, nt, tn, tt = row[KNN], row[KNT], row[KTN], row[KTT]
        nt_size = abs(nt - row[FT] / length) + abs(row[FT] / length)
        tt_size = abs(tt + row[FN] / length) + abs(row[FN] / length)
        square = length * length
        stiff += math.sqrt(nn * nn + nt_size * nt_size + tn * tn + tt_size * tt_size) * square
        # The block from the frame n = (dx, dy), t = (-dy, dx).
        block = (
            (
                nn * dx * dx - (nt + tn) * dx * dy + tt * dy * dy,
                nn * dx * dy + nt * dx * dx - tn * dy * dy - tt * dx * dy,
            ),
            (
                nn * dx * dy - nt * dy * dy + tn * dx * dx - tt * dx * dy,
                nn * dy * dy + (nt + tn) * dx * dy + tt * dx * dx,
            ),
        )
        for i in range(2):
            for k in range(2):
                value = block[i][k] * square
                out[2 * i, 2 * k] += value * dx * dx
                out[2 * i, 2 * k + 1] += value * dx * dy
                out[2 * i + 1, 2 * k] += value * dx * dy
                out[2 * i + 1, 2 * k + 1] += value * dy * dy
    for i in range(4):
        for j in range(4):
            out[i, j] /= 0.5 * double
    return 0.5 * double, terms / double, stiff / (0.5 * double)


@kernel
def _norm(a: Floats) -> float:
    square = 0.0
    for i in range(4):
        for j in range(4):
            square += a[i, j] * a[i, j]
    return math.sqrt(square)


@kernel
def _unscale(a: Floats, factor: float, scale_x: float, scale_y: float) -> None:
    for i in range(4):
        for j in range(4):
            a[i, j] *= factor / ((scale_y if i & 1 else scale_x) * (scale_y if j & 1 else scale_x))


@kernel
def _towards_zero(own: float, other: float) -> float:
    """Change to another eigenvalue, as far as it leads towards zero or beyond; else 0."""
    return max(0.0, own - other if own > 0.0 else other - own)


@kernel
def _change(own: Floats, other: Floats, smallest: float) -> float:
    """Largest change towards zero of a smallest eigenvalue, in the plane or of all strains."""
    in_plane = _towards_zero(_smallest_in_plane(own), _smallest_in_plane(other))
    return max(in_plane, _towards_zero(smallest, _smallest(other)))


@kernel
def _smallest_in_plane(a: Floats) -> float:
    """Smallest eigenvalue of Ks in (11, 22)."""
    return 0.5 * (a[0, 0] + a[3, 3] - math.hypot(a[0, 0] - a[3, 3], a[0, 3] + a[3, 0]))


@kernel
def _smallest(a: Floats) -> float:
    """Smallest eigenvalue of Ks in (11, 22, (12 + 21)/sqrt 2), by a third of an angle."""
    half = math.sqrt(0.5)
    k00, k11 = a[0, 0], a[3, 3]
    k22 = 0.5 * (a[1, 1] + a[2, 2] + a[1, 2] + a[2, 1])
    k01 = 0.5 * (a[0, 3] + a[3, 0])
    k02 = 0.5 * half * (a[0, 1] + a[1, 0] + a[0, 2] + a[2, 0])
    k12 = 0.5 * half * (a[3, 1] + a[1, 3] + a[3, 2] + a[2, 3])
    mean = (k00 + k11 + k22) / 3.0
    k00, k11, k22 = k00 - mean, k11 - mean, k22 - mean
    square = k00 * k00 + k11 * k11 + k22 * k22 + 2.0 * (k01 * k01 + k02 * k02 + k12 * k12)
    size = math.sqrt(square / 6.0)
    if not size > 0.0:
        return mean
    det = k00 * (k11 * k22 - k12 * k12) - k01 * (k01 * k22 - k12 * k02)
    det += k02 * (k01 * k12 - k11 * k02)
    cosine = min(1.0, max(-1.0, 0.5 * det / size**3))
    return mean + 2.0 * size * math.cos((math.acos(cosine) + 2.0 * math.pi) / 3.0)


@kernel
def _ring(
    rows: Floats, contacts: Integers, forward: Flags, begin: int, n: int, out: Floats
) -> tuple[float, float, float]:
    """Fill in the geometry of a ring's contacts; return sizes of m, and the stiffness."""
    x, y, double, moment_x, moment_y, stiffness = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(n):
        row, sign = rows[contacts[begin + c]], 1.0 if forward[begin + c] else -1.0
        dx, dy = sign * row[DX], sign * row[DY]
        next_x, next_y = x + dx, y + dy
        weight = x * next_y - y * next_x
        double += weight
        moment_x += weight * (x + next_x)
        moment_y += weight * (y + next_y)
        # m is the middle of an edge turned by a quarter.
        out[c, MX], out[c, MY] = y + 0.5 * dy, -(x + 0.5 * dx)
        out[c, NX], out[c, NY] = dx, dy
        stiffness = max(stiffness, abs(row[KNN]))
        x, y = next_x, next_y
    if not (double > 0.0 and stiffness > 0.0):
        return 0.0, 0.0, 0.0
    scale_x, scale_y = 0.0, 0.0
    for c in range(n):
        out[c, MX] -= moment_y / (3.0 * double)
        out[c, MY] += moment_x / (3.0 * double)
        scale_x += out[c, MX] ** 2
        scale_y += out[c, MY] ** 2
    scale_x, scale_y = math.sqrt(scale_x / n), math.sqrt(scale_y / n)
    length = math.sqrt(0.5 * double)
    for c in range(n):
        row = rows[contacts[begin + c]]
        out[c, MX] /= scale_x
        out[c, MY] /= scale_y
        branch = math.hypot(row[DX], row[DY])
        out[c, NX] /= branch
        out[c, NY] /= branch
        out[c, TURN_N] = row[FN] / (branch * stiffness)
        out[c, TURN_T] = 0.5 * row[FT] / (length * stiffness)
        out[c, LENGTH] = branch / length
    return scale_x, scale_y, stiffness


@kernel
def _contacts(
    rows: Floats,
    shear: Floats,
    contacts: Integers,
    begin: int,
    n: int,
    free: bool,
    stiffness: float,
    geometry: Floats,
    slip: Integers,
) -> bool:
    """Fill in compliances and slips of a ring's contacts; False if a contact has neither."""
    for c in range(n):
        row, out = rows[contacts[begin + c]], geometry[c]
        nn, nt = row[KNN] / stiffness, row[KNT] / stiffness
        tn, tt = row[KTN] / stiffness, row[KTT] / stiffness
        felt = shear[contacts[begin + c]] / stiffness if free else 0.0
        det = nn * tt - nt * tn
        slip[c] = NONE
        if felt == 0.0 and abs(det) < SOFT * nn * nn:
            slip[c] = SLIDES
            out[S_NN], out[S_NT], out[S_TN], out[S_TT] = 1.0 / nn, 0.0, 0.0, 0.0
            out[H_N], out[H_T] = -nt / nn, 1.0
            out[K_N], out[K_Z] = -tn / nn, det / nn
            continue
        if det == 0.0:
            return False
        out[S_NN], out[S_NT] = tt / det, -nt / det
        out[S_TN], out[S_TT] = -tn / det, nn / det
        out[H_N], out[H_T] = felt * out[S_NT], felt * out[S_TT]
        if felt != 0.0:
            slip[c] = ROLLS
    return True


@kernel
def _moments(geometry: Floats, n: int, moment: Floats) -> None:
    """Moment of every grain per slip of the contact before and of its own, and per f^ and P."""
    moment[:n] = 0.0
    for c in range(n):
        g = geometry[c]
        second = c + 1 if c + 1 < n else 0
        gap = g[RADIUS] - geometry[second, RADIUS]
        for side in range(2):
            grain = second if side else c
            arm = 0.5 * (g[LENGTH] - gap) if side else 0.5 * (g[LENGTH] + gap)
            moment[grain, BEFORE if side else OWN] = arm * g[TURN_N] * g[H_T] - g[TURN_T] * g[H_N]
            for k in range(2):
                nk, tk = (g[NY], g[NX]) if k else (g[NX], -g[NY])
                value = g[TURN_T] * (g[S_NN] * nk + g[S_NT] * tk)
                value -= arm * (g[TURN_N] * (g[S_TN] * nk + g[S_TT] * tk) + tk)
                moment[grain, REST + k] += value
                moment[grain, REST + 2 + 2 * k] -= value * g[MX]
                moment[grain, REST + 3 + 2 * k] -= value * g[MY]


@kernel
def _system(
    geometry: Floats,
    moment: Floats,
    slip: Integers,
    n: int,
    free: bool,
    by_radii: bool,
    out: Floats,
) -> tuple[int, float]:
    """Fill the equations, with four unit gradients as right-hand sides.

    Return the number of slips, and the distance of an even ring that rolls from a gear mode.
    """
    slips, rolls = 0, 0
    for c in range(n):
        slips += slip[c] != NONE
        rolls += slip[c] == ROLLS
    size = slips + 6
    for i in range(size):
        for j in range(size + 4):
            out[i, j] = 0.0
    for i in range(4):
        out[slips + 2 + i, size + i] = 1.0
    at, ratio = 0, 1.0
    for c in range(n):
        g = geometry[c]
        _close(g, at if slip[c] != NONE else -1, slips, out)
        if slip[c] == SLIDES:
            for k in range(2):
                force = g[K_N] * (g[NY] if k else g[NX]) + (g[NX] if k else -g[NY])
                out[at, slips + k] = force
                out[at, slips + 2 + 2 * k] = -force * g[MX]
                out[at, slips + 3 + 2 * k] = -force * g[MY]
            out[at, at] = g[K_Z]
        elif slip[c] == ROLLS:
            second, before = c + 1 if c + 1 < n else 0, c - 1 if c > 0 else n - 1
            r_i, r_j = g[RADIUS], geometry[second, RADIUS]
            # Only their ratio matters: a slip has no scale.
            if by_radii:
                b_i, b_j = r_i / (r_i + r_j), r_j / (r_i + r_j)
            else:
                b_i = 0.5 * (g[LENGTH] + r_i - r_j) / g[LENGTH]
                b_j = 0.5 * (g[LENGTH] + r_j - r_i) / g[LENGTH]
            ratio *= b_j / b_i
            b_i, b_j = b_i / (r_i * r_i), b_j / (r_j * r_j)
            if slip[before] != NONE:
                out[at, at - 1 if at > 0 else slips - 1] += b_i * moment[c, BEFORE]
            out[at, at] += b_i * moment[c, OWN] + b_j * moment[second, BEFORE]
            if slip[second] != NONE:
                out[at, at + 1 if at + 1 < slips else 0] += b_j * moment[second, OWN]
            for q in range(6):
                out[at, slips + q] += b_i * moment[c, REST + q] + b_j * moment[second, REST + q]
        at += slip[c] != NONE
    if not (free and rolls == n and n % 2 == 0):
        return slips, 1.0
    if abs(ratio - 1.0) > GEAR * n:
        return slips, min(abs(ratio - 1.0), 1.0)
    # A gear mode: the slips with alternating signs cancel, and so do their equations.
    for j in range(size):
        out[n - 1, j] = 0.0
    for c in range(n):
        out[n - 1, c] = 1.0 if c % 2 == 0 else -1.0
    return slips, 1.0


@kernel
def _close(g: Floats, at: int, slips: int, out: Floats) -> None:
    """Add the branch rate of a contact to the closure and, times m, to the gradient."""
    m = (1.0, g[MX], g[MY])
    for i in range(2):
        ni, ti = (g[NY], g[NX]) if i else (g[NX], -g[NY])
        place = (slips + i, slips + 2 + 2 * i, slips + 3 + 2 * i)
        if at >= 0:
            rate = g[H_N] * ni + g[H_T] * ti
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
    """Solve for the last four unknowns; return the smallest pivot, rows scaled to size one."""
    columns = size + 4
    for i in range(size):
        largest = 0.0
        for j in range(size):
            largest = max(largest, abs(a[i, j]))
        if not 0.0 < largest < np.inf:
            return 0.0
        for j in range(columns):
            a[i, j] /= largest
    smallest = 1.0
    for k in range(size):
        best, pivot = k, abs(a[k, k])
        for i in range(k + 1, size):
            # Selected without an if: the processor would mispredict every second one.
            larger = abs(a[i, k]) > pivot
            best, pivot = (i, abs(a[i, k])) if larger else (best, pivot)
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
