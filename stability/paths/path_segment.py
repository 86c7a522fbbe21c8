"""One segment of a path, from an event to the next: regimes and programme are fixed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import DOP853, DenseOutput
from scipy.optimize import brentq

from loops.arrays import Floats, Integers
from stability.paths.event_functions import (
    EventFunctions,
    first_crossing,
    pair_overlaps,
    pairs_in_reach,
    polish,
)
from stability.paths.model import PathModel
from stability.paths.state import Mode, unpack
from stability.paths.state_rates import StateRates
from stability.programmes import Stage

# Rows closer to an event than this share of their spacing are left out: the event has its own.
ROW_OF_EVENT = 1e-6
# Gauss points of a step, where rates are taken for the rows within it.
NODES, _ = legendre.leggauss(8)
# Shares of a step at which the event functions are compared.
SAMPLES = np.linspace(0.0, 1.0, 5)
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
NO_PAIRS: Integers = np.zeros((0, 2), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Segment:
    """Integration of one segment: model, regimes, event functions and tolerances.

    `functions`: Event functions; `rtol`, `atol` (Y,): Tolerances of the integrator; `max_step`:
    Longest step in `|H|`; `row_step`: Length in `|H|` between two rows, infinite for a row at every
    step; `size`: Size of the strains of the stage, at most 1.
    """

    model: PathModel
    mode: Mode
    stage: Stage
    functions: EventFunctions
    rtol: float
    atol: Floats
    max_step: float
    row_step: float
    size: float

    def at(self, y: Floats, gauge: Floats) -> StateRates:
        """State of the integrated variables `y`."""
        state = unpack(self.model, y)
        return StateRates(self.model, state, self.mode, self.stage.programme, gauge)


@dataclass(frozen=True, eq=False)
class SegmentEnd:
    """End of a segment.

    `y` (Y,): Integrated variables; `here`: The state in the regimes of the segment; `fired`: Kinds
    and items of the events, empty if the integrator gave up; `steps`: Accepted steps; `message`:
    Why the integrator gave up; `pairs` (Q, 2): Pairs of grains that the items of 'opposite_contact'
    count.
    """

    y: Floats
    here: StateRates
    fired: list[tuple[str, int]]
    steps: int
    message: str = ""
    pairs: Integers = field(default_factory=lambda: NO_PAIRS)


def follow_segment(
    segment: Segment,
    y: Floats,
    gauge: Floats,
    record_row: Callable[[StateRates], None],
    record_branching: Callable[[StateRates], None],
    steps_left: int,
) -> SegmentEnd:
    """Integrate from `y` to the first event."""
    functions, here = segment.functions, segment.at(y, gauge)
    values = functions.values(here)
    # Signs that make every function negative until its event; 0 where that is not yet known.
    known = np.abs(values) > np.maximum(functions.tolerance, SIMULTANEOUS)
    sign = np.where(functions.two_sided, np.where(known, -np.sign(values), 0.0), 1.0)
    solver = _solver(segment, y, gauge, np.inf, None)
    for steps in range(1, steps_left + 1):
        begin, y_begin = float(solver.t), solver.y
        message = _advance(solver)
        ill_conditioned = here.rates.condition > ILL_CONDITIONED
        # The integrator creeps up to a singular point of the controlled system.
        stalled = float(solver.t) - begin < STALLED * segment.size
        if message or (steps > SETTLED and stalled and ill_conditioned):
            fired = [("singular", -1)] if ill_conditioned else []
            return SegmentEnd(y_begin, here, fired, steps, message)
        end, dense = float(solver.t), solver.dense_output()
        step = _Step(segment, begin, y_begin, end, solver.y, dense, gauge)
        samples = [here, *(step.at(theta) for theta in SAMPLES[1:])]
        table = np.vstack([values, *(functions.values(each) for each in samples[1:])])
        # A function that starts at its zero takes the side to which it goes.
        for k in np.flatnonzero(sign == 0.0):
            beyond = table[np.abs(table[:, k]) > functions.tolerance[k], k]
            if len(beyond):
                sign[k] = -np.sign(beyond[0])
        pairs = pairs_in_reach(segment.model, [each.x for each in samples])
        overlaps = np.array([pair_overlaps(segment.model, pairs, each.x) for each in samples])
        signs = np.concatenate([sign, np.ones(len(pairs))])
        watched = functions.with_pairs(len(pairs))
        crossing = first_crossing(
            np.hstack([table, overlaps]) * signs,
            SAMPLES,
            watched.tolerance,
            partial(step.signed_values, pairs, signs),
        )
        until = 1.0 if crossing is None else crossing[0]
        for place in _branchings(step, samples, until):
            record_branching(place)
        for row in _rows(step, until):
            record_row(row)
        if crossing is not None:
            return _end_at_event(step, watched, signs, pairs, crossing, steps)
        here, values = samples[-1], table[-1]
        if not np.isfinite(segment.row_step):
            record_row(here)
        # The next step's direction is measured against the current one.
        gauge = here.rates.gauge
        solver.fun = partial(_right_hand_side, segment, gauge)
    message = "the limit on the number of steps was reached"
    return SegmentEnd(solver.y, here, [], steps_left, message)


@dataclass(frozen=True, eq=False)
class _Step:
    """One accepted step with its interpolant, `theta` from 0 to 1."""

    segment: Segment
    begin: float
    y_begin: Floats
    end: float
    y_end: Floats
    dense: DenseOutput
    gauge: Floats

    def at(self, theta: float) -> StateRates:
        y = self.y_end
        if theta < 1.0:
            y = self.dense(self.begin + theta * (self.end - self.begin))
        return self.segment.at(y, self.gauge)

    def signed_values(self, pairs: Integers, signs: Floats, theta: float) -> Floats:
        """Event functions, then overlaps of the pairs of grains: negative until the event."""
        return self.values_of(self.at(theta), pairs) * signs

    def values_of(self, here: StateRates, pairs: Integers) -> Floats:
        overlaps = pair_overlaps(self.segment.model, pairs, here.x)
        return np.concatenate([self.segment.functions.values(here), overlaps])

    def integrate(self, theta: float) -> Floats:
        """Variables integrated again from the start of the step: no interpolation error."""
        length = theta * (self.end - self.begin)
        if length == 0.0:
            return self.y_begin
        solver = _solver(self.segment, self.y_begin, self.gauge, length, length)
        _advance(solver)
        while solver.status == "running" and solver.step_size >= CREEPS * length:
            _advance(solver)
        if solver.status == "finished":
            return np.asarray(solver.y)
        # Next to a singular point the interpolant is all there is.
        return np.asarray(self.dense(self.begin + length))


def _rows(step: _Step, until: float) -> list[StateRates]:
    """Rows within a step: its rates integrated along its interpolant.

    The interpolant is an order below the step. What it misses, `y' - f(y)`, oscillates: its
    integral is smaller by what the rates change over a part of the step, and is left out.
    """
    length, spacing = until * (step.end - step.begin), step.segment.row_step
    if not np.isfinite(spacing):
        return []
    last = step.begin + length - (ROW_OF_EVENT * spacing if until < 1.0 else 0.0)
    marks = np.arange(np.floor(step.begin / spacing) + 1.0, np.floor(last / spacing) + 1.0)
    if len(marks) == 0:
        return []
    thetas = (marks * spacing - step.begin) / length
    points = step.dense(step.begin + 0.5 * length * (1.0 + NODES)).T
    rates = [step.segment.at(y, step.gauge).y_rates for y in points]
    integral = legendre.legint(legendre.legfit(NODES, rates, len(NODES) - 1), lbnd=-1.0)
    places = step.y_begin + 0.5 * length * legendre.legval(2.0 * thetas - 1.0, integral).T
    if not np.isfinite(places).all():
        # Next to a singular point the interpolant is all there is.
        return [step.at(until * theta) for theta in thetas]
    return [step.segment.at(y, step.gauge) for y in places]


def _branchings(step: _Step, samples: list[StateRates], until: float) -> list[StateRates]:
    """Places within a step where other paths branch off.

    On the interpolant, and without a restart: the rates are not determined there.
    """
    determinants = [each.balance_determinant for each in samples]
    places = []
    for k in range(1, len(samples)):
        if determinants[k - 1] * determinants[k] < 0:
            a, b = float(SAMPLES[k - 1]), float(SAMPLES[k])
            try:
                theta = brentq(lambda theta: step.at(theta).balance_determinant, a, b, xtol=1e-14)
            except ValueError:
                # No number somewhere between: the balance itself is singular there.
                continue
            if theta < until:
                places.append(step.at(theta))
    return places


def _end_at_event(
    step: _Step,
    watched: EventFunctions,
    signs: Floats,
    pairs: Integers,
    crossing: tuple[float, int],
    steps: int,
) -> SegmentEnd:
    """Put the path on the event, and find what else happens there."""
    theta, which = crossing

    def integrated(theta: float) -> tuple[Floats, StateRates, Floats]:
        y = step.integrate(theta)
        here = step.segment.at(y, step.gauge)
        return y, here, step.values_of(here, pairs) * signs

    def interpolated(theta: float) -> float:
        return float(step.signed_values(pairs, signs, theta)[which])

    y, here, values = polish(integrated, which, theta, interpolated)
    before = step.signed_values(pairs, signs, 0.0)
    at_event = (np.abs(values) <= SIMULTANEOUS) & ((before < 0) | ~watched.two_sided)
    at_event[which] = True
    fired = [(watched.kinds[k], int(watched.items[k])) for k in np.flatnonzero(at_event)]
    return SegmentEnd(y, here, fired, steps, pairs=pairs)


def _solver(
    segment: Segment, y: Floats, gauge: Floats, bound: float, first_step: float | None
) -> DOP853:
    return DOP853(
        partial(_right_hand_side, segment, gauge),
        0.0,
        y,
        bound,
        max_step=segment.max_step,
        rtol=segment.rtol,
        atol=segment.atol,
        first_step=first_step,
    )


def _right_hand_side(segment: Segment, gauge: Floats, _: float, y: Floats) -> Floats:
    return segment.at(y, gauge).y_rates


class _RejectedError(Exception):
    """The integrator has tried too many step sizes."""


def _advance(solver: DOP853) -> str:
    """Take one accepted step; the reason if there is none."""
    rates, left = solver.fun, EVALUATIONS

    def counted(t: float, y: Floats) -> Floats:
        nonlocal left
        left -= 1
        if left < 0:
            raise _RejectedError
        return rates(t, y)

    solver.fun = counted
    try:
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            message = solver.step()
    except _RejectedError:
        solver.status = "failed"
        message = "no step size keeps the error within its tolerance"
    finally:
        solver.fun = rates
    return message or ""
