"""Rates of a loop under a control, its tangent and event functions, compiled.

The closure's equations of a ring are those of `loops.closures.ring`; four equations of the control
and a gauge complete them, with the strain and the loading parameter as unknowns. In a symmetric
state only what the symmetry keeps may move: the equations act on the symmetric part of the
unknowns, and the rest is zero. What is no ring, or singular, is solved by
`stability.paths.state_rates`; contacts, control and all that follows from a solution are the same.

The laws are linear springs, with cohesion or not, and Hertz's; of others forces and stiffnesses are
given. `stability.paths.calls` compiles these functions together with those of the closure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from loops.arrays import Floats, Integers
from loops.closures.ring import (
    AFFINE,
    BI,
    BJ,
    COLUMNS,
    DNN,
    DNT,
    DTN,
    DTT,
    DX,
    DY,
    FELT,
    FIRST,
    FN,
    FREE,
    FT,
    KEPT,
    KNN,
    KNT,
    KTN,
    KTT,
    LENGTH,
    MX,
    MY,
    NO_GEAR,
    NX,
    NY,
    RI,
    RJ,
    ROLL,
    TRACTION,
    TURN_N,
    TURN_T,
    TURNING,
    WI,
    WJ,
    G,
    Ring,
    Solver,
    assemble,
    balance_rolls,
    condense,
    factor,
    kept_motions,
    moves,
    place_unknowns,
    prepare,
    solve,
    turn_block,
    weigh_moments,
)

# Columns behind those of the ring. Constants of a contact: reference branch and its length, overlap
# there, r_i + r_j, m, radii, gap where it opens, and the constants of its law: normal and shear
# stiffness (over the root of the overlap of spheres), friction, attraction, cohesion.
(D0X, D0Y, L0, OVERLAP0, TOUCHING, M0X, M0Y, RADIUS_I, RADIUS_J, OPENS, KN, KT, MU, PULL,
 COHESION) = range(COLUMNS, COLUMNS + 15)  # fmt: skip
# What a state makes of it: overlap, strength, forces, stiffnesses if it sticks.
OVERLAP, STRENGTH, NORMAL, SHEAR, NOW_KN, NOW_KT, COUPLING = range(COLUMNS + 15, COLUMNS + 22)
# Its rates: motion in its frame and shear displacement of the spins, these spins, forces.
EN, ET, SPUN, SPIN_I, SPIN_J, NORMAL_RATE, SHEAR_RATE = range(COLUMNS + 22, COLUMNS + 29)
REGIME, SIDE = COLUMNS + 29, COLUMNS + 30
# Of the grain before it: reference centre, boundary vector, gear mode and spin times radius.
X0, Y0, BX, BY, MODE, SPIN = range(COLUMNS + 31, COLUMNS + 37)
WIDTH = COLUMNS + 37
# Rows of `small`: displacement gradient, stress and their rates; tangent; equations of the control
# in H', P' and the parameter; the programme's; its rates; spin per H' of turning grains; numbers.
H, P, H_RATE, P_RATE, TANGENT, CONTROL, STRESS, STRAIN = 0, 1, 2, 3, 4, 8, 12, 16
RATE, TURN, NUMBERS, SOLUTION, ROWS = 20, 21, 22, 23, 24
# Rows of `places` behind those of `Ring`: grains of the contacts.
FROM, TO = 3, 4
VOLUME, LONG, STIFF, BULK, TARGET, SENSE, START, SIZE, PARAMETER = range(9)
# Of `SOLUTION`: rate of the parameter and its unit, condition, balance, unit of the stiffnesses,
# whether there is one answer.
PARAMETER_RATE, PARAMETER_UNIT, CONDITION, BALANCE, UNIT, TRUSTED = range(6)
# Places of `codes`; `QUANTITY` is a component of H, of P behind them, or 8: the parameter;
# `MIRRORS`: whether mirrors in the axes are symmetries.
LAW, BY_RADII, CLOSURE, SPINS, ISOCHORIC, CAUCHY, QUANTITY, MIRRORS, GRAINS = range(9)
HEADER, CODES = 7, 9
OPEN, STICKS, SLIDES = range(3)
LINEAR, COHESIVE, HERTZ, HERTZ_BY_DISPLACEMENT, GIVEN = range(5)
# Kinds of event functions, in the order of `KINDS` in `path_segment`.
(YIELD, UNLOADING, OPENING, CLOSING, SYMMETRIC_SPECTRUM, SPECTRUM, COLLAPSE, CONTROL_LIMIT,
 STAGE_END, TOUCH) = range(10)  # fmt: skip
# Pivot of the scaled equations below which null vectors are looked for, by numpy.
LEAST_RATE_PIVOT = 1e-12
# Stiffness of a ring, over that of its contacts, that is rounding.
NOTHING = 1e-13
# A gear mode that nearly closes: its slip over the spins is an unknown by itself below this.
NEARLY_CLOSED = 1e-2
# Pairs of grains with gaps beyond this fraction of r_i + r_j count as that far apart.
WATCHED_GAP = 0.1
# Loops longer than this are not searched for branching points.
MOST_GRAINS = 60


# What is asked for: rates of the variables; the sense of the present rates and the condition; event
# functions; all that is known of a state. Contacts and control alone; lengths, normals and overlaps
# of the contacts alone. From `SOLVED` on the same by a solution that is given.
RATES, FACTS, VALUES, LOOK, PLACE, GEOMETRY, SOLVED = range(7)


class Problem(NamedTuple):
    """A loop under a programme between two events, with the arrays of its solves.

    `shared` (3, L): a state, a gauge, and the answer to what is asked; `table` (n, WIDTH), `places`
    (5, n + 1), see `Ring`; `small` (ROWS, 9); `codes` (CODES,); unknowns (N, 4), multipliers, sizes
    and order of the rows, see `Solver`; `flat`: room for three systems of equations; `images`
    (S, n), `maps` (S, 2, 2) of the symmetry; `watch` (M, 2): kinds and items of the event
    functions; `bases` (K, 4, 4) and `spaces` (K,): subspaces and their sizes; `pairs` (Q, 2):
    grains without a contact.
    """

    shared: Floats
    table: Floats
    small: Floats
    X: Floats
    below: Floats
    sizes: Floats
    flat: Floats
    maps: Floats
    bases: Floats
    codes: Integers
    places: Integers
    order: Integers
    images: Integers
    watch: Integers
    spaces: Integers
    pairs: Integers


def lengths(header: Integers) -> tuple[int, int]:
    """Return how many numbers and whole numbers a problem takes that begins with this header."""
    L, n, S, M, K, Q, N = header
    floats = 3 * L + n * WIDTH + ROWS * 9 + 7 * N + N * N + 3 * N * (N + 4) + 4 * S + 16 * K
    return floats, HEADER + CODES + 5 * (n + 1) + N + S * n + 2 * M + K + 2 * Q


def problem_in(floats: Floats, whole: Integers) -> Problem:
    """Return the parts of a problem, which lie one after the other."""
    L, n, S, M, K, Q, N = whole[:HEADER]
    a, b = 3 * L, 3 * L + n * WIDTH
    c, d = b + ROWS * 9, b + ROWS * 9 + 4 * N
    e, f = d + N * N, d + N * N + 3 * N
    g = f + 3 * N * (N + 4)
    h = g + 4 * S
    i, j = HEADER + CODES, HEADER + CODES + 5 * (n + 1)
    k, m = j + N, j + N + S * n
    q, r = m + 2 * M, m + 2 * M + K
    return Problem(
        floats[:a].reshape((3, L)), floats[a:b].reshape((n, WIDTH)),
        floats[b:c].reshape((ROWS, 9)), floats[c:d].reshape((N, 4)), floats[d:e],
        floats[e:f].reshape((3, N)), floats[f:g], floats[g:h].reshape((S, 2, 2)),
        floats[h : h + 16 * K].reshape((K, 4, 4)), whole[HEADER:i], whole[i:j].reshape((5, n + 1)),
        whole[j:k], whole[k:m].reshape((S, n)), whole[m:q].reshape((M, 2)), whole[q:r],
        whole[r : r + 2 * Q].reshape((Q, 2)),
    )  # fmt: skip


def system(p: Problem, which: int, rows: int, columns: int) -> Floats:
    """Return room for a system of equations: moments too, those of the ring, all with control."""
    begin = which * (len(p.flat) // 3)
    return p.flat[begin : begin + rows * columns].reshape((rows, columns))


def solver_in(p: Problem) -> Solver:
    """Return the arrays for a solve."""
    return Solver(p.below, p.below, p.X, p.X, p.sizes, p.order)


def answer_of(p: Problem, what: int) -> None:
    """Compute what is asked for, see `RATES`.

    The last place of the answer is 0 where null vectors have to be looked for, and 1 otherwise.
    """
    y, gauge, out = p.shared
    solution, known = p.small[SOLUTION], True
    if what < SOLVED:
        place_contacts(p, y, what == GEOMETRY)
    if what == PLACE or what == GEOMETRY:
        write_control(p, p.small[NUMBERS, STIFF])
        out[len(out) - 1] = 1.0
        return
    if what < SOLVED:
        N, gear = write_equations(p)
        if what >= VALUES:
            known = tangent_of_ring(p, N) > LEAST_RATE_PIVOT
        complete(p, N, gauge)
        B = system(p, 2, N + 5, N + 9)
        known = factor(B, N + 5, solver_in(p)) > LEAST_RATE_PIVOT and known
        out[len(out) - 1] = 1.0 * known
        if not known:
            return
        solve_path(p, N, gear)
        if what == VALUES:
            solution[BALANCE] = balance_of_ring(p, N)
        elif what != RATES:
            solution[CONDITION] = condition_of(p, N + 5)
    force_rates(p)
    if what % SOLVED == RATES:
        write_rates(p, out)
    elif what % SOLVED == VALUES:
        write_values(p, y, out)
    else:
        describe(p, out)


def place_contacts(p: Problem, y: Floats, alone: bool) -> None:
    """Compute contacts, H and P of a state, and the stiffness in whose units the equations are.

    `alone`: Lengths, normals and overlaps of the contacts, without their forces.
    """
    table, tensors, n, given = p.table, p.small, len(p.table), p.codes[LAW] == GIVEN
    affine, by_radii, grains = p.codes[CLOSURE] == AFFINE, p.codes[BY_RADII] > 0, p.codes[GRAINS]
    volume = p.small[NUMBERS, VOLUME]
    for j in range(4):
        tensors[H, j] = y[j] if affine else 0.0
        tensors[P, j] = tensors[P, j] if alone else 0.0
    for g in range(0 if affine else grains):
        for i in range(2):
            for j in range(2):
                tensors[H, 2 * i + j] -= y[2 * g + i] * table[g, BX + j] / volume
    shears, unit = (4 if affine else 2 * grains), 0.0
    for c in range(n):
        row, before, after = table[c], p.places[FROM, c], p.places[TO, c]
        if affine:
            ux = -tensors[H, 0] * row[D0X] - tensors[H, 1] * row[D0Y]
            uy = -tensors[H, 2] * row[D0X] - tensors[H, 3] * row[D0Y]
        else:
            ux, uy = y[2 * after] - y[2 * before], y[2 * after + 1] - y[2 * before + 1]
        dx, dy = row[D0X] + ux, row[D0Y] + uy
        length = math.sqrt(dx * dx + dy * dy)
        # Stiff grains overlap by a fraction 1e-8 and keep their digits.
        shortening = -((dx + row[D0X]) * ux + (dy + row[D0Y]) * uy) / (length + row[L0])
        row[OVERLAP] = row[OVERLAP0] + shortening
        row[NX], row[NY], row[LENGTH] = dx / length, dy / length, length
        if alone:
            continue
        if not given:
            arm_i = 0.5 * (length + row[RADIUS_I] - row[RADIUS_J])
            row[G] = row[TOUCHING] / length if by_radii else 1.0
            row[BI] = row[RADIUS_I] if by_radii else arm_i
            row[BJ] = row[RADIUS_J] if by_radii else length - arm_i
            press_contact(p, c, y[shears + c])
        normal, shear = row[NORMAL], row[SHEAR]
        fx, fy = normal * row[NX] - shear * row[NY], normal * row[NY] + shear * row[NX]
        tensors[P, 0] += fx * row[D0X] / volume
        tensors[P, 1] += fx * row[D0Y] / volume
        tensors[P, 2] += fy * row[D0X] / volume
        tensors[P, 3] += fy * row[D0Y] / volume
        unit += (abs(row[DNN]) + abs(row[DTT])) / n
    if alone:
        return
    if not unit > 0.0:
        unit = p.small[NUMBERS, STIFF]
    p.small[SOLUTION, UNIT] = unit
    ring = Ring(table, p.places)
    per_length, per_unit = 1.0 / p.small[NUMBERS, LONG], 1.0 / unit
    for c in range(n):
        row = table[c]
        length = row[LENGTH]
        row[BI], row[BJ] = per_length * row[BI], per_length * row[BJ]
        row[TURN_N], row[TURN_T] = per_unit * row[NORMAL] / length, per_unit * row[SHEAR] / length
        row[FN], row[FT] = per_unit * per_length * row[NORMAL], per_unit * per_length * row[SHEAR]
        row[LENGTH], row[RI] = per_length * length, per_length * row[RADIUS_I]
        row[RJ], row[MX], row[MY] = (
            per_length * row[RADIUS_J], per_length * row[M0X], per_length * row[M0Y]
        )  # fmt: skip
        row[DX], row[DY] = per_length * row[D0X], per_length * row[D0Y]
        for k in (DNN, DNT, DTN, DTT):
            row[k] *= per_unit
        turn_block(ring, c)


def press_contact(p: Problem, c: int, shear: float) -> None:
    """Write forces, strength and stiffnesses of a contact of this overlap and shear force."""
    row, law = p.table[c], p.codes[LAW]
    overlap, closed, slides = row[OVERLAP], row[REGIME] != OPEN, row[REGIME] == SLIDES
    if law <= COHESIVE:
        normal, kn, kt = row[KN] * overlap - row[PULL], row[KN], row[KT]
    else:
        root = math.sqrt(abs(overlap))
        normal = row[KN] * overlap * root
        stiff = root if closed and overlap > 0.0 else 0.0
        kn, kt = 1.5 * row[KN] * stiff, row[KT] * stiff
    normal = normal if closed else 0.0
    strength = np.inf
    if row[MU] < np.inf:
        strength = row[MU] * normal + row[COHESION]
        strength = max(strength, 0.0) if law == COHESIVE else strength
    if slides:
        shear = row[SIDE] * strength
    elif not closed:
        shear = 0.0
    coupling = 0.0
    if law == HERTZ_BY_DISPLACEMENT and normal > 0.0:
        coupling = shear * kn / (3.0 * normal)
    row[STRENGTH], row[NORMAL], row[SHEAR] = strength, normal, shear
    row[NOW_KN], row[NOW_KT], row[COUPLING] = kn, kt, coupling
    row[DNN], row[DNT] = kn if closed else 0.0, 0.0
    row[DTN] = row[SIDE] * row[MU] * kn if slides else (coupling if closed else 0.0)
    row[DTT] = kt if closed and not slides else 0.0


def write_equations(p: Problem) -> tuple[int, int]:
    """Write the closure's equations of the ring, `E` (N, N + 4); return N and the gear mode."""
    ring, n, closure = Ring(p.table, p.places), len(p.table), p.codes[CLOSURE]
    for c in range(n):
        kept = 0
        for s in range(len(p.images)):
            # Contacts that the symmetry maps on each other are treated alike.
            kept = max(kept, kept_motions(ring, p.images[s, c]))
        p.places[KEPT, c] = kept
    for c in range(n):
        condense(ring, c)
    free = p.codes[SPINS] == FREE
    gear, N = prepare(ring, n, free), place_unknowns(ring, n, closure)
    nearly = False
    if free and len(p.images) > 1:
        # All equations of rolls alike, as the symmetry has them.
        weigh_moments(ring, n - 1)
    elif free and n % 2 == 0 and gear == NO_GEAR:
        nearly = abs(mode_by_depths(p, n, True)) < NEARLY_CLOSED
        if nearly:
            weigh_moments(ring, n - 1)
    turn = p.small[TURN, :4]
    if p.codes[SPINS] == TURNING:
        h = p.small[H]
        over = 0.5 / ((1.0 - h[0]) * (1.0 - h[3]) - h[1] * h[2])
        turn[0], turn[1] = over * h[1], over * (1.0 - h[0])
        turn[2], turn[3] = -over * (1.0 - h[3]), -over * h[2]
    A = system(p, 0, N + n if free else N, N + 4)
    E = system(p, 1, N, N + 4)
    assemble(ring, A, n, closure, p.codes[SPINS], turn)
    balance_rolls(ring, A, n, N, 0.0, E)
    if nearly or gear != NO_GEAR:
        close_gears(p, n, N, gear, E)
    return N, gear


