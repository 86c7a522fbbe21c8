"""Kernels of the material point: one step of many contacts, and of loops whose centres relax.

A contact goes from the branch `d_n` to `d` on a straight line. A row of its answer has eight
columns, see `FX`; a row of its parameters four, see `TOUCHING`.
"""

from __future__ import annotations

import math

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.compiled import kernel

# Columns of a contact's answer: force, tangent -df/dd, shear force, regime.
FX, FY, KXX, KXY, KYX, KYY, SHEAR, REGIME = range(8)
ANSWER = 8
# Columns of a contact's parameters: length at touch; kn, or the factor a of N = a delta^(3/2);
# kt, or kt/kn; friction.
TOUCHING, NORMAL, TANGENTIAL, FRICTION = range(4)
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


@kernel
def _segment(q2: float) -> tuple[float, float]:
    """Return `atanh(q)/q` and its derivative over q, from `q^2`."""
    if q2 < SHORT:
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


@kernel
def _contact(
    kind: int, by_radii: bool, parameters: Floats, px: float, py: float, dx: float, dy: float,
    before: float, row: Floats,
) -> None:  # fmt: skip
    """Write the answer of a contact that moves from the branch `p` to `d`, `before` its shear."""
    touching, normal = parameters[TOUCHING], parameters[NORMAL]
    tangential, mu = parameters[TANGENTIAL], parameters[FRICTION]
    length = math.sqrt(dx * dx + dy * dy)
    # A linear contact that just touches has its stiffness; a Hertzian one has none yet.
    reach = touching * (1.0 + TOUCH) if kind == LINEAR else touching
    if not length < reach:
        for column in range(REGIME):
            row[column] = 0.0
        row[REGIME] = OPEN
        return
    nx, ny = dx / length, dy / length
    overlap = max(touching - length, 0.0)
    if kind == LINEAR:
        force, kn = normal * overlap, normal
    else:
        kn = 1.5 * normal * math.sqrt(overlap)
        force = kn * overlap / 1.5
    # A contact that was open shears from its touch at p = d_n + s (d - d_n) on;
    # `m` is dp/dd.
    m00, m01, m10, m11 = 0.0, 0.0, 0.0, 0.0
    far = px * px + py * py - touching * touching
    if far > 2.0 * TOUCH * touching * touching:
        ex, ey = dx - px, dy - py
        approach = px * ex + py * ey
        root = approach * approach - (ex * ex + ey * ey) * far
        root = math.sqrt(max(root, TOUCH * approach * approach))
        s = far / (root - approach)
        px, py, before = px + s * ex, py + s * ey, 0.0
        m00, m01 = s * (1.0 + ex * px / root), s * ex * py / root
        m10, m11 = s * ey * px / root, s * (1.0 + ey * py / root)
    ex, ey = dx - px, dy - py
    turn = px * dy - py * dx
    turn_x = m00 * dy - m10 * dx - py
    turn_y = m01 * dy - m11 * dx + px
    first = math.sqrt(px * px + py * py)
    if kind == HERTZ_FORCE:
        total, total_x, total_y = 0.0, 0.0, 0.0
        for g in range(5):
            s = NODES[g]
            gx, gy = px + s * ex, py + s * ey
            r = math.sqrt(gx * gx + gy * gy)
            depth = max(touching - r, 0.0)
            root = math.sqrt(depth)
            share = touching / (r * r) if by_radii else 1.0 / r
            power = 2.0 if by_radii else 1.0
            kt = 1.5 * tangential * normal * root
            total += WEIGHTS[g] * kt * share
            slope = -kt * share * power / r
            if depth > 0.0:
                slope -= 0.75 * tangential * normal / root * share
            slope *= WEIGHTS[g] / r
            ahead = 1.0 - s
            total_x += slope * (gx * (ahead * m00 + s) + gy * ahead * m10)
            total_y += slope * (gx * ahead * m01 + gy * (ahead * m11 + s))
        trial = before - turn * total
        trial_x = -(turn_x * total + turn * total_x)
        trial_y = -(turn_y * total + turn * total_y)
    else:
        # slid: the integral of g t . dd along the branch's line.
        if by_radii:
            slid = touching * math.atan2(turn, px * dx + py * dy)
            ratio, r2 = touching / length, touching / (first * first)
            slid_x = -ratio * ny - r2 * (px * m10 - py * m00)
            slid_y = ratio * nx - r2 * (px * m11 - py * m01)
        else:
            ends = first + length
            q2 = (ex * ex + ey * ey) / (ends * ends)
            value, slope = _segment(q2)
            mean = 2.0 * value / ends
            ends_x = nx + (px * m00 + py * m10) / first
            ends_y = ny + (px * m01 + py * m11) / first
            e_x = (ex - ex * m00 - ey * m10) / ends
            e_y = (ey - ex * m01 - ey * m11) / ends
            stretch = 2.0 * slope / (ends * ends)
            slid = turn * mean
            slid_x = turn_x * mean + turn * (stretch * (e_x - q2 * ends_x) - mean * ends_x / ends)
            slid_y = turn_y * mean + turn * (stretch * (e_y - q2 * ends_y) - mean * ends_y / ends)
        kt = tangential if kind == LINEAR else tangential * kn
        trial = before - kt * slid
        trial_x, trial_y = -kt * slid_x, -kt * slid_y
        if kind == HERTZ_DISPLACEMENT:
            # T = -kt(delta) xi: what was there changes with kt.
            kept = 0.0
            if before != 0.0:
                kept = before / math.sqrt(max(touching - first, 0.0) / overlap)
            growth = -0.5 * (kept - kt * slid) / overlap
            trial += kept - before
            trial_x += growth * nx
            trial_y += growth * ny
    regime = ELASTIC
    limit = mu * force
    if abs(trial) > limit or mu == 0.0:
        side = 1.0 if trial > 0.0 else -1.0
        trial, regime = side * limit, SLIDING
        trial_x, trial_y = -side * mu * kn * nx, -side * mu * kn * ny
    a, b = force / length, trial / length
    row[FX], row[FY] = force * nx - trial * ny, force * ny + trial * nx
    row[KXX] = kn * nx * nx - a * ny * ny + ny * trial_x - b * nx * ny
    row[KXY] = kn * nx * ny + a * ny * nx + ny * trial_y + b * nx * nx
    row[KYX] = kn * ny * nx + a * nx * ny - nx * trial_x - b * ny * ny
    row[KYY] = kn * ny * ny - a * nx * nx - nx * trial_y + b * ny * nx
    row[SHEAR], row[REGIME] = trial, regime


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


