"""The quasi-static path of a packing: its solver, ways past instabilities, and what is asked."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, get_args

import numpy as np

from loops.arrays import Floats
from loops.contacts import Contacts, contacts_at_start
from loops.errors import InputError, check_choice, check_type, counted, number, whole_number
from loops.scene import Scene
from stability.complementarity import positive_definite
from stability.p_matrix import has_definite_scaling, is_p_matrix
from stability.packing.equations_of_motion import require_upright, snap_through
from stability.packing.point import MAY_CLOSE_GAP, RELEASED, PackingPoint, regimes_of
from stability.packing.rattlers import free_rattlers, settle
from stability.packing.regime_factor import ELASTIC, OPEN, RegimeFactor
from stability.packing.strain_increment import MAX_SPEED_RATIO, StrainIncrement
from stability.path import (
    FINISHED,
    Event,
    Past,
    Path,
    Pathologies,
    PathStatus,
    follow_stages,
    reason,
)
from stability.programmes import NOTHING, MixedControl, Stage
from stability.regimes import SlipProblem, agreeing

# Candidates up to which minors and solutions are looked for.
FEW_CANDIDATES = 30
# Candidates up to which there is a matrix.
MOST_CANDIDATES = 192
# Random and named starts of the search for solutions where not all sets are tried.
FEW_STARTS = 5


@dataclass(frozen=True)
class Viscous:
    """Drag the grains of the mode by springs on the ground; hold the contact if none is left.

    `stiffness` multiplies the springs of `strain_increment`.
    """

    stiffness: float = 1.0


# What is done past an instability; None ends the path at the first one. A function returns the
# state at rest behind it and the work until then, as `Path.work`, or raises `ArithmeticError`; the
# control is the whole change of stress and strain ahead.
PassBy = Viscous | Callable[[PackingPoint, Event, MixedControl], tuple[Contacts, Floats]] | None


@dataclass(frozen=True)
class Dynamic:
    """Follow the equations of motion through the rest of the interval, then until rest.

    `damping` is Cundall's.
    """

    damping: float = 0.3

    def __call__(
        self, here: PackingPoint, instability: Event, control: MixedControl
    ) -> tuple[Contacts, Floats]:
        """Return the packing at rest, and the work."""
        end, work = snap_through(here.state, here.load, control, self.damping)
        jump = here.jump_to(end)
        if jump:
            raise ArithmeticError(jump)
        return end, work


WAYS: dict[str, PassBy] = {"viscous": Viscous(), "dynamic": Dynamic(), "stop": None}
# The same ways with three times the springs, and with a third of the damping: the stress of a path
# past instabilities is known to the difference (docs/knobs.md).
OTHER_WAYS: dict[PassBy, PassBy] = {
    Viscous(): Viscous(stiffness=3.0),
    Dynamic(): Dynamic(damping=0.1),
}


def past_of(way: Past | PassBy) -> PassBy:
    """Return the function for what is done past instabilities, which options give by its name."""
    return WAYS[way] if isinstance(way, str) else way


# Strain over which the load that balances the start decreases to the share that is kept.
DECAY = 1e-5
# Contacts may open within an interval from an overlap of this many intervals of the diameter.
REACH = 4.0
# Times that an interval is cut where it catches grains that carried nothing.
CUTS_AT_CATCH = 3
# Intervals before the end of a path that are kept, to go through them again.
HISTORY = 64
Stop = tuple[PathStatus, str]
CONTROL_LIMIT: Stop = ("control_limit", "limit of the control: the strain grows without bound")
NO_LOAD: Stop = ("no_load", "the packing has come apart and carries no force")


class Interval(NamedTuple):
    """The end of an interval, the loss that ended it before its `duration`, if one did."""

    end: PackingPoint
    lost: Event | None
    duration: float


class PackingPathSolver:
    """A packing on its path: its point now, and those of the last intervals."""

    def __init__(
        self,
        scene: Scene,
        stages: Sequence[Stage],
        options: PackingPathOptions,
        coasting: bool = False,
    ) -> None:
        start = contacts_at_start(scene)
        for stage in stages:
            require_upright(start, *stage.programme.equations(NOTHING, NOTHING))
        self.options, self.past, self.coasting = options, past_of(options.past), coasting
        self.history: deque[PackingPoint] = deque(maxlen=HISTORY)
        listed = start.with_forces_of_geometry().with_near(MAY_CLOSE_GAP * 2.0 * start.mean_radius)
        state, rattlers, _ = free_rattlers(listed)
        first = stages[0], float(np.linalg.norm(start.stress))
        self.point = self._recorded(PackingPoint.at_start(state, rattlers, *first))

    def start_stage(self, number: int, stage: Stage, rows: int) -> Stop | None:
        """Measure a stage, with rows at equal parts, from here; why it leads away, if it does."""
        begun = self.point.begun(number, stage)
        if begun.intervals:
            place = begun.parameter, number, len(begun.rows) - 1
            change = Event("programme_change", *place, programme=stage.programme.name)
            begun = replace(begun, events=(*begun.events, change))
        targets = np.linspace(begun.quantity, stage.target, rows + 1)[1:].tolist()
        self.point = replace(begun, targets=tuple(targets))
        self._record_reached(self.options.interval)
        away = stage.away(np.sign(stage.target - begun.quantity)) if self.point.targets else ""
        return ("lost", away) if away else None

    def run(
        self,
        size: float,
        max_steps: float = np.inf,
        progress: Callable[[float], None] | None = None,
    ) -> Stop:
        """Go on at intervals of a size to the target of the stage, or until the path ends."""
        while self.point.targets:
            self.history.append(self.point)
            enough = counted(max_steps, "interval was", "intervals were")
            stop: Stop | None = "lost", f"{enough} not enough"
            if self.point.intervals < max_steps:
                stop = self.step(size)
            if stop is not None:
                self.record()
                return stop
            if progress is not None:
                progress(self.point.parameter)
        return FINISHED

    def _record_reached(self, size: float) -> None:
        """Record a row for every target that is reached to a millionth of an interval."""
        leg, scale = self.point.leg, 1.0
        if leg.stage.quantity[0] == "P":
            state = self.point.state
            scale = float(state.law.stiffnesses(state.overlap)[0].mean())
        elif leg.stage.quantity == "parameter":
            scale = 1.0 / float(np.abs(leg.stage.programme.rate).max())
        # Targets of a quantity that is not driven may be leapt over.
        way = np.sign(leg.stage.target - leg.stage.value(leg.H, leg.P, 0.0))
        now, targets = self.point.quantity, self.point.targets
        while targets and not way * (targets[0] - now) > 1e-6 * size * scale:
            targets = targets[1:]
            self.point = replace(self.point, targets=targets)
            self.record()

    def step(self, size: float) -> Stop | None:
        """Go on by one interval, and through the instability that ends it; why the path ends.

        It is a shorter one where it catches grains that carried nothing.
        """
        start, cut = self.point, size
        for _ in range(CUTS_AT_CATCH + 1):
            events: list[Event] = []
            found: Interval | Stop
            try:
                found = self._interval(start, cut, events)
            except (ArithmeticError, RuntimeError, np.linalg.LinAlgError) as error:
                found = "lost", f"the system can't be solved: {error}"
            if not isinstance(found, Interval) or found.end.free_share == 1.0:
                break
            # There forces of grains that are caught are next to nothing, and grow with the rates of
            # the packing.
            cut *= found.end.free_share
        if not isinstance(found, Interval):
            # The events that led there stay.
            self.point = start.with_events(events) if found[0] == "lost" else start
            return found
        self.point = found.end
        if found.lost and found.lost.kind == "control_limit":
            return CONTROL_LIMIT
        stop = self._pass(found.lost, found.duration) if found.lost else None
        met = {event.contacts for event in self.point.events if event.kind == "instability"}
        if stop is None and len(met) >= self.options.instabilities:
            stop = "instabilities", f"{counted(len(met), 'contact')} without a consistent regime"
        if stop is None:
            self._record_reached(size)
        return stop

    def _interval(self, start: PackingPoint, size: float, events: list[Event]) -> Interval | Stop:
        """Strain by an increment, whose events are added; why there is none, or no end of it."""
        reach = REACH * size * 2.0 * start.state.mean_radius
        regimes = start.regime, start.side
        packing = RegimeFactor(start.state, *regimes, reach=reach, order=start.order)
        speed = float(np.linalg.norm(packing.solve(start.control())[:4]))
        if not (np.isfinite(speed) and speed > 0):
            return "no_solution", "the control moves nothing"
        point, duration = replace(start, slowest=min(start.slowest, speed)), size / speed
        if speed > MAX_SPEED_RATIO * point.slowest:
            return CONTROL_LIMIT
        kept = self.options.load_kept
        relief = min((1.0 - kept) * size / DECAY, start.load_share - kept)
        drag = self.past.stiffness if isinstance(self.past, Viscous) else None
        increment = StrainIncrement(point, packing, size, duration, relief, drag, events)
        lost = increment.run()
        while increment.reached and len(point.targets) > 1:
            # A row within the interval, which goes on as if there were none.
            end = self._end(increment)
            if end is None:
                return NO_LOAD
            increment.left += point.targets[1] - point.targets[0]
            rows = self._recorded(end).rows
            point = increment.point = replace(point, rows=rows, targets=point.targets[1:])
            lost = increment.run()
        # Up to an event within the interval the packing is in equilibrium.
        empty = not increment.time or (packing.regime[: packing.pair_count] == OPEN).all()
        if lost and lost.kind == "control_limit" and empty:
            return CONTROL_LIMIT
        end = self._end(increment)
        if end is None:
            return NO_LOAD
        jump = start.jump_to(end.state)
        if jump:
            return "lost", jump
        # Neighbours come nearer with the cell as well, by twice this.
        affine = float(np.linalg.norm(increment.strain) * start.state.radii.max())
        wandered = end.wandered + (float(np.abs(increment.u).max()) + affine)
        end = replace(end, intervals=end.intervals + 1, wandered=wandered)
        near = 2.0 * wandered < 0.5 * end.listed_gap
        return Interval(end if near else end.listed(), lost, duration)

    def _end(self, increment: StrainIncrement) -> PackingPoint | None:
        """Return the point that an increment has reached; None where no contact carries there."""
        end = increment.end()
        if not end.state.closed.any():
            return None
        return settle(end, increment.point, increment.time, self.coasting)

    def _pass(self, lost: Event, duration: float) -> Stop | None:
        """Go through a loss of equilibrium that ended an interval, or stop there."""
        point, said = self.point, f"contact {lost.contacts[0]}: {reason(lost)}"
        lost = replace(lost, parameter=0.0)
        if self.past is None:
            self.point = point.with_events([replace(lost, passed="stopped")])
            return "instabilities", said
        assert not isinstance(self.past, Viscous)
        stage = point.leg.stage
        rate = 1.0 if stage.quantity == "parameter" else stage.programme.driven(stage.quantity)
        left = (point.targets[0] - point.quantity) / rate if rate else np.inf
        # A target of a quantity that is not driven may be leapt over.
        span = min(duration, left) if left > 0 else duration
        control = point.control(1.0 / span)
        try:
            end, work = self.past(point, lost, control._replace(rate=control.rate * span))
        except ArithmeticError as error:
            self.point = point.with_events([replace(lost, passed="lost")])
            return "lost", f"{said}; {error}"
        event = replace(lost, passed="replayed", released=float(work[RELEASED]))
        self.point = point.with_events([event])
        self.go_on_from(end, work, span)
        return None

    def go_on_from(self, state: Contacts, work: Floats, duration: float) -> None:
        """Take over a state at rest, with pairs of its own, whose regimes are to be found.

        `work` (4,) is that of the motion to it, as `Path.work`.
        """
        here = self.point
        end = replace(
            here,
            state=state,
            F=state.cell @ np.linalg.inv(here.state.cell) @ here.F,
            parameter=here.parameter + duration,
            work=here.work + work,
        )
        # Its forces are in balance: a grain that was loaded in the motion keeps all of them.
        end = settle(end, None, duration)
        regime, side = regimes_of(end.state)
        self.point = replace(end, regime=regime, side=side).listed()
        # Nothing goes back through a motion.
        self.history.clear()

    def record(self) -> None:
        """Add a row."""
        self.point = self._recorded(self.point)

    def _recorded(self, point: PackingPoint) -> PackingPoint:
        """Return a point with its row, and the pathologies of its state where these are wanted."""
        if not self.options.pathologies:
            return point.recorded()
        return point.recorded(pathologies=pathologies(point))

    def path(self, status: PathStatus, message: str) -> Path:
        """The path so far."""
        columns: dict[str, Any] = {}
        for name in self.point.rows[0]:
            values = tuple(row[name] for row in self.point.rows)
            columns[name] = values if name in ("states", "pathologies") else np.array(values)
        columns |= {"events": self.point.events, "intervals": self.point.intervals}
        return Path(status=status, message=message, **columns)


# Share of the intervals before the end of a path that is gone through again in halves, and the
# least number of them.
STRETCH = 0.5
LEAST_STRETCH = 4
# Change of a limit by half the interval, over itself, from which on it counts as converged.
CONVERGED = 0.01
# Halvings after which a limit is said to be not converged.
MOST_HALVINGS = 5


@dataclass(frozen=True)
class PackingPathOptions:
    """Options of `follow` under the packing closure, see there."""

    interval: float = 5e-6
    instabilities: int = 20
    past: Past | PassBy = "viscous"
    load_kept: float = 1.0
    spread: bool = False
    progress: Callable[[float], None] | None = None
    pathologies: bool = False

    def __post_init__(self) -> None:
        number("interval", self.interval, 0.0, open_low=True)
        whole_number("instabilities", self.instabilities, 1)
        if not (callable(self.past) or isinstance(self.past, Viscous)):
            check_choice("past", self.past, get_args(Past))
        number("load_kept", self.load_kept, 0.0, 1.0)
        if self.progress is not None:
            check_type("progress", self.progress, Callable, "Give a function, or leave it out.")
        if self.spread and past_of(self.past) not in OTHER_WAYS:
            received = f"True with past={self.past!r}"
            remedy = "Leave it out: other paths have no second choice at instabilities."
            raise InputError("spread", received, "past='viscous' or 'dynamic'", remedy)


def follow_packing(
    scene: Scene,
    stages: Sequence[Stage],
    options: PackingPathOptions,
    *,
    rows: int = 0,
    max_steps: int = 20_000,
) -> Path:
    """Follow a packing through its stages: `stability.follow` with the packing closure."""
    o, solver = options, PackingPathSolver(scene, stages, options)

    def through(number: int, stage: Stage) -> Stop:
        away = solver.start_stage(number, stage, max(rows, 1))
        return away or solver.run(o.interval, max_steps, o.progress)

    stop = follow_stages(through, stages)
    path = solver.path(*stop)
    if o.spread:
        again = path
        if any(event.passed for event in path.events):
            other = OTHER_WAYS[solver.past]
            asked = replace(o, past=other, spread=False, pathologies=False)
            again = follow_packing(scene, stages, asked, rows=rows, max_steps=max_steps)
        path = replace(path, stress_spread=_stress_spread(path, again))
    met = stop[0] == "control_limit" or (stop[0] == "instabilities" and solver.past is None)
    if not (met and solver.history):
        return path

    def in_halves(size: float) -> Stop | None:
        stop = solver.run(size)
        return None if stop == FINISHED else stop

    _, limit, spread = halved(solver, stop, in_halves, lambda: solver.point.parameter)
    message = f"{path.message}; the limit has not converged" if spread > CONVERGED else path.message
    return replace(path, message=message, limit=limit, limit_spread=spread)


def _stress_spread(path: Path, other: Path) -> float:
    """Largest difference of the stress of two paths where both have rows, over its change."""
    both = path.parameter <= other.parameter[-1] * (1.0 + 1e-12)
    P = np.array([np.interp(path.parameter[both], other.parameter, p) for p in other.P.T]).T
    apart = np.linalg.norm(path.P[both] - P, axis=1).max()
    return float(apart / max(np.linalg.norm(path.P - path.P[0], axis=1).max(), 1e-300))


def halved(
    solver: PackingPathSolver,
    stop: Stop,
    again: Callable[[float], Stop | None],
    value: Callable[[], float],
) -> tuple[Stop, float, float]:
    """Go through the last intervals again, in halves: the stop, its limit, its change over itself.

    `again` goes on at intervals of a size, and tells why the path stops, if before its target. They
    are halved until the limit changes by less than 1 %; else the change is infinite.
    """
    limit = value()
    for _ in range(MOST_HALVINGS):
        end = solver.point
        back = min(max(LEAST_STRETCH, math.ceil(STRETCH * end.intervals)), len(solver.history))
        for _ in range(back):
            solver.point = solver.history.pop()
        # Half of what the intervals were in the mean: one that a limit ends is shorter.
        size = 0.5 * float(np.linalg.norm(end.F - solver.point.F)) / back
        found = again(size) if size > 0 else None
        if found is None:
            # In halves it goes on, or nothing moved.
            solver.point = end
            return stop, limit, math.inf if size > 0 else 0.0
        stop, coarse, limit = found, limit, value()
        if abs(coarse - limit) <= CONVERGED * abs(limit):
            return stop, limit, abs(coarse - limit) / max(abs(limit), 1e-300)
    return stop, limit, math.inf


def pathologies(point: PackingPoint) -> Pathologies:
    """Look at the matrix of the candidates of a state, with a factor of its own.

    Pairs of grains that carry nothing have no regimes.
    """
    state, regime, control = point.state, point.regime, point.control()
    N = np.tile(state.normal_force, state.law.springs)
    T = state.law.of_springs(state.shear_force, state.rolling_moment / state.mean_radius)
    packing = RegimeFactor(state, regime, point.side, order=point.order)
    held = np.resize(point.absent, len(regime))
    candidates = packing.at_yield(N, T, held)
    stuck = candidates[regime[candidates] == ELASTIC]
    packing.side[stuck] = np.sign(T[stuck])
    rates, m = packing.solve(control), len(candidates)
    strain, stress = rates[:4], packing.stress(rates)
    # Over the sizes of both.
    size = float(np.linalg.norm(stress) * np.linalg.norm(strain))
    w2 = float(stress @ strain) / size if size > 0 else np.nan
    if m > MOST_CANDIDATES:
        said = f"{m} candidates, {MOST_CANDIDATES} at most"
        return Pathologies(m, np.nan, None, None, -1, False, w2, said)
    if m == 0:
        return _judged(np.zeros(0), np.eye(0), w2)
    q, M = packing.problem(control, candidates)
    # Of slips, not of slips times stiffness: work-conjugate to the forces.
    return _judged(q, M * packing.frame["kt"][candidates], w2, packing.rounding(rates))


def _judged(q: Floats, M: Floats, w2: float, low: float = 0.0) -> Pathologies:
    """Return what `w = q + M z` says of itself."""
    m, size = len(q), float(np.linalg.norm(M)) or 1.0
    asymmetry, definite = float(np.linalg.norm(M - M.T)) / size, m == 0 or positive_definite(M)
    if m < FEW_CANDIDATES:
        sure, told = is_p_matrix(M), "minors vanish to rounding, or are too many to decide"
    else:
        sure = True if definite or has_definite_scaling(M) else None
        told = f"{m} candidates, fewer than {FEW_CANDIDATES} wanted for the minors"
    told = "" if sure is not None else told
    solutions, proved = (1, True) if sure else (-1, False)
    if not sure and m < FEW_CANDIDATES:
        found = agreeing(SlipProblem(q, M, low=low), starts=FEW_STARTS)
        solutions, proved = len(found.solutions), found.exhaustive
    return Pathologies(m, asymmetry, definite, sure, solutions, proved, w2, told)


def columns(found: tuple[Pathologies, ...]) -> dict[str, Floats]:
    """Return columns of a table: flags as 1, 0, nan where they are not known."""
    names = ("candidates", "asymmetry", "symmetric", "definite", "p_matrix", "solutions", "proved")
    kinds = {"candidates": int, "solutions": int, "proved": bool, "withheld": str}
    out: dict[str, Floats] = {}
    for name in (*names, "w2", "withheld"):
        values = [getattr(one, name) for one in found]
        # None becomes not a number.
        out["path_w2" if name == "w2" else name] = np.array(values, kinds.get(name, float))
    return out
