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
from loops.contacts import Contacts, PackingState
from loops.laws.of_pairs import SMALL_OVERLAP

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
# Rounds in which the grains that carry nothing move out of overlap.
MOST_ROUNDS = 30
# Dampings of Newton's step (Levenberg's), over the stiffness, tried until the energy falls.
DAMPINGS = (1e-6, 1e-4, 1e-2, 1.0, 1e2)
# Falls of the energy below this share are rounding.
ENERGY_RTOL = 1e-14
# A grain whose resultant is below this share of its largest force is in balance. One that is not
# still moves out of overlap, as a chain of two discs does, which no friction holds.
IN_BALANCE = 1e-3


class Freed(NamedTuple):
    """The state without forces on grains that carry nothing, these (B,), and the energy let go."""

    state: Contacts
    rattlers: Flags
    released: float


def carrying_nothing(state: Contacts, share: float) -> Flags:
    """Return grains (B,) without load: below a share of the mean force, or under two contacts.

    Contacts of such grains do not count for their neighbours, and so on. The load of a contact is
    its force above that `at_touch`, and a contact that can pull holds a grain as two do.
    """
    i, j = state.contacts[state.closed].T
    at_touch, bodies = state.law.at_touch, len(state.x)
    N = (state.normal_force - at_touch)[state.closed]
    holds = np.where(at_touch[state.closed] < 0, 2, 1)
    least = share * state.mean_force
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


def free_rattlers(state: Contacts, before: Flags | None = None) -> Freed:
    """Take the forces of grains that carry nothing, and move them out of overlap.

    Grains that did so `before` do until they find no room: then they keep the normal forces of
    their overlaps.
    """
    if before is None:
        idle = carrying_nothing(state, LOADED_SHARE)
    else:
        was = before[state.contacts].any(axis=1)
        others = replace(state, closed=state.closed & ~was)
        idle = carrying_nothing(others, UNLOADED_SHARE)
    free: Flags = np.asarray(idle[state.contacts].any(axis=1))
    freed = free & state.closed
    x, T = _out_of_overlap(state, idle, free)
    moved = replace(
        state,
        x=x,
        normal_force=np.where(free, 0.0, state.normal_force),
        shear_force=np.where(free, 0.0, state.shear_force),
        rolling_moment=np.where(free, 0.0, state.rolling_moment),
        closed=state.closed & ~free,
    )
    overlap = np.where(free, moved.overlap, 0.0)
    N = state.law.normal_force(overlap)
    pressed = replace(moved, normal_force=N, shear_force=T)
    idle = idle & ~_held(pressed, idle, LOADED_SHARE * state.mean_force)
    free = np.asarray(idle[state.contacts].any(axis=1))
    joined = ~free & (overlap > 0)
    N = np.where(joined, N, moved.normal_force)
    T = np.where(joined, T, moved.shear_force)
    moved = replace(moved, normal_force=N, shear_force=T, closed=moved.closed | joined)
    return Freed(moved, idle, state.energy(freed) - moved.energy(joined))


def _held(state: Contacts, idle: Flags, least: float) -> Flags:
    """Return the idle grains (B,) with a load of `least`, in balance with the others that have."""
    rows = np.flatnonzero(idle[state.contacts].any(axis=1) & (state.normal_force != 0))
    ends, load = state.contacts[rows], (state.normal_force - state.law.at_touch)[rows]
    held = idle
    while True:
        carries = ~(idle & ~held)[ends].any(axis=1)
        of, largest = rows[carries], np.zeros(len(idle))
        np.maximum.at(largest, ends[carries], load[carries, None])
        left = np.abs(_at(state, of).resultants).max(axis=1)
        found = held & (largest >= least) & (left <= IN_BALANCE * largest)
        if (found == held).all():
            return held
        held = found


def _at(state: Contacts, rows: Integers) -> PackingState:
    """Return the geometry and forces of some pairs alone, without rolling moments."""
    forces = {name: getattr(state, name)[rows] for name in ("normal_force", "shear_force")}
    moment = np.zeros(len(rows))
    ends, images = state.contacts[rows], state.images[rows]
    return replace(state, contacts=ends, images=images, rolling_moment=moment, **forces)


