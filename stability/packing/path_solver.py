"""The solver of the path of a packing: its state, interval after interval, events and rows."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from loops.arrays import Flags, Floats, Regimes
from loops.contacts import AT_YIELD, Contacts, contacts_at_start
from loops.scene import Scene
from stability.packing.controls import MixedControl
from stability.packing.equations_of_motion import require_upright
from stability.packing.past import PassBy, Passed, Standing, Viscous, past_of
from stability.packing.pathologies import pathologies
from stability.packing.rattlers import free_rattlers, share_until_caught
from stability.packing.regime_factor import ELASTIC, OPEN, SLIDING, RegimeFactor
from stability.packing.state import jumped
from stability.packing.strain_increment import (
    RELEASED,
    ControlLimitError,
    Goal,
    InstabilityError,
    StrainIncrement,
)
from stability.path import FINISHED, Event, Past, Path, Pathologies, PathStatus
from stability.programmes import NOTHING, Stage
from stability.spectra import COMPONENTS

# Pairs closer than this share of the mean diameter may close: they are listed, as open contacts.
MAY_CLOSE_GAP = 0.01
# Strain over which the load that balances the start decreases to the share that is kept.
DECAY = 1e-5
# Contacts may open within an interval from an overlap of this many intervals of the diameter.
REACH = 4.0
# Largest strain speed over the smallest of the stage; beyond, the control has met its limit.
MAX_SPEED_RATIO = 1e3
# Times that an interval is cut where it catches grains that carried nothing.
CUTS_AT_CATCH = 3
# Share of the gap up to which pairs are listed that a coasting grain goes in an interval at most.
MOST_COAST = 0.25
# Intervals before the end of a path that are kept, to go through them again.
HISTORY = 64
CONTROL_LIMIT = "limit of the control: the strain grows without bound"
Stop = tuple[PathStatus, str]


class RejectedError(Exception):
    """The path ends in the state before the interval: status and message."""


class PackingPathSolver:
    """The current state of a packing on its path, and the rows and events so far."""

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
        self.wandered, self.listed_gap = 0.0, MAY_CLOSE_GAP * 2.0 * start.mean_radius
        self.state = start.with_forces_of_geometry().with_near(self.listed_gap)
        for stage in stages:
            require_upright(start, *stage.programme.equations(NOTHING, NOTHING))
        self.stages, self.looks_at_pathologies = stages, pathologies
        self.looked: RegimeFactor | None = None
        self.size, self.past, self.load_kept = interval, past_of(past), load_kept
        self.parameter, self.intervals = 0.0, 0
        # Whether grains that carry nothing go on, and how far (B, 2) for the loading parameter.
        self.coasting, self.coast = coasting, np.zeros((1, 2))
        # Share of the last increment up to which no grain that carried nothing was caught.
        self.free_share = 1.0
        self.work = np.zeros(4)
        self.events: list[Event] = []
        self.rows: list[dict[str, Any]] = []
        # Values of the stage's quantity at which rows are left to record, and where to go back to.
        self.targets: deque[float] = deque()
        self.history: deque[dict[str, Any]] = deque(maxlen=HISTORY)
        # Memory and order of elimination of the increment before.
        self.packing: RegimeFactor | None = None
        self.F = np.eye(2)
        self.volume = abs(float(np.linalg.det(self.state.cell)))
        self.first_stress = float(np.linalg.norm(start.stress))
        # Of the pairs, then of their springs against rolling.
        self.regime: Regimes
        self.side: Floats
        self.state, self.rattlers, _ = free_rattlers(self.state)
        self._find_regimes()
        self.first_resultants, self.unbalanced_share = self.state.resultants, 1.0
        self.imbalance = 0.0 * self.balance
        self._start_stage(0)
        self.record()

    def _list_pairs(self) -> None:
        """Add the pairs that are close to the list, as open contacts."""
        self.wandered = 0.0
        self.state = self.state.with_near(self.listed_gap)
        springs, known = self.state.law.springs, len(self.regime)
        fresh = np.zeros((springs, len(self.state.contacts) - known // springs))
        regime, side = self.regime.reshape(springs, -1), self.side.reshape(springs, -1)
        self.regime = np.hstack([regime, fresh + OPEN]).astype(np.int8).ravel()
        self.side = np.hstack([side, fresh]).ravel()

    def _find_regimes(self) -> None:
        """Mark closed contacts on the friction limit as sliding, on the side of their force."""
        law, state = self.state.law, self.state
        T = law.of_springs(state.shear_force, state.rolling_moment)
        most = law.of_springs(state.strength, state.rolling_strength)
        slides = np.abs(T) >= AT_YIELD * most
        regime = np.where(slides, SLIDING, ELASTIC)
        closed = np.resize(self.state.closed, len(T))
        self.regime = np.where(closed, regime, OPEN).astype(np.int8)
        self.side = np.sign(T)

    def _start_stage(self, number: int) -> None:
        """Measure strains, stresses and the loading parameter of a stage from this state."""
        self.stage, self.stage_start = number, self.parameter
        self.H_start, self.P_start = self.H, self.P
        self.min_strain_speed = np.inf

    @property
    def H(self) -> Floats:
        """(4,) displacement gradient."""
        return (np.eye(2) - self.F).ravel()

    @property
    def balance(self) -> Floats:
        """(B, 3) resultants of the start that are still balanced by a load."""
        return self.unbalanced_share * self.first_resultants

    @property
    def P(self) -> Floats:
        """(4,) nominal stress over the reference cell."""
        return self._to_reference() @ self.state.stress.ravel()

    def _to_reference(self) -> Floats:
        """`P0 = (V/V0) P F^-T` on the components."""
        share = abs(float(np.linalg.det(self.state.cell))) / self.volume
        return share * np.kron(np.eye(2), np.linalg.inv(self.F))

    def follow(
        self,
        number: int,
        stage: Stage,
        rows: int,
        instabilities: int,
        max_steps: int,
        progress: Callable[[float], None] | None,
    ) -> Stop:
        """Follow a stage to its target, or until the path ends; status and message."""
        if self.intervals:
            place, name = (self.parameter, number, len(self.rows) - 1), stage.programme.name
            self.events.append(Event("programme_change", *place, programme=name))
        self.start_stage(number, stage, rows)
        away = stage.away(np.sign(stage.target - self._quantity(stage))) if self.targets else ""
        if away:
            return "lost", away
        while self.targets:
            if self.intervals >= max_steps:
                self.record()
                return "lost", f"{max_steps} intervals were not enough"
            self.history.append(self.saved())
            stop = self.step(stage, instabilities)
            if stop is not None:
                self.record()
                return stop
            if progress is not None:
                progress(self.parameter)
        return FINISHED

    def ends(self, stage: Stage, size: float, instabilities: int) -> bool:
        """Go on at intervals of a size; whether the path ends before the target of the stage."""
        self.size = size
        while self.targets:
            self.history.append(self.saved())
            if self.step(stage, instabilities) is not None:
                return True
        return False

    def start_stage(self, number: int, stage: Stage, rows: int) -> None:
        """Measure a stage from this state; rows are recorded at equal parts of its quantity."""
        self._start_stage(number)
        start = self._quantity(stage)
        self.targets = deque(np.linspace(start, stage.target, rows + 1)[1:].tolist())
        self._record_reached(stage)

    def saved(self) -> dict[str, Any]:
        """All that the path is, to go back to."""
        kept = {name: value for name, value in vars(self).items() if name != "history"}
        return {name: copy(value) for name, value in kept.items()}

    def restore(self, saved: dict[str, Any]) -> None:
        """Go back to a saved state of the path."""
        vars(self).update({name: copy(value) for name, value in saved.items()})

    def _quantity(self, stage: Stage) -> float:
        """The quantity whose target ends the stage."""
        return stage.value(self.H, self.P, self.parameter - self.stage_start)

    def _record_reached(self, stage: Stage) -> None:
        """Record a row for every target that is reached to a millionth of an interval."""
        scale = 1.0
        if stage.quantity[0] == "P":
            scale = float(self.state.law.stiffnesses(self.state.overlap)[0].mean())
        elif stage.quantity == "parameter":
            scale = 1.0 / float(np.abs(stage.programme.rate).max())
        # Targets of a quantity that is not driven may be leapt over.
        way = np.sign(stage.target - (stage.value(self.H_start, self.P_start, 0.0)))
        while self.targets and not (
            way * (self.targets[0] - self._quantity(stage)) > 1e-6 * self.size * scale
        ):
            self.targets.popleft()
            self.record()

    def step(self, stage: Stage, instabilities: int) -> Stop | None:
        """Go on by one interval, and through the instability that ends it; why the path ends.

        It is a shorter one where it catches grains that carried nothing.
        """
        before = self.saved()
        events: list[Event] = []
        try:
            for cut in range(CUTS_AT_CATCH + 1):
                met, duration = self._interval(stage, events)
                if self.free_share == 1.0 or cut == CUTS_AT_CATCH:
                    break
                # There forces of grains that are caught are next to nothing, and grow with the
                # rates of the packing.
                size = self.free_share * self.size
                self.restore(before)
                events.clear()
                self.size = size
            self.size = before["size"]
        except RejectedError as error:
            status, message = error.args
        except ControlLimitError:
            status, message = "control_limit", CONTROL_LIMIT
        except (ArithmeticError, RuntimeError, np.linalg.LinAlgError) as error:
            status, message = "lost", f"the system can't be solved: {error}"
        else:
            if isinstance(met, ControlLimitError):
                return "control_limit", CONTROL_LIMIT
            stop = self._pass(met, duration, stage) if met else None
            found = {event.contacts for event in self.events if event.kind == "instability"}
            if stop is None and len(found) >= instabilities:
                stop = "instabilities", f"{len(found)} contacts have no consistent regime"
            if stop is None:
                self._record_reached(stage)
            return stop
        self.restore(before)
        if status == "lost":
            # The events that led there stay.
            self._add_events(events)
        return status, message

    def _increment(self, stage: Stage) -> tuple[StrainIncrement, float]:
        """Return the increment that comes next, and the share of the resultants that it takes."""
        reach = REACH * self.size * 2.0 * self.state.mean_radius
        pairs = self.state.records(reach), self.regime, self.side
        none = np.zeros(3 * len(self.state.x))
        packing = RegimeFactor(self.state, *pairs, none, self.packing)
        speed = float(np.linalg.norm(packing.solve(*self._control(stage, 0.0)).h[:4]))
        if not (np.isfinite(speed) and speed > 0):
            raise RejectedError("no_solution", "the control moves nothing")
        self.min_strain_speed = min(self.min_strain_speed, speed)
        max_speed = MAX_SPEED_RATIO * self.min_strain_speed
        if speed > max_speed:
            raise ControlLimitError
        duration = self.size / speed
        scale = np.tile([1.0, 1.0, 1.0 / packing.length], len(self.state.x))
        decrease = (1.0 - self.load_kept) * self.size / DECAY
        decrease = min(decrease, self.unbalanced_share - self.load_kept)
        relief = decrease * self.first_resultants.ravel() * scale / duration
        # Remove the force imbalance over this interval by adding it as a load.
        packing.set_load(self.imbalance.ravel() * scale / duration + relief)
        return StrainIncrement(
            packing,
            self.state,
            reach,
            self._control(stage, 1.0 / duration),
            self.balance.ravel() * scale,
            relief,
            duration,
            self._goal(stage, self.targets[0]),
            # Under given strain rates its time ends it, to rounding.
            (1.0 + 1e-9) * self.size,
            max_speed,
            self.past if isinstance(self.past, Viscous) else None,
            self.rattlers,
        ), decrease

    def _interval(
        self, stage: Stage, events: list[Event]
    ) -> tuple[InstabilityError | ControlLimitError | None, float]:
        """Strain by an increment: what ends it before its goal, and the duration asked for."""
        increment, decrease = self._increment(stage)
        packing, duration = increment.packing, increment.duration
        met: InstabilityError | ControlLimitError | None = None
        taken = increment, decrease / duration
        try:
            increment.run()
            while len(self.targets) > 1 and increment.reached and increment.time < duration:
                # A row within the interval, which goes on as if there were none.
                before = self.saved()
                self._take(*taken)
                self.record()
                self.restore(before | {"rows": self.rows})
                increment.left += self.targets[1] - self.targets.popleft()
                increment.run()
        except InstabilityError as error:
            met = error
        except ControlLimitError as error:
            # It is met at an event within the interval; up to there the packing is in equilibrium.
            if not increment.time or (packing.regime[: packing.pair_count] == OPEN).all():
                raise
            met = error
        finally:
            events += increment.events
        before_it = self.state
        self._take(*taken)
        self.packing = packing
        jump = jumped(before_it, self.state, self.first_stress)
        if jump:
            raise RejectedError("lost", jump)
        self.intervals += 1
        # Neighbours come nearer with the cell as well, by twice this.
        affine = float(np.linalg.norm(increment.strain) * self.state.radii.max())
        self.wandered += float(np.abs(increment.u).max()) + affine
        if not 2.0 * self.wandered < 0.5 * self.listed_gap:
            self._list_pairs()
        return met, duration

    def _take(self, increment: StrainIncrement, relief: float) -> None:
        """Take over the state that an increment has reached; `relief` of the load a time."""
        state, self.regime, self.side, work = increment.end()
        if not state.closed.any():
            raise RejectedError("no_load", "the packing has come apart and carries no force")
        self._add_events(increment.events, increment.released)
        self.F = self.F - increment.strain.reshape(2, 2) @ self.F
        self.unbalanced_share -= relief * increment.time
        self._accept(state, increment.time, work, increment.rattlers)
        closed = np.resize(self.state.closed, len(self.regime))
        entered = closed & (self.regime == OPEN)
        regime = np.where(closed, np.where(entered, ELASTIC, self.regime), OPEN)
        self.regime = regime.astype(np.int8)

    def _accept(self, state: Contacts, duration: float, work: Floats, before: Flags | None) -> None:
        """Take over a later state, with the loading parameter and work that led to it.

        Grains that carry nothing leave the system, or join it; some did not carry `before`.
        """
        start, idle = self.state, self.rattlers
        free_before = before if self.coasting and duration > 0.0 else None
        free = state if free_before is None else self._coasted(state, duration)
        self.state, self.rattlers, released = free_rattlers(free, before)
        self.coast = np.zeros_like(state.x)
        if free_before is not None:
            coasting = self.rattlers & free_before
            self.coast[coasting] = (self.state.x - state.x)[coasting] / duration
        caught = idle & ~self.rattlers
        self.free_share = 1.0
        if before is not None and caught.any():
            self.free_share = share_until_caught(start, state, caught, before)
        self.first_resultants[self.rattlers] = 0.0
        self.parameter += duration
        self.work += work
        self.work[RELEASED] += released
        self.wandered += float(np.abs(self.state.x - state.x).max())
        self.imbalance = self.state.resultants - self.balance

    def _coasted(self, state: Contacts, duration: float) -> Contacts:
        """Return the state where grains without load have gone on as in the interval before.

        No further than the pairs are listed. What they meet then pushes them out of overlap.
        """
        step = self.coast * duration
        most = MOST_COAST * self.listed_gap / np.maximum(np.linalg.norm(step, axis=1), 1e-300)
        return replace(state, x=state.x + np.minimum(1.0, most)[:, None] * step)

    def _pass(self, met: InstabilityError, duration: float, stage: Stage) -> Stop | None:
        """Go through an instability that ended an interval, or stop there."""
        rate = 1.0 if stage.quantity == "parameter" else stage.programme.driven(stage.quantity)
        left = (self.targets[0] - self._quantity(stage)) / rate if rate else np.inf
        # A target of a quantity that is not driven may be leapt over.
        span = min(duration, left) if left > 0 else duration
        control = self._control(stage, 1.0 / span)
        passed = self.past(self.here, met.event, control._replace(rate=control.rate * span))
        event = replace(met.event, parameter=0.0, passed=passed.how, released=passed.released)
        self._add_events([event])
        if passed.how == "stopped":
            return "instabilities", str(met)
        if passed.state is None:
            return "lost", f"{met}; {passed.message}"
        self._go_on_from(passed, span)
        return None

    @property
    def here(self) -> Standing:
        """Return what an instability meets, for a function that passes it."""
        return Standing(self.state, -self.balance, self.first_stress)

    def take_motion(self, passed: Passed, load: float) -> None:
        """Go on from the end of a motion that came to rest, at another loading parameter."""
        self._go_on_from(passed, load - self.parameter)
        self.record()

    def _go_on_from(self, passed: Passed, duration: float) -> None:
        """Take over a state at rest, with pairs of its own, whose regimes are to be found."""
        assert passed.state is not None and passed.work is not None
        self.F = passed.state.cell @ np.linalg.inv(self.state.cell) @ self.F
        # Its forces are in balance: a grain that was loaded in the motion keeps all of them.
        self._accept(passed.state, duration, passed.work, None)
        self._find_regimes()
        self._list_pairs()
        # Nothing goes back through a motion.
        self.history.clear()

    def control_to(self, stage: Stage, parameter: float) -> MixedControl:
        """The whole change of stress and strain to a later loading parameter."""
        whole = stage.programme.rate * (parameter - self.stage_start) - self._done(stage)
        return self._control(stage, 0.0)._replace(rate=whole)

    def _control(self, stage: Stage, correction: float) -> MixedControl:
        """The programme on rates in the current geometry; its error is made good at a rate."""
        stress, strain, rate = stage.programme.equations(self.H, self.P)
        if correction:
            asked = rate * (self.parameter - self.stage_start)
            rate = rate - correction * (self._done(stage) - asked)
        turned = np.kron(np.eye(2), self.F.T)
        return MixedControl(stress @ self._to_reference(), strain @ turned, rate)

    def _done(self, stage: Stage) -> Floats:
        """Return how far the controlled values (4,) have come in the stage."""
        now, start = (self.H, self.P), (self.H_start, self.P_start)
        return stage.programme.values(*now) - stage.programme.values(*start)

    def _goal(self, stage: Stage, target: float) -> Goal:
        """The stage's quantity on rates in the current geometry, and its distance to the target."""
        left, none = target - self._quantity(stage), np.zeros(4)
        if stage.quantity == "parameter":
            return Goal(left, none, none, 1.0)
        k = COMPONENTS.index(stage.quantity[1:])
        if stage.quantity[0] == "H":
            return Goal(left, np.kron(np.eye(2), self.F.T)[k], none, 0.0)
        return Goal(left, none, self._to_reference()[k], 0.0)

    def _add_events(self, events: list[Event], released: Floats | None = None) -> None:
        """Add events after the current state, those of grains with the energy that these let go."""
        left = None if released is None else released.copy()
        for event in events:
            if event.grains and left is not None:
                grains = list(event.grains)
                event = replace(event, released=float(left[grains].sum()))
                # The energy of a grain belongs to its first instability.
                left[grains] = 0.0
            parameter = self.parameter + event.parameter
            index = sum(one["parameter"] <= parameter for one in self.rows) - 1
            place = {"parameter": parameter, "stage": self.stage, "index": index}
            self.events.append(replace(event, **place))

    def record(self) -> None:
        """Add a row."""
        state = self.state
        row = {
            "parameter": self.parameter,
            "stage": self.stage,
            "H": self.H,
            "P": self.P,
            "states": state,
            "work": self.work.copy(),
            "energy": state.stored_energy,
            "imbalance": np.abs(self.imbalance)[:, :2].max() / state.mean_force,
        }
        if self.looks_at_pathologies:
            row["pathologies"] = self._pathologies()
        self.rows.append(row)

    def _pathologies(self) -> Pathologies:
        """Look at the matrix of the candidates of this state, with a factor of its own."""
        held = np.resize(self.rattlers[self.state.contacts].any(axis=1), len(self.regime))
        control, regimes = self._control(self.stages[self.stage], 0.0), (self.regime, self.side)
        found, self.looked = pathologies(self.state, *regimes, control, held, self.looked)
        return found

    def path(self, status: PathStatus, message: str) -> Path:
        """The path so far."""
        columns: dict[str, Any] = {}
        for name in self.rows[0]:
            values = tuple(row[name] for row in self.rows)
            columns[name] = values if name in ("states", "pathologies") else np.array(values)
        columns |= {"events": tuple(self.events), "intervals": self.intervals}
        return Path(status=status, message=message, **columns)
