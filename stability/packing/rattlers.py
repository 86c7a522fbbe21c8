"""Grains that carry nothing: they leave the system, move out of overlap, and join when loaded.

A grain without load is held by nothing: in the rates of the packing its motion would be that of
a nearly singular system, or of a spring to the ground. Here it has no contacts and goes with the
mean strain; at the end of an increment it moves as far as its gaps let it, and where they, or the
friction of the contacts that press it, let it no further it is loaded, with their forces.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.contacts import Contacts
from loops.laws.of_pairs import SMALL_OVERLAP
from stability.packing.point import RELEASED, PackingPoint
from stability.packing.regime_factor import ELASTIC, OPEN

# A grain whose largest normal force is below this share of the mean force carries nothing, at the
# start and until it finds no room. Grains of held states have 1e-6 or 7e-3 and more.
LOADED_SHARE = 1e-4
# One that carries does so until this share: with one share for both it would come and go.
UNLOADED_SHARE = 1e-5
# A grain whose forces are below this share of the mean force is light: where it has no consistent
# regimes it leaves the system. Such a snap of one grain moves the sample by 3e-7 and has 1e-9 of
# its energy; whether an interval met it changed the first loss by a factor of two.
LIGHT_SHARE = 1e-2
# An interval in which a grain is caught ends where its largest force is below this share of the
# mean force: its load enters the packing at once. With 5e-4 two limits are the same to 2e-4 and
# 1e-5, with 5e-3 one moves by 7e-4; without a bound forces are up to .05 of the mean.
CAUGHT_SHARE = 2e-3
# Halvings by which that place is found.
CATCH_HALVINGS = 20
# Most steps in which grains that carry nothing move out of overlap, or into balance.
MOST_ROUNDS = 100
# Dampings of a step (Levenberg's), over the stiffness, tried until the energy falls.
DAMPINGS = (1e-6, 1e-4, 1e-2, 1.0, 1e2)
# Falls of the energy below this share are rounding.
ENERGY_RTOL = 1e-14
# A balance with a mode of a stiffness below this share of `-N/l` is left along it.
BENDS = 1e-3
# A grain whose resultant is below this share of its largest force is in balance. One that is not
# still moves out of overlap, as a chain of two discs does, which no friction holds.
IN_BALANCE = 1e-3
# Share of the gap up to which pairs are listed that a coasting grain goes in an interval at most.
MOST_COAST = 0.25


class Freed(NamedTuple):
    """The state without forces on grains that carry nothing, these (B,), and the energy let go."""

    state: Contacts
    rattlers: Flags
    released: float


def carrying_nothing(state: Contacts, share: float, closed: Flags | None = None) -> Flags:
    """Return grains (B,) without load: below a share of the mean force, or under two contacts.

    Of the `closed` contacts (C,), by default those of the state. Contacts of such grains do not
    count for their neighbours, and so on. The load of a contact is its force above that `at_touch`,
    and a contact that can pull holds a grain as two do.
    """
    closed = state.closed if closed is None else closed
    i, j = state.contacts[closed].T
    at_touch, bodies = state.law.at_touch[closed], len(state.x)
    N = state.normal_force[closed] - at_touch
    holds = np.where(at_touch < 0, 2, 1)
    least = share * state.mean_force_of(closed)
    largest = np.zeros(bodies)
    np.maximum.at(largest, i, N)
    np.maximum.at(largest, j, N)
    idle = largest < least
    while True:
        kept = np.where(idle[i] | idle[j], 0, holds)
        degree = np.bincount(i, kept, minlength=bodies) + np.bincount(j, kept, minlength=bodies)
        found = idle | (degree < 2)
        found[state.count :] = False
        if (found == idle).all():
            return found
        idle = found


def settle(
    end: PackingPoint, start: PackingPoint | None, duration: float, coasting: bool = False
) -> PackingPoint:
    """Return the end of an interval where grains that carry nothing leave the system, or join it.

    Those of the interval did not carry in it. Where these are `coasting` they go on as in the
    interval before, no further than pairs are listed, and what they meet pushes them out of
    overlap. After a motion, without a `start`, all of them are found anew.
    """
    before, state, goes_on = end.rattlers, end.state, coasting and start and duration > 0.0
    if goes_on:
        step = end.coast * duration
        most = MOST_COAST * end.listed_gap / np.maximum(np.linalg.norm(step, axis=1), 1e-300)
        state = replace(state, x=state.x + np.minimum(1.0, most)[:, None] * step)
    state, rattlers, released = free_rattlers(state, before if start else None)
    moved, on = state.x - end.state.x, rattlers & before
    coast = np.where(on[:, None], moved / duration, 0.0) if goes_on else np.zeros_like(moved)
    caught, share = np.zeros_like(rattlers) if start is None else start.rattlers & ~rattlers, 1.0
    if start and caught.any():
        share = share_until_caught(start.state, end.state, caught, before)
    work = end.work.copy()
    work[RELEASED] += released
    closed, regime = np.resize(state.closed, len(end.regime)), end.regime
    regime = np.where(closed, np.where(regime == OPEN, ELASTIC, regime), OPEN)
    return replace(
        end,
        state=state,
        regime=regime.astype(np.int8),
        rattlers=rattlers,
        coast=coast,
        carried=np.where(rattlers[:, None], 0.0, end.carried),
        work=work,
        free_share=share,
        wandered=end.wandered + float(np.abs(moved).max()),
    )


def free_rattlers(state: Contacts, before: Flags | None = None) -> Freed:
    """Take the forces of grains that carry nothing, and move them out of overlap.

    Grains that did so `before` do until they find no room: then they keep the normal forces of
    their overlaps.
    """
    if before is None:
        idle = carrying_nothing(state, LOADED_SHARE)
    else:
        others = state.closed & ~before[state.contacts].any(axis=1)
        idle = carrying_nothing(state, UNLOADED_SHARE, others)
    free: Flags = np.asarray(idle[state.contacts].any(axis=1))
    rows = np.flatnonzero(free)
    pressed = _out_of_overlap(_at(state, rows), idle)
    idle = idle & ~_held(pressed, idle, LOADED_SHARE * state.mean_force)
    joined = np.zeros(len(free), dtype=bool)
    joined[rows] = ~idle[pressed.contacts].any(axis=1) & (pressed.overlap > 0)
    N = np.where(free, 0.0, state.normal_force)
    T = np.where(free, 0.0, state.shear_force)
    N[joined], T[joined] = (k[joined[rows]] for k in (pressed.normal_force, pressed.shear_force))
    moved = replace(
        state,
        x=pressed.x,
        normal_force=N,
        shear_force=T,
        rolling_moment=np.where(free, 0.0, state.rolling_moment),
        closed=(state.closed & ~free) | joined,
    )
    return Freed(moved, idle, state.energy(free & state.closed) - moved.energy(joined))


def _held(state: Contacts, idle: Flags, least: float) -> Flags:
    """Return the idle grains (B,) with a load of `least`, in balance with the others that have."""
    rows = np.flatnonzero(idle[state.contacts].any(axis=1) & (state.normal_force != 0))
    if not len(rows):
        return np.zeros(len(idle), dtype=bool)
    ends, load = state.contacts[rows], (state.normal_force - state.law.at_touch)[rows]
    arms, held = np.ones((len(idle), 3)), idle
    arms[idle, 2] = state.radii[idle]
    while True:
        carries = ~(idle & ~held)[ends].any(axis=1)
        of, largest = rows[carries], np.zeros(len(idle))
        np.maximum.at(largest, ends[carries], load[carries, None])
        left = np.abs(_at(state, of).resultants / arms).max(axis=1)
        found = held & (largest >= least) & (left <= IN_BALANCE * largest)
        if (found == held).all():
            return held
        held = found


def _at(state: Contacts, rows: Integers) -> Contacts:
    """Return some contacts alone, without rolling moments."""
    names = ("contacts", "images", "normal_force", "shear_force", "closed")
    taken = {name: getattr(state, name)[rows] for name in names}
    return replace(state, law=state.law.taken(rows), rolling_moment=np.zeros(len(rows)), **taken)


def share_until_caught(start: Contacts, end: Contacts, caught: Flags, idle: Flags) -> float:
    """Return the share of the way between two states on which grains stay free of load.

    They are `caught` at the end; `idle` are all grains that carried nothing. At the share the load
    has reached `CAUGHT_SHARE` at most. One where it does not exceed that at the end, or is there
    from the start on.
    """
    others = (idle & ~caught)[end.contacts].any(axis=1)
    listed = _at(end, np.flatnonzero(caught[end.contacts].any(axis=1) & ~others))
    low, share, high = 0.0, 1.0, 1.0
    for _ in range(CATCH_HALVINGS):
        x = start.x + share * (end.x - start.x)
        here = replace(listed, x=x, cell=start.cell + share * (end.cell - start.cell))
        here = _out_of_overlap(here, caught)
        held = _held(here, caught, LOADED_SHARE * end.mean_force)
        rows = held[here.contacts].any(axis=1)
        load = float((here.normal_force - here.law.at_touch)[rows].max(initial=0.0))
        if 0.0 < load <= CAUGHT_SHARE * end.mean_force or (share == 1.0 and load == 0.0):
            break
        low, high = (low, share) if load > 0.0 else (share, high)
        share = 0.5 * (low + high)
    else:
        # Near another balance the load is there at once: no place in between has less.
        share = share if low > 0.0 else 1.0
    return share


class _Cages:
    """Springs of the pairs (R,) of grains that carry nothing, at centres and turns from the start.

    `load` and `T` are forces on them, above those at touch. Contacts stick while friction can hold
    them, and slide with their strength where it can't: a grain between two others stays where the
    line between its contacts lies in both friction cones, and slips out where it does not.
    """

    def __init__(self, state: Contacts, idle: Flags) -> None:
        from stability.compiled import cages

        self.state, self.idle, self.kernels = state, idle, cages
        self.offset = state.images @ state.cell.T
        self.ends = np.ascontiguousarray(state.contacts.T)
        touching = state.law.touching
        kn, kt = state.law.stiffnesses(np.maximum(state.overlap, SMALL_OVERLAP * touching))
        self.ratio = kt / kn
        # Contacts that only touch, by rounding, are open.
        self.rounding = 4.0 * np.finfo(float).eps * float(np.abs(state.x).max())
        self.place(state.x, np.zeros(len(state.x)))

    def place(self, x: Floats, turned: Floats) -> None:
        """Set the centres (B, 2), and the turns times the radii (B,)."""
        kernels = self.kernels
        self.x, self.turned, state, law = x, turned, self.state, self.state.law
        pairs = self.ends, self.offset, state.walls, x, law.touching
        n, length, overlap = kernels.normals_and_overlaps(*pairs)
        seen = law.contacts(overlap)
        N = law.normal_force(overlap, seen)
        self.stored = float(np.sum(law.normal_energy(overlap, seen) - law.at_touch * overlap))
        # The rest is of those that overlap.
        self.pressed = c = np.flatnonzero(overlap)
        self.load, self.overlap, self.length = (N - law.at_touch)[c], overlap[c], length[c]
        n = n[c]
        # Secants, with which springs that stiffen leave an overlap in one step.
        self.kn = self.load / self.overlap
        self.kt, self.strength = self.ratio[c] * self.kn, law.shear_strength(overlap, N, seen)[c]
        springs = self.kt, self.strength
        found = kernels.sheared(self.ends, c, n, x - state.x, turned, *springs)
        self.slid, self.T, self.slides = found
        (self.part, self.slip), self.grains = kernels.parting_and_slip(self.ends, c, n, self.idle)

    def work(self, springs: Floats) -> float:
        """Return the energy stored, with what shear stores and takes at `kt`, strengths (2, R)."""
        return self.stored + self.kernels.work_of_shear(self.pressed, *springs, self.slid)

    def step(self) -> bool:
        """Take a step towards balance in which the energy falls; whether there was one.

        With secants of springs and of friction, damped until the energy falls, which is that at the
        strengths of the start; at rest along a mode that has no stiffness.
        """
        c = self.pressed
        if not len(c):
            return False
        kn, kt, load, T, slides = self.kn, self.kt, self.load, self.T, self.slides
        overlap, length = self.overlap, self.length
        part, slip, grains = self.part, self.slip, self.grains
        left = part.T @ (load + kn * self.rounding) + slip.T @ T
        secant = np.where(slides, self.strength / np.where(slides, np.abs(self.slid), 1.0), kt)
        squeezed = part.T @ (kn[:, None] * part)
        stiffness = squeezed + slip.T @ (secant[:, None] * slip)
        unit = float(kn.max()) * np.eye(len(left))
        start, springs = (self.x, self.turned), np.zeros((2, len(self.ratio)))
        springs[:, c] = kt, self.strength
        least = (1.0 - ENERGY_RTOL) * self.work(springs)

        def falls(moves: Floats) -> bool:
            x, turned = start[0].copy(), start[1].copy()
            x[grains] += moves.reshape(-1, 3)[:, :2]
            turned[grains] += moves.reshape(-1, 3)[:, 2]
            self.place(x, turned)
            return self.work(springs) < least

        if any(falls(np.linalg.solve(stiffness + d * unit, left)) for d in DAMPINGS):
            return True
        # At rest. Forces turn with the branches: a row of grains may roll away all the same.
        across = slip.copy()
        across.reshape(len(c), -1, 3)[..., 2] = 0.0
        turns = (load / length)[:, None] * across - (T / length)[:, None] * part
        turns = across.T @ turns
        stuck = squeezed + slip.T @ (np.where(slides, 0.0, kt)[:, None] * slip)
        values, modes = np.linalg.eigh(stuck - 0.5 * (turns + turns.T))
        mode = float(overlap.max()) * np.sign(modes[:, 0] @ left) * modes[:, 0]
        bends = values[0] < -BENDS * float((load / length).max())
        if bends and (falls(mode) or falls(-mode)):
            return True
        self.place(*start)
        return False


def _out_of_overlap(state: Contacts, idle: Flags) -> Contacts:
    """Return the contacts where grains that carry nothing are in balance, with their forces there.

    All these grains move together, the others stay.
    """
    cages = _Cages(state, idle)
    for _ in range(MOST_ROUNDS):
        if not cages.step():
            break
    T = np.zeros(len(state.contacts))
    T[cages.pressed] = cages.T
    moved = replace(state, x=cages.x, shear_force=T)
    return replace(moved, normal_force=moved.law.normal_force(moved.overlap))