def close_gears(p: Problem, n: int, N: int, gear: int, E: Floats) -> None:
    """Add what determines a gear mode of the whole ring to the equations of its rolls.

    These depend on each other then, with the weights `nu`. An exact mode stands still: spins make
    rolls that close around the ring. One that nearly closes slips at the last contact, by a small
    share of the spins: its moments, over that share, resist it by `-T'` of the slip.
    """
    ring, own, row, nu, weight = Ring(p.table, p.places), p.table, p.X[:, 3], 1.0, 1.0
    unknowns, largest = p.X[:, 2], 1.0
    for j in range(N + 4):
        row[j], unknowns[j] = 0.0, 0.0
    if gear == NO_GEAR:
        slip, largest = mode_by_depths(p, n, True), 0.0
        for j in range(N + 4):
            unknowns[j] = 1.0
            for c in range(n):
                en, et, z = moves(ring, n, p.codes[CLOSURE], c, unknowns, N, 0.0)
                spins = (
                    own[c, MODE] / own[c, RI] + own[c + 1 if c + 1 < n else 0, MODE] / own[c, RJ]
                )
                row[j] += 0.5 * own[c, FT] * spins / slip * en
                if c == n - 1:
                    row[j] += own[c, DTN] * en + own[c, DTT] * (own[c, G] * et - z)
            unknowns[j] = 0.0
            largest = max(largest, abs(row[j]))
    else:
        for c in range(n):
            row[p.places[ROLL, c]] = weight / own[c, FELT]
            weight = -weight * own[c, BJ] / own[c + 1 if c + 1 < n else 0, BI]
    for c in range(n):
        for j in range(N + 4):
            E[p.places[ROLL, c], j] += nu / largest * row[j]
        nu = -nu * own[c, WJ] / own[c + 1 if c + 1 < n else 0, WI]