@kernel
def _add_affine(row: Floats, x: float, y: float, w: float, sums: Floats) -> None:
    """Add stress and tangent of one contact of reference branch (x, y), `w` times."""
    xx, xy, yy = w * x * x, w * x * y, w * y * y
    for i in range(2):
        sums[P11 + 2 * i] += w * row[FX + i] * x
        sums[P11 + 2 * i + 1] += w * row[FX + i] * y
        for k in range(2):
            stiffness, at = row[KXX + 2 * i + k], A11 + 8 * i + 2 * k
            sums[at] += stiffness * xx
            sums[at + 1] += stiffness * xy
            sums[at + 4] += stiffness * xy
            sums[at + 5] += stiffness * yy


@kernel
def affine_sums(
    answer: Floats, branches: Floats, offsets: Integers, density: Floats, weight: Floats,
    sums: Floats,
) -> None:  # fmt: skip
    """Add stress and tangent of loops whose centres follow the strain to the sums (q, 24).

    `density` (L,) is the weight over the area, for forces.
    """
    for q in range(answer.shape[0]):
        for loop in range(len(density)):
            begin, end = offsets[loop], offsets[loop + 1]
            for c in range(begin, end):
                x, y = branches[c, 0], branches[c, 1]
                _add_affine(answer[q, c], x, y, density[loop], sums[q])
            count_regimes(answer[q], begin, end, weight[loop], sums[q])


@kernel
def affine_steps(
    kind: int, by_radii: bool, parameters: Floats, branches: Floats, offsets: Integers,
    density: Floats, weight: Floats, start: Floats, end: Floats, shear: Floats, new: Floats,
    sums: Floats,
) -> None:  # fmt: skip
    """Take the steps from the stretch `start` to `end`, (q, 4), and add up as `affine_sums`.

    The shear forces at the end are written to `new` (q, m).
    """
    longest = 0
    for loop in range(len(offsets) - 1):
        longest = max(longest, offsets[loop + 1] - offsets[loop])
    rows = np.empty((longest, ANSWER))
    for q in range(start.shape[0]):
        u, v = start[q], end[q]
        for loop in range(len(density)):
            begin, stop = offsets[loop], offsets[loop + 1]
            for c in range(begin, stop):
                x, y = branches[c, 0], branches[c, 1]
                row = rows[c - begin]
                _contact(
                    kind, by_radii, parameters[c], u[0] * x + u[1] * y, u[2] * x + u[3] * y,
                    v[0] * x + v[1] * y, v[2] * x + v[3] * y, shear[q, c], row,
                )  # fmt: skip
                new[q, c] = row[SHEAR]
                _add_affine(row, x, y, density[loop], sums[q])
            count_regimes(rows, 0, stop - begin, weight[loop], sums[q])


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
def relax(
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
