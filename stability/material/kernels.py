"""Kernels of the material point: one step of many contacts, and of loops whose centres relax.

A contact goes from the branch `d_n` to `d` on a straight line. A row of its answer has eight
columns, see `FX`; a row of its parameters four, see `TOUCHING`.
"""

from __future__ import annotations

import math

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.compiled import inlined, inlined_sum, kernel

# Columns of a contact's answer: force, tangent -df/dd, shear force, regime.
FX, FY, KXX, KXY, KYX, KYY, SHEAR, REGIME = range(8)
ANSWER = 8
# Columns of a contact's parameters: length at touch; kn, or the factor a of N = a delta^(3/2);
# kt, or kt/kn; friction.
TOUCHING, NORMAL, TANGENTIAL, FRICTION = range(4)
# Columns of a contact under the affine closure: its parameters, its branch at the start, the weight
# of its loop over the area, its share of the regimes.
X, Y, DENSITY, SHARE = range(4, 8)
# Rows of a chunk of contacts at work: those columns, the answer, the shear force at the start, and
# whether `_contact` takes it.
OUT, BEFORE, TAKEN, ROWS = 8, 16, 17, 18
# Contacts taken together: their columns and answers stay in the nearest cache.
CHUNK = 256
LINEAR, HERTZ_FORCE, HERTZ_DISPLACEMENT = range(3)
OPEN, ELASTIC, SLIDING = 0.0, 1.0, 2.0
# Columns of the sums of a point: stress, tangent, shares stuck, sliding and open, weight.
P11, A11, STUCK, SLIDES, OPENED, WEIGHT = 0, 4, 20, 21, 22, 23
SUMS = 24
# States of a loop while its centres relax.
MOVING, RELAXED, LOST = range(3)
# Force out of balance over stiffness and length of a loop of six at which it is relaxed: some
# hundred times the rounding of its terms.
BALANCED = 1e-13
# (length over sum of the ends' lengths)^2 below which the series of atanh has all digits.
SHORT = 0.01
# A gap below this share of the length at touch is none: rounding of turned loops.
TOUCH = 1e-12
# Pivot over the largest entry at which a system is singular.
SINGULAR = 1e-14
# Five Gauss points on [0, 1], for stiffnesses that change with the overlap.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(5)
NODES, WEIGHTS = 0.5 * (NODES + 1.0), 0.5 * WEIGHTS


@inlined
def _segment(q2: float, short: bool) -> tuple[float, float]:
    """Return `atanh(q)/q` and its derivative over q, over q, from `q^2`."""
    if short or q2 < SHORT:
        # Sums of q2^k / (2 k + 1) and of 2 k q2^(k - 1) / (2 k + 1), k up to 8.
        value = 1 / 15 + q2 / 17
        value = 1 / 9 + q2 * (1 / 11 + q2 * (1 / 13 + q2 * value))
        value = 1 + q2 * (1 / 3 + q2 * (1 / 5 + q2 * (1 / 7 + q2 * value)))
        slope = 12 / 13 + q2 * (14 / 15 + q2 * (16 / 17))
        slope = 2 / 3 + q2 * (4 / 5 + q2 * (6 / 7 + q2 * (8 / 9 + q2 * (10 / 11 + q2 * slope))))
        return value, slope
    q = math.sqrt(q2)
    value = math.atanh(q) / q
    return value, (1.0 / (1.0 - q2) - value) / q2


@inlined
def _angle(z: float, short: bool) -> float:
    """Return `2 atan(z)`."""
    z2 = z * z
    if short or z2 < SHORT:
        value = 1 / 9 - z2 * (1 / 11 - z2 * (1 / 13 - z2 * (1 / 15 - z2 / 17)))
        return 2.0 * z * (1 - z2 * (1 / 3 - z2 * (1 / 5 - z2 * (1 / 7 - z2 * value))))
    return 2.0 * math.atan(z)


