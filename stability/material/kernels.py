"""Kernels of the material point: steps of many contacts, sums over loops, turns of the mean.

A contact goes from the branch `d_n` to `d` on a straight line. Its answer has eight rows, see `FX`;
its law is that of `loops.compiled.laws`, with slopes.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from loops.arrays import Floats
from loops.compiled import inlined, inlined_sum, kernel

# Rows of the answers: force, tangent -df/dd, shear force, regime.
FX, FY, KXX, KXY, KYX, KYY, SHEAR, REGIME = range(8)
ANSWER = 8
# Rows of a law: normal force, kt, strength, shear force that is kept; their slopes.
N, KT, MOST, KEPT, N_SLOPE, KT_SLOPE, MOST_SLOPE, KEPT_SLOPE = range(8)
# Rows of a chunk of contacts at work, behind those of the law and of the answer: branches at the
# start and the end, lengths at touch and at opening, overlaps at the start and the end, shear
# force at the start, and whether `_contact` takes it.
PX, PY, DX, DY, TOUCHING, OPENS, BEFORE, OVERLAP, SHEAR0, TAKEN, ROWS = range(16, 27)
# Contacts taken together: their rows stay in the nearest cache.
CHUNK = 256
OPEN, ELASTIC, SLIDING = 0.0, 1.0, 2.0
# Columns of the sums of a point: stress, tangent, shares stuck, sliding and open.
P11, A11, STUCK, SUMS = 0, 4, 20, 23
# (length over sum of the ends' lengths)^2 below which the series of atanh has all digits.
SHORT = 0.01
# A gap below this share of the length at touch is none: rounding of turned loops.
TOUCH = 1e-12
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
    over, inverse = 1.0 / length, 1.0 / (first + length)
    ex, ey = (dx - px) * inverse, (dy - py) * inverse
    q2 = ex * ex + ey * ey
    value, slope = _segment(q2, short)
    mean, stretch = 2.0 * value * inverse, 2.0 * slope * inverse * inverse
    shorter = stretch * q2 + mean * inverse
    along_x = stretch * ex - shorter * over * dx
    along_y = stretch * ey - shorter * over * dy
    return turn * mean, turn * along_x - py * mean, turn * along_y + px * mean


@inlined
def _closed(length: float, opens: float, normal: float) -> bool:
    """Return whether a contact is closed; one that just touches is if it has a stiffness there."""
    return (length < opens) | ((length < opens * (1.0 + TOUCH)) & (normal > 0.0))


@inlined
def _was_open(p2: float, opens: float) -> bool:
    """Return whether a branch of this square comes from beyond the touch."""
    return p2 - opens * opens > 2.0 * TOUCH * opens * opens


@kernel
def _slid_by_nodes(
    by_radii: bool, touching: float, opens: float, px: float, py: float, dx: float, dy: float,
    laws: Floats, c: int,
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Return the integral of `kt g t . dd` from `p` to `d` by Gauss points, and its gradients.

    Over `d`, and over `p` of the way back.
    """
    turn, power = px * dy - py * dx, 2.0 if by_radii else 1.0
    total, there_x, there_y, here_x, here_y = 0.0, 0.0, 0.0, 0.0, 0.0
    for g in range(5):
        s, kt, rise, kn = NODES[g], laws[g, KT, c], laws[g, KT_SLOPE, c], laws[g, N_SLOPE, c]
        gx, gy = px + s * (dx - px), py + s * (dy - py)
        r = math.sqrt(gx * gx + gy * gy)
        if _closed(r, opens, kn):
            share = WEIGHTS[g] * (touching / (r * r) if by_radii else 1.0 / r)
            total += kt * share
            slope = -turn * share / r * (kt * power / r + rise)
            there_x, there_y = there_x + slope * s * gx, there_y + slope * s * gy
            here_x, here_y = here_x - slope * (1.0 - s) * gx, here_y - slope * (1.0 - s) * gy
    lost_x, lost_y = there_x - py * total, there_y + px * total
    return turn * total, lost_x, lost_y, here_x - dy * total, here_y + dx * total


