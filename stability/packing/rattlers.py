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

# A grain whose largest normal force is below this share of the mean force carries nothing, at the
# start and until it finds no room. Grains of held states have 1e-6 or 7e-3 and more.
LOADED_SHARE = 1e-4
# One that carries does so until this share: with one share for both it would come and go.
UNLOADED_SHARE = 1e-5
# A grain whose forces are below this share of the mean force is light: where it has no consistent
# regimes it leaves the system. Such a snap of one grain moves the sample by 3e-7 and has 1e-9 of
# its energy; whether an interval met it changed the first loss by a factor of two.
LIGHT_SHARE = 1e-2
# Motions of these grains are left out that take less than this share of the best one out of an
# overlap: with a smooth grain between two others, more than thirty times the overlap to the side.
WEDGED = 0.03
# Rounds in which the grains that carry nothing move out of overlap, one after the other.
MOST_ROUNDS = 30
# Shares of a step that are tried until the energy falls.
HALVES = tuple(0.5**k for k in range(10))


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
    energy = state.energy(free & state.closed)
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
    loaded = (overlap > 0) & (N - state.law.at_touch >= LOADED_SHARE * state.mean_force)
    idle[state.contacts[loaded].ravel()] = False
    free = np.asarray(idle[state.contacts].any(axis=1))
    joined = ~free & (overlap > 0)
    N = np.where(joined, N, moved.normal_force)
    T = np.where(joined, T, moved.shear_force)
    moved = replace(moved, normal_force=N, shear_force=T, closed=moved.closed | joined)
    return Freed(moved, idle, energy - moved.energy(joined))


def _out_of_overlap(state: Contacts, idle: Flags, free: Flags) -> tuple[Floats, Floats]:
    """Return centres (B, 2) where grains that carry nothing have least energy, and `T` (P,) there.

    Newton's steps of all these grains together, halved until the energy falls; all others stay.
    Pressed contacts stick while friction can hold them: a grain between two others stays where the
    line between its contacts lies in both friction cones, and slips out where it does not.
    """
    rows = np.flatnonzero(free)
    ends = state.contacts[rows]
    i, j = ends.T
    touching, T = state.law.touching, np.zeros(len(free))
    kn, kt = state.law.stiffnesses(np.maximum(state.overlap, SMALL_OVERLAP * touching))
    weight = np.sqrt(np.where(state.law.kn > 0, state.law.kn, 1.0))[rows]
    weight /= weight.max(initial=0.0)
    ratio, still = (kt / kn)[rows], np.finfo(float).eps * float(np.abs(state.x).max())
    sticks = np.ones(len(rows), dtype=bool)

    def deep(x: Floats) -> tuple[Floats, Floats]:
        d = replace(state, x=x).branches[rows]
        length = np.linalg.norm(d, axis=1)
        return touching[rows] - length, d / length[:, None]

    def slid(x: Floats, rolled: Floats) -> Floats:
        u = x - state.x
        t = np.column_stack([-n[:, 1], n[:, 0]])
        return np.asarray(np.sum((u[j] - u[i]) * t, axis=1) - rolled[i] - rolled[j])

    def energy(x: Floats, rolled: Floats) -> float:
        shear = np.where(stuck, ratio, 0.0) * slid(x, rolled) ** 2
        return float(np.sum(weight**2 * (np.maximum(deep(x)[0], 0.0) ** 2 + shear)))

    x, rolled = state.x, np.zeros(len(state.x))
    overlap, n = deep(x)
    for _ in range(MOST_ROUNDS):
        pressed, stuck = np.flatnonzero(overlap > 0), sticks & (overlap > 0)
        if not len(pressed):
            break
        grains = np.unique(ends[pressed])
        grains = grains[idle[grains]]
        shear = np.where(stuck, np.sqrt(ratio), 0.0)[pressed]
        matrix = _parting_and_slip(ends[pressed], n[pressed], grains, len(x))
        matrix *= weight[pressed, None] * np.stack([np.ones(len(pressed)), shear])[..., None]
        # Contacts that only touch, by rounding, are open.
        right = np.stack([overlap[pressed] + 4.0 * still, -shear * slid(x, rolled)[pressed]])
        right *= weight[pressed]
        moves = np.linalg.lstsq(matrix.reshape(right.size, -1), right.ravel(), rcond=WEDGED)[0]
        before, start, moves = energy(x, rolled), (x, rolled), moves.reshape(-1, 3)
        for step in HALVES:
            x, rolled = start[0].copy(), start[1].copy()
            x[grains] += step * moves[:, :2]
            rolled[grains] += step * moves[:, 2]
            if energy(x, rolled) < before:
                break
        else:
            x, rolled = start
        overlap, n = deep(x)
        stuck = sticks & (overlap > 0)
        every = np.zeros(len(free))
        every[rows] = np.maximum(overlap, 0.0)
        N = state.law.normal_force(every)
        carried = (N - state.law.at_touch)[rows] / np.where(stuck, overlap, 1.0)
        T[rows] = np.where(stuck, -ratio * slid(x, rolled) * carried, 0.0)
        most = replace(state, x=x, normal_force=N).strength
        slips = np.abs(T[rows]) > most[rows]
        T[rows[slips]] = 0.0
        sticks &= ~slips
        if x is start[0] and not slips.any():
            break
    return x, T


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