@inlined
def _slid(
    by_radii: bool, short: bool, touching: float, px: float, py: float, dx: float, dy: float
) -> tuple[float, float, float]:
    """Return the integral of `g t . dd` from the branch `p` to `d`, and its gradient over `d`.

    Over `p` it has minus the gradient of the way back. `short`: the way is short (`SHORT`).
    """
    first, length = math.sqrt(px * px + py * py), math.sqrt(dx * dx + dy * dy)
    turn = px * dy - py * dx
    if by_radii:
        ratio = touching / (length * length)
        angle = _angle(turn / (first * length + px * dx + py * dy), short)
        return touching * angle, -ratio * dy, ratio * dx
    nx, ny, inverse = dx / length, dy / length, 1.0 / (first + length)
    ex, ey = (dx - px) * inverse, (dy - py) * inverse
    q2 = ex * ex + ey * ey
    value, slope = _segment(q2, short)
    mean, stretch = 2.0 * value * inverse, 2.0 * slope * inverse * inverse
    shorter = stretch * q2 + mean * inverse
    along_x = stretch * ex - shorter * nx
    along_y = stretch * ey - shorter * ny
    return turn * mean, turn * along_x - py * mean, turn * along_y + px * mean


@kernel
def _hertz_shear(
    by_radii: bool, touching: float, stiffness: float, px: float, py: float, dx: float, dy: float
) -> tuple[float, float, float]:
    """Return the integral of `kt g t . dd` of spheres by Gauss points, otherwise as `_slid`.

    `stiffness` is kt over the root of the overlap.
    """
    turn, power = px * dy - py * dx, 2.0 if by_radii else 1.0
    total, total_x, total_y = 0.0, 0.0, 0.0
    for g in range(5):
        s = NODES[g]
        gx, gy = px + s * (dx - px), py + s * (dy - py)
        r = math.sqrt(gx * gx + gy * gy)
        depth = max(touching - r, 0.0)
        root = math.sqrt(depth)
        share = WEIGHTS[g] * (touching / (r * r) if by_radii else 1.0 / r)
        total += stiffness * root * share
        slope = -stiffness * root * share * power / r
        if depth > 0.0:
            slope -= 0.5 * stiffness / root * share
        total_x += slope * s * gx / r
        total_y += slope * s * gy / r
    return turn * total, turn * total_x - py * total, turn * total_y + px * total


