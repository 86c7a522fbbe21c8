"""One segment of a path, from an event to the next: regimes and programme are fixed.

Events are where smooth functions of the state change sign; the integrator stops at the first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import DOP853, DenseOutput
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from loops.arrays import Flags, Floats, Integers
from loops.laws.frictional import Regime
from stability.paths.model import PathModel, pair_keys
from stability.paths.state import Mode, unpack
from stability.paths.state_rates import StateRates
from stability.programmes import NOTHING, Stage, area_ratio
from stability.spectra import subspace_basis

Anything = TypeVar("Anything")
# Points at which the polynomial through the samples looks for an excursion between them.
EXCURSION_POINTS = np.linspace(0.0, 1.0, 41)
# An event function has changed its sign once it is beyond zero by more than its rounding.
CROSSING_TOLERANCE = {
    "yield": 1e-13,
    "unloading": 1e-12,
    "opening": 1e-14,
    "closing": 1e-14,
    "opposite_contact": 1e-14,
    "det_Ks_zero": 1e-12,
    "det_K_zero": 1e-12,
    "flutter": 1e-12,
    "collapse": 0.0,
    "control_limit": 1e-12,
    "stage_end": 0.0,
}
SPECTRAL = ("det_Ks_zero", "det_K_zero")
# Pairs of grains are watched whose gap is below this fraction of r_i + r_j.
WATCHED_GAP = 0.1
# An eigenvalue of K whose imaginary part is below this fraction of |K| is real.
REAL_RTOL = 1e-7
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
class EventFunctions:
    """Event functions of a segment, each giving the values of a state.

    `kinds`: Kind of event, one per value; `items` (M,): Contact, pair or eigenvalue that it belongs
    to, four eigenvalues a subspace; -1 for none.
    """

    kinds: list[str]
    items: Integers
    functions: Sequence[Callable[[StateRates], Sequence[float] | Floats]]

    @cached_property
    def two_sided(self) -> Flags:
        """(M,) whether a change of sign either way is the event; the others are negative before."""
        return np.isin(self.kinds, SPECTRAL)

    @cached_property
    def tolerance(self) -> Floats:
        """(M,) largest value beyond zero that may be rounding."""
        return np.array([CROSSING_TOLERANCE[kind] for kind in self.kinds])

    def values(self, here: StateRates) -> Floats:
        """(M,) dimensionless values in a state, the pairs' left out."""
        return np.concatenate([function(here) for function in self.functions])

    def with_pairs(self, count: int) -> EventFunctions:
        """These functions, then the overlaps of `count` pairs of grains."""
        kinds = [*self.kinds, *["opposite_contact"] * count]
        return EventFunctions(kinds, np.concatenate([self.items, np.arange(count)]), self.functions)


def event_functions(
    model: PathModel, mode: Mode, stage: Stage, start: float, sense: float, size: float,
    subspaces: tuple[str, ...],
) -> EventFunctions:  # fmt: skip
    """Event functions of a segment with these regimes.

    The stage began at the loading parameter `start` and its quantity grows by `sense`; strains are
    of that `size`.
    """
    law, force, unit = model.law, model.stiffness * model.length, model.touching * size
    elastic = np.flatnonzero((mode.regime == Regime.ELASTIC) & model.has_cone)
    sliding = np.flatnonzero((mode.regime == Regime.SLIDING) & model.has_cone)
    closed = np.flatnonzero(mode.regime != Regime.OPEN)
    is_open = np.flatnonzero(mode.regime == Regime.OPEN)
    programme, none = stage.programme, [-1]
    # Size of the loading parameter per unit of strain.
    driven = np.abs(programme.rate).argmax()
    strain = np.abs(programme.equations(NOTHING, NOTHING)[1][driven]).max()
    weight = max(np.abs(programme.stress[driven]).max() * model.stiffness, strain)
    parameter_unit = float(weight / np.abs(programme.rate[driven]))

    def beyond_strength(here: StateRates) -> Floats:
        beyond = np.abs(here.contacts.shear_force) - law.strength(here.contacts)
        return np.asarray(beyond[elastic] / (force * size))

    def beyond_target(here: StateRates) -> list[float]:
        value = stage.value(here.H, here.P, here.state.parameter - start)
        return [sense * (value - stage.target)]

    watched: list[tuple[Sequence[str], Any, Callable[[StateRates], Any]]] = [
        (["yield"], elastic, beyond_strength),
        (["unloading"], sliding, lambda here: -here.slip[sliding] / force),
        (["opening"], closed, lambda here: (law.gap(here.contacts) / unit)[closed]),
        (["closing"], is_open, lambda here: (here.contacts.overlap / unit)[is_open]),
        *(
            (SPECTRAL, 4 * k + np.arange(len(subspace_basis(one))), partial(_spectra, subspace=one))
            for k, one in enumerate(subspaces)
        ),
        (["collapse"], none, lambda here: [-area_ratio(here.H)]),
        (["control_limit"], none, lambda here: [-here.rates.parameter / parameter_unit]),
        (["stage_end"], none, beyond_target),
    ]
    return EventFunctions(
        kinds=[kind for kinds, items, _ in watched for kind in kinds for _ in items],
        items=np.concatenate([items for kinds, items, _ in watched for _ in kinds]).astype(int),
        functions=[function for *_, function in watched],
    )


def eigenvalue_kind(A: Floats, subspace: str, item: int) -> str:
    """Kind of event where the real part of an eigenvalue of K vanishes: det_K_zero or flutter."""
    basis = subspace_basis(subspace)
    K = basis @ A @ basis.T
    if not np.isfinite(K).all():
        # In a singular state itself the operator is not known, and neither is its spectrum.
        return "det_K_zero"
    values = np.sort(np.linalg.eigvals(K).astype(complex))
    real = abs(values[item].imag) <= REAL_RTOL * np.linalg.norm(K)
    return "det_K_zero" if real else "flutter"