@kernel
def _since_touch(
    opens: float, px: float, py: float, dx: float, dy: float
) -> tuple[float, float, float, float, float, float]:
    """Return where an open branch that goes from `p` to `d` touches, and its derivatives over `d`.

    It touches at the length `opens`, at `p + s (d - p)`; the derivatives are those of x, then of y.
    """
    ex, ey, far = dx - px, dy - py, px * px + py * py - opens * opens
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
    c: int, closed: bool, dx: float, dy: float, over: float, lost: float, lost_x: float,
    lost_y: float, kept: float, law: Floats, answer: Floats,
) -> None:  # fmt: skip
    """Write the answer of a contact that loses so much shear, the rest cut to the strength.

    `over` is one over its length.
    """
    nx, ny, force, kn = dx * over, dy * over, law[N, c], law[N_SLOPE, c]
    limit, rise = law[MOST, c], law[MOST_SLOPE, c]
    # What is kept goes with the overlap; nothing is kept of nothing.
    trial = (0.0 if kept == 0.0 else law[KEPT, c]) - lost
    growth = 0.0 if kept == 0.0 else law[KEPT_SLOPE, c]
    slides = (abs(trial) > limit) | ((limit == 0.0) & (rise == 0.0))
    side = 1.0 if trial > 0.0 else -1.0
    T = side * limit if slides else trial
    T_x = -side * rise * nx if slides else -growth * nx - lost_x
    T_y = -side * rise * ny if slides else -growth * ny - lost_y
    a, b = force * over, T * over
    answer[FX, c] = force * nx - T * ny if closed else 0.0
    answer[FY, c] = force * ny + T * nx if closed else 0.0
    answer[KXX, c] = kn * nx * nx - a * ny * ny + ny * T_x - b * nx * ny if closed else 0.0
    answer[KXY, c] = kn * nx * ny + a * ny * nx + ny * T_y + b * nx * nx if closed else 0.0
    answer[KYX, c] = kn * ny * nx + a * nx * ny - nx * T_x - b * ny * ny if closed else 0.0
    answer[KYY, c] = kn * ny * ny - a * nx * nx - nx * T_y + b * ny * nx if closed else 0.0
    answer[SHEAR, c] = T if closed else 0.0
    answer[REGIME, c] = (SLIDING if slides else ELASTIC) if closed else OPEN


@inlined
def _short_ways(nodes: int, by_radii: bool, count: int, work: Floats) -> int:
    """Write the answers of contacts that are closed all along a short way, or open at the end.

    Returns the number of others, which are `TAKEN` one by one. Without branches, so that it is
    vectorised.
    """
    left, law, answer = 0, work[:ANSWER], work[ANSWER:PX]
    for c in range(count):
        px, py, dx, dy = work[PX, c], work[PY, c], work[DX, c], work[DY, c]
        touching, opens = work[TOUCHING, c], work[OPENS, c]
        p2, length = px * px + py * py, math.sqrt(dx * dx + dy * dy)
        over = 1.0 / length
        closed = _closed(length, opens, law[N_SLOPE, c])
        ends, way2 = math.sqrt(p2) + length, (dx - px) * (dx - px) + (dy - py) * (dy - py)
        long = (nodes > 0) | (way2 >= SHORT * ends * ends) | _was_open(p2, opens)
        slid, slid_x, slid_y = _slid(by_radii, True, touching, px, py, dx, dy)
        kt, slope = law[KT, c], law[KT_SLOPE, c] * slid * over
        lost_x, lost_y = kt * slid_x - slope * dx, kt * slid_y - slope * dy
        kept = work[SHEAR0, c]
        _answer(c, closed, dx, dy, over, kt * slid, lost_x, lost_y, kept, law, answer)
        takes = closed & long
        work[TAKEN, c] = 1.0 if takes else 0.0
        left += takes
    return left


@kernel
def _contact(by_radii: bool, nodes: int, c: int, work: Floats, laws: Floats) -> None:
    """Write the answer of a closed contact, whatever its way; `laws` at the nodes (5, 8, C)."""
    px, py, dx, dy = work[PX, c], work[PY, c], work[DX, c], work[DY, c]
    length, touching, opens = math.sqrt(dx * dx + dy * dy), work[TOUCHING, c], work[OPENS, c]
    # A contact that was open shears from its touch on, a point that moves with d.
    opened, xx, xy, yx, yy = _was_open(px * px + py * py, opens), 0.0, 0.0, 0.0, 0.0
    if opened:
        px, py, xx, xy, yx, yy = _since_touch(opens, px, py, dx, dy)
    if nodes > 0:
        lost, lost_x, lost_y, back_x, back_y = _slid_by_nodes(
            by_radii, touching, opens, px, py, dx, dy, laws, c
        )
    else:
        kt, slope = work[KT, c], work[KT_SLOPE, c]
        slid, slid_x, slid_y = _slid(by_radii, False, touching, px, py, dx, dy)
        _, back_x, back_y = _slid(by_radii, False, touching, dx, dy, px, py)
        lost, back_x, back_y = kt * slid, kt * back_x, kt * back_y
        lost_x = kt * slid_x - slope * slid * dx / length
        lost_y = kt * slid_y - slope * slid * dy / length
    if opened:
        lost_x -= back_x * xx + back_y * yx
        lost_y -= back_x * xy + back_y * yy
    law, answer = work[:ANSWER], work[ANSWER:PX]
    _answer(c, True, dx, dy, 1.0 / length, lost, lost_x, lost_y, work[SHEAR0, c], law, answer)


