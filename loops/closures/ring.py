"""The equations of a ring: one loop under either closure, its tangent and a bound on the error.

A contact moves by `e = (e_n, e_t)` in its frame and answers with the force rate

    f = -K e + q z,    K = [[D_nn, D_nt g + T/l], [D_tn, D_tt g - N/l]],    q = (D_nt, D_tt),

`z = b_i w_i + b_j w_j` the part of the shear that spins make. Under the traction closure

    f = f^ - P m,    sum e = 0,    sum e (x) m = V0 H;

under the affine closure `e = -H d0` and `P = (1/V0) sum f (x) d0`. Triangles are affine under
either: three forces have as many components as `f^` and `P`.

Each contact is condensed exactly. Its motion is eliminated where `K` can be inverted; one that is
soft in shear, as sliding ones are, keeps `e_t`; one without normal stiffness keeps `e`. Where free
spins are felt the contact keeps its roll, a multiple of `z`, with the moments in the same
combination as the spins,

    (b_i/r_i^2) M_i + (b_j/r_j^2) M_j = 0.

So translations, and spins that no contact feels, never are unknowns. The gear mode of a whole ring
(every contact felt, `z = 0`) is left out with the moment that would have to balance it: the limit
of spins with a vanishing resistance. The unknowns are what the contacts keep, then `f^`, then `P`.

Functions take one ring, its contacts as rows of numbers, or many of one order: each number is then
an array. As they stand numpy runs them, for a few loops; `loops.closures.rings` compiles them for
many.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from loops.arrays import ROUNDING, Flags, Floats, Integers

AFFINE, TRACTION = 0, 1
BLOCKED, TURNING, FREE = 0, 1, 2  # spins: held, with the loop, relaxed
# Columns of a contact in units of the ring's length and stiffness; those of `contact_rows` come
# first: length, arms of spins, forces, growth of the shear displacement,
# stiffness of the law; normal, m and reference branch, radii; K, the motions `-S f` per force, q
# and the motion by a roll, their common unit, factors of the moments.
LENGTH, BI, BJ, FN, FT, G, DNN, DNT, DTN, DTT, NX, NY, MX, MY, DX, DY, RI, RJ = range(18)
KNN, KNT, KTN, KTT, SNN, SNT, STN, STT, QN, QT, ZN, ZT, FELT, TURN_N, TURN_T = range(18, 33)
WI, WJ, WIDE_I, WIDE_J = range(33, 37)
GIVEN, COLUMNS = 10, 37
# A contact keeps e_t below this determinant of its block over its normal stiffness squared, and e
# below this normal stiffness over the ring's.
SOFT, NO_NORMAL = 0.05, 1e-3
# Of a scaled system; below it null vectors are looked for.
LEAST_PIVOT = 1e-12
# With larger pivots rounding of the tangent by other arms is nothing beside what the arms change.
POOR = 1e-4
# Beyond this share of the operator a bound of first order in rounding means nothing.
ERROR_LIMIT = 0.1
# Rows of equations are treated in multiples of so many numbers: the processor's vectors.
LANES = 16
SWEEPS = 4  # of Jacobi's rotations, which converge quadratically
KEPT, FIRST, ROLL = 0, 1, 2  # rows of `Ring.places`
NO_GEAR, GEAR, UNSURE = 0, 1, 2
MOVING, RELAXED, LOST = 0, 1, 2  # while a ring goes to its balance
# Force out of balance over stiffness and length of a loop of six at which it is relaxed: some
# hundred times the rounding of its terms.
BALANCED = 1e-13
# Arms are shared as the radii within this of each other; rounding of one share is half of it.
SHARED = 4 * float(np.finfo(np.float64).eps)


class Ring(NamedTuple):
    """Contacts of a ring (n, COLUMNS), and the places of its unknowns (3, n + 1).

    Rows of `places`: how many motions of a contact are unknowns under traction; the place of its
    first unknown, at last that of `f^` or, affine, `P`; the place of its roll, -1 without one.
    """

    contacts: Floats
    places: Integers


class Solver(NamedTuple):
    """Arrays for a solve of N equations.

    Room for the equations `E` and the multipliers `below`, flat; the unknowns `X` and the rows of
    the inverse `Y` (N, 4); sizes of unknowns, of equations and scales of these (3, N); the order
    of the rows (N,).
    """

    E: Floats
    below: Floats
    X: Floats
    Y: Floats
    sizes: Floats
    order: Integers


def solver_of(N: int) -> Solver:
    """Return the arrays for a solve of N equations."""
    return Solver(
        np.empty(N * (N + 3 + LANES)), np.empty(N * N), np.empty((N, 4)), np.empty((N, 4)),
        np.empty((3, N)), np.empty(N, np.int64),
    )  # fmt: skip


def fill_ring(
    ring: Ring, rows: Floats, branches: Floats, reference: Floats, radii: Floats, begin: int,
    n: int, grains: Integers, contacts: Integers, forward: Flags,
) -> tuple[Any, Any, Any]:  # fmt: skip
    """Fill in the contacts of a ring from those of a packing.

    Return its area; the sum of the sizes of the terms of the area, `m . d0/2`, over it; its
    stiffness.
    """
    own = ring.contacts
    x, y, double, terms, moment_x, moment_y, stiffness = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(n):
        row, sign = contacts[begin + c], 1.0 if forward[begin + c] else -1.0
        dx, dy = sign * reference[row, 0], sign * reference[row, 1]
        next_x, next_y = x + dx, y + dy
        weight = x * next_y - y * next_x
        double = double + weight
        moment_x = moment_x + weight * (x + next_x)
        moment_y = moment_y + weight * (y + next_y)
        own[c, DX], own[c, DY] = dx, dy
        # m is the middle of an edge turned by a quarter.
        own[c, MX], own[c, MY] = y + 0.5 * dy, -(x + 0.5 * dx)
        stiffness = stiffness + abs(rows[row, DNN]) + abs(rows[row, DTT])
        x, y = next_x, next_y
    side = 1.0 - 2.0 * (double < 0.0)
    stiffness = stiffness / n + (stiffness == 0.0)
    per_length, per_stiffness = 1.0 / np.sqrt(0.5 * side * double), 1.0 / stiffness
    per_force = per_length * per_stiffness
    middle_x, middle_y = moment_x / (3.0 * double), moment_y / (3.0 * double)
    for c in range(n):
        h, row = begin + c, contacts[begin + c]
        own[c, MX] = side * per_length * (own[c, MX] - middle_y)
        own[c, MY] = side * per_length * (own[c, MY] + middle_x)
        own[c, DX], own[c, DY] = own[c, DX] * per_length, own[c, DY] * per_length
        terms = terms + 0.5 * (abs(own[c, MX] * own[c, DX]) + abs(own[c, MY] * own[c, DY]))
        over = 1.0 / rows[row, LENGTH]
        sign = over if forward[h] else -over
        own[c, NX], own[c, NY] = sign * branches[row, 0], sign * branches[row, 1]
        own[c, TURN_N] = over * rows[row, FN] * per_stiffness
        own[c, TURN_T] = over * rows[row, FT] * per_stiffness
        own[c, LENGTH] = rows[row, LENGTH] * per_length
        own[c, FN], own[c, FT] = rows[row, FN] * per_force, rows[row, FT] * per_force
        own[c, BI] = rows[row, BI if forward[h] else BJ] * per_length
        own[c, BJ] = rows[row, BJ if forward[h] else BI] * per_length
        own[c, RI] = radii[grains[h]] * per_length
        own[c, RJ] = radii[grains[h + 1 if c + 1 < n else begin]] * per_length
        own[c, G] = rows[row, G]
        for k in range(DNN, DTT + 1):
            own[c, k] = rows[row, k] * per_stiffness
        turn_block(ring, c)
    return 0.5 * side * double, terms, stiffness


def turn_block(ring: Ring, c: int) -> None:
    """Compute what a contact answers to motions, in its turning frame, and to rolls."""
    own = ring.contacts
    own[c, KNN], own[c, KTN] = own[c, DNN], own[c, DTN]
    own[c, KNT] = own[c, DNT] * own[c, G] + own[c, TURN_T]
    own[c, KTT] = own[c, DTT] * own[c, G] - own[c, TURN_N]
    felt = abs(own[c, DNT]) + abs(own[c, DTT])
    over = 1.0 / (felt + (felt == 0.0))
    own[c, FELT], own[c, QN], own[c, QT] = felt, own[c, DNT] * over, own[c, DTT] * over


def kept_motions(ring: Ring, c: int) -> Any:
    """Return how many components of its motion a contact keeps under traction, 0 to 2."""
    own = ring.contacts
    det = own[c, KNN] * own[c, KTT] - own[c, KNT] * own[c, KTN]
    rigid = abs(own[c, KNN]) > NO_NORMAL
    return 2 - 2 * rigid + rigid * (abs(det) < SOFT * own[c, KNN] * own[c, KNN])


def condense(ring: Ring, c: int) -> None:
    """Compute the motion of a contact by its force and its roll, as far as it is not kept."""
    own, kept = ring.contacts, ring.places[KEPT, c]
    if kept == 0:
        over = 1.0 / (own[c, KNN] * own[c, KTT] - own[c, KNT] * own[c, KTN])
        own[c, SNN], own[c, STT] = own[c, KTT] * over, own[c, KNN] * over
        own[c, SNT], own[c, STN] = -own[c, KNT] * over, -own[c, KTN] * over
    else:
        own[c, SNN] = 1.0 / own[c, KNN] if kept == 1 else 0.0
        own[c, SNT], own[c, STN], own[c, STT] = 0.0, 0.0, 0.0
    own[c, ZN] = own[c, SNN] * own[c, QN] + own[c, SNT] * own[c, QT]
    own[c, ZT] = own[c, STN] * own[c, QN] + own[c, STT] * own[c, QT]


def place_unknowns(ring: Ring, n: int, closure: int) -> int:
    """Number the unknowns; a contact with a roll is marked by `roll` 0, not -1. Return N."""
    at = 0
    for c in range(n):
        ring.places[FIRST, c] = at
        at += ring.places[KEPT, c] * closure
        if ring.places[ROLL, c] >= 0:
            ring.places[ROLL, c] = at
            at += 1
    ring.places[FIRST, n] = at
    return at + 4 + 2 * closure


def put(
    ring: Ring, A: Floats, n: int, closure: int, c: int, column: int, en: Any, et: Any, fn: Any,
    ft: Any, z: Any,
) -> None:  # fmt: skip
    """Add to the equations what an unknown does at a contact: motion, force and roll."""
    own, P = ring.contacts, ring.places[FIRST, n]
    nx, ny = own[c, NX], own[c, NY]
    if closure == TRACTION:
        vx, vy, lever_x, lever_y = nx * en - ny * et, ny * en + nx * et, own[c, MX], own[c, MY]
        A[P, column] += vx
        A[P + 1, column] += vy
        kept, first = ring.places[KEPT, c], ring.places[FIRST, c]
        if kept == 2:
            A[first, column] += fn + own[c, KNN] * en + own[c, KNT] * et - own[c, QN] * z
        if kept > 0:
            answer = ft + own[c, KTN] * en + own[c, KTT] * et - own[c, QT] * z
            A[first + kept - 1, column] += answer
        P += 2
    else:
        vx, vy, lever_x, lever_y = ny * ft - nx * fn, -ny * fn - nx * ft, own[c, DX], own[c, DY]
    A[P, column] += vx * lever_x
    A[P + 1, column] += vx * lever_y
    A[P + 2, column] += vy * lever_x
    A[P + 3, column] += vy * lever_y
    if len(A) > P + 4:
        # Moments on the grains of the contact, `-a T' - T e_n/2`.
        push, half = own[c, TURN_N] * et - ft, 0.5 * own[c, FT] * en
        apart = 0.5 * (own[c, RI] - own[c, RJ])
        A[P + 4 + c, column] += (0.5 * own[c, LENGTH] + apart) * push - half
        A[P + 4 + (c + 1 if c + 1 < n else 0), column] += (
            0.5 * own[c, LENGTH] - apart
        ) * push - half


def assemble(ring: Ring, A: Floats, n: int, closure: int, spins: int, turn: Floats) -> None:
    """Write the N equations of the unknowns, then of `H`: `A` (N, N + 4), but those of the rolls.

    Below, if the spins are free, the moments of the n grains. `turn` (4,) is the spin of turning
    grains per component of `H`.
    """
    own, P = ring.contacts, ring.places[FIRST, n] + 2 * closure
    N = P + 4
    A[: len(A)] = 0.0
    for i in range(4):
        A[P + i, N + i if closure == TRACTION else P + i] = 1.0 - 2.0 * closure
    for c in range(n):
        nx, ny, first, roll = own[c, NX], own[c, NY], ring.places[FIRST, c], ring.places[ROLL, c]
        b = own[c, FELT] * (own[c, BI] + own[c, BJ])
        if closure == TRACTION:
            kept, zn, zt = ring.places[KEPT, c], own[c, ZN], own[c, ZT]
            if kept == 1:
                put(ring, A, n, closure, c, first, -own[c, KNT] / own[c, KNN], 1.0, 0.0, 0.0, 0.0)
            elif kept == 2:
                put(ring, A, n, closure, c, first, 1.0, 0.0, 0.0, 0.0, 0.0)
                put(ring, A, n, closure, c, first + 1, 0.0, 1.0, 0.0, 0.0, 0.0)
            for i in range(2):
                fn, ft = (ny, nx) if i else (nx, -ny)
                en, et = -own[c, SNN] * fn - own[c, SNT] * ft, -own[c, STN] * fn - own[c, STT] * ft
                # A contact bears f^ itself and P times -m.
                put(ring, A, n, closure, c, P - 2 + i, en, et, fn, ft, 0.0)
                for j in range(2):
                    m = -own[c, MX + j]
                    put(ring, A, n, closure, c, P + 2 * i + j, m * en, m * et, m * fn, m * ft, 0.0)
            if roll >= 0:
                put(ring, A, n, closure, c, roll, zn, zt, 0.0, 0.0, 1.0)
            if spins == TURNING:
                for i in range(4):
                    z = b * turn[i]
                    put(ring, A, n, closure, c, N + i, z * zn, z * zt, 0.0, 0.0, z)
        else:
            if roll >= 0:
                put(ring, A, n, closure, c, roll, 0.0, 0.0, own[c, QN], own[c, QT], 1.0)
            for i in range(4):
                d, z = own[c, DX + (i & 1)], b * turn[i]
                en, et = (-ny * d, -nx * d) if i & 2 else (-nx * d, ny * d)
                fn = own[c, QN] * z - own[c, KNN] * en - own[c, KNT] * et
                ft = own[c, QT] * z - own[c, KTN] * en - own[c, KTT] * et
                put(ring, A, n, closure, c, N + i, en, et, fn, ft, z)


def load(ring: Ring, E: Floats, n: int, c: int, column: int) -> None:
    """Add to the equations of a ring under traction what a contact bears, and its branch."""
    own = ring.contacts
    an, at, nx, ny = own[c, FN], own[c, FT], own[c, NX], own[c, NY]
    dn, dt = nx * own[c, DX] + ny * own[c, DY], nx * own[c, DY] - ny * own[c, DX]
    en, et = own[c, SNN] * an + own[c, SNT] * at, own[c, STN] * an + own[c, STT] * at
    fn = -an - own[c, KNN] * dn - own[c, KNT] * dt
    ft = -at - own[c, KTN] * dn - own[c, KTT] * dt
    put(ring, E, n, TRACTION, c, column, dn + en, dt + et, fn, ft, 0.0)


def balance_rolls(ring: Ring, A: Floats, n: int, N: int, gear: Any, E: Floats) -> None:
    """Write all equations, those of the rolls from the moments in `A`: `E` (N, N + 4).

    Where `gear` is 1 the ring has a gear mode: the last of its dependent equations is replaced.
    """
    own, columns, roll = ring.contacts, E.shape[1], -1
    E[:N] = A[:N]
    for c in range(n):
        roll, after = ring.places[ROLL, c], N + (c + 1 if c + 1 < n else 0)
        if roll >= 0:
            wi, wj = own[c, WI], own[c, WJ]
            for j in range(columns):
                E[roll, j] = wi * A[N + c, j] + wj * A[after, j]
    if roll >= 0:
        for j in range(columns):
            E[roll, j] *= 1.0 - gear
        # Rolls of any spins; their signs alternate.
        weight = gear * 1.0
        for c in range(n):
            if ring.places[ROLL, c] >= 0:
                E[roll, ring.places[ROLL, c]] += weight / (own[c, FELT] + (own[c, FELT] == 0.0))
            weight = -weight * own[c, BJ] / own[c + 1 if c + 1 < n else 0, BI]


def gear_mode(ring: Ring, n: int) -> int:
    """Return whether a ring has a gear mode: the ratios of the arms around it multiply to one.

    They do where all contacts feel the spins and share them as the radii, or between grains of
    one size. `UNSURE` where rounding decides.
    """
    own, ratio, doubt, shared, equal = ring.contacts, 1.0, 0.0, 0, 0
    if n % 2 == 1:
        return NO_GEAR
    for c in range(n):
        bi, bj, ri, rj = own[c, BI], own[c, BJ], own[c, RI], own[c, RJ]
        if own[c, DNT] == 0.0 and own[c, DTT] == 0.0:
            return NO_GEAR
        shared += abs(bi * (ri + rj) - ri * (bi + bj)) <= SHARED * (bi + bj) * (ri + rj)
        equal += bi == bj
        ratio *= bj / bi
        doubt += (own[c, LENGTH] + ri + rj) * (1.0 / bi + 1.0 / bj)
    if shared == n or equal == n:
        return GEAR
    return NO_GEAR if abs(ratio - 1.0) > ROUNDING * doubt else UNSURE


def share_otherwise(ring: Ring, n: int, arms: Floats) -> None:
    """Share the `arms` of spins (n, 2), by the other rule: the point of contact, or the radii."""
    own = ring.contacts
    for c in range(n):
        arms[c, 0], arms[c, 1] = own[c, BI], own[c, BJ]
        total, touching = own[c, BI] + own[c, BJ], own[c, RI] + own[c, RJ]
        share = own[c, RI] / touching - own[c, BI] / total
        share += 0.5 + 0.5 * (own[c, RI] - own[c, RJ]) / own[c, LENGTH]
        own[c, BI], own[c, BJ] = share * total, (1.0 - share) * total


def sum_sizes(
    ring: Ring, n: int, closure: int, gear: Any, X: Floats, H: Any, turn: Floats, out: Floats
) -> None:
    """Sum the sizes of the terms of every equation, for sizes of the unknowns and of `H` (4,).

    Rounding changes an equation by so much times `ROUNDING`. `turn` (4,) is the size of what it is
    in `assemble`, and of its error. Sums of lengths stand for arms that are their differences.
    """
    own, P = ring.contacts, ring.places[FIRST, n]
    for i in range(P + (6 if closure == TRACTION else 4)):
        out[i] = 0.0 * X[0]
    spin = turn[0] * H[0] + turn[1] * H[1] + turn[2] * H[2] + turn[3] * H[3]
    reach_x, reach_y = 0.0, 0.0
    for c in range(n):
        reach_x = reach_x + abs(own[c, MX]) / n
        reach_y = reach_y + abs(own[c, MY]) / n
    for c in range(n):
        kept, first, roll = ring.places[KEPT, c], ring.places[FIRST, c], ring.places[ROLL, c]
        nx, ny = abs(own[c, NX]), abs(own[c, NY])
        turn_n, turn_t = abs(own[c, TURN_N]), abs(own[c, TURN_T])
        knn, knt = abs(own[c, KNN]), abs(own[c, DNT] * own[c, G]) + turn_t
        ktn, ktt = abs(own[c, KTN]), abs(own[c, DTT] * own[c, G]) + turn_n
        z = own[c, FELT] * (own[c, BI] + own[c, BJ]) * spin
        if roll >= 0:
            z = z + X[roll]
        qn, qt = abs(own[c, QN]) * z, abs(own[c, QT]) * z
        if closure == TRACTION:
            lever_x, lever_y = abs(own[c, MX]) + reach_x, abs(own[c, MY]) + reach_y
            fx = X[P] + lever_x * X[P + 2] + lever_y * X[P + 3]
            fy = X[P + 1] + lever_x * X[P + 4] + lever_y * X[P + 5]
            fn, ft = nx * fx + ny * fy, ny * fx + nx * fy
            if kept == 0:
                snn, snt, stn, stt = (
                    abs(own[c, SNN]), abs(own[c, SNT]), abs(own[c, STN]), abs(own[c, STT])
                )  # fmt: skip
                # K^-1 errs by K^-1 times the error of K times K^-1.
                en, et = snn * (fn + qn) + snt * (ft + qt), stn * (fn + qn) + stt * (ft + qt)
                gn, gt = knn * en + knt * et, ktn * en + ktt * et
                en, et = snn * gn + snt * gt, stn * gn + stt * gt
            elif kept == 1:
                et = X[first]
                en = (fn + qn + knt * et) / knn
            else:
                en, et = X[first], X[first + 1]
                out[first] += fn + qn + knn * en + knt * et
            if kept > 0:
                out[first + kept - 1] += ft + qt + ktn * en + ktt * et
            vx, vy = nx * en + ny * et, ny * en + nx * et
            out[P] += vx
            out[P + 1] += vy
        else:
            lever_x, lever_y = abs(own[c, DX]), abs(own[c, DY])
            ex, ey = H[0] * lever_x + H[1] * lever_y, H[2] * lever_x + H[3] * lever_y
            en, et = nx * ex + ny * ey, ny * ex + nx * ey
            fn, ft = knn * en + knt * et + qn, ktn * en + ktt * et + qt
            vx, vy = nx * fn + ny * ft, ny * fn + nx * ft
        at = P + 2 * closure
        out[at] += vx * lever_x
        out[at + 1] += vx * lever_y
        out[at + 2] += vy * lever_x
        out[at + 3] += vy * lever_y
        arm = 0.5 * (own[c, LENGTH] + own[c, RI] + own[c, RJ])
        moment = arm * (turn_n * et + ft) + 0.5 * abs(own[c, FT]) * en
        before, after = ring.places[ROLL, c - 1 if c > 0 else n - 1], c + 1 if c + 1 < n else 0
        if roll >= 0:
            out[roll] += (own[c, WIDE_I] + own[c, WIDE_J]) * moment
        if before >= 0:
            out[before] += own[c - 1 if c > 0 else n - 1, WIDE_J] * moment
        if ring.places[ROLL, after] >= 0:
            out[ring.places[ROLL, after]] += own[after, WIDE_I] * moment
    for i in range(4):
        out[P + 2 * closure + i] += H[i] if closure == TRACTION else X[P + i]
    last = ring.places[ROLL, n - 1]
    if last >= 0:
        out[last] *= 1.0 - gear
        for c in range(n):
            roll = ring.places[ROLL, c]
            if roll >= 0:
                size = gear * own[c, WIDE_J] / own[c, WJ] * X[roll]
                out[last] += size / (own[c, FELT] + (own[c, FELT] == 0.0))


def weigh_moments(ring: Ring, c: int) -> None:
    """Compute the factors of moments in the equation of a roll, and the sizes of their terms.

    Arms that are no share by the radii are differences of lengths.
    """
    own = ring.contacts
    total, touching = own[c, BI] + own[c, BJ], own[c, RI] + own[c, RJ]
    over_i, over_j = 1.0 / (own[c, RI] * own[c, RI]), 1.0 / (own[c, RJ] * own[c, RJ])
    apart = abs(own[c, BI] * touching - own[c, RI] * total) > SHARED * total * touching
    arm = apart * 0.5 * (own[c, LENGTH] + touching) * total / own[c, LENGTH]
    own[c, WI], own[c, WJ] = own[c, BI] * over_i, own[c, BJ] * over_j
    own[c, WIDE_I] = over_i * (arm + (1.0 - apart) * own[c, BI])
    own[c, WIDE_J] = over_j * (arm + (1.0 - apart) * own[c, BJ])


def balance_last(ring: Ring, n: int, gear: Any) -> None:
    """Let the last roll's equation balance one grain if the ring feels all spins, without a mode.

    With its sum of two moments the equations depend on each other by the square of the distance to
    a gear mode.
    """
    own, kept = ring.contacts, 1.0 * (gear != NO_GEAR)
    for c in range(n):
        kept = kept + (own[c, FELT] == 0.0)
    own[n - 1, WI] *= kept > 0.0
    own[n - 1, WIDE_I] *= kept > 0.0


def factor(E: Floats, N: int, solver: Solver) -> float:
    """Eliminate N unknowns, right-hand sides in the columns behind them; return the least pivot.

    Rows are scaled to size one and eliminated whole, also before the diagonal, where nothing is
    read again; the multipliers are kept apart.
    """
    width, least = E.shape[1], 1.0
    below = solver.below[: N * N].reshape((N, N))
    for i in range(N):
        largest = 0.0
        for j in range(N):
            largest = max(largest, abs(E[i, j]))
        if not 0.0 < largest < np.inf:
            return 0.0
        scale = 1.0 / largest
        solver.order[i], solver.sizes[2, i] = i, scale
        for j in range(width):
            E[i, j] *= scale
    for k in range(N):
        best, pivot = k, abs(E[k, k])
        for i in range(k + 1, N):
            # Selected without an if: the processor would mispredict every second one.
            larger = abs(E[i, k]) > pivot
            best, pivot = (i, abs(E[i, k])) if larger else (best, pivot)
        if not pivot > 0.0:
            return 0.0
        least = min(least, pivot)
        if best != k:
            solver.order[k], solver.order[best] = solver.order[best], solver.order[k]
            for j in range(width):
                E[k, j], E[best, j] = E[best, j], E[k, j]
            for j in range(k):
                below[k, j], below[best, j] = below[best, j], below[k, j]
        over = 1.0 / E[k, k]
        for i in range(k + 1, N):
            multiplier = E[i, k] * over
            below[i, k] = multiplier
            if multiplier != 0.0:
                for j in range(width):
                    E[i, j] -= multiplier * E[k, j]
    return least


def solve(E: Floats, N: int, solver: Solver) -> None:
    """Solve for the unknowns per component of `H`: `X`."""
    X = solver.X
    for i in range(N - 1, -1, -1):
        for k in range(4):
            X[i, k] = -E[i, N + k]
        for j in range(i + 1, N):
            value = E[i, j]
            for k in range(4):
                X[i, k] -= value * X[j, k]
        over = 1.0 / E[i, i]
        for k in range(4):
            X[i, k] *= over


def invert_stress(E: Floats, N: int, solver: Solver) -> None:
    """Solve the transposed system for the rows of the inverse that give `P`: `Y`, scaled rows."""
    Y, below = solver.Y, solver.below[: N * N].reshape((N, N))
    Y[:N] = 0.0
    for k in range(4):
        for i in range(N - 4 + k, N):
            value = 1.0 if i == N - 4 + k else 0.0
            for j in range(N - 4 + k, i):
                value -= E[j, i] * Y[j, k]
            Y[i, k] = value / E[i, i]
    for i in range(N - 1, -1, -1):
        for j in range(i + 1, N):
            value = below[j, i]
            for k in range(4):
                Y[i, k] -= value * Y[j, k]


def solve_ring(
    ring: Ring, A: Floats, n: int, N: int, closure: int, gear: int, solver: Solver, out: Floats
) -> float:
    """Tangent of a ring, (4, 4), in its units; return the least pivot, 0 without an answer."""
    least = 1.0
    if gear == UNSURE:
        return 0.0
    if closure == AFFINE and N == 4:
        # P alone: its equations read P + A H = 0.
        for i in range(4):
            solver.sizes[2, i], solver.order[i] = 1.0, i
            for k in range(4):
                solver.X[i, k], solver.Y[i, k] = -A[i, N + k], 1.0 * (i == k)
    else:
        E = solver.E[: N * A.shape[1]].reshape((N, A.shape[1]))
        balance_rolls(ring, A, n, N, gear, E)
        least = factor(E, N, solver)
        if not least > LEAST_PIVOT:
            return 0.0
        solve(E, N, solver)
    out[:] = solver.X[N - 4 : N]
    return least


def bound_error(
    ring: Ring, A: Floats, n: int, N: int, closure: int, gear: int, turn: Floats, solver: Solver
) -> float:
    """Return the bound on the error of a ring that was just solved, in its units.

    To first order in rounding, `|E^-1| sizes(E) |x|`, with the rows of the solution and of the
    inverse by their norms over the four components; or a quarter of `|E^-1| |L| |U| |x|`
    where that is larger.
    """
    bound, eliminated, unknowns, sizes = 0.0, 0.0, solver.sizes[0], solver.sizes[1]
    if not (closure == AFFINE and N == 4):
        E = solver.E[: N * A.shape[1]].reshape((N, A.shape[1]))
        invert_stress(E, N, solver)
        eliminated = elimination_terms(E, N, solver)
    for i in range(N):
        unknowns[i] = _norm4(solver.X, i)
    sum_sizes(ring, n, closure, gear, unknowns, (1.0, 1.0, 1.0, 1.0), turn, sizes)
    for i in range(N):
        row = solver.order[i]
        bound += _norm4(solver.Y, i) * solver.sizes[2, row] * sizes[row]
    return ROUNDING * max(bound, 0.25 * eliminated)


def elimination_terms(E: Floats, N: int, solver: Solver) -> float:
    """Return `|Y| |L| |U| |x|`, the rounding of the elimination."""
    below, total = solver.below[: N * N].reshape((N, N)), 0.0
    for i in range(N):
        solver.sizes[0, i] = _norm4(solver.X, i)
    for i in range(N):
        upper = 0.0
        for j in range(i, N):
            upper += abs(E[i, j]) * solver.sizes[0, j]
        solver.sizes[1, i] = upper
        for j in range(i):
            upper += abs(below[i, j]) * solver.sizes[1, j]
        total += _norm4(solver.Y, i) * upper
    return total


def _norm4(a: Floats, i: int) -> float:
    """Return the length of a row of four."""
    return math.sqrt(a[i, 0] ** 2 + a[i, 1] ** 2 + a[i, 2] ** 2 + a[i, 3] ** 2)


def prepare(ring: Ring, n: int, free: bool) -> int:
    """Mark the contacts of a ring that feel spins; return its gear mode."""
    for c in range(n):
        felt = ring.contacts[c, DNT] != 0.0 or ring.contacts[c, DTT] != 0.0
        ring.places[ROLL, c] = 0 if free and felt else -1
        if free:
            weigh_moments(ring, c)
    gear = gear_mode(ring, n) if free else NO_GEAR
    if free:
        balance_last(ring, n, gear)
    return gear


def tangents(
    rows: Floats, branches: Floats, reference: Floats, radii: Floats, offsets: Integers,
    grains: Integers, contacts: Integers, forward: Flags, loops: Integers, wanted: Integers,
    turn: Floats,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:  # fmt: skip
    """Tangents of the given faces, for each closure and rule of the spins that is `wanted` (K, 2).

    `turn` (T, 2, 4), T the number of loops or 1: spin of turning grains and its size. Returns the
    tangents (K, L, 4, 4), bounds on their errors (K, L), infinite where null vectors have to be
    looked for, the sensitivity of those with free spins to the arms (K, L), the areas and the sums
    of the sizes of their terms over them (L,).
    """
    count, longest = len(loops), 3
    for loop in loops:
        longest = max(longest, offsets[loop + 1] - offsets[loop])
    matrices = np.full((len(wanted), count, 4, 4), np.nan)
    errors, sensitivity = np.full((len(wanted), count), np.inf), np.zeros((len(wanted), count))
    area, growth, N = np.empty(count), np.empty(count), 3 * longest + 6
    ring = Ring(np.empty((longest, COLUMNS)), np.empty((3, longest + 1), np.int64))
    solver = solver_of(N)
    own, other, still = np.empty((4, 4)), np.empty((4, 4)), np.zeros((2, 4))
    arms, equations = np.empty((longest, 2)), np.empty((N + longest) * (N + 3 + LANES))
    for at in range(count):
        begin, n = offsets[loops[at]], offsets[loops[at] + 1] - offsets[loops[at]]
        area[at], growth[at], unit = fill_ring(
            ring, rows, branches, reference, radii, begin, n, grains, contacts, forward
        )
        for c in range(n):
            ring.places[KEPT, c] = kept_motions(ring, c)
            condense(ring, c)
        for k in range(len(wanted)):
            closure, spins = wanted[k, 0] if n > 3 else AFFINE, wanted[k, 1]
            if n == 3 and k > 0 and spins == wanted[k - 1, 1]:
                # The closure makes no difference.
                errors[k, at], matrices[k, at] = errors[k - 1, at], matrices[k - 1, at]
                continue
            free, spin = spins == FREE, turn[at % len(turn)] if spins == TURNING else still
            gear, N = prepare(ring, n, free), place_unknowns(ring, n, closure)
            height, width = N + n if free else N, (N + 3 + LANES) // LANES * LANES
            A = equations[: height * width].reshape((height, width))
            assemble(ring, A, n, closure, spins, spin[0])
            if not solve_ring(ring, A, n, N, closure, gear, solver, own) > 0.0:
                continue
            error = bound_error(ring, A, n, N, closure, gear, spin[1], solver)
            if free and n % 2 == 0:
                share_otherwise(ring, n, arms)
                gear = prepare(ring, n, free)
                place_unknowns(ring, n, closure)
                pivot, doubt = solve_ring(ring, A, n, N, closure, gear, solver, other), 0.0
                if 0.0 < pivot < POOR:
                    doubt = bound_error(ring, A, n, N, closure, gear, spin[1], solver)
                for c in range(n):
                    ring.contacts[c, BI], ring.contacts[c, BJ] = arms[c, 0], arms[c, 1]
                sensitivity[k, at] = unit * (change(own, other) + doubt)
                if not pivot > 0.0:
                    continue
            square = 0.0
            for i in range(4):
                for j in range(4):
                    square += own[i, j] * own[i, j]
                    matrices[k, at, i, j] = unit * own[i, j]
            if error < ERROR_LIMIT * math.sqrt(square):
                errors[k, at] = unit * error
    return matrices, errors, sensitivity, area, growth


def balance(
    ring: Ring, answers: Floats, branches: Floats, dead: Floats, stress: Floats, begin: int, n: int,
    size: float,
) -> tuple[float, float]:  # fmt: skip
    """Fill in the contacts of a ring from their forces and branches, see `relax`.

    Return its stiffness, and the largest force out of balance on a grain. In units of the ring
    `FN`, `FT` are what a contact bears and `DX`, `DY` its branch.
    """
    own, stiffness, worst, last_x, last_y = ring.contacts, 0.0, 0.0, 0.0, 0.0
    for c in range(n):
        at = begin + c
        x, y, mx, my = branches[at, 0], branches[at, 1], own[c, MX], own[c, MY]
        length = math.sqrt(x * x + y * y)
        nx, ny = x / length, y / length
        own[c, NX], own[c, NY], own[c, DX], own[c, DY] = nx, ny, x / size, y / size
        fx, fy = answers[0, at] + dead[at, 0], answers[1, at] + dead[at, 1]
        own[c, FN], own[c, FT] = nx * fx + ny * fy, nx * fy - ny * fx
        fx += size * (stress[0] * mx + stress[1] * my)
        fy += size * (stress[2] * mx + stress[3] * my)
        if c > 0:
            worst = max(worst, abs(fx - last_x), abs(fy - last_y))
        last_x, last_y = fx, fy
        xx, xy, yx, yy = answers[2, at], answers[3, at], answers[4, at], answers[5, at]
        stiffness = max(stiffness, abs(xx), abs(xy), abs(yx), abs(yy))
        own[c, KNN] = nx * (xx * nx + xy * ny) + ny * (yx * nx + yy * ny)
        own[c, KNT] = nx * (xy * nx - xx * ny) + ny * (yy * nx - yx * ny)
        own[c, KTN] = nx * (yx * nx + yy * ny) - ny * (xx * nx + xy * ny)
        own[c, KTT] = nx * (yy * nx - yx * ny) - ny * (xy * nx - xx * ny)
    for c in range(n if stiffness > 0.0 else 0):
        for k in range(KNN, KTT + 1):
            own[c, k] /= stiffness
        own[c, FN], own[c, FT] = own[c, FN] / (stiffness * size), own[c, FT] / (stiffness * size)
        ring.places[KEPT, c] = kept_motions(ring, c)
        condense(ring, c)
    return stiffness, worst


def move(ring: Ring, n: int, N: int, size: float, X: Floats, branches: Floats, begin: int) -> None:
    """Move the branches of a ring to the solution `X`."""
    own, x = ring.contacts, X[:, 0]
    for c in range(n):
        nx, ny, fn, ft = own[c, NX], own[c, NY], own[c, FN], own[c, FT]
        en, et, _ = moves(ring, n, TRACTION, c, x, N, 0.0)
        en += own[c, SNN] * fn + own[c, SNT] * ft
        et += own[c, STN] * fn + own[c, STT] * ft
        branches[begin + c, 0] += size * (nx * en - ny * et)
        branches[begin + c, 1] += size * (ny * en + nx * et)


def relax(
    answers: Floats, offsets: Integers, stretch: Floats, levers: Floats, dead: Floats,
    size: Floats, branches: Floats, stress: Floats, tangent: Floats, status: Integers,
) -> int:  # fmt: skip
    """Move rings towards balance under uniform stresses, one Newton step; return how many move.

    Of Q states of L rings: `answers` (Q, 8, M) of the contacts, force and `-df/dd` first, at the
    `branches` (Q, M, 2), which are moved, with the `stress` (Q, L, 4) and the `status` (Q, L);
    the `tangent` (Q, L, 16) is filled once a ring is relaxed. `f + dead = f^ - P m` with the
    `levers` m (M, 2) over the `size` (L,), and `sum d (x) m = -V0 U` under the `stretch` (Q, 4).
    """
    longest, moving = 3, 0
    for loop in range(len(size)):
        longest = max(longest, offsets[loop + 1] - offsets[loop])
    N = 2 * longest + 6
    ring = Ring(np.zeros((longest, COLUMNS)), np.full((3, longest + 1), -1))
    solver, still = solver_of(N), np.zeros(4)
    for q in range(len(answers)):
        for loop in range(len(size)):
            if status[q, loop] != MOVING:
                continue
            begin, n = offsets[loop], offsets[loop + 1] - offsets[loop]
            for c in range(n):
                ring.contacts[c, MX], ring.contacts[c, MY] = levers[begin + c]
            stiffness, worst = balance(
                ring, answers[q], branches[q], dead, stress[q, loop], begin, n, size[loop]
            )
            if not stiffness > 0.0:
                status[q, loop] = LOST
                continue
            N = place_unknowns(ring, n, TRACTION)
            width = (N + 3 + LANES) // LANES * LANES
            E = solver.E[: N * width].reshape((N, width))
            assemble(ring, E, n, TRACTION, BLOCKED, still)
            done = worst <= BALANCED * n / 6.0 * stiffness * size[loop]
            if not done:
                for i in range(4):
                    E[N - 4 + i, N + i] = 0.0
                    E[N - 4 + i, N] += stretch[q, i]
                for c in range(n):
                    load(ring, E, n, c, N)
            if not factor(E, N, solver) > LEAST_PIVOT:
                status[q, loop] = LOST
                continue
            solve(E, N, solver)
            if done:
                status[q, loop] = RELAXED
                for i in range(16):
                    tangent[q, loop, i] = stiffness * solver.X[N - 4 + i // 4, i % 4]
                continue
            moving += 1
            move(ring, n, N, size[loop], solver.X, branches[q], begin)
            for i in range(4):
                stress[q, loop, i] = stiffness * solver.X[N - 4 + i, 0]
    return moving


def moves(
    ring: Ring, n: int, closure: int, c: int, x: Floats, N: int, spin: float
) -> tuple[float, float, float]:
    """Motion of a contact in its frame and its roll, from the unknowns and, behind them, H'.

    `spin` is that of grains that turn with their loop.
    """
    own, roll, P0 = ring.contacts, ring.places[ROLL, c], ring.places[FIRST, n]
    nx, ny = own[c, NX], own[c, NY]
    z = x[roll] if roll >= 0 else own[c, FELT] * (own[c, BI] + own[c, BJ]) * spin
    if closure == AFFINE:
        ex = -x[N] * own[c, DX] - x[N + 1] * own[c, DY]
        ey = -x[N + 2] * own[c, DX] - x[N + 3] * own[c, DY]
        en, et = nx * ex + ny * ey, nx * ey - ny * ex
    else:
        fx = x[P0] - x[P0 + 2] * own[c, MX] - x[P0 + 3] * own[c, MY]
        fy = x[P0 + 1] - x[P0 + 4] * own[c, MX] - x[P0 + 5] * own[c, MY]
        fn, ft = nx * fx + ny * fy, nx * fy - ny * fx
        en = own[c, ZN] * z - own[c, SNN] * fn - own[c, SNT] * ft
        et = own[c, ZT] * z - own[c, STN] * fn - own[c, STT] * ft
        kept, first = ring.places[KEPT, c], ring.places[FIRST, c]
        if kept == 1:
            et += x[first]
            en -= own[c, KNT] / own[c, KNN] * x[first]
        elif kept == 2:
            en, et = en + x[first], et + x[first + 1]
    return en, et, z / own[c, FELT] if roll >= 0 else 0.0


def change(own: Floats, other: Floats) -> float:
    """Return how far another tangent's smallest eigenvalues lie towards zero and beyond.

    Those of Ks in (11, 22) and in (11, 22, (12 + 21)/sqrt 2).
    """
    first, second = smallest_in_plane(own), smallest_in_plane(other)
    in_plane = first - second if first > 0.0 else second - first
    first, second = smallest(own), smallest(other)
    return max(0.0, in_plane, first - second if first > 0.0 else second - first)


def smallest_in_plane(a: Floats) -> float:
    """Smallest eigenvalue of Ks in (11, 22)."""
    return float(0.5 * (a[0, 0] + a[3, 3] - math.hypot(a[0, 0] - a[3, 3], a[0, 3] + a[3, 0])))


def smallest(a: Floats) -> float:
    """Smallest eigenvalue of Ks in (11, 22, (12 + 21)/sqrt 2), by Jacobi's rotations."""
    half = math.sqrt(0.5)
    k00, k11 = a[0, 0], a[3, 3]
    k22 = 0.5 * (a[1, 1] + a[2, 2] + a[1, 2] + a[2, 1])
    k01 = 0.5 * (a[0, 3] + a[3, 0])
    k02 = 0.5 * half * (a[0, 1] + a[1, 0] + a[0, 2] + a[2, 0])
    k12 = 0.5 * half * (a[3, 1] + a[1, 3] + a[3, 2] + a[2, 3])
    for _ in range(SWEEPS):
        k00, k11, k01, k02, k12 = rotated(k00, k11, k01, k02, k12)
        k00, k22, k02, k01, k12 = rotated(k00, k22, k02, k01, k12)
        k11, k22, k12, k01, k02 = rotated(k11, k22, k12, k01, k02)
    return float(min(k00, k11, k22))


def rotated(
    pp: float, qq: float, pq: float, rp: float, rq: float
) -> tuple[float, float, float, float, float]:
    """Return these entries of a symmetric matrix, rotated so that the one at (p, q) vanishes."""
    if pq == 0.0:
        return pp, qq, pq, rp, rq
    turn = 0.5 * (qq - pp) / pq
    tangent = 1.0 / (abs(turn) + math.sqrt(turn * turn + 1.0))
    tangent = tangent if turn > 0.0 else -tangent
    cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    return (
        pp - tangent * pq,
        qq + tangent * pq,
        0.0,
        cosine * rp - sine * rq,
        sine * rp + cosine * rq,
    )