def mode_by_depths(p: Problem, n: int, moments: bool) -> float:
    """Write an even ring's gear mode, spins times radii from 1 on; return its slip where it closes.

    By the arms of the moments or of the spins, from the depths of the rims beneath the contacts,
    which keep their digits.
    """
    table, turned, depth, moments = p.table, 0.0, 0.0, moments or p.codes[BY_RADII] == 0
    for c in range(n):
        table[c, MODE] = math.exp(turned) * (1.0 - 2.0 * (c % 2))
        if moments:
            depth = 0.5 * table[c, OVERLAP]
            turned += math.log1p(-depth / table[c, RADIUS_I])
            depth /= table[c, RADIUS_J]
            turned -= math.log1p(-depth)
    return (1.0 - depth) * math.expm1(turned)


def keep_symmetric(p: Problem, N: int, x: Floats) -> None:
    """Take the mean of a solution over the symmetry: the rest is rounding.

    Beside a state in which other motions are singular rounding of these is large.
    """
    places, images, maps, n, new = p.places, p.images, p.maps, len(p.table), p.X[:, 1]
    at, P0, order = places[FIRST, n], N - 4, len(p.maps)
    for j in range(N + 4):
        new[j] = 0.0
    for s in range(order):
        m = maps[s]
        even = 1.0 / order
        odd = even * (m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0])
        for c in range(n):
            to, kept, roll = images[s, c], places[KEPT, c], places[ROLL, c]
            if p.codes[CLOSURE] == TRACTION and kept > 0:
                first, image = places[FIRST, c], places[FIRST, to]
                if kept == 2:
                    new[first] += even * x[image]
                new[first + kept - 1] += odd * x[image + kept - 1]
            if roll >= 0:
                new[roll] += odd * x[places[ROLL, to]]
        for a in range(2):
            for k in range(2):
                if p.codes[CLOSURE] == TRACTION:
                    new[at + a] += odd * m[k, a] * x[at + k]
                for b in range(2):
                    for q in range(2):
                        turned = even * m[k, a] * m[q, b]
                        new[P0 + 2 * a + b] += turned * x[P0 + 2 * k + q]
                        new[N + 2 * a + b] += turned * x[N + 2 * k + q]
    for j in range(N + 4):
        x[j] = new[j]


