"""One piece of a path: regimes and programme fixed, from an event to the next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import DOP853, DenseOutput
from scipy.optimize import brentq

from loops.arrays import Floats, Integers
from stability.paths.locate import first_crossing, polish
from stability.paths.look import Look
from stability.paths.model import PathModel
from stability.paths.monitors import (
    Monitors,
    near_pairs,
    pair_overlaps,
)
from stability.paths.state import Mode, unpack
from stability.programmes import Stage

# Rows closer to an event, over their spacing, are that of the event.
CLOSE = 1e-6
# Where rates are taken for rows within a step.
NODES, _ = legendre.leggauss(8)
SAMPLES = np.linspace(0.0, 1.0, 5)
# A path that stalls where its equations are worse conditioned than this has met a singular point.
ILL_CONDITIONED = 1e6
# Steps after which the integrator has found its step size.
SETTLED = 4
# Steps that short, over the size of the strains, stall.
STALLED = 1e-7
# Evaluations after which a step is given up: forty sizes, each a fifth of the last at least.
EVALUATIONS = 480
# Integrating a part of a step again takes a few steps; one below this share of the way tells of a
# singular point.
CREEPS = 1e-2
# Functions this close to zero where another event is located have their event there too.
SIMULTANEOUS = 1e-11


@dataclass(frozen=True, eq=False)
class Task:
    """What a piece integrates, and how accurately.

    `rtol`: Relative tolerance of the integrator; `atol` (Y,): Absolute tolerances; `max_step`:
    Longest step in `|H|`; `row_step`: Way in `|H|` between two rows, infinite for a row at every
    step; `size`: Size of the strains of the stage, at most 1; `watch`: Event functions.
    """

    model: PathModel
    mode: Mode
    stage: Stage
    watch: Monitors
    rtol: float
    atol: Floats
    max_step: float
    row_step: float
    size: float

    def look(self, y: Floats, gauge: Floats) -> Look:
        """Evaluate a state completely."""
        state = unpack(self.model, y)
        return Look(self.model, state, self.mode, self.stage.programme, gauge)

    def rates(self, y: Floats, gauge: Floats) -> Floats:
        """Right-hand side."""
        return self.look(y, gauge).y_rates


@dataclass(frozen=True, eq=False)
class PieceEnd:
    """End of a piece.

    `y` (Y,): Integrated variables there; `seen`: The state there, in the regimes of the piece;
    `fired`: Events there; empty if the integrator gave up; `steps`: Accepted steps; `message`: Why
    the integrator gave up; `pairs` (Q, 2): Pairs of grains that the items of 'opposite_contact'
    count.
    """

    y: Floats
    seen: Look
    fired: list[tuple[str, int]]
    steps: int
    message: str = ""
    pairs: Integers = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))


def run_piece(
    task: Task,
    y: Floats,
    gauge: Floats,
    record: Callable[[Look], None],
    branching: Callable[[Look], None],
    steps_left: int,
) -> PieceEnd:
    """Integrate until the first event."""
    watch, seen = task.watch, task.look(y, gauge)
    values = watch.values(seen)
    sign = _initial_signs(watch, values)
    solver = _solver(task, y, gauge, np.inf, None)
    for steps in range(1, steps_left + 1):
        begin, y_begin = float(solver.t), solver.y
        message = _advance(solver)
        ill = seen.rates.condition > ILL_CONDITIONED
        # The integrator creeps up to a singular point of the controlled system.
        short = float(solver.t) - begin < STALLED * task.size
        if message or (steps > SETTLED and short and ill):
            fired = [("singular", -1)] if ill else []
            return PieceEnd(y_begin, seen, fired, steps, message)
        step = _Step(task, begin, y_begin, float(solver.t), solver.y, solver.dense_output(), gauge)
        samples = [seen, *(step.look(theta) for theta in SAMPLES[1:])]
        table = np.vstack([values, *(watch.values(each) for each in samples[1:])])
        _adopt_signs(sign, table, watch)
        step.pairs = near_pairs(task.model, [each.x for each in samples])
        everything = watch.with_pairs(len(step.pairs))
        signs = np.concatenate([sign, np.ones(len(step.pairs))])
        gaps = np.array([pair_overlaps(task.model, step.pairs, each.x) for each in samples])
        functions = np.hstack([table, gaps]) * signs
        crossing = first_crossing(
            functions, SAMPLES, everything.tolerance, partial(step.signed_values, signs)
        )
        until = 1.0 if crossing is None else crossing[0]
        for place in _branchings(step, samples, until):
            branching(place)
        for row in _rows(step, until):
            record(row)
        if crossing is not None:
            theta, which = crossing
            return _land(step, everything, signs, theta, which, steps)
        seen, values = samples[-1], table[-1]
        if not np.isfinite(task.row_step):
            record(seen)
        # The next step's direction is measured against the current one.
        gauge = seen.rates.gauge
        solver.fun = partial(_right_hand_side, task, gauge)
    return PieceEnd(solver.y, seen, [], steps_left, "the limit on the number of steps was reached")


@dataclass(eq=False)
class _Step:
    """One accepted step with its interpolant, `theta` from 0 to 1."""

    task: Task
    begin: float
    y_begin: Floats
    end: float
    y_end: Floats
    dense: DenseOutput
    gauge: Floats
    pairs: Integers = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))

    def look(self, theta: float) -> Look:
        y = self.y_end
        if theta < 1.0:
            y = self.dense(self.begin + theta * (self.end - self.begin))
        return self.task.look(y, self.gauge)

    def signed_values(self, sign: Floats, theta: float) -> Floats:
        return self.values_of(self.look(theta)) * sign

    def values_of(self, seen: Look) -> Floats:
        gaps = pair_overlaps(self.task.model, self.pairs, seen.x)
        return np.concatenate([self.task.watch.values(seen), gaps])

    def integrate(self, theta: float) -> Floats:
        """Integrated again from the start of the step: no interpolation error."""
        length = theta * (self.end - self.begin)
        if length == 0.0:
            return self.y_begin
        solver = _solver(self.task, self.y_begin, self.gauge, length, length)
        _advance(solver)
        while solver.status == "running" and solver.step_size >= CREEPS * length:
            _advance(solver)
        if solver.status == "finished":
            return np.asarray(solver.y)
        # Next to a singular point the interpolant is all there is.
        return np.asarray(self.dense(self.begin + length))


def _rows(step: _Step, until: float) -> list[Look]:
    """Rows of a step, where its rates integrated along its interpolant lead.

    The interpolant is an order below the step. What it misses, `y' - f(y)`, oscillates: its
    integral is smaller by what the rates change over a part of the step, and is left out.
    """
    length, spacing = until * (step.end - step.begin), step.task.row_step
    if not np.isfinite(spacing):
        return []
    last = step.begin + length - (CLOSE * spacing if until < 1.0 else 0.0)
    marks = np.arange(np.floor(step.begin / spacing) + 1.0, np.floor(last / spacing) + 1.0)
    if len(marks) == 0:
        return []
    thetas = (marks * spacing - step.begin) / length
    rates = [
        step.task.rates(y, step.gauge)
        for y in step.dense(step.begin + 0.5 * length * (1.0 + NODES)).T
    ]
    way = legendre.legint(legendre.legfit(NODES, rates, len(NODES) - 1), lbnd=-1.0)
    places = step.y_begin + 0.5 * length * legendre.legval(2.0 * thetas - 1.0, way).T
    if not np.isfinite(places).all():
        # Next to a singular point the interpolant is all there is.
        return [step.look(until * theta) for theta in thetas]
    return [step.task.look(y, step.gauge) for y in places]


def _branchings(step: _Step, samples: list[Look], until: float) -> list[Look]:
    """Places within a step where other paths branch off.

    On the interpolant, and without a restart: the rates are not determined there.
    """
    numbers = [each.branching for each in samples]
    places = []
    for k in range(1, len(samples)):
        if numbers[k - 1] * numbers[k] < 0:
            a, b = float(SAMPLES[k - 1]), float(SAMPLES[k])
            try:
                theta = brentq(lambda theta: step.look(theta).branching, a, b, xtol=1e-14)
            except ValueError:
                # No number somewhere between: the balance itself is singular there.
                continue
            if theta < until:
                places.append(step.look(theta))
    return places


def _land(
    step: _Step, watch: Monitors, sign: Floats, theta: float, which: int, steps: int
) -> PieceEnd:
    """Put the path on the event, and find what else happens there."""

    def at(theta: float) -> tuple[Floats, Look, Floats]:
        y = step.integrate(theta)
        seen = step.task.look(y, step.gauge)
        return y, seen, step.values_of(seen) * sign

    y, seen, values = polish(at, which, theta, lambda t: float(step.signed_values(sign, t)[which]))
    before = step.signed_values(sign, 0.0)
    near = (np.abs(values) <= SIMULTANEOUS) & ((before < 0) | ~watch.two_sided)
    near[which] = True
    fired = [(watch.kinds[k], int(watch.items[k])) for k in np.flatnonzero(near)]
    return PieceEnd(y, seen, fired, steps, pairs=step.pairs)


def _initial_signs(watch: Monitors, values: Floats) -> Floats:
    """Factor that makes every function negative until its event; 0 where that is not yet known."""
    known = np.abs(values) > np.maximum(watch.tolerance, SIMULTANEOUS)
    return np.where(watch.two_sided, np.where(known, -np.sign(values), 0.0), 1.0)


def _adopt_signs(sign: Floats, table: Floats, watch: Monitors) -> None:
    """A function that starts at its zero takes the side to which it goes."""
    for k in np.flatnonzero(sign == 0.0):
        beyond = table[np.abs(table[:, k]) > watch.tolerance[k], k]
        if len(beyond):
            sign[k] = -np.sign(beyond[0])


def _solver(task: Task, y: Floats, gauge: Floats, bound: float, first_step: float | None) -> DOP853:
    return DOP853(
        partial(_right_hand_side, task, gauge),
        0.0,
        y,
        bound,
        max_step=task.max_step,
        rtol=task.rtol,
        atol=task.atol,
        first_step=first_step,
    )


def _right_hand_side(task: Task, gauge: Floats, _: float, y: Floats) -> Floats:
    return task.rates(y, gauge)


class _RejectedError(Exception):
    """The integrator has tried too many step sizes."""


def _advance(solver: DOP853) -> str:
    """One accepted step, or why there is none."""
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
