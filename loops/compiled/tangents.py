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
from loops.compiled import inlined, kernel

# Columns of `loop_shapes`.
X, Y, AREA, PERIMETER, ELONGATION, ORIENTATION = range(6)
S11, S12, S21, S22, SLIDING = range(6, 11)
COLUMNS = 11
ROUNDING = 8 * float(np.finfo(np.float64).eps)
LONGEST_LOOP = 60  # sides; longer loops are left to `macroscopic_tangent`
# Rows of equations are treated in multiples of so many numbers: the compiler's loops of vectors.
LANES = 16
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
    length: Floats,
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
            c = contacts[h]
            dx, dy, fn, ft = rows[c, DX], rows[c, DY], rows[c, FN], rows[c, FT]
            f0, f1 = (fn * dx - ft * dy) / length[c], (fn * dy + ft * dx) / length[c]
            out[loop, S11] += f0 * dx
            out[loop, S12] += f0 * dy
            out[loop, S21] += f1 * dx
            out[loop, S22] += f1 * dy
            out[loop, PERIMETER] += length[c]
            out[loop, SLIDING] += regime[contacts[h]] == 2
        out[loop, AREA] = 0.5 * double
        out[loop, X] /= 3.0 * double
        out[loop, Y] /= 3.0 * double
        for column in range(S11, S22 + 1):
            out[loop, column] /= out[loop, AREA]
        _add_moments(rows, contacts, forward, begin, end, loop, out)
        out[loop, X] += x[grains[begin], 0]
        out[loop, Y] += x[grains[begin], 1]
    return out


@inlined
def _add_moments(
    rows: Floats, contacts: Integers, forward: Flags, begin: int, end: int, loop: int, out: Floats
) -> None:
    """Elongation and orientation from the second moment of the area about the centroid."""
    xx, xy, yy = 0.0, 0.0, 0.0
    x0, y0 = -out[loop, X], -out[loop, Y]
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
    out[loop, ELONGATION] = math.sqrt((mean + radius) / gap) if gap > 0.0 else np.inf
    out[loop, ORIENTATION] = 0.5 * math.atan2(xy, half)