def share_until_caught(start: Contacts, end: Contacts, caught: Flags, idle: Flags) -> float:
    """Return the share of the way between two states on which grains stay free of load.

    They are `caught` at the end; `idle` are all grains that carried nothing. At the share the load
    has reached `CAUGHT_SHARE` at most. One where it does not exceed that at the end.
    """
    others = (idle & ~caught)[end.contacts].any(axis=1)
    free: Flags = np.asarray(caught[end.contacts].any(axis=1) & ~others)
    low, share, high = 0.0, 1.0, 1.0
    for _ in range(CATCH_HALVINGS):
        x = start.x + share * (end.x - start.x)
        here = replace(end, x=x, cell=start.cell + share * (end.cell - start.cell))
        x, T = _out_of_overlap(here, caught, free)
        here = replace(here, x=x)
        N = here.law.normal_force(np.where(free, here.overlap, 0.0))
        here = replace(here, normal_force=N, shear_force=T)
        held = _held(here, caught, LOADED_SHARE * end.mean_force)
        rows = free & held[end.contacts].any(axis=1)
        load = float((N - here.law.at_touch)[rows].max(initial=0.0))
        if 0.0 < load <= CAUGHT_SHARE * end.mean_force or (share == 1.0 and load == 0.0):
            break
        low, high = (low, share) if load > 0.0 else (share, high)
        share = 0.5 * (low + high)
    return share


