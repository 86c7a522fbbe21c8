"""One segment of a path, compiled: integration from one event to the next, regimes held.

The explicit method of order 8 by Hairer and Wanner (DOP853) with its dense output. Events are where
smooth functions of the state change sign; the integrator stops at the first. Functions here take
rates and event functions from a `System`: kernels of `ring_rates`, or numpy, called back.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import DOP853

from loops.arrays import Flags, Floats, Integers
from stability.paths.ring_rates import FACTS, RATES, VALUES

STAGES, DENSE = 12, 16
BEGIN, END, TRIAL = range(DENSE + 7, DENSE + 10)  # rows of `Step`, behind its interpolant
TABLEAU = np.zeros((DENSE, DENSE))
TABLEAU[:STAGES, :STAGES], TABLEAU[STAGES, :STAGES] = DOP853.A, DOP853.B
TABLEAU[STAGES + 1 :] = DOP853.A_EXTRA
B8, E3, E5, D8 = DOP853.B, DOP853.E3, DOP853.E5, DOP853.D
# Error of a step, of each variable and in its natural unit. Looser ones save no time, since steps
# end at events: from 1e-2 to 1e-12 strains at events err by 8e-13 to 1.4e-15.
RTOL, ATOL = 1e-12, 1e-14
# Powers of the error and of the step by which steps change, their share that is taken.
ORDER, SAFETY, LEAST_GROWTH, MOST_GROWTH = 8, 0.9, 0.2, 10.0
# Shares of a step at which the event functions are compared.
SAMPLES = np.linspace(0.0, 1.0, 5)
# Points at which the polynomial through the samples looks for an excursion between them.
EXCURSION_POINTS = np.linspace(0.0, 1.0, 41)
PEAKS = np.vander(EXCURSION_POINTS, 5) @ np.linalg.inv(np.vander(SAMPLES))
# Gauss points of a step, where rates are taken for the rows within it, and the integrals of
# Legendre's polynomials through values there.
NODES, _ = legendre.leggauss(8)
INTEGRALS = legendre.legint(legendre.legfit(NODES, np.eye(8), 7), lbnd=-1.0)
# Rows closer to an event than this share of their spacing are left out: the event has its own.
ROW_OF_EVENT = 1e-6
# Condition number beyond which an integrator that stalls has met a singular point.
ILL_CONDITIONED = 1e6
# Steps after which the integrator has found its step size.
SETTLED = 4
# Longest step, over the size of the strains, at which the integrator stalls.
STALLED = 1e-7
# Evaluations after which a step is given up: forty sizes, each at most a fifth of the one before.
EVALUATIONS = 480
# Integrating a part of a step again takes a few steps; one below this share of the way is due
# to a singular point.
CREEPS = 1e-2
# Event functions this close to zero where another event is located have their event there too.
SIMULTANEOUS = 1e-11
# Half the distance, in shares of a step, over which the slope of an event function is taken.
SLOPE_WIDTH = 1e-4
# Distance, in shares of a step, within which a branching point is the event itself.
COINCIDENT = 1e-9
POLISHES = 3
# Distance of two ends of a bracket, in shares of a step, that is rounding.
BRACKET = 1e-15
EVENT, SINGULAR, STUCK, TOO_LONG = range(4)
ROW, BRANCHING = range(2)


class Steps(NamedTuple):
    """Steps of a segment, in lengths `|H|` of the path.

    `atol` (Y,): Absolute tolerances; `max_step`: Longest step; `row_step`: Spacing of rows,
    infinite for one at every step; `size`: Size of the strains of the stage, at most 1; `most`:
    Number of steps after which the segment is given up.
    """

    atol: Floats
    max_step: float
    row_step: float
    size: float
    most: int


class Step(NamedTuple):
    """Arrays of one step.

    `rows` (26, Y): rates of its stages, from `DENSE` on coefficients of the interpolant, its first
    and last state, a trial; `marks` (2, M + 1): signs that make each function negative before its
    event, in the last place that of the balance, and values of all functions.
    """

    rows: Floats
    marks: Floats


class System(NamedTuple):
    """Rates and event functions of a segment: `call` answers for them, see `ring_rates.Problem`.

    Where it can't, the last place of its answer is 0, and `otherwise` does. `numbers` and `whole`
    are the arrays that they take; state, gauge and answer lie at the front, each in as many places
    as the first whole number says. `tolerance` (2, M): largest values of the event functions beyond
    zero that may be rounding, and 1 where a change of sign either way is the event, the others
    being negative before.
    """

    call: Any
    otherwise: Any
    numbers: Floats
    whole: Integers
    tolerance: Floats


def ask(p: System, what: int, y: Floats, gauge: Floats, out: Floats) -> None:
    """Compute what is asked for at a state.

    `RATES` per unit length of the path, not numbers if they are not known; `VALUES` of the event
    functions, in the last place the determinant of the balance; `FACTS`: gauge that keeps the sense
    of the rates, and their condition.
    """
    width = p.whole[0]
    for j in range(len(y)):
        p.numbers[j] = y[j]
    for j in range(5):
        p.numbers[width + j] = gauge[j]
    p.call(what, p.numbers.ctypes, p.whole.ctypes)
    if p.numbers[3 * width - 1] == 0.0:
        p.otherwise(what, p.numbers.ctypes, p.whole.ctypes)
    for j in range(len(out)):
        out[j] = p.numbers[2 * width + j]


def copy(a: Floats, b: Floats) -> None:
    """Write the numbers of one array to another, as many as this has."""
    for j in range(len(b)):
        b[j] = a[j]


# ---- steps


def stage(k: Floats, start: Floats, h: float, s: int, out: Floats) -> None:
    """State of a stage of a step."""
    for j in range(len(start)):
        total = 0.0
        for q in range(s):
            total += TABLEAU[s, q] * k[q, j]
        out[j] = start[j] + h * total


def first_step(p: System, step: Step, gauge: Floats, how: Steps) -> float:
    """Length of a first step from the rates and how they change (Hairer, Norsett, Wanner II.4)."""
    k = step.rows
    y, trial = k[BEGIN], k[TRIAL]
    zero, one, two = 0.0, 0.0, 0.0
    for j in range(len(y)):
        scale = how.atol[j] + RTOL * abs(y[j])
        zero += (y[j] / scale) ** 2
        one += (k[0, j] / scale) ** 2
    zero, one = math.sqrt(zero / len(y)), math.sqrt(one / len(y))
    h = 1e-6 if zero < 1e-5 or one < 1e-5 else 0.01 * zero / one
    for j in range(len(y)):
        trial[j] = y[j] + h * k[0, j]
    ask(p, RATES, trial, gauge, k[1])
    for j in range(len(y)):
        two += ((k[1, j] - k[0, j]) / (how.atol[j] + RTOL * abs(y[j]))) ** 2
    two = math.sqrt(two / len(y)) / h
    most = max(one, two)
    longer = max(1e-6, 1e-3 * h) if most <= 1e-15 else (0.01 / most) ** (1.0 / ORDER)
    return min(100.0 * h, longer, how.max_step)


def advance(
    p: System, step: Step, gauge: Floats, how: Steps, h: float, most: float
) -> tuple[float, float]:
    """Take one accepted step of at most `most`, `k[0]` known; its length, zero if none, the next.

    `y[0]` and `k[0]` stay; `y[1]` and `k[12]` are those of the end.
    """
    k = step.rows
    start, end, trial = k[BEGIN], k[END], k[TRIAL]
    rejected, left = False, EVALUATIONS
    while h > 0.0 and left >= STAGES:
        left -= STAGES
        length = min(h, most)
        for s in range(1, STAGES):
            stage(k, start, length, s, trial)
            ask(p, RATES, trial, gauge, k[s])
        stage(k, start, length, STAGES, end)
        ask(p, RATES, end, gauge, k[STAGES])
        five, three = 0.0, 0.0
        for j in range(len(start)):
            a, b = 0.0, 0.0
            for q in range(STAGES + 1):
                a += E5[q] * k[q, j]
                b += E3[q] * k[q, j]
            scale = how.atol[j] + RTOL * max(abs(start[j]), abs(end[j]))
            five, three = five + (a / scale) ** 2, three + (b / scale) ** 2
        error = 0.0
        if five != 0.0 or three != 0.0:
            error = length * five / math.sqrt((five + 0.01 * three) * len(start))
        if error < 1.0:
            growth = SAFETY * error ** (-1.0 / ORDER) if error > 0.0 else MOST_GROWTH
            return length, length * min(1.0 if rejected else MOST_GROWTH, growth)
        growth = SAFETY * error ** (-1.0 / ORDER)
        h, rejected = length * (growth if growth > LEAST_GROWTH else LEAST_GROWTH), True
    return 0.0, h


def prepare_interpolant(p: System, step: Step, gauge: Floats, h: float) -> None:
    """Compute the coefficients of the dense output of a step, of order 7."""
    k = step.rows
    start, end, trial = k[BEGIN], k[END], k[TRIAL]
    for s in range(STAGES + 1, DENSE):
        stage(k, start, h, s, trial)
        ask(p, RATES, trial, gauge, k[s])
    for j in range(len(start)):
        change = end[j] - start[j]
        k[DENSE, j] = change
        k[DENSE + 1, j] = h * k[0, j] - change
        k[DENSE + 2, j] = 2.0 * change - h * (k[0, j] + k[STAGES, j])
        for q in range(4):
            total = 0.0
            for s in range(DENSE):
                total += D8[q, s] * k[s, j]
            k[DENSE + 3 + q, j] = h * total


def interpolate(step: Step, theta: float, out: Floats) -> None:
    """State at a share of a step."""
    if theta >= 1.0:
        copy(step.rows[END], out)
        return
    for j in range(len(out)):
        value = 0.0
        for q in range(7):
            value = (value + step.rows[DENSE + 6 - q, j]) * (theta if q % 2 == 0 else 1.0 - theta)
        out[j] = step.rows[BEGIN, j] + value


def signed_values(p: System, step: Step, gauge: Floats, theta: float, out: Floats) -> None:
    """Event functions at a share of a step: negative until the event."""
    interpolate(step, theta, step.rows[TRIAL])
    ask(p, VALUES, step.rows[TRIAL], gauge, out)
    for f in range(len(out)):
        out[f] *= step.marks[0, f]


# ---- the first event of a step


def root(
    p: System, step: Step, gauge: Floats, which: int, a: float, b: float, fa: float, fb: float
) -> float:
    """Root of a function that is negative at `a`: secants that keep a bracket, and halvings.

    Next to a singular state the interpolant is rough: where the function isn't a number the bracket
    is halved towards where it stops being negative.
    """
    values, last, slow = step.marks[1], 0, 0
    while b - a > BRACKET:
        width = b - a
        middle = (a * fb - b * fa) / (fb - fa)
        if slow > 1 or not (fa < 0.0 < fb) or not a < middle < b:
            middle, slow = 0.5 * (a + b), 0
        if not a < middle < b:
            break
        signed_values(p, step, gauge, middle, values)
        value = values[which]
        if value < 0.0:
            a, fa = middle, value
            fb, last = 0.5 * fb if last == -1 else fb, -1
        else:
            b, fb = middle, value
            fa, last = 0.5 * fa if last == 1 else fa, 1
            if value == 0.0:
                break
        slow = slow + 1 if b - a > 0.25 * width else 0
    return b


def first_crossing(p: System, step: Step, gauge: Floats, table: Floats) -> tuple[float, int]:
    """First place within a step where a function rises through zero, and which; -1 if none.

    Excursions between the samples are looked for along the polynomial through them.
    """
    tolerance = p.tolerance[0]
    count = len(tolerance)
    places, rows = np.empty(len(SAMPLES) + count), np.empty((len(SAMPLES) + count, count + 1))
    found = len(SAMPLES)
    for s in range(found):
        places[s] = SAMPLES[s]
        copy(table[s], rows[s])
    for f in range(count):
        quiet, highest, at = True, -np.inf, 0
        for s in range(len(SAMPLES)):
            quiet = quiet and table[s, f] <= tolerance[f]
        if quiet:
            for point in range(len(EXCURSION_POINTS)):
                value = 0.0
                for s in range(len(SAMPLES)):
                    value += PEAKS[point, s] * table[s, f]
                if value > highest:
                    highest, at = value, point
            if highest > tolerance[f]:
                signed_values(p, step, gauge, EXCURSION_POINTS[at], rows[found])
                if rows[found, f] > tolerance[f]:
                    places[found] = EXCURSION_POINTS[at]
                    found += 1
    order, crossed = np.empty(found, np.int64), np.zeros(count, np.bool_)
    for n in range(found):
        # Sorted as they come.
        at = n
        while at > 0 and places[order[at - 1]] > places[n]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = n
    for n in range(1, found):
        low, high = rows[order[n - 1]], rows[order[n]]
        for f in range(count):
            crossed[f] = high[f] > tolerance[f]
        if crossed.any():
            a, b = places[order[n - 1]], places[order[n]]
            return first_root(p, step, gauge, crossed, a, b, low, high.copy())
    return 1.0, -1


def first_root(
    p: System, step: Step, gauge: Floats, crossed: Flags, a: float, b: float, low: Floats,
    high: Floats,
) -> tuple[float, int]:  # fmt: skip
    """First root in (a, b) of the functions that have `crossed` zero there."""
    while True:
        # The likeliest: a function that starts above zero, by rounding, has its root at the start.
        which, least = -1, np.inf
        for f in range(len(crossed)):
            if crossed[f]:
                begin = low[f] if low[f] < 0.0 else 0.0
                share = -begin / (high[f] - begin)
                if share < least:
                    which, least = f, share
        if not low[which] < 0.0:
            return a, which
        # Its root bounds the interval for those that cross before it.
        b = root(p, step, gauge, which, a, b, low[which], high[which])
        signed_values(p, step, gauge, b, high)
        again = False
        for f in range(len(crossed)):
            crossed[f] = crossed[f] and f != which and high[f] > p.tolerance[0, f]
            again = again or crossed[f]
        if not again:
            return b, which


def integrate(p: System, step: Step, gauge: Floats, how: Steps, length: float, part: Step) -> bool:
    """Integrate again over a part of a step: no error of interpolation; whether it succeeds.

    The state is `part.rows[BEGIN]`.
    """
    copy(step.rows[BEGIN], part.rows[BEGIN])
    copy(step.rows[0], part.rows[0])
    left, h = length, length
    while left > 0.0:
        done, h = advance(p, part, gauge, how, h, left)
        if done == 0.0 or (done < left and done < CREEPS * length):
            return False
        copy(part.rows[END], part.rows[BEGIN])
        copy(part.rows[STAGES], part.rows[0])
        left -= done
    return True


def polish(
    p: System, step: Step, gauge: Floats, how: Steps, h: float, theta: float, which: int
) -> None:
    """Correct a root of the interpolant by integrating to it: Newton with a fixed slope.

    The state is `y[1]` then, its signed functions `values`.
    """
    low, high = max(theta - SLOPE_WIDTH, 0.0), min(theta + SLOPE_WIDTH, 1.0)
    signed_values(p, step, gauge, high, step.marks[1])
    slope = step.marks[1, which]
    signed_values(p, step, gauge, low, step.marks[1])
    slope = (slope - step.marks[1, which]) / (high - low)
    part = Step(np.empty_like(step.rows), step.marks)
    best, values, place = step.marks[1].copy(), step.marks[1], theta
    end = np.empty(step.rows.shape[1])
    for attempt in range(POLISHES + 1):
        if not integrate(p, step, gauge, how, place * h, part):
            # Next to a singular point the interpolant is all there is.
            interpolate(step, place, part.rows[BEGIN])
        ask(p, VALUES, part.rows[BEGIN], gauge, values)
        for f in range(len(values)):
            values[f] *= step.marks[0, f]
        if attempt > 0 and not abs(values[which]) < abs(best[which]):
            break
        theta = place
        copy(values, best)
        copy(part.rows[BEGIN], end)
        if not slope > 0.0 or not abs(best[which]) > 1e-16:
            break
        place = min(max(theta - best[which] / slope, 0.0), 1.0)
    copy(best, values)
    copy(end, step.rows[END])


# ---- rows


def rows_between(
    p: System, step: Step, gauge: Floats, how: Steps, begin: float, h: float, until: float,
    event: bool, record: Floats, count: int,
) -> tuple[Floats, int]:  # fmt: skip
    """Add the rows within a step, until an event: its rates integrated along its interpolant.

    The interpolant is an order below the step. What it misses, `y' - f(y)`, oscillates: its
    integral is smaller by what the rates change over a part of the step, and is left out.
    """
    length, spacing = until * h, how.row_step
    last = begin + length - (ROW_OF_EVENT * spacing if event else 0.0)
    first, end = math.floor(begin / spacing) + 1.0, math.floor(last / spacing) + 1.0
    if end <= first:
        return record, count
    at_nodes, known = np.empty((len(NODES), step.rows.shape[1])), True
    for q in range(len(NODES)):
        interpolate(step, 0.5 * until * (1.0 + NODES[q]), step.rows[TRIAL])
        ask(p, RATES, step.rows[TRIAL], gauge, at_nodes[q])
        known = known and np.isfinite(at_nodes[q]).all()
    mark = first
    while mark < end:
        theta, row = (mark * spacing - begin) / length, step.rows[TRIAL]
        if known:
            copy(step.rows[BEGIN], row)
            x, before, now = 2.0 * theta - 1.0, 0.0, 1.0
            for degree in range(len(INTEGRALS)):
                for q in range(len(NODES)):
                    weight = 0.5 * length * now * INTEGRALS[degree, q]
                    for j in range(len(row)):
                        row[j] += weight * at_nodes[q, j]
                following = ((2 * degree + 1) * x * now - degree * before) / (degree + 1.0)
                before, now = now, following
        else:
            # Next to a singular point the interpolant is all there is.
            interpolate(step, until * theta, row)
        record, count = noted(record, count, ROW, row, gauge), count + 1
        mark += 1.0
    return record, count


def branchings(
    p: System, step: Step, gauge: Floats, table: Floats, until: float, record: Floats, count: int
) -> tuple[Floats, int]:
    """Add the places within a step where other paths branch off.

    On the interpolant, and without a restart: the rates are not determined there.
    """
    last = table.shape[1] - 1
    for s in range(1, len(SAMPLES)):
        low, high = table[s - 1, last], table[s, last]
        if low * high < 0.0:
            step.marks[0, last] = -1.0 if low > 0.0 else 1.0
            a, b = SAMPLES[s - 1], SAMPLES[s]
            theta = root(p, step, gauge, last, a, b, -abs(low), abs(high))
            step.marks[0, last] = 1.0
            if theta < until - COINCIDENT:
                interpolate(step, theta, step.rows[TRIAL])
                ask(p, VALUES, step.rows[TRIAL], gauge, step.marks[1])
                # No number: the balance itself is singular there.
                if np.isfinite(step.marks[1, last]):
                    row = step.rows[TRIAL]
                    record, count = noted(record, count, BRANCHING, row, gauge), count + 1
    return record, count


def noted(record: Floats, count: int, kind: int, y: Floats, gauge: Floats) -> Floats:
    """Return the record with one more state, longer if need be: kind, variables and gauge."""
    if count == len(record):
        longer = np.empty((2 * count, record.shape[1]))
        for k in range(count):
            copy(record[k], longer[k])
        record = longer
    record[count, 0] = kind
    for j in range(len(y)):
        record[count, 1 + j] = y[j]
    for j in range(5):
        record[count, 1 + len(y) + j] = gauge[j]
    return record


# ---- a segment


def follow(
    p: System, y: Floats, gauge: Floats, how: Steps
) -> tuple[int, int, Floats, Floats, Flags, Floats]:
    """Integrate from `y` to the first event.

    Return how it ended, steps, last state and gauge, which functions have their event there (M,),
    and the rows and branchings on the way, see `noted`.
    """
    count, size = p.tolerance.shape[1], len(y)
    step = Step(np.zeros((TRIAL + 1, size)), np.ones((2, count + 1)))
    table, fired = np.empty((len(SAMPLES), count + 1)), np.zeros(count, np.bool_)
    record, seen = np.empty((64, size + 6)), 0
    gauge, ahead = gauge.copy(), np.empty(6)
    copy(y, step.rows[BEGIN])
    ask(p, VALUES, step.rows[BEGIN], gauge, table[0])
    # Signs that make every function negative until its event; 0 where that is not yet known.
    for f in range(count):
        value = table[0, f]
        known = abs(value) > max(p.tolerance[0, f], SIMULTANEOUS)
        if p.tolerance[1, f] > 0.0:
            step.marks[0, f] = -np.sign(value) if known else 0.0
    ask(p, FACTS, step.rows[BEGIN], gauge, ahead)
    ask(p, RATES, step.rows[BEGIN], gauge, step.rows[0])
    h, begin = first_step(p, step, gauge, how), 0.0
    for taken in range(1, how.most + 1):
        length, h = advance(p, step, gauge, how, min(h, how.max_step), np.inf)
        ill = ahead[5] > ILL_CONDITIONED
        # The integrator creeps up to a singular point of the controlled system.
        if length == 0.0 or (taken > SETTLED and length < STALLED * how.size and ill):
            end = SINGULAR if ill else STUCK
            return end, taken, step.rows[BEGIN], gauge, fired, record[:seen]
        prepare_interpolant(p, step, gauge, length)
        for s in range(1, len(SAMPLES)):
            interpolate(step, SAMPLES[s], step.rows[TRIAL])
            ask(p, VALUES, step.rows[TRIAL], gauge, table[s])
        for f in range(count):
            # A function that starts at its zero takes the side to which it goes.
            for s in range(len(SAMPLES)):
                if step.marks[0, f] == 0.0 and abs(table[s, f]) > p.tolerance[0, f]:
                    step.marks[0, f] = -np.sign(table[s, f])
        for s in range(len(SAMPLES)):
            for f in range(count):
                table[s, f] *= step.marks[0, f]
        theta, which = first_crossing(p, step, gauge, table)
        record, seen = branchings(p, step, gauge, table, theta, record, seen)
        if np.isfinite(how.row_step):
            about = begin, length, theta, which >= 0
            record, seen = rows_between(p, step, gauge, how, *about, record, seen)
        if which >= 0:
            polish(p, step, gauge, how, length, theta, which)
            for f in range(count):
                here = abs(step.marks[1, f]) <= SIMULTANEOUS
                fired[f] = here and (table[0, f] < 0.0 or p.tolerance[1, f] == 0.0)
            fired[which] = True
            return EVENT, taken, step.rows[END], gauge, fired, record[:seen]
        if not np.isfinite(how.row_step):
            record, seen = noted(record, seen, ROW, step.rows[END], gauge), seen + 1
        # The next step's direction is measured against the current one.
        ask(p, FACTS, step.rows[END], gauge, ahead)
        copy(ahead, gauge)
        copy(step.rows[END], step.rows[BEGIN])
        copy(step.rows[STAGES], step.rows[0])
        begin += length
        for f in range(count):
            table[0, f] = step.marks[0, f] * table[len(SAMPLES) - 1, f]
        table[0, count] = table[len(SAMPLES) - 1, count]
    return TOO_LONG, how.most, step.rows[BEGIN], gauge, fired, record[:seen]