def write_control(p: Problem, unit: float) -> None:
    """Write the control's equations (4, 9), alike in size, and the unit of the parameter."""
    held, h, stress, small = p.small[CONTROL : CONTROL + 4], p.small[H], p.small[P], p.small
    isochoric, cauchy = p.codes[ISOCHORIC], p.codes[CAUCHY]
    area = (1.0 - h[0]) * (1.0 - h[3]) - h[1] * h[2]
    cofactor = (1.0 - h[3], h[2], h[1], 1.0 - h[0])
    deformed = (1.0 - h[0], -h[1], -h[2], 1.0 - h[3])
    for i in range(4):
        for j in range(4):
            held[i, j], held[i, 4 + j] = small[STRAIN + i, j], small[STRESS + i, j]
            if i == isochoric:
                held[i, j] = cofactor[j]
        if i == cauchy:
            own, total = (0 if i == 0 else 2), small[NUMBERS, BULK]
            for j in range(4):
                held[i, 4 + j] = 0.0
            for j in range(own, own + 2):
                held[i, 4 + j] = deformed[j] / area
                total += stress[j] * deformed[j] / area
            for j in range(4):
                held[i, j] = total * cofactor[j] / area
            for j in range(own, own + 2):
                held[i, j] -= stress[j] / area
        held[i, 8] = -small[RATE, i]
    largest = 0.0
    for i in range(4):
        weight = 0.0
        for j in range(4):
            held[i, 4 + j] *= unit
            weight = max(weight, abs(held[i, j]), abs(held[i, 4 + j]))
        for j in range(9):
            held[i, j] /= weight
        largest = max(largest, abs(held[i, 8]))
    for i in range(4):
        held[i, 8] /= largest
    small[SOLUTION, PARAMETER_UNIT] = 1.0 / largest


