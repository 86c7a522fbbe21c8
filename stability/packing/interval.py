"""A short strain of a packing from event to event: linear in between, geometry at its ends."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from loops.arrays import Floats, Integers, Regimes
from stability.packing.frozen_packing import (
    ELASTIC,
    OPEN,
    RANK,
    SLIDING,
    Combination,
    FrozenPacking,
)
from stability.packing.pair_frame import KN, KT, MU, SLIDES
from stability.packing.pairs import Pairs, strength
from stability.packing.pivots import Control, UnsolvedError, disagreeing, flip, pivot
from stability.packing.state import PackingState
from stability.paths.path import EventKind

# Events of one contact within an interval; at the next one it is dragged or held.
CHATTER = 12
# Springs on the grains of a mode that nothing holds, over kn, one after the other; then it is held.
DRAGS = (1e-3, 1e-2, 1e-1, 0.0)
# Columns of `PackingPath.work`.
SLIP, RELEASED = 1, 3
# Over the largest rate: wrong signs within it are rounding.
TINY = 1e-9


class ControlLimitError(Exception):
    """The control asks for ever more strain."""


class InstabilityError(Exception):
    """No regimes of a contact agree: why, and the grains of the mode."""

    def __init__(self, contact: int, why: str, grains: Integers) -> None:
        super().__init__(f"contact {contact}: {why}")
        self.contact, self.why, self.grains = contact, why, grains


class Told(Protocol):
    """Hears of every event."""

    def __call__(
        self,
        kind: EventKind,
        time: float,
        contact: int,
        detail: str = "",
        grains: Integers | None = None,
        /,
    ) -> None:
        """Take note; `grains` are those of an instability."""


@dataclass
class Goal:
    """What ends the interval early: `left` until then of `strain . H' + stress . P' + time`."""

    left: float
    strain: Floats
    stress: Floats
    time: float

    def speed(self, strain: Floats, stress: Floats) -> float:
        """Rate of the quantity."""
        return float(self.strain @ strain + self.stress @ stress) + self.time


@dataclass(eq=False)
class Interval:
    """Walks through one interval; `time` runs from 0 to `end`, or to the goal.

    `touching` are sums of the radii, `load` the resultants that the grains had at the start.
    Instabilities are passed if `viscous`, else they end the walk (`InstabilityError`).
    """

    pieces: FrozenPacking
    control: Control
    N: Floats
    T: Floats
    gap: Floats
    touching: Floats
    load: Floats
    end: float
    goal: Goal
    told: Told
    fastest: float
    viscous: bool
    time: float = 0.0
    events: Counter[int] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        count = len(self.N)
        # The kernels go on in place.
        self.N, self.T = self.N.copy(), self.T.copy()
        self.held = np.zeros(count, dtype=bool)
        self.u = np.zeros(3 * self.pieces.count)
        self.strain = np.zeros(4)
        # As in `PackingPath.work`; what was released grain by grain but for held contacts.
        self.work = np.zeros(4)
        self.released = np.zeros(self.pieces.count)
        self.rates = np.empty((count, 4))

    def walk(self) -> None:
        """Go to the end of the interval."""
        rates = self._settled()
        while self.time < self.end:
            if not np.linalg.norm(rates.h[:4]) <= self.fastest:
                raise ControlLimitError
            v = self.pieces.motion(rates)
            step, c, kind = self._next(rates.h, v)
            speed = self._speed(rates.h, v)
            left = self.end - self.time
            if speed * self.goal.left > 0:
                left = min(left, self.goal.left / speed)
            self.goal.left -= speed * min(step, left)
            if step >= left:
                self._advance(rates.h, v, max(left, 0.0))
                self.end = self.time
                return
            self._advance(rates.h, v, step)
            rates = self._changed(c, kind, rates)

    def _next(self, h: Floats, v: Floats) -> tuple[float, int, EventKind]:
        """The earliest event: time from now, contact, kind."""
        from stability.compiled.packing_rates import earliest

        pieces = self.pieces
        how = (*pieces.frame, pieces.regime, pieces.side, self.held, self.N, self.T, self.gap)
        left = self.end - self.time
        time, c, kind = earliest(*how, v, h, TINY, left, self.rates, pieces.due)
        if kind in (-1, 1):
            pieces.side[c] = kind
            return time, c, "yield"
        return time, c, "closing" if kind else "opening"

    def _speed(self, h: Floats, v: Floats) -> float:
        """Rate of the goal's quantity."""
        from stability.compiled.packing_rates import stress_rate

        pieces, stress = self.pieces, np.zeros(4)
        if self.goal.stress.any():
            stress_rate(*pieces.frame, pieces.regime, pieces.side, v, h, stress)
        return self.goal.speed(h[:4], stress / pieces.volume)

    def _advance(self, h: Floats, v: Floats, step: float) -> None:
        from stability.compiled.packing_rates import advance
        from stability.compiled.packing_work import add_work

        pieces = self.pieces
        how = (*pieces.frame, pieces.regime)
        where = (self.touching, self.load, pieces.length, self.strain, self.u)
        add_work(*how, *where, h, v, step, self.T, self.rates, self.work, self.released)
        advance(*how, step, self.rates, self.N, self.T, self.gap, self.work)
        self.strain += step * h[:4]
        self.u += step * v
        self.time += step

    def _changed(self, c: int, kind: EventKind, rates: Combination) -> Combination:
        """The event itself; afterwards everything at yield agrees again."""
        pieces = self.pieces
        self.events[c] += 1
        if self.events[c] > CHATTER:
            self.events[c] = 0
            self._calm(c, kind)
        elif kind == "yield":
            self._pivot(c, rates)
        else:
            self._part(c, SLIP)
            self._close(c) if kind == "closing" else pieces.set_regime(c, OPEN)
            self.told(kind, self.time, c)
        return self._settled()

    def _calm(self, c: int, kind: EventKind) -> None:
        """Drag a grain of less than three contacts that hits or grazes another again and again."""
        pieces = self.pieces
        pair = pieces.frame.grains[c]
        closed = pieces.regime != OPEN
        degree = np.bincount(pieces.frame.grains[closed].ravel(), minlength=pieces.count)[pair]
        loose = pair[degree == degree.min()]
        drag = 10.0 * max(float(pieces.drag[loose].max()), DRAGS[0])
        if degree.min() > 2 or drag > DRAGS[-2]:
            self._hold(c, "it changes regime again and again", kind)
            return
        self._met(c, "a loose grain rattles", loose)
        pieces.drag[loose] = drag
        pieces.factorise()
        self.told("instability", self.time, c, "a loose grain rattles; dragged", loose)

    def _close(self, c: int) -> None:
        """A contact that closes sticks if its forces then stay in the cone, else it slides."""
        pieces = self.pieces
        pieces.set_regime(c, ELASTIC)
        un, ut = pieces.relative(pieces.solve(*self.control), c)
        kn, kt, mu, slides = pieces.frame.rows[c, [KN, KT, MU, SLIDES]]
        if slides and un < 0 and kt * abs(ut) > -mu * kn * un:
            pieces.set_regime(c, SLIDING, -np.sign(ut))

    def _pivot(self, c: int, rates: Combination) -> None:
        """One contact at yield; where no regimes agree the grains of the mode are dragged."""
        pieces, why, grains = self.pieces, "", np.zeros(0, dtype=np.int64)
        for drag in DRAGS:
            critical = pieces.at_yield(self.N, self.T, self.held)
            # Who stands on the cone does so on the side of its force.
            stuck = critical[(pieces.regime[critical] == ELASTIC) & (critical != c)]
            pieces.side[stuck] = np.sign(self.T[stuck])
            try:
                changed = pivot(pieces, self.control, c, critical, TINY * self._scale(rates))
            except UnsolvedError as stop:
                why = why or self._mode(stop)
                u = np.linalg.norm(stop.motion.reshape(-1, 3), axis=1)
                grains = np.flatnonzero(u > 0.1 * u.max())
                self._met(c, why, grains)
                if drag == DRAGS[-1]:
                    break
                pieces.drag[grains] = np.maximum(pieces.drag[grains], drag)
                pieces.factorise()
                continue
            if why:
                self.told("instability", self.time, c, f"{why}; dragged", grains)
            for k in changed:
                slides = pieces.regime[k] == SLIDING
                self.told("yield" if slides else "unloading", self.time, k)
            return
        self._hold(c, why, "yield")

    def _scale(self, rates: Combination) -> float:
        size = float(np.abs(rates.h[:4]).max())
        return size * self.pieces.stiffest * 2.0 * self.pieces.length

    def _settled(self) -> Combination:
        """Rates with which every contact at yield agrees; factorised anew where ranks are many."""
        pieces = self.pieces
        tried: Counter[int] = Counter()
        while True:
            if len(pieces.at) > RANK:
                pieces.factorise()
            rates = pieces.solve(*self.control)
            critical = pieces.at_yield(self.N, self.T, self.held)
            # Those that stick have just been passed by, or have their event to come.
            sliders = critical[pieces.regime[critical] == SLIDING]
            wrong = disagreeing(pieces, rates, sliders, TINY * self._scale(rates))
            if len(wrong) == 0:
                return rates
            c = int(wrong[0])
            tried[c] += 1
            if tried[c] > 3:
                self._hold(c, "neither sticking nor sliding agrees", "yield")
            else:
                self._pivot(c, rates)

    def _hold(self, c: int, why: str, kind: EventKind) -> None:
        """Keep a contact stuck or open, whatever becomes of it, until the interval ends."""
        pieces = self.pieces
        self._met(c, why, pieces.frame.grains[c])
        if kind in ("opening", "closing"):
            pieces.set_regime(c, OPEN)
            self._part(c, RELEASED)
        elif pieces.regime[c] == SLIDING:
            flip(pieces, c)
        self.held[c] = True
        self.told("instability", self.time, c, f"{why}; held", pieces.frame.grains[c])

    def _met(self, c: int, why: str, grains: Integers) -> None:
        if not self.viscous:
            raise InstabilityError(c, why, grains)

    def _part(self, c: int, spent: int) -> None:
        """A contact's forces vanish; what its shear spring has left goes to one of the works."""
        kt = float(self.pieces.frame.rows[c, KT])
        self.work[spent] += self.T[c] ** 2 / (2 * kt) if kt > 0 else 0.0
        self.N[c] = self.T[c] = 0.0

    def _mode(self, stop: UnsolvedError) -> str:
        u = stop.motion.reshape(-1, 3)[:, :2]
        square = np.sum(u**2, axis=1)
        share = float(square.sum() ** 2 / max(float(np.sum(square**2)), 1e-300))
        turns = "changes sign" if stop.turns else "keeps its sign"
        return f"no regimes agree: {share:.0f} grains take part, det K {turns}"


