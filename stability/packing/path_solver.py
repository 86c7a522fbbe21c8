"""The solver of the path of a packing: interval after interval, each replaces its point."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from loops.contacts import contacts_at_start
from loops.scene import Scene
from stability.packing.equations_of_motion import require_upright
from stability.packing.past import PassBy, Passed, Viscous, past_of
from stability.packing.pivots import pathologies
from stability.packing.point import MAY_CLOSE_GAP, PackingPoint, regimes_of
from stability.packing.rattlers import free_rattlers, settle
from stability.packing.regime_factor import OPEN, Memory, RegimeFactor
from stability.packing.strain_increment import MAX_SPEED_RATIO, StrainIncrement
from stability.path import FINISHED, Event, Past, Path, PathStatus, reason
from stability.programmes import NOTHING, Stage

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
        interval: float,
        past: Past | PassBy,
        load_kept: float = 1.0,
        pathologies: bool = False,
        coasting: bool = False,
    ) -> None:
        start = contacts_at_start(scene)
        for stage in stages:
            require_upright(start, *stage.programme.equations(NOTHING, NOTHING))
        self.interval, self.past, self.load_kept = interval, past_of(past), load_kept
        self.looks_at_pathologies, self.coasting = pathologies, coasting
        self.looked: Memory | None = None
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
        self._record_reached(self.interval)
        away = stage.away(np.sign(stage.target - begun.quantity)) if self.point.targets else ""
        return ("lost", away) if away else None

    def run(
        self,
        size: float,
        instabilities: int,
        max_steps: float = np.inf,
        progress: Callable[[float], None] | None = None,
    ) -> Stop:
        """Go on at intervals of a size to the target of the stage, or until the path ends."""
        while self.point.targets:
            self.history.append(self.point)
            stop: Stop | None = "lost", f"{max_steps} intervals were not enough"
            if self.point.intervals < max_steps:
                stop = self.step(size, instabilities)
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

    def step(self, size: float, instabilities: int) -> Stop | None:
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
        if stop is None and len(met) >= instabilities:
            stop = "instabilities", f"{len(met)} contacts have no consistent regime"
        if stop is None:
            self._record_reached(size)
        return stop

    def _interval(self, start: PackingPoint, size: float, events: list[Event]) -> Interval | Stop:
        """Strain by an increment, whose events are added; why there is none, or no end of it."""
        reach = REACH * size * 2.0 * start.state.mean_radius
        regimes = start.regime, start.side
        packing = RegimeFactor(start.state, *regimes, reach=reach, memory=start.memory)
        speed = float(np.linalg.norm(packing.solve(start.control()).h[:4]))
        if not (np.isfinite(speed) and speed > 0):
            return "no_solution", "the control moves nothing"
        point, duration = replace(start, slowest=min(start.slowest, speed)), size / speed
        if speed > MAX_SPEED_RATIO * point.slowest:
            return CONTROL_LIMIT
        relief = min((1.0 - self.load_kept) * size / DECAY, start.load_share - self.load_kept)
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
        stage = point.leg.stage
        rate = 1.0 if stage.quantity == "parameter" else stage.programme.driven(stage.quantity)
        left = (point.targets[0] - point.quantity) / rate if rate else np.inf
        # A target of a quantity that is not driven may be leapt over.
        span = min(duration, left) if left > 0 else duration
        control = point.control(1.0 / span)
        assert not isinstance(self.past, Viscous)
        passed = self.past(point, lost, control._replace(rate=control.rate * span))
        event = replace(lost, parameter=0.0, passed=passed.how, released=passed.released)
        self.point = point.with_events([event])
        if passed.how == "stopped":
            return "instabilities", said
        if passed.state is None:
            return "lost", f"{said}; {passed.message}"
        self.go_on_from(passed, span)
        return None

    def go_on_from(self, passed: Passed, duration: float) -> None:
        """Take over a state at rest, with pairs of its own, whose regimes are to be found."""
        assert passed.state is not None and passed.work is not None
        here = self.point
        end = replace(
            here,
            state=passed.state,
            F=passed.state.cell @ np.linalg.inv(here.state.cell) @ here.F,
            parameter=here.parameter + duration,
            work=here.work + passed.work,
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
        if not self.looks_at_pathologies:
            return point.recorded()
        found, self.looked = pathologies(point, self.looked)
        return point.recorded(pathologies=found)

    def path(self, status: PathStatus, message: str) -> Path:
        """The path so far."""
        columns: dict[str, Any] = {}
        for name in self.point.rows[0]:
            values = tuple(row[name] for row in self.point.rows)
            columns[name] = values if name in ("states", "pathologies") else np.array(values)
        columns |= {"events": self.point.events, "intervals": self.point.intervals}
        return Path(status=status, message=message, **columns)