@kernel
def _shear(
    kind: int, by_radii: bool, touching: float, stiffness: float, px: float, py: float, dx: float,
    dy: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return what shear force a contact loses from `p` to `d`, and its gradient over `d`."""
    if kind == HERTZ_FORCE:
        return _hertz_shear(by_radii, touching, stiffness, px, py, dx, dy)
    slid, slid_x, slid_y = _slid(by_radii, False, touching, px, py, dx, dy)
    return stiffness * slid, stiffness * slid_x, stiffness * slid_y


@kernel
def _since_touch(
    far: float, px: float, py: float, dx: float, dy: float
) -> tuple[float, float, float, float, float, float]:
    """Return where an open branch that goes from `p` to `d` touches, and its derivatives over `d`.

    `far` is `p^2` less the square of the length at touch. The touch is at `p + s (d - p)`; the
    derivatives are those of x, then of y.
    """
    ex, ey = dx - px, dy - py
    approach = px * ex + py * ey
    root = approach * approach - (ex * ex + ey * ey) * far
    root = math.sqrt(max(root, TOUCH * approach * approach))
    s = far / (root - approach)
    px, py = px + s * ex, py + s * ey
    share = s / root
    return (
        px, py, s + share * ex * px, share * ex * py, share * ey * px, s + share * ey * py
    )  # fmt: skip


@inlined
def _answer(
    dx: float, dy: float, length: float, force: float, kn: float, mu: float, trial: float,
    trial_x: float, trial_y: float,
) -> tuple[float, float, float, float, float, float, float, float]:  # fmt: skip
    """Return the columns of a closed contact, its trial shear force cut to the strength."""
    nx, ny, limit = dx / length, dy / length, mu * force
    slides = abs(trial) > limit or mu == 0.0
    side = 1.0 if trial > 0.0 else -1.0
    T = side * limit if slides else trial
    slope = side * mu * kn
    T_x = -slope * nx if slides else trial_x
    T_y = -slope * ny if slides else trial_y
    a, b = force / length, T / length
    return (
        force * nx - T * ny,
        force * ny + T * nx,
        kn * nx * nx - a * ny * ny + ny * T_x - b * nx * ny,
        kn * nx * ny + a * ny * nx + ny * T_y + b * nx * nx,
        kn * ny * nx + a * nx * ny - nx * T_x - b * ny * ny,
        kn * ny * ny - a * nx * nx - nx * T_y + b * ny * nx,
        T,
        SLIDING if slides else ELASTIC,
    )


@kernel
def _contact(
    kind: int, by_radii: bool, parameters: Floats, px: float, py: float, dx: float, dy: float,
    before: float, row: Floats,
) -> None:  # fmt: skip
    """Write the answer of a contact that moves from the branch `p` to `d`, `before` its shear."""
    touching, normal = parameters[TOUCHING], parameters[NORMAL]
    length = math.sqrt(dx * dx + dy * dy)
    # A linear contact that just touches has its stiffness; a Hertzian one has none yet.
    if not length < (touching * (1.0 + TOUCH) if kind == LINEAR else touching):
        row[:REGIME], row[REGIME] = 0.0, OPEN
        return
    overlap = max(touching - length, 0.0)
    kn = normal if kind == LINEAR else 1.5 * normal * math.sqrt(overlap)
    force = kn * overlap if kind == LINEAR else kn * overlap / 1.5
    kt = parameters[TANGENTIAL]
    if kind != LINEAR:
        kt *= 1.5 * normal if kind == HERTZ_FORCE else kn
    # A contact that was open shears from its touch on, a point that moves with d.
    far = px * px + py * py - touching * touching
    opened = far > 2.0 * TOUCH * touching * touching
    xx, xy, yx, yy = 0.0, 0.0, 0.0, 0.0
    if opened:
        before = 0.0
        px, py, xx, xy, yx, yy = _since_touch(far, px, py, dx, dy)
    lost, lost_x, lost_y = _shear(kind, by_radii, touching, kt, px, py, dx, dy)
    if opened:
        _, back_x, back_y = _shear(kind, by_radii, touching, kt, dx, dy, px, py)
        lost_x -= back_x * xx + back_y * yx
        lost_y -= back_x * xy + back_y * yy
    if kind == HERTZ_DISPLACEMENT:
        # T = -kt(delta) xi: what was there changes with kt.
        kept = 0.0
        if before != 0.0:
            first = math.sqrt(px * px + py * py)
            kept = before / math.sqrt(max(touching - first, 0.0) / overlap)
        growth = 0.5 * (kept - lost) / overlap
        before = kept
        lost_x += growth * dx / length
        lost_y += growth * dy / length
    mu, trial = parameters[FRICTION], before - lost
    columns = _answer(dx, dy, length, force, kn, mu, trial, -lost_x, -lost_y)
    for column in range(ANSWER):
        row[column] = columns[column]


@kernel
def contact_steps(
    kind: int, by_radii: bool, parameters: Floats, start: Floats, end: Floats, shear: Floats,
    out: Floats,
) -> None:  # fmt: skip
    """Write the answers (q, m, 8) of contacts that move from `start` to `end`, (q, m, 2)."""
    for q in range(end.shape[0]):
        for c in range(end.shape[1]):
            _contact(
                kind, by_radii, parameters[c], start[q, c, 0], start[q, c, 1], end[q, c, 0],
                end[q, c, 1], shear[q, c], out[q, c],
            )  # fmt: skip


@kernel
def count_regimes(answer: Floats, begin: int, end: int, share: float, sums: Floats) -> None:
    """Add the shares of the regimes of one loop's contacts, and its weight, to the sums."""
    each = share / (end - begin)
    for c in range(begin, end):
        regime = answer[c, REGIME]
        if regime == ELASTIC:
            sums[STUCK] += each
        elif regime == SLIDING:
            sums[SLIDES] += each
        else:
            sums[OPENED] += each
    sums[WEIGHT] += share


@inlined
def _stays(by_radii: bool, count: int, u: Floats, v: Floats, work: Floats) -> int:
    """Write the answers of linear contacts that are closed all along, or open at the end.

    Branches go from `u d0` to `v d0`, u and v the four components. Returns the number of contacts
    that `_contact` has to take, marked in the row TAKEN. Without branches, so that it is
    vectorised.
    """
    left = 0
    for c in range(count):
        x, y, touching = work[X, c], work[Y, c], work[TOUCHING, c]
        px, py = u[0] * x + u[1] * y, u[2] * x + u[3] * y
        dx, dy = v[0] * x + v[1] * y, v[2] * x + v[3] * y
        p2, length = px * px + py * py, math.sqrt(dx * dx + dy * dy)
        closed = length < touching * (1.0 + TOUCH)
        opened = p2 - touching * touching > 2.0 * TOUCH * touching * touching
        ends, way2 = math.sqrt(p2) + length, (dx - px) * (dx - px) + (dy - py) * (dy - py)
        takes = closed and (opened or way2 >= SHORT * ends * ends)
        slid, slid_x, slid_y = _slid(by_radii, True, touching, px, py, dx, dy)
        kn, kt = work[NORMAL, c], work[TANGENTIAL, c]
        force = kn * max(touching - length, 0.0)
        row = _answer(
            dx, dy, length, force, kn, work[FRICTION, c], work[BEFORE, c] - kt * slid, -kt * slid_x,
            -kt * slid_y,
        )  # fmt: skip
        work[OUT + FX, c] = row[FX] if closed else 0.0
        work[OUT + FY, c] = row[FY] if closed else 0.0
        work[OUT + KXX, c] = row[KXX] if closed else 0.0
        work[OUT + KXY, c] = row[KXY] if closed else 0.0
        work[OUT + KYX, c] = row[KYX] if closed else 0.0
        work[OUT + KYY, c] = row[KYY] if closed else 0.0
        work[OUT + SHEAR, c] = row[SHEAR] if closed else 0.0
        work[OUT + REGIME, c] = row[REGIME] if closed else OPEN
        work[TAKEN, c] = 1.0 if takes else 0.0
        left += takes
    return left


@inlined_sum
def _add(count: int, work: Floats, sums: Floats) -> None:
    """Add stress, tangent and shares of the regimes of contacts."""
    p11, p12, p21, p22 = 0.0, 0.0, 0.0, 0.0
    xx1, xx2, xx3, xy1, xy2, xy3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    yx1, yx2, yx3, yy1, yy2, yy3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    stuck, slides, opened = 0.0, 0.0, 0.0
    for c in range(count):
        x, y = work[X, c], work[Y, c]
        wx, wy = work[DENSITY, c] * x, work[DENSITY, c] * y
        p11 += work[OUT + FX, c] * wx
        p12 += work[OUT + FX, c] * wy
        p21 += work[OUT + FY, c] * wx
        p22 += work[OUT + FY, c] * wy
        w11, w12, w22 = wx * x, wx * y, wy * y
        xx1 += work[OUT + KXX, c] * w11
        xx2 += work[OUT + KXX, c] * w12
        xx3 += work[OUT + KXX, c] * w22
        xy1 += work[OUT + KXY, c] * w11
        xy2 += work[OUT + KXY, c] * w12
        xy3 += work[OUT + KXY, c] * w22
        yx1 += work[OUT + KYX, c] * w11
        yx2 += work[OUT + KYX, c] * w12
        yx3 += work[OUT + KYX, c] * w22
        yy1 += work[OUT + KYY, c] * w11
        yy2 += work[OUT + KYY, c] * w12
        yy3 += work[OUT + KYY, c] * w22
        share, regime = work[SHARE, c], work[OUT + REGIME, c]
        stuck += share if regime == ELASTIC else 0.0
        slides += share if regime == SLIDING else 0.0
        opened += share if regime == OPEN else 0.0
    # A_ijkl: k_ik d_j d_l, so the row of ij and the column of kl.
    found = (
        p11, p12, p21, p22,
        xx1, xx2, xy1, xy2, xx2, xx3, xy2, xy3,
        yx1, yx2, yy1, yy2, yx2, yx3, yy2, yy3,
        stuck, slides, opened, stuck + slides + opened,
    )  # fmt: skip
    for k in range(SUMS):
        sums[k] += found[k]


@kernel
def affine_steps(
    kind: int, by_radii: bool, parameters: Floats, columns: Floats, start: Floats, end: Floats,
    shear: Floats, new: Floats, sums: Floats,
) -> None:  # fmt: skip
    """Take the steps of contacts whose centres follow the strain; add up in sums (q, 24).

    From the stretch `start` to `end`, (q, 4); the shear forces at the end are written to `new`
    (q, m).
    """
    work, row = np.empty((ROWS, CHUNK)), np.empty(ANSWER)
    for begin in range(0, columns.shape[1], CHUNK):
        count = min(CHUNK, columns.shape[1] - begin)
        work[:OUT, :count] = columns[:, begin : begin + count]
        for q in range(start.shape[0]):
            u, v, left = start[q], end[q], count
            for c in range(count):
                work[BEFORE, c], work[TAKEN, c] = shear[q, begin + c], 1.0
            if kind == LINEAR:
                left = _stays(by_radii, count, u, v, work)
            for c in range(count if left > 0 else 0):
                if work[TAKEN, c] > 0.0:
                    x, y = work[X, c], work[Y, c]
                    _contact(
                        kind, by_radii, parameters[begin + c], u[0] * x + u[1] * y,
                        u[2] * x + u[3] * y, v[0] * x + v[1] * y, v[2] * x + v[3] * y,
                        work[BEFORE, c], row,
                    )  # fmt: skip
                    for k in range(ANSWER):
                        work[OUT + k, c] = row[k]
            for c in range(count):
                new[q, begin + c] = work[OUT + SHEAR, c]
            _add(count, work, sums[q])


@kernel
def affine_sums(answer: Floats, columns: Floats, sums: Floats) -> None:
    """Add up the answers (q, m, 8) of contacts whose centres follow the strain, in sums (q, 24)."""
    work = np.empty((ROWS, CHUNK))
    for begin in range(0, columns.shape[1], CHUNK):
        count = min(CHUNK, columns.shape[1] - begin)
        work[:OUT, :count] = columns[:, begin : begin + count]
        for q in range(answer.shape[0]):
            for c in range(count):
                for k in range(ANSWER):
                    work[OUT + k, c] = answer[q, begin + c, k]
            _add(count, work, sums[q])


@kernel
def _solve(a: Floats, b: Floats, size: int, columns: int) -> bool:
    """Solve in place by Gauss with row pivots; False where the system is singular."""
    largest = 0.0
    for i in range(size):
        for j in range(size):
            largest = max(largest, abs(a[i, j]))
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        if not abs(a[pivot, k]) > SINGULAR * largest:
            return False
        if pivot != k:
            for j in range(k, size):
                a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
            for j in range(columns):
                b[k, j], b[pivot, j] = b[pivot, j], b[k, j]
        inverse = 1.0 / a[k, k]
        for i in range(k + 1, size):
            factor = a[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, size):
                    a[i, j] -= factor * a[k, j]
                for j in range(columns):
                    b[i, j] -= factor * b[k, j]
    for k in range(size - 1, -1, -1):
        inverse = 1.0 / a[k, k]
        for j in range(columns):
            total = b[k, j]
            for i in range(k + 1, size):
                total -= a[k, i] * b[i, j]
            b[k, j] = total * inverse
    return True


@kernel
def _balance(
    answer: Floats, x: Floats, stress: Floats, stretch: Floats, boundary: Floats, dead: Floats,
    size: float, stiffness: float, a: Floats, b: Floats,
) -> float:  # fmt: skip
    """Write the equations of one loop's centres and stress; return the force out of balance.

    Unknowns are the centres of all grains but the first, then `P size/stiffness`; `boundary` is
    over `size`, the root of the area. The first column of `b` is minus the residual.
    """
    n = len(answer)
    whole = 2 * n + 2
    a[:whole, :whole] = 0.0
    out_of_balance = 0.0
    for i in range(1, n):
        for u in range(2):
            row = 2 * (i - 1) + u
            pushed = stress[2 * u] * boundary[i, 0] + stress[2 * u + 1] * boundary[i, 1]
            residual = answer[i - 1, FX + u] - answer[i, FX + u] - dead[i, u] - size * pushed
            out_of_balance = max(out_of_balance, abs(residual))
            b[row, 0] = -residual
            for v in range(2):
                before, after = answer[i - 1, KXX + 2 * u + v], answer[i, KXX + 2 * u + v]
                a[row, 2 * (i - 1) + v] = -before - after
                if i > 1:
                    a[row, 2 * (i - 2) + v] = before
                if i < n - 1:
                    a[row, 2 * i + v] = after
                a[row, 2 * n - 2 + 2 * u + v] = -stiffness * boundary[i, v]
    for u in range(2):
        for v in range(2):
            row = 2 * n - 2 + 2 * u + v
            mean = 0.0
            for i in range(1, n):
                mean += x[i, u] * boundary[i, v]
                a[row, 2 * (i - 1) + u] = stiffness * boundary[i, v]
            residual = stiffness * (mean - size * stretch[2 * u + v])
            out_of_balance = max(out_of_balance, abs(residual))
            b[row, 0] = -residual
    return out_of_balance


@kernel
def relax_centres(
    answer: Floats, offsets: Integers, stretch: Floats, boundary: Floats, dead: Floats,
    size: Floats, x: Floats, end: Floats, stress: Floats, tangent: Floats, status: Integers,
) -> int:  # fmt: skip
    """Move the centres of loops under uniform stress one Newton step; return how many still move.

    `answer` (q, m, 8) of the contacts at the centres `x` (q, m, 2), whose branches are `end`;
    `stretch` (q, 4); `stress` (q, L, 4) and `tangent` (q, L, 16) are filled. Loops are left alone
    once their `status` (q, L) is not MOVING.
    """
    longest = 0
    for loop in range(len(offsets) - 1):
        longest = max(longest, offsets[loop + 1] - offsets[loop])
    a, b = np.empty((2 * longest + 2, 2 * longest + 2)), np.empty((2 * longest + 2, 4))
    moving = 0
    for q in range(answer.shape[0]):
        for loop in range(len(offsets) - 1):
            if status[q, loop] != MOVING:
                continue
            begin, stop = offsets[loop], offsets[loop + 1]
            n, whole = stop - begin, 2 * (stop - begin) + 2
            rows = answer[q, begin:stop]
            stiffness = 0.0
            for c in range(n):
                for k in range(KXX, KYY + 1):
                    stiffness = max(stiffness, abs(rows[c, k]))
            unbalanced = _balance(
                rows, x[q, begin:stop], stress[q, loop], stretch[q], boundary[begin:stop],
                dead[begin:stop], size[loop], stiffness, a, b,
            )  # fmt: skip
            done = unbalanced <= BALANCED * n / 6.0 * stiffness * size[loop]
            if done:
                b[:whole] = 0.0
                for k in range(4):
                    # dH = -dU: the residual of the strain grows by size dH.
                    b[2 * n - 2 + k, k] = -stiffness * size[loop]
            if not (stiffness > 0.0 and _solve(a, b, whole, 4 if done else 1)):
                status[q, loop] = LOST
                continue
            scale = stiffness / size[loop]
            if done:
                status[q, loop] = RELAXED
                for i in range(4):
                    for k in range(4):
                        tangent[q, loop, 4 * i + k] = scale * b[2 * n - 2 + i, k]
                continue
            moving += 1
            for i in range(1, n):
                x[q, begin + i, 0] += b[2 * i - 2, 0]
                x[q, begin + i, 1] += b[2 * i - 1, 0]
            for i in range(4):
                stress[q, loop, i] += scale * b[2 * n - 2 + i, 0]
            for c in range(n):
                after = begin + (c + 1) % n
                end[q, begin + c, 0] = x[q, after, 0] - x[q, begin + c, 0]
                end[q, begin + c, 1] = x[q, after, 1] - x[q, begin + c, 1]
    return moving


@kernel
def relaxed_sums(
    answer: Floats, offsets: Integers, weight: Floats, share: float, stress: Floats,
    tangent: Floats, lost: Flags, sums: Floats,
) -> None:  # fmt: skip
    """Add stress and tangent of the loops that are not lost to the sums (q, 24)."""
    for q in range(answer.shape[0]):
        for loop in range(len(weight)):
            if lost[q, loop]:
                continue
            w = share * weight[loop]
            for k in range(4):
                sums[q, P11 + k] += w * stress[q, loop, k]
            for k in range(16):
                sums[q, A11 + k] += w * tangent[q, loop, k]
            count_regimes(answer[q], offsets[loop], offsets[loop + 1], weight[loop], sums[q])