def pairs_in_reach(model: PathModel, places: list[Floats]) -> Integers:
    """(Q, 2) pairs of grains without a contact that are near in one of the places (G, 2)."""
    # Beside a singular state the interpolant may have left the numbers.
    if not model.watches_pairs or not np.isfinite(places).all():
        return np.zeros((0, 2), dtype=np.int64)
    reach = (1.0 + WATCHED_GAP) * 2.0 * float(model.radii.max())
    found = [cKDTree(x).query_pairs(reach, output_type="ndarray") for x in places]
    pairs = np.unique(np.concatenate(found), axis=0)
    gaps = np.max([pair_overlaps(model, pairs, x) for x in places], axis=0, initial=-np.inf)
    met = np.isin(pair_keys(model, pairs), model.met)
    return np.asarray(pairs[(gaps > -WATCHED_GAP) & ~met], dtype=np.int64)


def pair_overlaps(model: PathModel, pairs: Integers, x: Floats) -> Floats:
    """(Q,) overlaps of pairs of grains over `r_i + r_j`."""
    i, j = pairs.T
    d = x[j] - x[i]
    touching = model.radii[i] + model.radii[j]
    return np.asarray((touching - np.hypot(d[:, 0], d[:, 1])) / touching)


def _spectra(here: StateRates, subspace: str) -> Floats:
    """Eigenvalues of Ks, then real parts of those of K, ascending, over the norm of K."""
    basis = subspace_basis(subspace)
    K = basis @ here.A @ basis.T
    norm = np.linalg.norm(K)
    if not np.isfinite(norm) or norm == 0.0:
        return np.full(2 * len(basis), np.nan)
    symmetric = np.linalg.eigvalsh(0.5 * (K + K.T))
    return np.asarray(np.concatenate([symmetric, np.sort(np.linalg.eigvals(K).real)]) / norm)


def first_crossing(
    table: Floats, thetas: Floats, tolerance: Floats, values: Callable[[float], Floats]
) -> tuple[float, int] | None:
    """First place within a step where a function rises through zero, and which one.

    Excursions between the samples are looked for along the polynomial through them.
    """
    places, rows = _with_excursions(table, thetas, tolerance, values)
    beyond = np.flatnonzero((rows[1:] > tolerance).any(axis=1))
    if len(beyond) == 0:
        return None
    k = int(beyond[0])
    a, b = float(places[k]), float(places[k + 1])
    crossed = np.flatnonzero(rows[k + 1] > tolerance)
    low, high = np.minimum(rows[k, crossed], 0.0), rows[k + 1, crossed]
    while True:
        # A function that starts above zero, by rounding, has its root at the start.
        first = int(np.argmin(-low / (high - low)))
        which = int(crossed[first])
        if not low[first] < 0:
            return a, which
        # The root of the likeliest function bounds the interval for those that cross before it.
        b = _root(values, which, a, b)
        here = values(b)
        earlier = np.flatnonzero((here[crossed] > tolerance[crossed]) & (crossed != which))
        if len(earlier) == 0:
            return b, which
        crossed, low, high = crossed[earlier], low[earlier], here[crossed[earlier]]


def polish(
    at: Callable[[float], tuple[Floats, Anything, Floats]],
    which: int,
    theta: float,
    interpolated: Callable[[float], float],
) -> tuple[Floats, Anything, Floats]:
    """Correct a root of the interpolant by integrating to it: Newton with a fixed slope."""
    low, high = max(theta - 1e-4, 0.0), min(theta + 1e-4, 1.0)
    slope = (interpolated(high) - interpolated(low)) / (high - low)
    best = at(theta)
    for _ in range(3):
        error = float(best[2][which])
        if not slope > 0 or not abs(error) > 1e-16:
            break
        moved = min(max(theta - error / slope, 0.0), 1.0)
        trial = at(moved)
        if not abs(trial[2][which]) < abs(error):
            break
        theta, best = moved, trial
    return best


def _root(values: Callable[[float], Floats], which: int, a: float, b: float) -> float:
    """Root of one function within an interval at whose start it is negative."""
    try:
        return float(brentq(lambda theta: values(theta)[which], a, b, xtol=1e-15, rtol=1e-14))
    except ValueError:
        # Next to a singular state the interpolant is rough: not a number somewhere, or not of the
        # signs that its samples have. Halve the interval towards where it stops being negative.
        while b - a > np.finfo(float).eps:
            middle = 0.5 * (a + b)
            a, b = (middle, b) if values(middle)[which] < 0 else (a, middle)
        return b


def _with_excursions(
    table: Floats, thetas: Floats, tolerance: Floats, values: Callable[[float], Floats]
) -> tuple[Floats, Floats]:
    """Samples, and places between them where a function is above zero."""
    quiet = np.flatnonzero((table <= tolerance).all(axis=0))
    if len(quiet) == 0:
        return thetas, table
    powers = np.linalg.solve(np.vander(thetas), table[:, quiet])
    peaks = np.vander(EXCURSION_POINTS, len(thetas)) @ powers
    above = np.flatnonzero((peaks > tolerance[quiet]).any(axis=0))
    places, rows = list(thetas), list(table)
    for column in above:
        theta = float(EXCURSION_POINTS[np.argmax(peaks[:, column])])
        row = values(theta)
        if row[quiet[column]] > tolerance[quiet[column]]:
            places.append(theta)
            rows.append(row)
    order = np.argsort(places, kind="stable")
    return np.asarray(places)[order], np.asarray(rows)[order]


# ---- integration from event to event


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