def complete(p: Problem, N: int, gauge: Floats) -> None:
    """Write the equations, the control and the gauge as one system `B`, for `solve`."""
    size, E, B = N + 5, system(p, 1, N, N + 4), system(p, 2, N + 5, N + 9)
    B[:size] = 0.0
    for i in range(N):
        for j in range(N + 4):
            B[i, j] = E[i, j]
    write_control(p, p.small[SOLUTION, UNIT])
    control = p.small[CONTROL : CONTROL + 4]
    for i in range(4):
        for j in range(4):
            B[N + i, N + j], B[N + i, N - 4 + j] = control[i, j], control[i, 4 + j]
            B[N + 4, N + j] = gauge[j]
        B[N + i, N + 4] = control[i, 8]
    B[N + 4, N + 4] = gauge[4] * p.small[SOLUTION, PARAMETER_UNIT]
    B[N + 4, N + 5] = -1.0


def solve_path(p: Problem, N: int, gear: int) -> None:
    """Solve the factored system for the rates in the time of the gauge.

    Those of H, P and the parameter are in `small` then, the motions of the contacts in `table`.
    """
    x, unit = p.X[:, 0], p.small[SOLUTION, UNIT]
    solve(system(p, 2, N + 5, N + 9), N + 5, solver_in(p))
    if len(p.maps) > 1:
        keep_symmetric(p, N, x)
    for j in range(4):
        p.small[H_RATE, j] = x[N + j]
        p.small[P_RATE, j] = unit * x[N - 4 + j]
    move_contacts(p, N, gear, x, unit)
    p.small[SOLUTION, PARAMETER_RATE] = p.small[SOLUTION, PARAMETER_UNIT] * x[N + 4]