@inlined
def _overlaps(count: int, work: Floats) -> None:
    """Write overlaps at the start and the end."""
    for c in range(count):
        px, py, dx, dy = work[PX, c], work[PY, c], work[DX, c], work[DY, c]
        work[BEFORE, c] = work[TOUCHING, c] - min(math.sqrt(px * px + py * py), work[OPENS, c])
        work[OVERLAP, c] = work[TOUCHING, c] - min(math.sqrt(dx * dx + dy * dy), work[OPENS, c])


@kernel
def _overlaps_on_the_way(g: int, count: int, work: Floats) -> None:
    """Write the overlaps at a node of the ways that contacts go while they are closed."""
    for c in range(count):
        px, py, dx, dy = work[PX, c], work[PY, c], work[DX, c], work[DY, c]
        opens = work[OPENS, c]
        if _was_open(px * px + py * py, opens):
            px, py = _since_touch(opens, px, py, dx, dy)[:2]
        gx, gy = px + NODES[g] * (dx - px), py + NODES[g] * (dy - py)
        work[OVERLAP, c] = work[TOUCHING, c] - min(math.sqrt(gx * gx + gy * gy), opens)


@kernel
def contact_steps(
    fill: Any, constants: Floats, radii: Floats, touching: Floats, nodes: int, by_radii: bool,
    start: Floats, end: Floats, shear: Floats, answer: Floats,
) -> None:  # fmt: skip
    """Write the answers (q, 8, m) of contacts that move from `start` to `end`, (q, m, 2).

    The law is what `fill` gives of the `constants` (q or 1, 1 + nodes or 1, chunks, n, C) and of
    `radii` (chunks, 2, C) in chunks of C contacts, at the end and at the nodes. `touching`
    (chunks, 2, C) are the lengths at touch, and those at which contacts open. Where C is a
    multiple of m a chunk has the contacts of several points.
    """
    work, laws = np.empty((ROWS, CHUNK)), np.empty((5, 8, CHUNK))
    size, each = radii.shape[2], shear.shape[1]
    last_q, last_g, together = len(constants) - 1, constants.shape[1] - 1, max(1, size // each)
    u, v, force = start.reshape((-1, 2)), end.reshape((-1, 2)), shear.reshape(-1)
    for begin in range(0, each, size):
        chunk, part = begin // size, min(size, each - begin)
        for q in range(0, len(end), together):
            points = min(together, len(end) - q)
            first, count, own = q * each + begin, points * part, constants[min(q, last_q)]
            overlap, before = work[OVERLAP, :count], work[BEFORE, :count]
            shear0 = work[SHEAR0, :count]
            for c in range(count):
                work[PX, c], work[PY, c] = u[first + c, 0], u[first + c, 1]
                work[DX, c], work[DY, c] = v[first + c, 0], v[first + c, 1]
                work[TOUCHING, c], work[OPENS, c] = touching[chunk, 0, c], touching[chunk, 1, c]
                work[SHEAR0, c] = force[first + c]
            _overlaps(count, work)
            fill(own[0, chunk], radii[chunk], overlap, before, shear0, work[:ANSWER])
            for g in range(nodes):
                _overlaps_on_the_way(g, count, work)
                given = own[min(g + 1, last_g), chunk]
                fill(given, radii[chunk], overlap, before, shear0, laws[g])
            left = _short_ways(nodes, by_radii, count, work)
            for c in range(count if left > 0 else 0):
                if work[TAKEN, c] > 0.0:
                    _contact(by_radii, nodes, c, work, laws)
            for p in range(points):
                for k in range(ANSWER):
                    for c in range(part):
                        answer[q + p, k, begin + c] = work[ANSWER + k, p * part + c]


@kernel
def strained(U: Floats, branches: Floats, out: Floats) -> None:
    """Write the branches (q, m, 2) under stretches (q, 2, 2) of those (m, 2) at the start."""
    for q in range(len(U)):
        xx, xy, yx, yy = U[q, 0, 0], U[q, 0, 1], U[q, 1, 0], U[q, 1, 1]
        for c in range(len(branches)):
            x, y = branches[c, 0], branches[c, 1]
            out[q, c, 0], out[q, c, 1] = xx * x + xy * y, yx * x + yy * y


@inlined_sum
def regime_sums(answer: Floats, share: Floats, sums: Floats) -> None:
    """Add up the regimes of contacts (q, 8, m) that have a `share` (q or 1, m)."""
    for q in range(len(answer)):
        own = share[min(q, len(share) - 1)]
        for k in range(3):
            total = 0.0
            for c in range(len(own)):
                total += own[c] if answer[q, REGIME, c] == (k + 1) % 3 else 0.0
            sums[q, STUCK + k] += total


@kernel
def nominal_response(R: Floats, U: Floats, B: Floats, A: Floats) -> tuple[Floats, Floats]:
    """Return the nominal stress (Q, 2, 2) and its tangent (Q, 2, 2, 2, 2) `dP/dH`, `H = 1 - F`.

    `B` (Q, 2, 2) is the stress in the frame of `U` and `A` (Q, 2, 2, 2, 2) its tangent over
    `1 - U`. Of `B` only the symmetric part does work on `U'`; the rest is the couple by which the
    spins are held, and has no place in a stress that does no work under a rotation. So
    `P = R (sym B + c E)`, with `c` such that the Cauchy stress is symmetric.
    """
    stress, tangent = np.empty(B.shape), np.empty(A.shape)
    X, dX, G, dB = np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2)), np.empty((2, 2))
    for q in range(len(U)):
        u11, u12, u22 = U[q, 0, 0], U[q, 0, 1], U[q, 1, 1]
        trace, b12 = u11 + u22, 0.5 * (B[q, 0, 1] + B[q, 1, 0])
        b11, b22 = B[q, 0, 0], B[q, 1, 1]
        # (sym B + c E) U is symmetric, E = (0, 1; -1, 0).
        c = -(u12 * (b11 - b22) + b12 * (u22 - u11)) / trace
        X[0, 0], X[0, 1], X[1, 0], X[1, 1] = b11, b12 + c, b12 - c, b22
        for i in range(2):
            for j in range(2):
                stress[q, i, j] = R[q, i, 0] * X[0, j] + R[q, i, 1] * X[1, j]
        for k in range(2):
            for m in range(2):
                # Of a unit change of F_km: R^T dF, the angle, U, sym B and c.
                G[:] = 0.0
                G[0, m], G[1, m] = R[q, k, 0], R[q, k, 1]
                angle = -(G[0, 1] - G[1, 0]) / trace
                # R' = angle R J, J = (0, -1; 1, 0), so dU = R^T dF - angle J U.
                d11, d22 = G[0, 0] + angle * u12, G[1, 1] - angle * u12
                d12 = 0.5 * (G[0, 1] + G[1, 0] + angle * (u22 - u11))
                for i in range(2):
                    for j in range(2):
                        a = A[q, i, j]
                        dB[i, j] = -(a[0, 0] * d11 + (a[0, 1] + a[1, 0]) * d12 + a[1, 1] * d22)
                e12 = 0.5 * (dB[0, 1] + dB[1, 0])
                first = u12 * (dB[0, 0] - dB[1, 1]) + e12 * (u22 - u11)
                second = d12 * (b11 - b22) + b12 * (d22 - d11)
                dc = -(first + second + c * (d11 + d22)) / trace
                dX[0, 0], dX[0, 1] = dB[0, 0] - angle * X[1, 0], e12 + dc - angle * X[1, 1]
                dX[1, 0], dX[1, 1] = e12 - dc + angle * X[0, 0], dB[1, 1] + angle * X[0, 1]
                for i in range(2):
                    for j in range(2):
                        turned = R[q, i, 0] * dX[0, j] + R[q, i, 1] * dX[1, j]
                        tangent[q, i, j, k, m] = -turned
    return stress, tangent
