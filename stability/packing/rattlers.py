"""Grains that carry nothing: they leave the system, move out of overlap, and join when loaded.

A grain without load is held by nothing: in the rates of the packing its motion would be that of
a nearly singular system, or of a spring to the ground. Here it has no contacts and goes with the
mean strain; at the end of an increment it moves as far as its gaps let it, and where they let it
no further it is loaded, with the forces of its overlaps.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from loops.arrays import Flags, Floats
from stability.packing.pairs import (
    Pairs,
    normal_energy,
    normal_forces,
    overlaps,
    rolling_energy,
    tangents,
    touching_distances,
)
from stability.packing.state import PackingState

# A grain whose largest normal force is below this share of the mean force carries nothing, at the
# start and until it finds no room. Grains of held states have 1e-6 or 7e-3 and more.
LOADED_SHARE = 1e-4
# One that carries does so until this share: with one share for both it would come and go.
UNLOADED_SHARE = 1e-5
# A grain whose forces are below this share of the mean force is light: where it has no consistent
# regimes it leaves the system. Such a snap of one grain moves the sample by 3e-7 and has 1e-9 of
# its energy; whether an interval met it changed the first loss by a factor of two.
LIGHT_SHARE = 1e-2
# Normals of two contacts that are opposite to this share hold a grain between them: it does not
# slip out sideways, where it would move by more than ten times its overlap.
WEDGED = 0.1
# Rounds in which the grains that carry nothing move out of overlap, one after the other.
MOST_ROUNDS = 30


class Freed(NamedTuple):
    """The state without forces on grains that carry nothing, these (B,), and the energy let go."""

    state: PackingState
    rattlers: Flags
    released: float


def carrying_nothing(state: PackingState, share: float, at_touch: Floats | float = 0.0) -> Flags:
    """Return grains (B,) without load: below a share of the mean force, or under two contacts.

    Contacts of such grains do not count for their neighbours, and so on. The load of a contact is
    its force above that `at_touch`, and a contact that can pull holds a grain as two do.
    """
    i, j = state.contacts[state.closed].T
    N, bodies = (state.normal_force - at_touch)[state.closed], len(state.x)
    holds = np.where(np.broadcast_to(at_touch, len(state.closed))[state.closed] < 0, 2, 1)
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


def free_rattlers(state: PackingState, pairs: Pairs, before: Flags | None = None) -> Freed:
    """Take the forces of grains that carry nothing, and move them out of overlap.

    Grains that did so `before` do until they find no room: then they keep the normal forces of
    their overlaps.
    """
    if before is None:
        idle = carrying_nothing(state, LOADED_SHARE, pairs.at_touch)
    else:
        was = before[pairs.grains].any(axis=1)
        others = replace(state, closed=state.closed & ~was)
        idle = carrying_nothing(others, UNLOADED_SHARE, pairs.at_touch)
    free: Flags = np.asarray(idle[pairs.grains].any(axis=1))
    energy = _energy(state, pairs, free & state.closed)
    nothing = {
        name: np.where(free, 0.0, getattr(state, name))
        for name in ("normal_force", "shear_force", "rolling_moment")
    }
    nothing["closed"] = state.closed & ~free
    moved = replace(state, x=_out_of_overlap(state, pairs, idle, free), **nothing)
    overlap = np.where(free, overlaps(moved, pairs), 0.0)
    N = normal_forces(pairs, overlap)
    loaded = (overlap > 0) & (N - pairs.at_touch >= LOADED_SHARE * state.mean_force)
    idle[pairs.grains[loaded].ravel()] = False
    free = np.asarray(idle[pairs.grains].any(axis=1))
    joined = ~free & (overlap > 0)
    N = np.where(joined, N, moved.normal_force)
    moved = replace(moved, normal_force=N, closed=moved.closed | joined)
    return Freed(moved, idle, energy - _energy(moved, pairs, joined))


def _out_of_overlap(state: PackingState, pairs: Pairs, idle: Flags, free: Flags) -> Floats:
    """Return centres (B, 2) where springs of grains that carry nothing have least energy.

    Newton's steps of all these grains together, halved until the energy falls; all others stay.
    """
    rows = np.flatnonzero(free)
    i, j = pairs.grains[rows].T
    shift, wall = pairs.images[rows] @ state.cell.T, j - state.count
    touching = touching_distances(state, pairs)[rows]
    weight = np.sqrt(np.where(pairs.kn > 0, pairs.kn, 1.0))[rows]
    weight /= weight.max(initial=0.0)
    still = np.finfo(float).eps * float(np.abs(state.x).max())

    def deep(x: Floats) -> tuple[Floats, Floats]:
        d = x[j] + shift - x[i]
        at_wall = wall >= 0
        if at_wall.any():
            normal = state.walls[wall[at_wall]]
            d[at_wall] = np.sum(d[at_wall] * normal, axis=1, keepdims=True) * normal
        length = np.linalg.norm(d, axis=1)
        return touching - length, d / length[:, None]

    x = state.x.copy()
    overlap, n = deep(x)
    for _ in range(MOST_ROUNDS):
        pressed = np.flatnonzero(overlap > 0)
        if not len(pressed):
            break
        grains = np.unique([i[pressed], j[pressed]])
        grains = grains[idle[grains]]
        place = np.full(len(x), -1)
        place[grains] = np.arange(len(grains))
        apart = np.zeros((len(pressed), len(grains), 2))
        for grain, way in ((i, -n), (j, n)):
            at = np.flatnonzero(idle[grain[pressed]])
            apart[at, place[grain[pressed[at]]]] += way[pressed[at]]
        w = weight[pressed]
        matrix = w[:, None] * apart.reshape(len(pressed), -1)
        # Contacts that only touch, by rounding, are open.
        right = w * (overlap[pressed] + 4.0 * still)
        moves = np.linalg.lstsq(matrix, right, rcond=WEDGED)[0].reshape(-1, 2)
        energy = float(np.sum((weight * np.maximum(overlap, 0.0)) ** 2))
        start, step = x, 1.0
        while step > 1e-3:
            x = start.copy()
            x[grains] += step * moves
            overlap, n = deep(x)
            if float(np.sum((weight * np.maximum(overlap, 0.0)) ** 2)) < energy:
                break
            step *= 0.5
        else:
            return start
    return x


def _energy(state: PackingState, pairs: Pairs, rows: Flags) -> float:
    """Return the energy of the springs of some pairs at their overlaps."""
    overlap, T = np.where(rows, overlaps(state, pairs), 0.0), state.shear_force
    kt = tangents(pairs, overlap)[1]
    shear = np.divide(T**2, 2.0 * kt, out=np.zeros(len(pairs)), where=rows & (kt > 0))
    rolling = rolling_energy(pairs, np.where(rows, state.rolling_moment, 0.0))
    return float(np.sum(normal_energy(pairs, overlap)[rows] + shear[rows])) + rolling