@kernel
def tangents_of_faces(
    rows: Floats,
    length: Floats,
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

    `length` (C,) are those of the branches, `shear` the shear stiffness, zero where a contact
    slides; `by_radii` tells whether spins shear by the radii or by the arms to the contact point.
    Returns the tangents (3, L, 4, 4) in the order (11, 12, 21, 22), their conditions (3, L),
    infinite where `macroscopic_tangent` is needed, the smallest eigenvalues of Ks in the symmetric
    subspace by traction (2, L), the sensitivity of the third (L,), and the areas (L,).
    """
    count = len(loops)
    tangents, own, other = np.full((3, count, 4, 4), np.nan), np.empty((4, 4)), np.empty((4, 4))
    conditions, smallest = np.full((3, count), np.inf), np.full((2, count), np.nan)
    sensitivity, area = np.zeros(count), np.empty(count)
    system = np.empty((LONGEST_LOOP + 6, _width(LONGEST_LOOP + 6)))
    geometry, moment = np.empty((LONGEST_LOOP, 16)), np.empty((LONGEST_LOOP, 8))
    slip = np.empty(LONGEST_LOOP, dtype=np.int64)
    for loop in range(count):
        begin, end = offsets[loops[loop]], offsets[loops[loop] + 1]
        area[loop], growth, stiff = _affine(rows, length, contacts, forward, begin, end, own)
        _store(own, tangents, 0, loop)
        norm = _norm(own)
        none = 1.0 if stiff == 0.0 else np.inf
        conditions[0, loop] = (max(1.0, stiff / norm) if norm > 0.0 else none) + growth
        n = end - begin
        if n > LONGEST_LOOP:
            continue
        scale_x, scale_y, stiffness = _ring(rows, length, contacts, forward, begin, n, geometry)
        if not stiffness > 0.0:
            continue
        for free in range(2):
            k = 1 + free
            if not _contacts(rows, shear, contacts, begin, n, free == 1, stiffness, geometry, slip):
                continue
            if n == 3 and not free:
                # Three contact forces have as many components as f^ and P: the motion is affine.
                _store(own, tangents, 1, loop)
                conditions[1, loop], smallest[0, loop] = conditions[0, loop], _smallest(own)
                continue
            if free:
                for c in range(n):
                    geometry[c, RADIUS] = radii[grains[begin + c]] / math.sqrt(area[loop])
                _moments(geometry, n, moment)
            factor = stiffness * area[loop]
            slips, gear = _system(geometry, moment, slip, n, free == 1, by_radii, system)
            pivot = _solve(system, slips + 6, own)
            if not pivot > 0.0:
                continue
            _unscale(own, factor, scale_x, scale_y)
            _store(own, tangents, k, loop)
            if gear < 1.0:
                # Digits are lost by the ratio of the arms, and again where only rotation resists.
                turn = 0.0
                for c in range(n):
                    turn = max(turn, abs(geometry[c, TURN_N]))
                gear *= min(turn, 1.0)
            conditions[k, loop] = n / (pivot * gear) + growth
            smallest[free, loop] = _smallest(own)
            if not free or n % 2 == 1:
                continue
            slips, gear = _system(geometry, moment, slip, n, True, not by_radii, system)
            pivot = _solve(system, slips + 6, other)
            if not pivot > 0.0:
                conditions[k, loop] = np.inf
                continue
            _unscale(other, factor, scale_x, scale_y)
            doubt = ROUNDING * n / (pivot * gear) * _norm(other)
            sensitivity[loop] = _change(own, other, smallest[free, loop]) + doubt
    return tangents, conditions, smallest, sensitivity, area


@inlined
def _affine(
    rows: Floats,
    lengths: Floats,
    contacts: Integers,
    forward: Flags,
    begin: int,
    end: int,
    out: Floats,
) -> tuple[float, float, float]:
    """`A = (1/V0) sum k_ik d0_j d0_l`; V0, its `area_growth`, the sizes of the terms of A."""
    x, y, double, terms, stiff = 0.0, 0.0, 0.0, 0.0, 0.0
    out[:] = 0.0
    for h in range(begin, end):
        c, sign = contacts[h], 1.0 if forward[h] else -1.0
        next_x, next_y = x + sign * rows[c, DX], y + sign * rows[c, DY]
        double += x * next_y - y * next_x
        terms += abs(x * next_y) + abs(y * next_x)
        x, y = next_x, next_y
        length = lengths[c]
        dx, dy = rows[c, DX] / length, rows[c, DY] / length
        nn, nt, tn, tt = rows[c, KNN], rows[c, KNT], rows[c, KTN], rows[c, KTT]
        turn_n, turn_t = rows[c, FN] / length, rows[c, FT] / length
        nt_size, tt_size = abs(nt - turn_t) + abs(turn_t), abs(tt + turn_n) + abs(turn_n)
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


@inlined
def _store(a: Floats, tangents: Floats, k: int, loop: int) -> None:
    for i in range(4):
        for j in range(4):
            tangents[k, loop, i, j] = a[i, j]


@inlined
def _norm(a: Floats) -> float:
    square = 0.0
    for i in range(4):
        for j in range(4):
            square += a[i, j] * a[i, j]
    return math.sqrt(square)


@inlined
def _unscale(a: Floats, factor: float, scale_x: float, scale_y: float) -> None:
    for i in range(4):
        for j in range(4):
            a[i, j] *= factor / ((scale_y if i & 1 else scale_x) * (scale_y if j & 1 else scale_x))


@inlined
def _towards_zero(own: float, other: float) -> float:
    """Change to another eigenvalue, as far as it leads towards zero or beyond; else 0."""
    return max(0.0, own - other if own > 0.0 else other - own)


@inlined
def _change(own: Floats, other: Floats, smallest: float) -> float:
    """Largest change towards zero of a smallest eigenvalue, in the plane or of all strains."""
    in_plane = _towards_zero(_smallest_in_plane(own), _smallest_in_plane(other))
    return max(in_plane, _towards_zero(smallest, _smallest(other)))


@inlined
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


@inlined
def _ring(
    rows: Floats,
    lengths: Floats,
    contacts: Integers,
    forward: Flags,
    begin: int,
    n: int,
    out: Floats,
) -> tuple[float, float, float]:
    """Fill in the geometry of a ring's contacts; return sizes of m, and the stiffness."""
    x, y, double, moment_x, moment_y, stiffness = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(n):
        row, sign = contacts[begin + c], 1.0 if forward[begin + c] else -1.0
        dx, dy = sign * rows[row, DX], sign * rows[row, DY]
        next_x, next_y = x + dx, y + dy
        weight = x * next_y - y * next_x
        double += weight
        moment_x += weight * (x + next_x)
        moment_y += weight * (y + next_y)
        # m is the middle of an edge turned by a quarter.
        out[c, MX], out[c, MY] = y + 0.5 * dy, -(x + 0.5 * dx)
        out[c, NX], out[c, NY] = dx, dy
        stiffness = max(stiffness, abs(rows[row, KNN]))
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
        row = contacts[begin + c]
        out[c, MX] /= scale_x
        out[c, MY] /= scale_y
        branch = lengths[row]
        out[c, NX] /= branch
        out[c, NY] /= branch
        out[c, TURN_N] = rows[row, FN] / (branch * stiffness)
        out[c, TURN_T] = 0.5 * rows[row, FT] / (length * stiffness)
        out[c, LENGTH] = branch / length
    return scale_x, scale_y, stiffness


@inlined
def _contacts(
    rows: Floats,
    shear: Floats,
    contacts: Integers,
    begin: int,
    n: int,
    free: bool,
    stiffness: float,
    out: Floats,
    slip: Integers,
) -> bool:
    """Fill in compliances and slips of a ring's contacts; False if a contact has neither."""
    for c in range(n):
        row = contacts[begin + c]
        nn, nt = rows[row, KNN] / stiffness, rows[row, KNT] / stiffness
        tn, tt = rows[row, KTN] / stiffness, rows[row, KTT] / stiffness
        felt = shear[contacts[begin + c]] / stiffness if free else 0.0
        det = nn * tt - nt * tn
        slip[c] = NONE
        if felt == 0.0 and abs(det) < SOFT * nn * nn:
            slip[c] = SLIDES
            out[c, S_NN], out[c, S_NT], out[c, S_TN], out[c, S_TT] = 1.0 / nn, 0.0, 0.0, 0.0
            out[c, H_N], out[c, H_T] = -nt / nn, 1.0
            out[c, K_N], out[c, K_Z] = -tn / nn, det / nn
            continue
        if det == 0.0:
            return False
        out[c, S_NN], out[c, S_NT] = tt / det, -nt / det
        out[c, S_TN], out[c, S_TT] = -tn / det, nn / det
        out[c, H_N], out[c, H_T] = felt * out[c, S_NT], felt * out[c, S_TT]
        if felt != 0.0:
            slip[c] = ROLLS
    return True


@inlined
def _moments(g: Floats, n: int, moment: Floats) -> None:
    """Moment of every grain per slip of the contact before and of its own, and per f^ and P."""
    moment[:n] = 0.0
    for c in range(n):
        second = c + 1 if c + 1 < n else 0
        gap = g[c, RADIUS] - g[second, RADIUS]
        for side in range(2):
            grain = second if side else c
            arm = 0.5 * (g[c, LENGTH] - gap) if side else 0.5 * (g[c, LENGTH] + gap)
            moment[grain, BEFORE if side else OWN] = (
                arm * g[c, TURN_N] * g[c, H_T] - g[c, TURN_T] * g[c, H_N]
            )
            for k in range(2):
                nk, tk = (g[c, NY], g[c, NX]) if k else (g[c, NX], -g[c, NY])
                value = g[c, TURN_T] * (g[c, S_NN] * nk + g[c, S_NT] * tk)
                value -= arm * (g[c, TURN_N] * (g[c, S_TN] * nk + g[c, S_TT] * tk) + tk)
                moment[grain, REST + k] += value
                moment[grain, REST + 2 + 2 * k] -= value * g[c, MX]
                moment[grain, REST + 3 + 2 * k] -= value * g[c, MY]


@inlined
def _system(
    g: Floats,
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
        for j in range(_width(size)):
            out[i, j] = 0.0
    for i in range(4):
        out[slips + 2 + i, size + i] = 1.0
    at, ratio = 0, 1.0
    for c in range(n):
        _close(g, c, at if slip[c] != NONE else -1, slips, out)
        if slip[c] == SLIDES:
            for k in range(2):
                force = g[c, K_N] * (g[c, NY] if k else g[c, NX]) + (g[c, NX] if k else -g[c, NY])
                out[at, slips + k] = force
                out[at, slips + 2 + 2 * k] = -force * g[c, MX]
                out[at, slips + 3 + 2 * k] = -force * g[c, MY]
            out[at, at] = g[c, K_Z]
        elif slip[c] == ROLLS:
            second, before = c + 1 if c + 1 < n else 0, c - 1 if c > 0 else n - 1
            r_i, r_j = g[c, RADIUS], g[second, RADIUS]
            # Only their ratio matters: a slip has no scale.
            if by_radii:
                b_i, b_j = r_i / (r_i + r_j), r_j / (r_i + r_j)
            else:
                b_i = 0.5 * (g[c, LENGTH] + r_i - r_j) / g[c, LENGTH]
                b_j = 0.5 * (g[c, LENGTH] + r_j - r_i) / g[c, LENGTH]
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


@inlined
def _close(g: Floats, c: int, at: int, slips: int, out: Floats) -> None:
    """Add the branch rate of a contact to the closure and, times m, to the gradient."""
    m = (1.0, g[c, MX], g[c, MY])
    for i in range(2):
        ni, ti = (g[c, NY], g[c, NX]) if i else (g[c, NX], -g[c, NY])
        place = (slips + i, slips + 2 + 2 * i, slips + 3 + 2 * i)
        if at >= 0:
            rate = g[c, H_N] * ni + g[c, H_T] * ti
            for q in range(3):
                out[place[q], at] += rate * m[q]
        for k in range(2):
            nk, tk = (g[c, NY], g[c, NX]) if k else (g[c, NX], -g[c, NY])
            rate = ni * (g[c, S_NN] * nk + g[c, S_NT] * tk) + ti * (
                g[c, S_TN] * nk + g[c, S_TT] * tk
            )
            column = (slips + k, slips + 2 + 2 * k, slips + 3 + 2 * k)
            for p in range(3):
                value = -rate * m[p] if p == 0 else rate * m[p]
                for q in range(3):
                    out[place[q], column[p]] += value * m[q]


@inlined
def _width(size: int) -> int:
    """Numbers in a row of so many equations and four right-hand sides, a multiple of `LANES`."""
    return (size + 3 + LANES) // LANES * LANES


@inlined
def _solve(a: Floats, size: int, stress: Floats) -> float:
    """Solve for the last four unknowns; return the smallest pivot, rows scaled to size one.

    Whole rows are eliminated, also before the diagonal, where nothing is read again.
    """
    width = _width(size)
    for i in range(size):
        largest = 0.0
        for j in range(size):
            largest = max(largest, abs(a[i, j]))
        if not 0.0 < largest < np.inf:
            return 0.0
        for j in range(width):
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
            for j in range(width):
                a[k, j], a[best, j] = a[best, j], a[k, j]
        for i in range(k + 1, size):
            factor = a[i, k] / a[k, k]
            if factor != 0.0:
                for j in range(width):
                    a[i, j] -= factor * a[k, j]
    for column in range(4):
        for i in range(3, -1, -1):
            row = size - 4 + i
            value = a[row, size + column]
            for j in range(i + 1, 4):
                value -= a[row, size - 4 + j] * stress[j, column]
            stress[i, column] = value / a[row, row]
    return smallest