class _Cages:
    """Springs of the pairs (R,) of grains that carry nothing, at centres and turns from the start.

    Pressed contacts stick while friction can hold them: a grain between two others stays where the
    line between its contacts lies in both friction cones, and slips out where it does not. `T` (P,)
    are the shear forces of those that stick.
    """

    def __init__(self, state: Contacts, idle: Flags, free: Flags) -> None:
        self.state, self.idle, self.rows = state, idle, np.flatnonzero(free)
        self.ends, self.listed = state.contacts[self.rows], _at(state, self.rows)
        touching, self.T = state.law.touching, np.zeros(len(free))
        kn, kt = state.law.stiffnesses(np.maximum(state.overlap, SMALL_OVERLAP * touching))
        self.ratio, self.touching = (kt / kn)[self.rows], touching[self.rows]
        self.sticks = np.ones(len(self.rows), dtype=bool)
        self.place(state.x, np.zeros(len(state.x)))
        self.weigh()

    def place(self, x: Floats, turned: Floats) -> None:
        """Set the centres (B, 2), and the turns times the radii (B,)."""
        self.x, self.turned = x, turned
        d = replace(self.listed, x=x).branches
        length = np.linalg.norm(d, axis=1)
        self.overlap, self.n = self.touching - length, d / length[:, None]

    def weigh(self) -> None:
        """Weigh pairs by the secant stiffness, `N` over the overlap: least energy is balance."""
        law = self.state.law
        if law.linear:
            secant = np.where(law.kn > 0, law.kn, 1.0)[self.rows]
        else:
            overlap = SMALL_OVERLAP * law.touching
            overlap[self.rows[self.overlap > 0]] = self.overlap[self.overlap > 0]
            secant = ((law.normal_force(overlap) - law.at_touch) / overlap)[self.rows]
        weight = np.sqrt(secant)
        self.weight = weight / weight.max(initial=0.0)

    @property
    def stuck(self) -> Flags:
        """(R,) pressed contacts that stick."""
        return np.asarray(self.sticks & (self.overlap > 0))

    def slid(self, n: Floats) -> Floats:
        """Return the shear (R,) since the start across normals (R, 2)."""
        (i, j), u = self.ends.T, self.x - self.state.x
        across = n[:, 0] * (u[j] - u[i])[:, 1] - n[:, 1] * (u[j] - u[i])[:, 0]
        return np.asarray(across - self.turned[i] - self.turned[j])

    def energy(self, n: Floats, stuck: Flags) -> float:
        """Return the energy with shear across normals of contacts that stick."""
        shear = np.where(stuck, self.ratio, 0.0) * self.slid(n) ** 2
        return float(np.sum(self.weight**2 * (np.maximum(self.overlap, 0.0) ** 2 + shear)))

    def step(self, rounding: float) -> bool:
        """Take a step of Newton's, damped until the energy falls; whether it did."""
        pressed, stuck, n = np.flatnonzero(self.overlap > 0), self.stuck, self.n
        grains = np.unique(self.ends[pressed])
        grains = grains[self.idle[grains]]
        shear = np.where(stuck, np.sqrt(self.ratio), 0.0)[pressed]
        matrix = _parting_and_slip(self.ends[pressed], n[pressed], grains, len(self.x))
        weight = self.weight[pressed]
        matrix *= (weight * np.stack([np.ones(len(pressed)), shear]))[..., None]
        matrix = matrix.reshape(2 * len(pressed), -1)
        # Contacts that only touch, by rounding, are open.
        parting = self.overlap[pressed] + 4.0 * rounding
        right = weight * np.stack([parting, -shear * self.slid(n)[pressed]])
        stiffness, force = matrix.T @ matrix, matrix.T @ right.ravel()
        before, start = self.energy(n, stuck), (self.x, self.turned)
        for damping in DAMPINGS:
            moves = np.linalg.solve(stiffness + damping * np.eye(len(force)), force).reshape(-1, 3)
            x, turned = start[0].copy(), start[1].copy()
            x[grains] += moves[:, :2]
            turned[grains] += moves[:, 2]
            self.place(x, turned)
            if self.energy(n, stuck) < (1.0 - ENERGY_RTOL) * before:
                return True
        self.place(*start)
        return False

    def settle(self, rounding: float) -> bool:
        """Take a step, and steps until weights of springs that vary settle; whether it moved."""
        moved = self.step(rounding)
        if not self.state.law.linear:
            for _ in range(MOST_ROUNDS):
                self.weigh()
                if not ((self.overlap > 0).any() and self.step(rounding)):
                    break
        return moved

    def slip(self) -> bool:
        """Find the shear forces, and let contacts beyond their strength slip; whether any do."""
        rows, stuck, law = self.rows, self.stuck, self.state.law
        every = np.zeros(len(self.T))
        every[rows] = np.maximum(self.overlap, 0.0)
        N = law.normal_force(every)
        carried = (N - law.at_touch)[rows] / np.where(stuck, self.overlap, 1.0)
        self.T[rows] = np.where(stuck, -self.ratio * self.slid(self.n) * carried, 0.0)
        most = law.strength(every, N)
        slips = np.abs(self.T[rows]) > most[rows]
        self.T[rows[slips]] = 0.0
        self.sticks &= ~slips
        return bool(slips.any())


def _out_of_overlap(state: Contacts, idle: Flags, free: Flags) -> tuple[Floats, Floats]:
    """Return centres (B, 2) where grains that carry nothing have least energy, and `T` (P,) there.

    All these grains move together, the others stay.
    """
    cages = _Cages(state, idle, free)
    rounding = np.finfo(float).eps * float(np.abs(state.x).max())
    for _ in range(MOST_ROUNDS):
        if not (cages.overlap > 0).any():
            break
        moved = cages.settle(rounding)
        if not cages.slip() and not moved:
            break
    return cages.x, cages.T


def _parting_and_slip(ends: Integers, n: Floats, grains: Integers, bodies: int) -> Floats:
    """Return (2, P, 3 G) how grains part contacts and shear them.

    Unknowns of a grain: its displacement, and its spin times its radius.
    """
    place = np.full(bodies, -1)
    place[grains] = np.arange(len(grains))
    t = np.column_stack([-n[:, 1], n[:, 0]])
    out = np.zeros((2, len(ends), len(grains), 3))
    for grain, sense in zip(ends.T, (-1.0, 1.0), strict=True):
        c = np.flatnonzero(place[grain] >= 0)
        out[0, c, place[grain[c]], :2] += sense * n[c]
        out[1, c, place[grain[c]], :2] += sense * t[c]
        out[1, c, place[grain[c]], 2] -= 1.0
    return out.reshape(2, len(ends), -1)
