"""A short strain of a packing from event to event: linear in between, geometry at its ends."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from loops.arrays import Floats, Regimes
from loops.laws.protocol import Regime
from stability.packing.linear_pieces import RANK, Pieces, Rates
from stability.packing.pairs import Pairs, strength
from stability.packing.pivots import Control, UnsolvedError, disagreeing, flip, pivot
from stability.packing.state import PackingState
from stability.paths.path import EventKind

# Events of one contact, and of length zero one after the other, beyond which it is held.
CHATTER, IDLE = 12, 60
# Springs on the grains of a mode that nothing holds, over kn, one after the other; then it is held.
DRAGS = (1e-3, 1e-2, 1e-1, 0.0)
# Over the largest rate: wrong signs within it are rounding.
TINY = 1e-9


class Told(Protocol):
    """Hears of every event."""

    def __call__(self, kind: EventKind, time: float, contact: int, detail: str = "", /) -> None:
        """Take note."""


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
    """Walks through one interval; `time` runs from 0 to `end`, or to the goal."""

    pieces: Pieces
    control: Control
    N: Floats
    T: Floats
    gap: Floats
    end: float
    goal: Goal
    told: Told
    time: float = 0.0
    slip_work: float = 0.0
    events: Counter[int] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        count = len(self.N)
        self.held = np.zeros(count, dtype=bool)
        self.u = np.zeros(self.pieces.V.shape[0])
        self.strain = np.zeros(4)
        self.idle = 0
        self._clear()

    def _clear(self) -> None:
        self.h, self.w = np.zeros(5), np.zeros(self.pieces.Q.shape[1])

    def walk(self) -> None:
        """Go to the end of the interval."""
        rates = self._settled()
        while self.time < self.end:
            un, ut = np.split(self.pieces.q(rates)[: 2 * len(self.N)], 2)
            dN, dT = self._force_rates(un, ut)
            speed = self.goal.speed(rates.h[:4], self.pieces.stress(rates))
            left = self.end - self.time
            if speed * self.goal.left > 0:
                left = min(left, self.goal.left / speed)
            step, c, kind = self._next(un, dN, dT)
            self.goal.left -= speed * min(step, left)
            if step >= left:
                self._advance(rates, un, ut, dN, dT, max(left, 0.0))
                self.end = self.time
                return
            self._advance(rates, un, ut, dN, dT, step)
            self.idle = self.idle + 1 if step <= 1e-12 * self.end else 0
            rates = self._changed(c, kind, rates)

    def _force_rates(self, un: Floats, ut: Floats) -> tuple[Floats, Floats]:
        nn, sn, ss = self.pieces.tangent()
        return -nn * un, -sn * un - ss * ut

    def _next(self, un: Floats, dN: Floats, dT: Floats) -> tuple[float, int, EventKind]:
        """The earliest event: time from now, contact, kind."""
        regime, mu = self.pieces.regime, self.pieces.mu
        is_open, free = regime == Regime.OPEN, ~self.held
        conical = (regime == Regime.ELASTIC) & free & np.isfinite(self.pieces.pairs.mu)
        tiny, still = (TINY * np.abs(rate).max(initial=0.0) for rate in (dN, un))
        with np.errstate(divide="ignore", invalid="ignore"):
            opening = np.where(
                ~is_open & ~self.held & (dN < -tiny), np.maximum(self.N, 0.0) / -dN, np.inf
            )
            closing = np.where(
                is_open & ~self.held & (un < -still), np.maximum(self.gap, 0.0) / -un, np.inf
            )
            left = np.full((2, len(dN)), np.inf)
            for k, s in enumerate((1.0, -1.0)):
                rate = s * dT - mu * dN
                away = np.maximum(mu * self.N - s * self.T, 0.0)
                left[k] = np.where(conical & (rate > tiny), away / rate, np.inf)
        best: tuple[float, int, EventKind] = (np.inf, -1, "opening")
        kinds: tuple[EventKind, ...] = ("opening", "yield", "closing")
        each: tuple[Floats, ...] = (opening, left.min(axis=0), closing)
        for times, kind in zip(each, kinds, strict=True):
            c = int(np.argmin(times))
            if times[c] < best[0]:
                best = (float(times[c]), c, kind)
        if best[2] == "yield":
            self.pieces.side[best[1]] = 1.0 if left[0, best[1]] <= left[1, best[1]] else -1.0
        return best

    def _advance(
        self, rates: Rates, un: Floats, ut: Floats, dN: Floats, dT: Floats, step: float
    ) -> None:
        pieces = self.pieces
        slides = pieces.regime == Regime.SLIDING
        slip = (-ut - np.divide(dT, pieces.pairs.kt, out=0 * dT, where=pieces.pairs.kt > 0))[slides]
        mean = self.T[slides] + 0.5 * step * dT[slides]
        self.slip_work += float(np.sum(slip * mean)) * step
        self.N = self.N + step * dN
        self.T = self.T + step * dT
        self.gap = self.gap + step * np.where(pieces.regime == Regime.OPEN, un, 0.0)
        self.strain += step * rates.h[:4]
        self.h += step * rates.h
        self.w[: len(rates.w)] += step * rates.w
        self.time += step

    def _changed(self, c: int, kind: EventKind, rates: Rates) -> Rates:
        """The event itself; afterwards everything at yield agrees again."""
        pieces = self.pieces
        self.events[c] += 1
        if self.events[c] > CHATTER or self.idle > IDLE:
            self.idle = 0
            self._hold(c, "it changes regime again and again; held", kind)
        elif kind == "yield":
            self._pivot(c, rates)
        else:
            self.N[c] = self.T[c] = self.gap[c] = 0.0
            self._close(c) if kind == "closing" else pieces.set_regime(c, Regime.OPEN)
            self.told(kind, self.time, c)
        return self._settled()

    def _close(self, c: int) -> None:
        """At the tip of its cone a contact sticks, or slides at once to either side."""
        pieces, one = self.pieces, np.array([c])
        for side in (0.0, 1.0, -1.0):
            pieces.set_regime(c, Regime.SLIDING if side else Regime.ELASTIC, side)
            rates, _, _ = pieces.solve(*self.control)
            un, ut = (float(pieces.q(rates, rows)[0]) for rows in (one, one + len(self.N)))
            shear, strength = pieces.pairs.kt[c] * ut, -pieces.mu[c] * pieces.pairs.kn[c] * un
            agrees = -side * shear >= strength if side else abs(shear) <= strength
            if un < 0 and (agrees or not np.isfinite(pieces.pairs.mu[c])):
                return
        pieces.set_regime(c, Regime.ELASTIC)

    def _pivot(self, c: int, rates: Rates) -> None:
        """One contact at yield; where no regimes agree the grains of the mode are dragged."""
        pieces, why = self.pieces, ""
        for drag in DRAGS:
            critical = pieces.at_yield(self.N, self.T, self.held)
            # Who stands on the cone does so on the side of its force.
            stuck = critical[(pieces.regime[critical] == Regime.ELASTIC) & (critical != c)]
            pieces.side[stuck] = np.sign(self.T[stuck])
            try:
                changed = pivot(pieces, self.control, c, critical, TINY * self._scale(rates))
            except UnsolvedError as stop:
                why = why or self._mode(stop)
                if drag == DRAGS[-1]:
                    break
                u = np.linalg.norm(stop.motion.reshape(-1, 3), axis=1)
                self.flush()
                grains = u > 0.1 * u.max()
                pieces.drag[grains] = np.maximum(pieces.drag[grains], drag)
                pieces.factorise()
                continue
            if why:
                self.told("instability", self.time, c, f"{why}; dragged")
            for k in changed:
                slides = pieces.regime[k] == Regime.SLIDING
                self.told("yield" if slides else "unloading", self.time, k)
            return
        self._hold(c, f"{why}; held", "yield")

    def _scale(self, rates: Rates) -> float:
        size = float(np.abs(rates.h[:4]).max())
        return size * float(self.pieces.pairs.kn.max()) * 2.0 * self.pieces.length

    def _settled(self) -> Rates:
        """Rates with which every contact at yield agrees; factorised anew where ranks are many."""
        pieces = self.pieces
        if len(pieces.rows) > RANK:
            self.flush()
            pieces.factorise()
        tried: Counter[int] = Counter()
        while True:
            rates, _, _ = pieces.solve(*self.control)
            critical = pieces.at_yield(self.N, self.T, self.held)
            # Those that stick have just been passed by, or have their event to come.
            sliders = critical[pieces.regime[critical] == Regime.SLIDING]
            wrong = disagreeing(pieces, rates, sliders, TINY * self._scale(rates))
            if len(wrong) == 0:
                return rates
            c = int(wrong[0])
            tried[c] += 1
            if tried[c] > 3:
                self._hold(c, "neither sticking nor sliding agrees; held", "yield")
            else:
                self._pivot(c, rates)
            if len(pieces.rows) > RANK:
                self.flush()
                pieces.factorise()

    def _hold(self, c: int, why: str, kind: EventKind) -> None:
        """Keep a contact stuck or open, whatever becomes of it, until the interval ends."""
        pieces = self.pieces
        if kind in ("opening", "closing"):
            pieces.set_regime(c, Regime.OPEN)
            self.N[c] = self.T[c] = 0.0
        elif pieces.regime[c] == Regime.SLIDING:
            flip(pieces, c)
        self.held[c] = True
        self.told("instability", self.time, c, why)

    def _mode(self, stop: UnsolvedError) -> str:
        u = stop.motion.reshape(-1, 3)[:, :2]
        square = np.sum(u**2, axis=1)
        share = float(square.sum() ** 2 / max(float(np.sum(square**2)), 1e-300))
        turns = "changes sign" if stop.turns else "keeps its sign"
        return f"no regimes agree: {share:.0f} grains take part, det K {turns}"

    def flush(self) -> None:
        """Add up the motion of the columns that stand."""
        m = len(self.pieces.rows)
        self.u += self.pieces.V @ self.h + self.pieces.U[:, :m] @ self.w[:m]
        self._clear()


def end_state(
    interval: Interval, state: PackingState, pairs: Pairs
) -> tuple[PackingState, Regimes, Floats]:
    """Geometry, exact normal forces, shear forces within the cone; what was cut off of them.

    The last is the energy of the springs that held contacts had beyond their strength.
    """
    interval.flush()
    pieces = interval.pieces
    v = interval.u.reshape(-1, 3)
    E = interval.strain.reshape(2, 2)
    moved = replace(
        state,
        x=state.x - state.x @ E.T + v[:, :2],
        angle=state.angle + v[:, 2] / pieces.length,
        cell=state.cell - E @ state.cell,
    )
    i, j = pairs.grains.T
    overlap = state.radii[i] + state.radii[j] - np.linalg.norm(moved.branches, axis=1)
    N = np.maximum(pairs.kn * overlap, 0.0)
    regime = np.where(N > 0, pieces.regime, Regime.OPEN).astype(np.int8)
    regime = np.where((N > 0) & (regime == Regime.OPEN), Regime.ELASTIC, regime).astype(np.int8)
    most = strength(pairs, N)
    slides = regime == Regime.SLIDING
    T = np.where(slides, interval.pieces.side * interval.pieces.mu * N, interval.T)
    T = np.where(N > 0, T, 0.0)
    cut = np.clip(T, -most, most)
    cut_off = np.where(interval.held & (pairs.kt > 0), T**2 - cut**2, 0.0) / (
        2 * np.maximum(pairs.kt, 1e-300)
    )
    # Whoever was held stands at its cone again.
    at_cone = interval.held & (np.abs(cut) >= (1 - 1e-6) * most) & (N > 0) & (most > 0)
    pieces.side[at_cone] = np.sign(cut[at_cone])
    regime[at_cone] = Regime.SLIDING
    return replace(moved, normal_force=N, shear_force=cut), regime, cut_off
