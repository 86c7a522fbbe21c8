"""Solver of a loop's path: segments of fixed regimes, joined by rate problems at the events."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np

from loops import Scene
from loops.arrays import Floats
from loops.closures import Closure, Spins
from loops.errors import InputError, check_choice
from loops.laws.frictional import TOUCHING_RTOL, Regime
from loops.laws.of_pairs import require_unlimited_rolling
from loops.symmetry import PointGroup
from stability.path import (
    CAUSES,
    FINISHED,
    Cause,
    ModelOption,
    Path,
    PathStatus,
    follow_stages,
    reason,
)
from stability.paths.model import PathModel, path_model, with_contact, without_pairs
from stability.paths.path_segment import SegmentEnd, event_functions, follow_segment
from stability.paths.record import (
    Record,
    Searches,
    expected_regimes,
    model_choice,
    record_changes,
    record_fired,
    record_jumps,
    record_start,
    touched_pairs,
)
from stability.paths.regimes import EdgeTrial, edge_problem, path_symmetry, rate_vector
from stability.paths.segment import ATOL, Steps
from stability.paths.state import (
    Mode,
    centres,
    first_state,
    pair_overlaps,
    scales,
    shear_stiffness,
    start_mode,
)
from stability.paths.state_rates import UNIT_PARAMETER, StateRates
from stability.programmes import Programme, Stage
from stability.regimes import ENUMERATION_LIMIT, RateStatus, Regimes
from stability.spectra import operator_norm, restrict, subspace_basis

# Statuses of a rate problem without regimes to go on with.
UNANSWERED: tuple[RateStatus, ...] = ("none", "none found")
# Longest step in the space of `H`, and steps that a stage takes at least, if it is as long as its
# start promises; events are looked for four times a step.
LONGEST_STEP, MIN_STEPS = 0.05, 8
# Rate problems in a row without progress after which the stage ends without a solution; without
# a force in any contact events are rounding, and after the second one the loop has come apart.
CHATTER, UNLOADED = 12, 1
# Longest steps to try, over the first one, where a singular state is in the way.
RETRIES = (1.0, 0.86, 0.74, 0.62)
# A target this close, in strain or in stress over kn, is reached.
REACHED = 1e-15
# Change of H within which nothing has moved.
UNMOVED = 1e-13
# Force that a parting contact may drop, over kn times length.
RELEASE = 1e-9
# A normalised eigenvalue this small is zero.
SINGULAR_RTOL = 1e-12
# Status of a path that kept its symmetry to the end.
SYMMETRY_KEPT = "to the end"
STOPPED: tuple[PathStatus, str] = ("unfinished", "an event ends the path")
OnTouch = Literal["ignore", "stop", "add"]


@dataclass(frozen=True, eq=False)
class LoopPathOptions:
    """Options of `follow` under the affine and traction closures, see there."""

    spins: Spins = "blocked"
    subspace: str | Sequence[str] = "diagonal"
    contact_on_touch: OnTouch = "ignore"
    model: ModelOption = "auto"

    def __post_init__(self) -> None:
        check_choice("spins", self.spins, get_args(Spins))
        check_choice("contact_on_touch", self.contact_on_touch, get_args(OnTouch))
        check_choice("model", self.model, get_args(ModelOption))
        for subspace in self.subspaces:
            subspace_basis(subspace)
        if not self.subspaces:
            raise InputError("subspace", "none", "one at least", "Name 'diagonal', say.")

    @property
    def subspaces(self) -> tuple[str, ...]:
        """Subspaces whose spectra are watched."""
        return (self.subspace,) if isinstance(self.subspace, str) else tuple(self.subspace)


@dataclass
class LoopPathSolver:
    """State of a path, and how it goes on; `follow_stages` leads it through its stages.

    `y` (Y,): Integrated variables; `atol`: Tolerance in natural units; `rows`: Rows of a stage;
    `steps_left`: Steps until the path is given up; `common`: Symmetry that all programmes keep;
    `symmetry_kept`: How far the symmetry served; `stop`: Kinds of events at the first of which, in
    the first subspace, the path ends; it begins with the opening of contacts that part at once;
    `in_full`: Combinations of regimes up to which all are tried.
    """

    model: PathModel
    y: Floats
    mode: Mode
    options: LoopPathOptions
    atol: float
    rows: int
    steps_left: int
    programmes: tuple[Programme, ...]
    record: Record = field(default_factory=Record)
    searches: Searches = field(default_factory=Searches)
    common: PointGroup | None = None
    symmetry_kept: str = SYMMETRY_KEPT
    stop: tuple[str, ...] = ()
    in_full: int = ENUMERATION_LIMIT

    @property
    def parameter(self) -> float:
        """Loading parameter."""
        return float(self.y[-5])

    def at(self, programme: Programme, gauge: Floats = UNIT_PARAMETER) -> StateRates:
        """The present state."""
        return StateRates(self.model, self.y, self.mode, programme, gauge)

    # ---- symmetry

    def find_symmetry(self) -> None:
        """Find the symmetry of the state and of all that follows, if the model may be smaller."""
        if self.options.model == "auto":
            self.common = self._symmetry(self.programmes)
            self.model = replace(self.model, symmetry=self.common)

    def _symmetry(self, programmes: Sequence[Programme]) -> PointGroup | None:
        return path_symmetry(self.at(programmes[0]), programmes)

    # ---- stages

    def _start_stage(self, number: int, stage: Stage) -> None:
        """Record the change of programme, and take on the symmetry of the stage.

        By itself a stage may keep a larger symmetry than all of them do: fewer freedoms are left to
        go singular. Those of a ring do so together at a threshold.
        """
        if self.record.rows:
            self.record.event("programme_change", self.parameter, programme=stage.programme.name)
        self.record.stage = number
        several = len(self.programmes) > 1
        if self.options.model == "auto" and self.symmetry_kept == SYMMETRY_KEPT and several:
            own = self._symmetry([stage.programme])
            larger = own is not None and own.order > (self.common.order if self.common else 1)
            self.model = replace(self.model, symmetry=own if larger else self.common)

    def follow_stage(self, number: int, stage: Stage) -> tuple[PathStatus, str]:
        """Follow one stage to its target or to where it ends."""
        self._start_stage(number, stage)
        start, name = self.parameter, stage.programme.name
        here = self.at(stage.programme)
        way = stage.target - stage.value(here.H, here.P, 0.0)
        unit = self.model.stiffness if stage.quantity.startswith("P") else 1.0
        if self.record.rows and abs(way) <= REACHED * unit:
            return FINISHED
        sense = float(np.sign(way))
        expected: dict[int, int] = {}
        before: StateRates | None = None
        idle, reach = 0, np.inf
        while True:
            problem = self._rate_problem(stage, expected, before)
            if problem.status in UNANSWERED:
                # Zero force at the start of loading is not a separation.
                if self.record.rows and self._carries_nothing(self.at(stage.programme)):
                    return self._came_apart()
                return self._no_continuation(stage, problem, expected)
            here = self._take_regimes(stage, problem, before)
            if sense == 0.0:
                return FINISHED
            if self._stops() or self._begins_lost(here):
                return STOPPED
            if before is None:
                if away := stage.away(sense):
                    return "lost", away
                # Length of the stage in the space of H, judged from its start.
                rate = abs(stage.value(here.rates.H, here.rates.P, here.rates.parameter))
                left = abs(stage.target - stage.value(here.H, here.P, 0.0))
                reach = float(left / rate) if rate > 0 else np.inf
            end = self._run_segment(stage, start, sense, reach, here)
            self.y, self.steps_left = end.here.y, self.steps_left - end.steps
            if not end.fired:
                if self._carries_nothing(end.here):
                    return self._came_apart()
                return "lost", f"{name} to {stage.quantity}: {end.message}"
            self.record.row(self.model, end.here)
            record_fired(self.record, end, self.options.subspaces)
            outcome = self._outcome(stage, end)
            if outcome is not None:
                return outcome
            expected, before = expected_regimes(end), end.here
            if self._stops() and not expected:
                return STOPPED
            self._take_on_contacts(end)
            moved = float(np.abs(end.here.H - here.H).max()) > UNMOVED
            idle = 0 if moved else idle + 1
            if idle > UNLOADED and self._carries_nothing(self.at(stage.programme)):
                return self._came_apart()
            if idle > CHATTER:
                return "no_solution", self._limit(stage, expected, "never_consistent")

    # ---- from an event on

    def _rate_problem(
        self, stage: Stage, expected: dict[int, int], before: StateRates | None
    ) -> Regimes[EdgeTrial]:
        """Rate problem of the state; of the full model where no symmetric motion goes on."""
        direction = None
        if before is not None and len(before.mode.regime) == self.model.contact_count:
            direction = rate_vector(self.model, before.rates)
        problem = self._solve(self.model, stage, expected, direction)
        if problem.status in UNANSWERED and self.model.symmetry is not None:
            full = replace(self.model, symmetry=None)
            problem = self._solve(full, stage, expected, direction)
            if problem.status not in UNANSWERED:
                self.model = full
                self.symmetry_kept = (
                    f"given up at parameter {self.parameter:.15g}: no symmetric motion goes on"
                )
        return problem

    def _solve(
        self,
        model: PathModel,
        stage: Stage,
        expected: dict[int, int],
        direction: Floats | None,
    ) -> Regimes[EdgeTrial]:
        here = replace(self.at(stage.programme), model=model)
        problem = edge_problem(here, preferred=expected, direction=direction, in_full=self.in_full)
        self.searches.add(problem)
        return problem

    def _take_regimes(
        self, stage: Stage, problem: Regimes[EdgeTrial], before: StateRates | None
    ) -> StateRates:
        """Take the regimes of the rate problem's solution, and record what changes.

        Forces are those of the regimes, exactly on the friction limit; what a parting contact drops
        is dissipated.
        """
        model, trial, closed = self.model, problem.taken.rates, self.at(stage.programme)
        old, self.mode, y = closed.mode, trial.mode, self.y.copy()
        y[model.shears] = self.at(stage.programme).contacts.shear_force
        parting = (self.mode.regime == Regime.OPEN) & (old.regime != Regime.OPEN)
        if parting.any():
            elastic = self.y[model.shears] ** 2 / (2 * shear_stiffness(model, closed.contacts))
            lost = np.where(parting, model.law.normal_energy(closed.contacts), 0.0).sum()
            y[-2:] += lost, lost + np.where(parting, elastic, 0.0).sum()
            self.model = model = replace(model, law=model.law.parted(parting))
        self.y = y
        here = self.at(stage.programme, trial.rates.gauge)
        if not self.record.rows:
            self.record.row(model, here)
            if self.stop and (parting := self._parting(here)):
                self.record.event("opening", 0.0, parting, cause="start")
            record_start(self.record, model, self.mode)
            return here
        record_changes(self.record, old, self.mode, self.parameter, problem)
        if before is not None:
            jump = before.A, here.A
            record_jumps(self.record, *jump, self.parameter, self.options.subspaces)
        if before is None or (old.regime != self.mode.regime).any():
            self.record.row(model, here)
        return here

    def _run_segment(
        self, stage: Stage, start: float, sense: float, reach: float, here: StateRates
    ) -> SegmentEnd:
        """Integrate to the next event; where strain alone drives, step over a singular point.

        The closure's system may be singular in a single state. Steps of other lengths pass it.
        """
        strain = float(np.abs(here.H).max())
        size = min(max(reach, strain), 1.0)
        about = self.model, self.mode, stage, start, sense, size
        functions = event_functions(*about, self.options.subspaces)
        row_step = min(reach, 1.0) / self.rows if self.rows else np.inf
        atol, longest = self.atol * size * scales(self.model), min(LONGEST_STEP, reach / MIN_STEPS)
        rows, events = len(self.record.rows), len(self.record.events)
        for shorter in RETRIES:
            how = Steps(atol, shorter * longest, row_step, size, self.steps_left)
            end = follow_segment(
                self.at(stage.programme, here.gauge),
                functions,
                how,
                lambda row: self.record.row(self.model, row),
                self.record.branching,
            )
            stuck = not end.fired or ("singular", -1) in end.fired
            if not stuck or stage.programme.stress.any():
                break
            if shorter != RETRIES[-1]:
                del self.record.rows[rows:], self.record.events[events:]
        return end

    def _take_on_contacts(self, end: SegmentEnd) -> None:
        """Grains that have come to touch overlap from now on, or get a contact."""
        pairs = touched_pairs(end)
        if len(pairs) == 0:
            return
        self.model = without_pairs(self.model, pairs)
        if self.options.contact_on_touch != "add":
            return
        new, last = np.zeros(len(pairs)), self.model.shears.stop
        # Grains that overlap from the start press on each other at once.
        pressed = pair_overlaps(self.model, pairs, centres(self.model, self.y)) > TOUCHING_RTOL
        regime = np.where(pressed, Regime.ELASTIC, Regime.OPEN).astype(np.int8)
        self.model, self.y = with_contact(self.model, pairs), np.insert(self.y, last, new)
        self.mode = Mode(np.append(self.mode.regime, regime), np.append(self.mode.side, new))
        self.find_symmetry()

    # ---- how a stage ends

    def _outcome(self, stage: Stage, end: SegmentEnd) -> tuple[PathStatus, str] | None:
        """Status if the events end the stage."""
        kinds, name = {kind for kind, _ in end.fired}, stage.programme.name
        if "collapse" in kinds:
            return "lost", f"the loop collapses to a line at parameter {self.parameter:.15g}"
        if "stage_end" in kinds:
            return FINISHED
        if "singular" in kinds:
            said = CAUSES["singular"]
            return "control_limit", f"{name} at parameter {self.parameter:.15g}: {said}"
        if "control_limit" in kinds:
            return (
                "control_limit",
                f"{name}: the loading parameter has an extremum at {self.parameter:.15g}; "
                f"{stage.quantity} = {stage.target:.6g} was not reached",
            )
        if "opposite_contact" in kinds and self.options.contact_on_touch == "stop":
            return "opposite_contact", f"grains {touched_pairs(end).tolist()} touch"
        if self.model.closure == "affine":
            return None
        # A force that a parting contact still carries would have to be balanced at once.
        limit = RELEASE * self.model.stiffness * self.model.length
        contacts = end.here.contacts
        force = np.maximum(np.abs(contacts.shear_force), np.abs(contacts.normal_force))
        torn = [c for kind, c in end.fired if kind == "opening" and force[c] > limit]
        if torn:
            message = f"contacts {torn} part while they carry a force: the loop is out of balance"
            return "lost", message
        return None

    def _stops(self) -> bool:
        """Whether an event at which the path ends has happened."""
        own = ("", self.options.subspaces[0])
        events = self.record.events
        return bool(self.stop) and any(e.kind in self.stop and e.subspace in own for e in events)

    def _parting(self, here: StateRates) -> tuple[int, ...]:
        """Return contacts that just touch and part at once."""
        touches = here.contacts.overlap >= -TOUCHING_RTOL * self.model.touching
        leaves = here.rates.un > UNMOVED * self.model.length
        parts = touches & leaves & (self.mode.regime == Regime.OPEN)
        return tuple(np.flatnonzero(parts).tolist())

    def _begins_lost(self, here: StateRates) -> bool:
        """Whether the path is to end at a loss of det K, and begins beyond it."""
        if "det_K_zero" not in self.stop or len(self.record.rows) > 1:
            return False
        K = np.nan_to_num(restrict(here.A, self.options.subspaces[0]))
        return bool(np.linalg.eigvals(K).real.min() <= SINGULAR_RTOL * operator_norm(K))

    def _carries_nothing(self, here: StateRates) -> bool:
        """Whether every contact force is below `RELEASE`."""
        contacts = here.contacts
        force = np.maximum(np.abs(contacts.normal_force), np.abs(contacts.shear_force))
        return bool(force.max(initial=0.0) <= RELEASE * self.model.stiffness * self.model.length)

    def _came_apart(self) -> tuple[PathStatus, str]:
        parted = int((self.mode.regime == Regime.OPEN).sum())
        return (
            "no_load",
            f"the loop comes apart at parameter {self.parameter:.15g}: its contacts carry no force"
            f" ({parted} of {self.model.contact_count} open) and nothing resists the control",
        )

    def _no_continuation(
        self, stage: Stage, problem: Regimes[EdgeTrial], expected: dict[int, int]
    ) -> tuple[PathStatus, str]:
        """End of a stage where no regimes agree with the control: a limit of it, or no solution."""
        status: PathStatus = "control_limit"
        # Do the expected regimes agree with a falling loading parameter?
        turns_back = False
        if expected:
            here = self.at(stage.programme, -UNIT_PARAMETER)
            back = edge_problem(here, preferred=expected, direction=None)
            turns_back = any(
                all(one.rates.mode.regime[c] == abs(regime) for c, regime in expected.items())
                for one in back.solutions
            )
        cause: Cause = "turns_back" if turns_back else "singular"
        if not (turns_back or problem.singular):
            status, cause = "no_solution", "inconsistent"
        if not self.record.rows:
            # No direction is known.
            self.record.row(self.model, self.at(stage.programme))
        count = 0 if problem.exhaustive else problem.combinations
        return status, self._limit(stage, expected, cause, count)

    def _limit(self, stage: Stage, expected: dict[int, int], cause: Cause, count: float = 0) -> str:
        """Record a limit of the control here, and say why it is one."""
        contacts = tuple(sorted(expected))
        self.record.event("control_limit", self.parameter, contacts, cause=cause, count=count)
        said = reason(self.record.events[-1])
        return f"{stage.programme.name} at parameter {self.parameter:.15g}: {said}"


def follow_loop(
    scene: Scene,
    stages: Sequence[Stage],
    closure: Closure,
    options: LoopPathOptions,
    *,
    rows: int = 0,
    max_steps: int = 20_000,
    stop: tuple[str, ...] = (),
) -> Path:
    """Follow a loop through its stages, see `stability.follow`; to the first event to `stop` at."""
    graph, law = scene.graph, scene.law
    require_unlimited_rolling(law)
    contacts = scene.contact_state
    model = path_model(graph, contacts, law, closure, options.spins, scene.given_volume)
    mode = start_mode(model, contacts)
    model, y, least = first_state(model, contacts)
    solver = LoopPathSolver(
        model=replace(model, search_all=options.model == "full"),
        y=y,
        mode=mode,
        options=options,
        atol=max(ATOL, least),
        rows=rows,
        steps_left=max_steps,
        programmes=tuple(stage.programme for stage in stages),
        stop=stop,
        in_full=1 if stop else ENUMERATION_LIMIT,
    )
    solver.find_symmetry()
    start = solver.model
    status, message = follow_stages(solver.follow_stage, stages)
    chosen = model_choice(start, options.model, solver.searches, solver.symmetry_kept)
    return solver.record.path(solver.model, status, message, options.subspaces[0], chosen)