def move_contacts(p: Problem, N: int, gear: int, x: Floats, unit: float) -> None:
    """Write the motions of the contacts, in the units of the path, and the spins."""
    table, ring, n = p.table, Ring(p.table, p.places), len(p.table)
    long, closure, spins = p.small[NUMBERS, LONG], p.codes[CLOSURE], p.codes[SPINS]
    spin = 0.0
    if spins == TURNING:
        for j in range(4):
            spin += p.small[TURN, j] * p.small[H_RATE, j]
    for c in range(n):
        en, et, z = moves(ring, n, closure, c, x, N, spin)
        table[c, EN], table[c, ET], table[c, SPUN] = long * en, long * et, z
        table[c, SPIN_I] = table[c, SPIN_J] = spin
    if spins == FREE:
        spins_of_grains(p, n, N, gear, x, unit / p.small[NUMBERS, STIFF])
    for c in range(n):
        row = table[c]
        if spins != FREE or p.places[ROLL, c] < 0:
            table[c, SPUN] = row[BI] * table[c, SPIN_I] + row[BJ] * table[c, SPIN_J]
        table[c, SPUN] *= long


def force_rates(p: Problem) -> None:
    """Write the rates of the forces of the contacts, which move as they do."""
    unit = p.small[SOLUTION, UNIT]
    for c in range(len(p.table)):
        row = p.table[c]
        un, ut = row[EN], row[G] * row[ET] - row[SPUN]
        row[NORMAL_RATE] = -unit * (row[DNN] * un + row[DNT] * ut)
        row[SHEAR_RATE] = -unit * (row[DTN] * un + row[DTT] * ut)


def spins_of_grains(p: Problem, n: int, N: int, gear: int, x: Floats, resistance: float) -> None:
    """Compute the free spins from the rolls around a ring.

    An exact gear mode moves by the moments that are left along it, against one stiffness.
    """
    own, square, along, last, A = p.table, 1.0, 0.0, n - 1, system(p, 0, N + n, N + 4)
    spin, mode = own[:, SPIN], own[:, MODE]
    # Times radii; what the first one does, an amplitude of the mode, follows where the ring closes.
    spin[0], mode[0] = 0.0, 1.0
    for c in range(last):
        over_i, over_j = own[c, BI] / own[c, RI], own[c, BJ] / own[c, RJ]
        spin[c + 1] = (own[c, SPUN] - over_i * spin[c]) / over_j
        mode[c + 1] = -mode[c] * over_i / over_j
        square += mode[c + 1] * mode[c + 1]
        along += mode[c + 1] * spin[c + 1]
    over_i, over_j = own[last, BI] / own[last, RI], own[last, BJ] / own[last, RJ]
    for g in range(n):
        for j in range(N + 4):
            along -= resistance * mode[g] * A[N + g, j] * x[j] / own[g, RI]
    amplitude = -along / square
    if gear == NO_GEAR:
        slip = over_i * mode[last] + over_j
        if n % 2 == 0:
            slip = -mode_by_depths(p, n, False)
        amplitude = (own[last, SPUN] - over_i * spin[last]) / slip
    for g in range(n):
        spin[g] += amplitude * mode[g]
    for c in range(n):
        after = c + 1 if c + 1 < n else 0
        own[c, SPIN_I], own[c, SPIN_J] = spin[c] / own[c, RI], spin[after] / own[c, RJ]