def end_state(
    interval: Interval, state: PackingState, pairs: Pairs
) -> tuple[PackingState, Regimes, Floats]:
    """Geometry, exact normal forces, shear forces within the cone; regimes; and the work."""
    pieces = interval.pieces
    v = interval.u.reshape(-1, 3)
    E = interval.strain.reshape(2, 2)
    moved = replace(
        state,
        x=state.x - state.x @ E.T + v[:, :2],
        angle=state.angle + v[:, 2] / pieces.length,
        cell=state.cell - E @ state.cell,
    )
    overlap = interval.touching - np.linalg.norm(moved.branches, axis=1)
    N = np.maximum(pairs.kn * overlap, 0.0)
    regime = np.where(N > 0, pieces.regime, OPEN).astype(np.int8)
    regime = np.where((N > 0) & (regime == OPEN), ELASTIC, regime).astype(np.int8)
    most = strength(pairs, N)
    slides = regime == SLIDING
    T = np.where(slides, interval.pieces.side * interval.pieces.frame.rows[:, MU] * N, interval.T)
    T = np.where(N > 0, T, 0.0)
    cut = np.clip(T, -most, most)
    # Shear springs relax: by slip, or where a contact was held by what held it.
    relaxed = np.divide(interval.T**2 - cut**2, 2 * pairs.kt, out=0 * cut, where=pairs.kt > 0)
    work = interval.work.copy()
    work[SLIP] += relaxed[~interval.held].sum()
    work[RELEASED] += relaxed[interval.held].sum() + interval.released.sum()
    # Whoever was held stands at its cone again.
    at_cone = interval.held & (np.abs(cut) >= (1 - 1e-6) * most) & (N > 0) & (most > 0)
    pieces.side[at_cone] = np.sign(cut[at_cone])
    regime[at_cone] = SLIDING
    return replace(moved, normal_force=N, shear_force=cut), regime, work
