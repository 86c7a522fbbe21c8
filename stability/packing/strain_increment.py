"""A short strain of a packing from event to event: linear in between, with frozen geometry."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from loops.arrays import Flags, Floats
from loops.contacts import AT_YIELD, Contacts
from loops.laws.of_pairs import AT_TOUCH
from stability.packing.point import INCREMENT, RELEASED, SLIP, PackingPoint
from stability.packing.rattlers import LIGHT_SHARE, UNLOADED_SHARE, carrying_nothing
from stability.packing.regime_factor import (
    ELASTIC,
    OPEN,
    RANK,
    RATE_RTOL,
    ROOM,
    SLIDING,
    RegimeFactor,
    disagreeing,
    pivot,
    seek,
)
from stability.path import Event, EventKind, Spring

# Events of one contact within an increment; at the next one it is damped or held.
CHATTER = 12
# Ground springs (in kn) tried in turn on an unstable mode; the last is none: the contact is held.
GROUND_SPRINGS = (1e-3, 1e-2, 1e-1, 0.0)
# No contact stops a grain that moves so far between two events (in mean radii, and over a hundred
# times the strain meanwhile): its path and the work of its slip are those of its ground spring,
# which from then on is this one (in kn).
RUNS_AWAY = 0.01
HELD_BACK = 1e-4
# Largest strain speed over the smallest of the stage; beyond, the control has met its limit.
MAX_SPEED_RATIO = 1e3


class StrainIncrement:
    """A packing under its stage for a `duration` of the loading parameter, to its goal or a strain.

    Its load decreases by a share `relief` of the resultants of the start, and takes up what is out
    of balance. Grains of an instability are dragged by springs on the ground, `drag` times those of
    `GROUND_SPRINGS`; where it is None it ends the increment. What happens is added to the `events`.
    """

    def __init__(
        self,
        point: PackingPoint,
        packing: RegimeFactor,
        size: float,
        duration: float,
        relief: float,
        drag: float | None,
        events: list[Event],
    ) -> None:
        self.point, self.packing, self.state = point, packing, point.state
        self.control, self.duration, self.drag = point.control(1.0 / duration), duration, drag
        self.left = point.targets[0] - point.quantity
        # Under given strain rates its time ends it, to rounding.
        self.left_to_strain = (1.0 + 1e-9) * size
        state, law = point.state, point.state.law
        scale = np.tile([1.0, 1.0, 1.0 / packing.length], len(state.x))
        self.relief_rate = relief / duration
        self.load = -point.load.ravel() * scale
        self.relief = relief * point.carried.ravel() * scale / duration
        # Remove the force imbalance over this interval by adding it as a load.
        packing.set_load(point.imbalance.ravel() * scale / duration + self.relief)
        # Grains that carry nothing, and the pairs that they are in: never in touch.
        self.rattlers, self.absent = point.rattlers.copy(), point.absent
        self.touching = np.where(self.absent, 0.0, law.touching)
        # The kernels change these in place.
        self.N = np.tile(state.normal_force, law.springs)
        self.T = law.of_springs(state.shear_force, state.rolling_moment / packing.length)
        self.gap = np.maximum(state.length - law.touching, 0.0)
        self.rates = np.empty((len(self.N), 4))
        # Whether it ended at its goal, before its duration.
        self.reached = False
        self.time, self.u, self.strain = 0.0, np.zeros(3 * packing.count), np.zeros(4)
        # As in `Path.work`; the last is that of held contacts, of grains it is `released`.
        self.work, self.released = np.zeros(4), np.zeros(packing.count)
        # Pairs without events: absent ones, and contacts that are held.
        self.held = np.resize(self.absent, len(self.N))
        self.event_count: Counter[int] = Counter()
        self.events = events

    def run(self) -> Event | None:
        """Go from event to event to the end of the increment; or to the loss that ends it before.

        That is an instability, a contact that pulls off, or the limit of the control.
        """
        from stability.compiled.packing_rates import earliest

        packing, point, self.reached = self.packing, self.point, False
        rates = self._settled()
        while self.time < self.duration and self.left_to_strain > 0:
            if isinstance(rates, Event):
                return rates
            h, v = rates[:5], packing.motion(rates)
            strain_speed = float(np.linalg.norm(h[:4]))
            if not strain_speed <= MAX_SPEED_RATIO * point.slowest:
                return self._event("control_limit")
            left = min(self.duration - self.time, self.left_to_strain / strain_speed)
            # The earliest event: time from now, contact, and its side if it yields.
            pairs = packing.frame, packing.regime, packing.side
            now = self.held, self.N, self.T, self.gap, v, h, RATE_RTOL, left
            step, c, event = earliest(*pairs, *now, self.rates, packing.time_to_event)
            kind: EventKind = "closing" if event else "opening"
            if event in (-1, 1):
                kind = "yield"
                packing.side[c] = event
            # Rate of the quantity whose target ends it.
            by_stress = point.leg.stage.quantity[0] == "P"
            speed = point.speed(h[:4], packing.stress(rates) if by_stress else np.zeros(4))
            reached = speed * self.left > 0 and self.left / speed < left
            if reached:
                left = self.left / speed
            if self._held_back(v, min(step, left), strain_speed):
                rates = self._settled()
                continue
            self.left -= speed * min(step, left)
            self.left_to_strain -= strain_speed * min(step, left)
            if step >= left:
                self._advance(h, v, max(left, 0.0))
                self.reached = reached and self.time < self.duration
                return None
            self._advance(h, v, step)
            lost = self._change(c, kind, rates)
            rates = self._settled() if lost is None else lost
        return rates if isinstance(rates, Event) else None

    def _held_back(self, v: Floats, step: float, strain_speed: float) -> bool:
        """Hold grains that no contact stops, turned by the friction of one; whether any are."""
        packing, least = self.packing, max(RUNS_AWAY, 100.0 * strain_speed * step)
        size = np.linalg.norm(v.reshape(-1, 3), axis=1) * step / packing.length
        grains = np.flatnonzero((size > least) & (packing.ground_spring < HELD_BACK))
        if len(grains):
            packing.add_ground_springs(grains, HELD_BACK)
        return len(grains) > 0

    def _advance(self, h: Floats, v: Floats, step: float) -> None:
        """Go on by a time at constant rates."""
        from stability.compiled.packing_rates import GAUSS, add_work, advance

        packing = self.packing
        normal = np.zeros((0, 0))
        law = self.state.law
        if not law.linear:
            # Of such forces the energies at both ends are exact, whatever the rule in between.
            times = step * np.array([0.0, GAUSS, 1.0 - GAUSS, 1.0])
            overlap = self._overlaps(h, v, times)
            normal = law.normal_force(overlap[1:3])
            before, after = (law.normal_energy(overlap[k]) for k in (0, 3))
            self.work[0] += float(np.sum(after - before)) if step > 0 else 0.0
        pairs = (packing.frame, packing.regime)
        motion = (packing.length, self.strain, self.u, h, v, step)
        forces = (self.T, self.rates, self.work, self.released)
        # Rates are constant: the mean load does the work of the decreasing one.
        load = self.load - (self.time + 0.5 * step) * self.relief
        add_work(*pairs, self.touching, normal, load, *motion, *forces)
        advance(*pairs, step, self.rates, self.N, self.T, self.gap, self.work)
        self.strain += step * h[:4]
        self.u += step * v
        self.time += step

    def _overlaps(self, h: Floats, v: Floats, times: Floats) -> Floats:
        """Overlaps (k, C) of the pairs at times from now at constant rates."""
        pairs = self.packing.frame[: len(self.absent)]
        (i, j), d = pairs["grains"].T, pairs["d"]
        u, w = (motion.reshape(-1, 3)[:, :2] for motion in (self.u, v))
        branch = d - d @ self.strain.reshape(2, 2).T + u[j] - u[i]
        rate = w[j] - w[i] - d @ h[:4].reshape(2, 2).T
        branch = branch + times[:, None, None] * rate
        # Contacts with walls keep their normals.
        away, length = np.sum(branch * pairs["n"], axis=2), np.linalg.norm(branch, axis=2)
        length = np.where(pairs["turns"] == 0, np.abs(away), length)
        return np.maximum(self.touching - length, 0.0)

    def _change(self, c: int, kind: EventKind, rates: Floats) -> Event | None:
        """Change the regime of a contact at its event; end its rattling. The loss, if it is one."""
        self.event_count[c] += 1
        packing = self.packing
        if self.event_count[c] <= CHATTER:
            if kind == "yield":
                return self._pivot(c, rates)
            if kind == "opening":
                return self._part(c)
            self._end_forces(c, SLIP)
            self._close(c)
            self._tell(kind, c)
            return None
        self.event_count[c] = 0
        if self._free(c, LIGHT_SHARE):
            return None
        # A grain of fewer than three contacts is held by a ground spring; else the contact is.
        pair = packing.frame["grains"][c]
        closed = np.flatnonzero(packing.regime[: packing.pair_count] != OPEN)
        degree = np.bincount(packing.frame["grains"][closed].ravel(), minlength=packing.count)[pair]
        loose = pair[degree == degree.min()]
        spring = 10.0 * max(float(packing.ground_spring[loose].max()), GROUND_SPRINGS[0])
        if degree.min() > 2 or spring > GROUND_SPRINGS[-2]:
            return self._hold(c, kind, cause="chatters")
        return self._pass(c, spring, cause="rattles", grains=tuple(loose.tolist()))

    def _part(self, c: int) -> Event | None:
        """Open a contact; what it pulled with drops at once, which is a loss."""
        # One that opens under shear lets its energy go; others have slipped to none.
        self._end_forces(c, RELEASED if self.strength_at_touch(c) > 0 else SLIP)
        pulls = self.packing.frame["at_touch"][c] < 0
        self._open(c)
        self._break(np.arange(len(self.absent)) == c)
        event = self._event("opening", c)
        if pulls:
            ends = tuple(self.packing.frame["grains"][c].tolist())
            event = replace(event, cause="pulls_off", grains=ends)
            if self.drag is None:
                return event
            event = replace(event, passed="dragged")
        self.events.append(event)
        self._free(c)
        return None

    def _free(self, c: int, share: float = UNLOADED_SHARE) -> bool:
        """Take grains of a contact that carry nothing out of the system to the end; whether any."""
        packing, count, ends = self.packing, len(self.absent), self.state.contacts
        closed, N = packing.regime[:count] != OPEN, self.N[:count]
        idle = carrying_nothing(replace(self.state, normal_force=N, closed=closed), share)
        grains = [g for g in ends[c % count].tolist() if idle[g]]
        self.rattlers[grains] = True
        rows = np.flatnonzero(self.rattlers[ends].any(axis=1) & ~self.absent)
        if len(rows):
            self._break(np.isin(np.arange(count), rows))
            moved = self._moved()
            energy = moved.law.normal_energy(moved.overlap)
            self.work[RELEASED] += float(energy[rows].sum())
        for row in rows.tolist():
            self.absent[row] = self.held[self._springs(row)] = True
            self.touching[row] = 0.0
            if packing.regime[row] != OPEN:
                self._end_forces(row, RELEASED)
                self._open(row)
                self._tell("opening", row, cause="unloaded")
        if grains:
            # Nothing would hold them against a load.
            for load in (self.load, self.relief):
                load.reshape(-1, 3)[grains] = 0.0
            packing.factorise()
        return bool(grains)

    def _moved(self) -> Contacts:
        """The packing where the increment has taken it, with the forces of its start."""
        v, E = self.u.reshape(-1, 3), self.strain.reshape(2, 2)
        return replace(
            self.state,
            x=self.state.x - self.state.x @ E.T + v[:, :2],
            angle=self.state.angle + v[:, 2] / self.packing.length,
            cell=self.state.cell - E @ self.state.cell,
        )

    def _springs(self, c: int) -> list[int]:
        """The pair, and its spring against rolling."""
        return list(range(c, len(self.N), len(self.absent)))

    def _open(self, c: int) -> None:
        for row in self._springs(c):
            self.packing.set_regime(row, OPEN)

    def _break(self, opened: Flags) -> None:
        """Take the bonds of pairs that have opened: these touch again where the grains do."""
        whole, self.state = self.state, self.state.parted(opened)
        law = self.state.law
        if law is whole.law:
            return
        moved = self._moved()
        whole = replace(moved, law=whole.law)
        before, after = (one.law.normal_energy(one.overlap)[opened] for one in (whole, moved))
        self.work[RELEASED] += float(np.sum(before - after))
        self.touching = np.where(self.absent, 0.0, law.touching)
        self.gap += whole.law.reach - law.reach
        frame = self.state.records(self.packing.reach)
        rows = np.flatnonzero(np.resize(opened, len(frame)))
        was = self.packing.frame[rows]
        self.packing.frame[rows] = frame[rows]
        # Their stiffness is in the factors.
        if any((frame[rows][name] != was[name]).any() for name in ("kn", "kt", "mu", "coupling")):
            self.packing.factorise()

    def _close(self, c: int) -> None:
        """Make a contact stick or slide to either side, whichever agrees with its closing.

        It begins with the force `at_touch`; one that has strength there sticks.
        """
        packing, rows = self.packing, self._springs(c)
        self.N[rows] = packing.frame[c]["at_touch"]
        sticks = self.strength_at_touch(c) > 0
        for sides in () if sticks else product((0.0, 1.0, -1.0), repeat=len(rows)):
            for row, side in zip(rows, sides, strict=True):
                packing.set_regime(row, SLIDING if side else ELASTIC, side)
            rates, agree = packing.solve(self.control), True
            for row, side in zip(rows, sides, strict=True):
                pair = packing.frame[row]
                un, ut = packing.relative(rates, row)
                shear, strength = pair["kt"] * ut, -pair["mu"] * pair["kn"] * un
                agrees = -side * shear >= strength if side else abs(shear) <= strength
                agree = agree and un < 0 and bool(agrees or not pair["slides"])
            if agree:
                return
        for row in rows:
            packing.set_regime(row, ELASTIC)

    def _pivot(self, c: int, rates: Floats) -> Event | None:
        """Find the regime of a contact at yield; hold the grains of a mode that nothing stops."""
        packing, facts, before = self.packing, dict[str, Any](), len(self.events)
        for spring in GROUND_SPRINGS:
            critical = packing.at_yield(self.N, self.T, self.held)
            # A stuck contact on the friction limit would slide in the direction of its force.
            stuck = critical[(packing.regime[critical] == ELASTIC) & (critical != c)]
            packing.side[stuck] = np.sign(self.T[stuck])
            low = packing.rounding(rates)
            changed, mode = pivot(packing, self.control, c, critical, low)
            if changed is None:
                # What the spring before did is no event; a light grain leaves before regimes of all
                # contacts are sought.
                del self.events[before:]
                if self._free(c, LIGHT_SHARE):
                    return None
            if changed is None and not facts:
                # Springs make another problem: whether this one has a solution is asked once.
                every = np.append(critical[critical != c], c)
                changed, mode["cause"] = seek(packing, self.control, every, low)
            if changed is not None:
                for k in changed:
                    self._tell("yield" if packing.regime[k] == SLIDING else "unloading", k)
                return None
            # The first mode is told; the last one is dragged.
            facts = (facts or mode) | {"grains": mode["grains"]}
            lost = self._pass(c, spring, **facts) if spring else self._hold(c, "yield", **facts)
            if lost is not None:
                return lost
        return None

    def _settled(self) -> Floats | Event:
        """Rates with which every sliding contact agrees, after the pivots that this takes.

        Or the loss that a pivot meets; the limit of a control of stress where no contact is left.
        """
        packing = self.packing
        tried: Counter[int] = Counter()
        while True:
            if len(packing.at) > min(RANK, ROOM // 2):
                packing.factorise()
            if self.control.stress.any() and (packing.regime == OPEN).all():
                return self._event("control_limit")
            rates = packing.solve(self.control)
            critical = packing.at_yield(self.N, self.T, self.held)
            # Stuck ones have just been looked at, or have their event to come.
            sliders = critical[packing.regime[critical] == SLIDING]
            wrong = disagreeing(packing, rates, sliders, packing.rounding(rates))
            if len(wrong) == 0:
                return rates
            c = int(wrong[0])
            tried[c] += 1
            undecided = tried[c] > 3
            lost = self._hold(c, "yield", cause="undecided") if undecided else self._pivot(c, rates)
            if lost is not None:
                return lost

    def _hold(self, c: int, kind: EventKind, **facts: Any) -> Event | None:
        """Keep a contact stuck or open to the end of the increment, whatever its forces."""
        packing = self.packing
        facts |= {"grains": tuple(packing.frame["grains"][c].tolist())}
        lost = self._pass(c, 0.0, **facts)
        if lost is not None:
            return lost
        if kind in ("opening", "closing"):
            self._open(c)
            self._end_forces(c, RELEASED)
        elif packing.regime[c] == SLIDING:
            packing.flip(c)
        self.held[self._springs(c)] = True
        return None

    def _pass(self, c: int, spring: float, **facts: Any) -> Event | None:
        """Drag the grains of an instability, without a spring none; or return it, as a loss."""
        event = self._event("instability", c, **facts)
        if self.drag is None:
            return event
        if spring:
            self.packing.add_ground_springs(np.array(event.grains), self.drag * spring)
        self.events.append(replace(event, passed="dragged" if spring else "held"))
        return None

    def _tell(self, kind: EventKind, c: int, **facts: Any) -> None:
        self.events.append(self._event(kind, c, **facts))

    def _event(self, kind: EventKind, c: int = 0, **facts: Any) -> Event:
        """Return an event now; its parameter counts from the start of the increment."""
        rolling, contact = divmod(c, len(self.absent))
        spring: Spring = "rolling" if rolling else "shear"
        return Event(kind, self.time, contacts=(contact,), spring=spring, **facts)

    def strength_at_touch(self, c: int) -> float:
        """Return the shear force that a contact can carry where it opens, zero to rounding."""
        pair = self.packing.frame[c]
        friction, cohesion = float(pair["mu"] * pair["at_touch"]), float(pair["cohesion"])
        rounding = AT_TOUCH * (abs(friction) + abs(cohesion))
        return friction + cohesion if friction + cohesion > rounding else 0.0

    def _end_forces(self, c: int, spent: int) -> None:
        """Set the forces of a contact to zero; the energy of its shear spring becomes work."""
        for row in self._springs(c):
            kt = float(self.packing.frame["kt"][row])
            self.work[spent] += self.T[row] ** 2 / (2 * kt) if kt > 0 else 0.0
            self.N[row] = self.T[row] = 0.0

    def end(self) -> PackingPoint:
        """The packing after the increment: exact normal forces, shear forces within the cone."""
        packing, moved, point = self.packing, self._moved(), self.point
        overlap = np.where(self.absent, 0.0, moved.overlap)
        # Bonds that have opened by then are gone, with the energy that they had left.
        whole, moved, work = moved.law, moved.parted(overlap == 0), self.work.copy()
        law, count = moved.law, len(overlap)
        left = whole.normal_energy(overlap) - law.normal_energy(overlap)
        work[RELEASED] += float(left[overlap == 0].sum())
        N = law.normal_force(overlap)
        touch = overlap > 0
        moved = replace(moved, normal_force=N, closed=touch)
        most = law.of_springs(moved.strength, moved.rolling_strength / packing.length)
        touch = np.tile(touch, law.springs)
        closed = np.where(packing.regime == OPEN, ELASTIC, packing.regime)
        regime, side = np.where(touch, closed, OPEN).astype(np.int8), packing.side.copy()
        # Sliding contacts have all of their strength, others at most that.
        T = np.where(regime == SLIDING, side * np.where(np.isfinite(most), most, 0.0), self.T)
        T = np.clip(np.where(touch, T, 0.0), -most, most)
        # Shear springs relax by slip, or by the work of the constraint on a held contact.
        kt = packing.frame["kt"]
        relaxed = np.divide(self.T**2 - T**2, 2 * kt, out=0 * T, where=kt > 0)
        # Under the same force a stiffer spring stores less.
        now = law.stiffnesses(overlap)[1]
        springs = np.flatnonzero((kt[:count] > 0) & (now > 0))
        softer = 1 / kt[springs] - 1 / now[springs]
        work[INCREMENT] += 0.5 * float(np.sum(T[springs] ** 2 * softer))
        work[SLIP] += relaxed[~self.held].sum()
        work[RELEASED] += relaxed[self.held].sum() + self.released.sum()
        # A held contact that stands on the friction limit slides from now on.
        at_limit = self.held & (np.abs(T) >= AT_YIELD * most) & touch & (most > 0)
        side[at_limit] = np.sign(T[at_limit])
        regime[at_limit] = SLIDING
        M = law.rolling_part(T) * packing.length
        return replace(
            point.with_events(self.events, self.released),
            state=replace(moved, shear_force=T[:count], rolling_moment=M),
            regime=regime,
            side=side,
            rattlers=self.rattlers.copy(),
            F=point.F - self.strain.reshape(2, 2) @ point.F,
            work=point.work + work,
            load_share=point.load_share - self.relief_rate * self.time,
            parameter=point.parameter + self.time,
            order=packing.order,
        )