def write_rates(p: Problem, out: Floats) -> None:
    """Write the rates of the integrated variables, `|H'| = 1`."""
    table, n, affine = p.table, len(p.table), p.codes[CLOSURE] == AFFINE
    tensors, square, grains = p.small, 0.0, p.codes[GRAINS]
    volume, long = tensors[NUMBERS, VOLUME], tensors[NUMBERS, LONG]
    for j in range(4):
        square += tensors[H_RATE, j] ** 2
    scale = 1.0 / math.sqrt(square)
    external, held, shear_work, dissipated = 0.0, 0.0, 0.0, 0.0
    for j in range(4):
        external += volume * tensors[P, j] * tensors[H_RATE, j]
    shears = 4 if affine else 2 * grains
    x, y_place, mean_x, mean_y = 0.0, 0.0, 0.0, 0.0
    for c in range(n):
        row = table[c]
        en, et = row[EN], row[ET]
        if not affine and c < grains:
            # The ring's contacts come first, from grain to grain.
            out[2 * c], out[2 * c + 1] = x, y_place
            mean_x, mean_y = mean_x + x / grains, mean_y + y_place / grains
            x, y_place = x + row[NX] * en - row[NY] * et, y_place + row[NY] * en + row[NX] * et
        out[shears + c] = scale * row[SHEAR_RATE]
        arm = 0.5 * (row[LENGTH] + row[RI] - row[RJ])
        rolled = row[SPUN]
        if p.codes[BY_RADII]:
            rolled = long * (arm * row[SPIN_I] + (row[LENGTH] - arm) * row[SPIN_J])
        held += row[SHEAR] * rolled
        shear_work -= row[SHEAR] * (et - rolled)
        if row[REGIME] == SLIDES:
            elastic = -row[SHEAR_RATE] / row[NOW_KT] if row[NOW_KT] > 0.0 else 0.0
            dissipated -= row[SHEAR] * (row[G] * et - row[SPUN] - elastic)
    if affine:
        for j in range(4):
            out[j] = scale * tensors[H_RATE, j]
    else:
        for g in range(grains):
            out[2 * g] = scale * (out[2 * g] - mean_x)
            out[2 * g + 1] = scale * (out[2 * g + 1] - mean_y)
    last, parameter = shears + n, tensors[SOLUTION, PARAMETER_RATE]
    out[last], out[last + 1], out[last + 2] = scale * parameter, scale * external, scale * held
    out[last + 3], out[last + 4] = scale * shear_work, scale * dissipated


def describe(p: Problem, out: Floats) -> None:
    """Write the gauge that keeps the sense of the rates, and their condition."""
    square, h = 0.0, p.small[H_RATE]
    for j in range(4):
        square += h[j] * h[j]
    for j in range(4):
        out[j] = h[j] / square
    out[4], out[5] = 0.0, p.small[SOLUTION, CONDITION]


def condition_of(p: Problem, size: int) -> float:
    """Condition number of the factored system in the norm of the largest sum of a row.

    Its rows are of size one, so that the size of the inverse is what counts.
    """
    B, x, sums = system(p, 2, size, size + 4), p.X[:, 1], p.X[:, 2]
    below = p.below[: size * size].reshape((size, size))
    for i in range(size):
        sums[i] = 0.0
    for k in range(size):
        for i in range(size):
            value = 1.0 if i == k else 0.0
            for j in range(i):
                value -= below[i, j] * x[j]
            x[i] = value
        for i in range(size - 1, -1, -1):
            value = x[i]
            for j in range(i + 1, size):
                value -= B[i, j] * x[j]
            x[i] = value / B[i, i]
            sums[i] += abs(x[i])
    largest = 0.0
    for i in range(size):
        largest = max(largest, sums[i])
    return largest


def tangent_of_ring(p: Problem, N: int) -> float:
    """Write the tangent; return the least pivot.

    Where the axes are mirrors H11 and H22 answer to themselves alone, and H12 and H21 do: the rest
    is rounding.
    """
    E, B, X = system(p, 1, N, N + 4), system(p, 2, N, N + 4), p.X
    unit = p.small[SOLUTION, UNIT]
    A, largest = p.small[TANGENT : TANGENT + 4, :4], 0.0
    for i in range(N):
        for j in range(N + 4):
            B[i, j] = E[i, j]
    least = factor(B, N, solver_in(p))
    solve(B, N, solver_in(p))
    for k in range(4):
        for i in range(4):
            mixed = p.codes[MIRRORS] and (i == 0 or i == 3) != (k == 0 or k == 3)
            A[i, k] = 0.0 if mixed else unit * X[N - 4 + i, k]
            largest = max(largest, abs(A[i, k]))
    if not largest > NOTHING * unit:
        # What nothing resists has no stiffness: the rest is rounding.
        for i in range(4):
            for k in range(4):
                A[i, k] = 0.0
    return least


def balance_of_ring(p: Problem, N: int) -> float:
    """Determinant of balance, control and gauge, its root of the order of their number.

    Its sign is that of all equations, those of contacts that were eliminated included. Where
    branching points are not looked for it is not a number.
    """
    n, own, sizes, order = len(p.table), p.table, p.sizes, p.order
    size, sign, log = N + 5, 1.0, 0.0
    B, searched = system(p, 2, size, size + 4), p.codes[CLOSURE] == TRACTION and n <= MOST_GRAINS
    searched = searched and p.codes[SPINS] != FREE
    for i in range(size):
        sign = sign if B[i, i] > 0.0 else -sign
        log += math.log(abs(B[i, i])) - math.log(sizes[2, i])
        # Parity of the order of the rows, a swap at a time.
        while order[i] != i:
            j = order[i]
            order[i], order[j] = order[j], j
            sign = -sign
    for c in range(n):
        kept = p.places[KEPT, c]
        value = 1.0
        if kept == 0:
            value = own[c, KNN] * own[c, KTT] - own[c, KNT] * own[c, KTN]
        elif kept == 1:
            value = own[c, KNN]
        sign, log = sign if value > 0.0 else -sign, log + math.log(abs(value))
        searched = searched and own[c, REGIME] != OPEN
    return sign * math.exp(log / size) if searched else np.nan


