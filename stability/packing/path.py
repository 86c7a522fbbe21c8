"""The quasi-static path of a periodic packing, followed from event to event."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from loops.arrays import Floats, Integers, Regimes
from loops.graph import GrainGraph
from loops.laws import ContactLaw
from loops.laws.protocol import Regime
from stability.packing.frozen_packing import AT_YIELD, FrozenPacking
from stability.packing.interval import (
    ControlLimitError,
    Goal,
    InstabilityError,
    Interval,
    end_state,
)
from stability.packing.packing_path import PackingPath
from stability.packing.pairs import Pairs, contact_pairs, require_replayable, strength, with_near
from stability.packing.pivots import Control
from stability.packing.snap_through import snap_through, stored
from stability.packing.state import jumped, start_state
from stability.paths.path import Event, EventKind, Past, PathStatus
from stability.programmes import Stage
from stability.subspaces import COMPONENTS

# Pairs closer than this share of the mean diameter stand in the arrays as open contacts.
NEAR = 0.01
# Strain asked for by the control, over the least of the stage.
LIMIT = 1e3
FINISHED: tuple[PathStatus, str] = ("finished", "every stage reached its target")


def follow_packing(
    graph: GrainGraph,
    law: ContactLaw,
    stages: Sequence[Stage],
    *,
    rows: int,
    interval: float,
    instabilities: int,
    past: Past,
    max_steps: int,
) -> PackingPath:
    """What `follow` does with the packing closure."""
    checked = require_replayable(graph, law)
    by_radii = checked.shear_increment == "radii"
    walk = _Walk(graph, contact_pairs(graph, checked), by_radii, interval, past)
    walk.record()
    stop: tuple[PathStatus, str] = FINISHED
    for k, stage in enumerate(stages):
        if stage.fallback != (stop[0] in ("control_limit", "no_solution")):
            continue
        if walk.intervals:
            walk.changes(k, stage)
        walk.stage, walk.begun = k, walk.parameter
        walk.enter()
        stop = _walk_stage(walk, stage, max(rows, 1), instabilities, max_steps)
        if stop[0] in ("instabilities", "lost"):
            break
    return walk.path(*stop)


def _walk_stage(
    walk: _Walk, stage: Stage, rows: int, instabilities: int, max_steps: int
) -> tuple[PathStatus, str]:
    start = walk.quantity(stage)
    way = stage.target - start
    for target in np.linspace(start, stage.target, rows + 1)[1:]:
        while not walk.at(stage, target, way):
            if walk.intervals >= max_steps:
                return "lost", f"{max_steps} intervals were not enough"
            stop = walk.step(stage, float(target), instabilities)
            if stop is not None:
                walk.record()
                return stop
        walk.record()
    return FINISHED


@dataclass(eq=False)
class _Walk:
    """The state on its way, and the rows that it leaves."""

    graph: GrainGraph
    pairs: Pairs
    by_radii: bool
    size: float
    past: Past
    parameter: float = 0.0
    begun: float = 0.0
    stage: int = 0
    intervals: int = 0
    events: list[Event] = field(default_factory=list)
    wandered: float = 0.0
    rows: list[tuple[Any, ...]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.state = start_state(self.graph)
        self.F = np.eye(2)
        self.volume = abs(float(np.linalg.det(self.state.cell)))
        self.stress = float(np.linalg.norm(self.state.stress))
        self.work = np.zeros(4)
        self.unstable: list[tuple[int, Integers]] = []
        self.pieces: FrozenPacking | None = None
        self.regime: Regimes = np.zeros(0, dtype=np.int8)
        self.side = np.zeros(0)
        self._start()
        self.balance = self.state.resultants
        self.drift = 0.0 * self.balance
        self.enter()

    def _start(self) -> None:
        """Forces of the geometry; who stands at its cone may slide."""
        N = np.maximum(-self.pairs.kn * self._gaps(), 0.0)
        T = np.where(N > 0, self.state.shear_force, 0.0)
        most = strength(self.pairs, N)
        self.state = replace(self.state, normal_force=N, shear_force=np.clip(T, -most, most))
        self._renew(0.0)
        self._set_regimes()

    def _set_regimes(self) -> None:
        """Who stands on its cone slides, on the side of its force."""
        N, T = self.state.normal_force, self.state.shear_force
        slides = np.abs(T) >= AT_YIELD * strength(self.pairs, N)
        closed = np.where(slides, Regime.SLIDING, Regime.ELASTIC)
        self.regime = np.where(N > 0, closed, Regime.OPEN).astype(np.int8)
        self.side = np.sign(T)

    @property
    def H(self) -> Floats:
        """(4,) displacement gradient."""
        return (np.eye(2) - self.F).ravel()

    @property
    def P(self) -> Floats:
        """(4,) nominal stress over the reference cell."""
        return self._to_reference() @ self.state.stress.ravel()

    def _to_reference(self) -> Floats:
        """`P0 = (V/V0) P F^-T` on the components."""
        share = abs(float(np.linalg.det(self.state.cell))) / self.volume
        return share * np.kron(np.eye(2), np.linalg.inv(self.F))

    def changes(self, number: int, stage: Stage) -> None:
        """The programme gives way to another one."""
        row, detail = len(self.rows) - 1, f"to {stage.programme.name}"
        self.events.append(Event("programme_change", self.parameter, number, row, (), detail))

    def quantity(self, stage: Stage) -> float:
        """What ends the stage."""
        if stage.quantity == "parameter":
            return self.parameter - self.begun
        values = self.H if stage.quantity[0] == "H" else self.P
        return float(values[COMPONENTS.index(stage.quantity[1:])])

    def at(self, stage: Stage, target: float, way: float) -> bool:
        """Whether the target is reached, to a millionth of an interval, or has been leapt over."""
        scale = 1.0
        if stage.quantity[0] == "P":
            scale = float(self.pairs.kn.mean())
        elif stage.quantity == "parameter":
            scale = 1.0 / float(np.abs(stage.programme.rate).max())
        return np.sign(way) * (target - self.quantity(stage)) <= 1e-6 * self.size * scale

    def enter(self) -> None:
        """What a programme holds is counted from here."""
        self.H_start, self.P_start = self.H, self.P
        self.slowest = np.inf

    def step(self, stage: Stage, target: float, most: int) -> tuple[PathStatus, str] | None:
        """One interval; why the path ends if it does."""
        before = (self.state, self.F, self.regime.copy(), self.side.copy(), self.pairs)
        told = len(self.events)
        try:
            stop = self._interval(stage, target)
        except ControlLimitError:
            stop = "control_limit", "the control has met its limit: it asks for ever more strain"
        except (ArithmeticError, RuntimeError, np.linalg.LinAlgError) as error:
            stop = ("lost", f"the system has no answer: {error}")
        if stop is not None:
            self.state, self.F, self.regime, self.side, self.pairs = before
            self.unstable = []
            if stop[0] != "lost":  # Who is lost may ask what led there.
                del self.events[told:]
            return stop
        if self.met is not None:
            stop = self._pass(self.met, stage, target)
            if stop is not None:
                return stop
        found = {event.contacts for event in self.events if event.kind == "instability"}
        if len(found) >= most:
            return "instabilities", f"{len(found)} contacts found no regimes that agree"
        return None

    def _interval(self, stage: Stage, target: float) -> tuple[PathStatus, str] | None:
        # What has to go: the loads of the rates are external forces.
        load = self.drift
        pieces = FrozenPacking(
            self.state,
            self.pairs,
            self.regime.copy(),
            self.side.copy(),
            self.by_radii,
            0.0 * load.ravel(),
            self.pieces,
        )
        trial = pieces.solve(*self._control(stage, 0.0))
        speed = float(np.linalg.norm(trial.h[:4]))
        if not (np.isfinite(speed) and speed > 0):
            return "no_solution", "the control moves nothing"
        self.slowest = min(self.slowest, speed)
        if speed > LIMIT * self.slowest:
            raise ControlLimitError
        end = self.size / speed
        scale = np.tile([1.0, 1.0, 1.0 / pieces.length], len(self.state.x))
        pieces.set_load(load.ravel() * scale / end)
        walk = Interval(
            pieces=pieces,
            control=self._control(stage, 1.0 / end),
            N=self.state.normal_force,
            T=self.state.shear_force,
            gap=np.maximum(self._gaps(), 0.0),
            touching=self._touching(),
            load=self.balance.ravel() * scale,
            end=end,
            goal=self._goal(stage, target),
            told=self._told,
            fastest=LIMIT * self.slowest,
            viscous=self.past == "viscous",
        )
        self.met = None
        try:
            walk.walk()
        except InstabilityError as met:
            self.met, self.span = met, end
        state, self.regime, work = end_state(walk, self.state, self.pairs)
        self.side, self.pieces = pieces.side, pieces
        if not state.closed.any():
            return "no_load", "the packing has come apart and carries no force"
        jump = jumped(self.state, state, self.stress)
        if jump:
            return "lost", jump
        self.F = self.F - walk.strain.reshape(2, 2) @ self.F
        self.state = state
        self.parameter += walk.time
        self.intervals += 1
        self.work += work
        self.drift = self.state.resultants - self.balance
        self._tell_energy(walk.released)
        # Neighbours come nearer with the cell as well, by twice this.
        affine = float(np.linalg.norm(walk.strain) * state.radii.max())
        self._renew(float(np.abs(walk.u).max()) + affine)
        return None

    def _pass(
        self, met: InstabilityError, stage: Stage, target: float
    ) -> tuple[PathStatus, str] | None:
        """Stop at an instability, or go through it by the equations of motion."""
        told = partial(self._told, "instability", 0.0, met.contact)
        if self.past == "stop":
            told(f"{met.why}; stopped")
            return "instabilities", str(met)
        rate = 1.0 if stage.quantity == "parameter" else stage.programme.driven(stage.quantity)
        left = (target - self.quantity(stage)) / rate if rate else np.inf
        # Where nobody knows when the target is reached it may be leapt over.
        span = min(self.span, left) if left > 0 else self.span
        load, control = -self.balance, self._control(stage, 1.0 / span)
        try:
            snap = snap_through(self.state, self.pairs, load, control, span, self.by_radii)
            jump = jumped(self.state, snap.state, self.stress)
            if jump:
                raise ArithmeticError(jump)
        except ArithmeticError as error:
            told(f"{met.why}; lost")
            return "lost", f"{met}; {error}"
        told(f"{met.why}; replayed; {snap.work[3]:.2g} released")
        self.F = snap.state.cell @ np.linalg.inv(self.state.cell) @ self.F
        self.state, self.pairs = snap.state, snap.pairs
        self.parameter += span
        self.work += snap.work
        self.drift = self.state.resultants - self.balance
        self._set_regimes()
        self._renew(np.inf)
        return None

    def _control(self, stage: Stage, drift: float) -> Control:
        """The programme on rates in the current geometry; `drift` over time is made good."""
        stress, strain, rate = stage.programme.equations(self.H)
        if drift and stage.programme.isochoric_row is None:
            done = stress @ (self.P - self.P_start) + strain @ (self.H - self.H_start)
            rate = rate - drift * (done - rate * (self.parameter - self.begun))
        turned = np.kron(np.eye(2), self.F.T)
        return Control(stress @ self._to_reference(), strain @ turned, rate)

    def _goal(self, stage: Stage, target: float) -> Goal:
        """How far the stage's quantity still is from its target."""
        left, none = target - self.quantity(stage), np.zeros(4)
        if stage.quantity == "parameter":
            return Goal(left, none, none, 1.0)
        k = COMPONENTS.index(stage.quantity[1:])
        if stage.quantity[0] == "H":
            return Goal(left, np.kron(np.eye(2), self.F.T)[k], none, 0.0)
        return Goal(left, none, self._to_reference()[k], 0.0)

    def _told(
        self,
        kind: EventKind,
        time: float,
        contact: int,
        detail: str = "",
        grains: Integers | None = None,
    ) -> None:
        where = self.parameter + time
        if grains is not None:
            self.unstable.append((len(self.events), grains))
        self.events.append(Event(kind, where, self.stage, len(self.rows) - 1, (contact,), detail))

    def _tell_energy(self, released: Floats) -> None:
        """What the grains of every instability of the interval gave off, each but once."""
        for k, grains in self.unstable:
            event = self.events[k]
            detail = f"{event.detail}; {released[grains].sum():.2g} released"
            self.events[k] = replace(event, detail=detail)
            released = released.copy()
            released[grains] = 0.0
        self.unstable = []

    def _touching(self) -> Floats:
        return self.state.radii[self.pairs.grains].sum(axis=1)

    def _gaps(self) -> Floats:
        return np.linalg.norm(self.state.branches, axis=1) - self._touching()

    def _renew(self, moved: float) -> None:
        """List the pairs anew where grains may have come out of nowhere."""
        gap = NEAR * 2.0 * float(self.state.radii.mean())
        self.wandered += moved
        if self.intervals and 2.0 * self.wandered < 0.5 * gap:
            return
        self.wandered = 0.0
        state = self.state
        self.pairs = with_near(self.pairs, state.x, state.cell, state.radii, gap)
        new = len(self.pairs) - len(state.contacts)
        N, T = (
            np.append(force, np.zeros(new)) for force in (state.normal_force, state.shear_force)
        )
        self.state = replace(
            state,
            contacts=self.pairs.grains,
            images=self.pairs.images,
            normal_force=N,
            shear_force=T,
        )
        closed = np.where(N > 0, Regime.ELASTIC, Regime.OPEN)
        self.regime = np.append(self.regime, closed[len(self.regime) :]).astype(np.int8)
        self.side = np.append(self.side, np.zeros(new + len(N) - new - len(self.side)))

    def record(self) -> None:
        """A row."""
        state, pairs = self.state, self.pairs
        energy = stored(state, pairs)
        closed = np.hypot(state.normal_force, state.shear_force)[state.closed]
        drift = np.abs(self.drift)[:, :2].max() / float(closed.mean() if len(closed) else np.nan)
        row = self.parameter, self.stage, self.H, self.P, state, self.work.copy(), energy, drift
        self.rows.append(row)

    def path(self, status: PathStatus, message: str) -> PackingPath:
        """What has been walked."""
        columns = list(zip(*self.rows, strict=True))
        parameter, stage, H, P, states, work, energy, drift = columns
        return PackingPath(
            status=status,
            message=message,
            events=tuple(self.events),
            parameter=np.array(parameter),
            stage=np.array(stage),
            H=np.array(H),
            P=np.array(P),
            states=states,
            work=np.array(work),
            energy=np.array(energy),
            imbalance=np.array(drift),
            intervals=self.intervals,
        )