def write_values(p: Problem, y: Floats, out: Floats) -> None:
    """Write the event functions of a state, and the determinant of its balance."""
    watch, tensors, table, n = p.watch, p.small, p.table, len(p.table)
    affine, size = p.codes[CLOSURE] == AFFINE, tensors[NUMBERS, SIZE]
    force = tensors[NUMBERS, STIFF] * tensors[NUMBERS, LONG]
    square = 0.0
    for j in range(4):
        square += tensors[H_RATE, j] ** 2
    scale = 1.0 / math.sqrt(square)
    shears = 4 if affine else 2 * p.codes[GRAINS]
    out[len(p.watch)] = tensors[SOLUTION, BALANCE]
    for f in range(len(p.watch)):
        kind, c = watch[f, 0], watch[f, 1]
        if kind == YIELD:
            at = table[c]
            out[f] = (abs(at[SHEAR]) - at[STRENGTH]) / (force * size)
        elif kind == UNLOADING:
            at = table[c]
            un, ut = at[EN], at[G] * at[ET] - at[SPUN]
            sticking = -at[COUPLING] * un - at[NOW_KT] * ut
            out[f] = -scale * at[SIDE] * (sticking - at[SHEAR_RATE]) / force
        elif kind == OPENING or kind == CLOSING:
            own, overlap = table[c], table[c, OVERLAP]
            gap = overlap if kind == CLOSING else -overlap - own[OPENS]
            out[f] = gap / (own[TOUCHING] * size)
        elif kind == COLLAPSE:
            h = tensors[H]
            out[f] = h[1] * h[2] - (1.0 - h[0]) * (1.0 - h[3])
        elif kind == CONTROL_LIMIT:
            out[f] = -scale * tensors[SOLUTION, PARAMETER_RATE] / tensors[NUMBERS, PARAMETER]
        elif kind == STAGE_END:
            value = y[shears + n] - tensors[NUMBERS, START]
            if p.codes[QUANTITY] < 8:
                value = tensors[P if p.codes[QUANTITY] > 3 else H, p.codes[QUANTITY] % 4]
            out[f] = tensors[NUMBERS, SENSE] * (value - tensors[NUMBERS, TARGET])
        elif kind == TOUCH:
            out[f] = closest_pair(p, y)
    write_spectra(p, out)


def write_spectra(p: Problem, out: Floats) -> None:
    """Eigenvalues of Ks, then real parts of those of K, ascending, over the norm of K."""
    f = 0
    while f < len(p.watch) and p.watch[f, 0] != SYMMETRIC_SPECTRUM:
        f += 1
    for k in range(len(p.spaces)):
        q = p.spaces[k]
        K, norm = np.zeros((q, q)), 0.0
        for i in range(q):
            for j in range(q):
                for a in range(4):
                    for b in range(4):
                        K[i, j] += p.bases[k, i, a] * p.small[TANGENT + a, b] * p.bases[k, j, b]
                norm += K[i, j] * K[i, j]
        norm = math.sqrt(norm)
        if not 0.0 < norm < np.inf:
            for i in range(2 * q):
                out[f + i] = np.nan
        else:
            K /= norm
            symmetric = np.linalg.eigvalsh(0.5 * (K + K.T))
            values = np.linalg.eigvals(K.astype(np.complex128))
            for i in range(q):
                out[f + i] = symmetric[i]
                # Sorted as they come.
                at = f + q + i
                while at > f + q and out[at - 1] > values[i].real:
                    out[at] = out[at - 1]
                    at -= 1
                out[at] = values[i].real
        f += 2 * q


def closest_pair(p: Problem, y: Floats) -> float:
    """Largest overlap of grains without a contact, over r_i + r_j; at least that of far ones."""
    table, h, largest = p.table, p.small[H], -WATCHED_GAP
    for q in range(len(p.pairs)):
        i, j = p.pairs[q]
        dx, dy = table[j, X0] - table[i, X0], table[j, Y0] - table[i, Y0]
        if p.codes[CLOSURE] == AFFINE:
            dx, dy = dx - h[0] * dx - h[1] * dy, dy - h[2] * dx - h[3] * dy
        else:
            dx, dy = dx + y[2 * j] - y[2 * i], dy + y[2 * j + 1] - y[2 * i + 1]
        touching = table[i, RADIUS_I] + table[j, RADIUS_I]
        largest = max(largest, (touching - math.sqrt(dx * dx + dy * dy)) / touching)
    return largest
