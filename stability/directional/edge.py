"""Contacts whose regime depends on the direction of loading, and solutions in each direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from loops import ContactLaw, ContactState, GrainGraph, Regime, contact_state
from loops.arrays import Flags, Floats, Integers, Regimes
from loops.laws.frictional import edge_of, with_sides
from loops.laws.protocol import require_law

# Arcs this short separate angles that are the same up to rounding.
NO_ARC = 1e-13


@dataclass(frozen=True, eq=False)
class YieldingContacts:
    """Contacts at the edge of their law, batch axes `...` first.

    `regime` has those at the edge elastic: the branch on which nothing slides and touching contacts
    stick. `at_yield`, `touching` and `apex` are as in `loops.laws.frictional.Edge`; `slides` marks
    those that may slide, `side` is the sign of `T` at yield, else 0. `stick` and `slide`
    (..., C, 2, 2) are the law's stiffnesses in either regime, `unit` their size.
    """

    state: ContactState
    regime: Regimes
    at_yield: Flags
    touching: Flags
    apex: Flags
    slides: Flags
    side: Floats
    stick: Floats
    slide: Floats
    mu: Floats
    unit: float

    @property
    def anywhere(self) -> Integers:
        """Contacts at the edge in some state of the batch."""
        edge = self.at_yield | self.touching
        return np.flatnonzero(edge.reshape(-1, edge.shape[-1]).any(axis=0))

    def rows(self, nu: Floats, sigma: Floats, which: Integers) -> tuple[Floats, ...]:
        """`-un'`, `N'`, `T'` if stuck and the strength's rate per direction, (..., E, m) each.

        From `un' = -nu . e` and `ut' = -sigma . e`; the first in the unit of the others.
        """
        stick, slide = self.stick[..., which, :, :], self.slide[..., which, :, :]
        side = np.where(self.side < 0.0, -1.0, 1.0)[..., which, None]
        normal = stick[..., 0, 0, None] * nu + stick[..., 0, 1, None] * sigma
        shear = stick[..., 1, 0, None] * nu + stick[..., 1, 1, None] * sigma
        slid = slide[..., 1, 0, None] * nu + slide[..., 1, 1, None] * sigma
        strength = np.where(self.slides[..., which, None], side * slid, 0.0)
        return self.unit * nu, normal, shear, strength


def edge_contacts(
    graph: GrainGraph, law: ContactLaw, regime: ArrayLike | None = None
) -> YieldingContacts:
    """Find the contacts at the edge of their law.

    A closed contact is at yield if it carries its strength or is flagged sliding; it is touching
    without force and without gap, unless flagged open. Frictionless contacts slide both ways and
    are left out.
    """
    require_law(law)
    state = contact_state(graph)
    read = law.regime(state) if regime is None else np.asarray(regime, dtype=np.int8)
    stick = law.local_stiffness(state, np.full(read.shape, Regime.ELASTIC, dtype=np.int8))
    shape = np.broadcast_shapes(stick.shape[:-2], state.normal_force.shape, read.shape)
    read = np.broadcast_to(read, shape)
    mu = np.broadcast_to(np.asarray(law.mu, dtype=float), shape)
    N, T = (np.broadcast_to(a, shape) for a in (state.normal_force, state.shear_force))
    closed, cone = read != Regime.OPEN, (mu > 0.0) & np.isfinite(mu)
    edge = edge_of(law, state, closed)
    yields = edge.at_yield & (law.strength(state) > 0.0)
    at_yield = yields | (closed & cone & (T != 0.0) & (read == Regime.SLIDING))
    touching = closed & edge.touching & (N <= 0.0) & (T == 0.0)
    apex = touching & edge.apex
    base = np.where(at_yield | touching, Regime.ELASTIC, read).astype(np.int8)
    side = np.where(at_yield, np.sign(T), 0.0)
    as_sliding = np.full(shape, Regime.SLIDING, dtype=np.int8)
    slide = law.local_stiffness(with_sides(state, np.where(side < 0.0, -1.0, 1.0)), as_sliding)
    slides = np.isfinite(mu) & (at_yield | apex | (touching & (mu == 0.0)))
    unit = float(np.abs(stick[..., 0, 0]).mean()) or 1.0
    wide = (*shape, 2, 2)
    stick, slide = np.broadcast_to(stick, wide), np.broadcast_to(slide, wide)
    return YieldingContacts(
        state, base, at_yield, touching, apex, slides, side, stick, slide, mu, unit
    )


@dataclass(frozen=True, eq=False)
class Solutions:
    """Solutions in each of D directions, batch axes `...` first.

    `count` (..., D) is 0 for none, 1, or 2 for several; `work` and `cosine` (..., D, 2) are the
    smallest and largest W2 of the solutions per unit strain rate and the same normalised, NaN where
    there is none; `regime` (..., D, C) that of the smallest, -1 where there is none.
    """

    count: Integers
    work: Floats
    cosine: Floats
    regime: Regimes


def one_solution(directions: Floats, stress: Floats, regime: Regimes) -> Solutions:
    """One solution in each direction, from its stress rate (..., D, m)."""
    work, cosine = works(directions, stress)
    count = np.ones(work.shape, dtype=np.int64)
    return Solutions(count, np.stack([work] * 2, axis=-1), np.stack([cosine] * 2, axis=-1), regime)


def works(directions: Floats, stress: Floats) -> tuple[Floats, Floats]:
    """W2 and its normalised form, 0 where there is no stress rate, along unit directions."""
    work = np.einsum("...i,...i->...", directions, stress)
    size = np.linalg.norm(stress, axis=-1)
    cosine = np.divide(work, size, out=np.zeros_like(work), where=size != 0.0)
    return work, np.clip(cosine, -1.0, 1.0)


def unit_directions(directions: Floats) -> Floats:
    """Directions divided by their length, without overflow."""
    size = np.abs(directions).max(axis=-1, keepdims=True)
    scaled = directions / size
    return np.asarray(scaled / np.linalg.norm(scaled, axis=-1, keepdims=True))


# ---- directions of the plane as angles, tan(theta) = e2/e1, and the arcs between them


def plane_directions(angle: Floats) -> Floats:
    """Unit directions (..., 2) at angles (...)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def line_angles(lines: Floats) -> Floats:
    """Both angles in [0, 2 pi) at which each row of (..., L, 2) vanishes: (..., 2 L), ascending."""
    angle = np.arctan2(-lines[..., 0], lines[..., 1])
    both = np.concatenate([angle, angle + np.pi], axis=-1)
    return np.sort(np.mod(both, 2.0 * np.pi), axis=-1)


def middles(angle: Floats) -> Floats:
    """Middle of the arc from each of the ascending angles (..., A) to the next, around."""
    middle = 0.5 * (angle + np.roll(angle, -1, axis=-1))
    middle[..., -1] += np.pi
    return np.asarray(middle)


def widths(angle: Floats) -> Floats:
    """Length of the arc from each of the ascending angles (..., A) to the next; 2 pi in all."""
    width = np.roll(angle, -1, axis=-1) - angle
    width[..., -1] += 2.0 * np.pi
    return np.asarray(width)


def edges_of(angle: Floats, inside: Flags) -> Floats:
    """Angles (..., B) at which the arcs change from inside to outside or back; NaN behind the last.

    `angle` (..., A) ascends in [0, 2 pi), `inside` belongs to the arc from each angle to the next.
    """
    count = angle.shape[-1]
    # An arc without length counts as the last one before it that has a length.
    order = np.where(widths(angle) > NO_ARC, np.arange(count), -1)
    twice = np.concatenate([order, np.where(order >= 0, order + count, -1)], axis=-1)
    before = np.maximum.accumulate(twice, axis=-1)[..., count - 1 :]
    known = np.take_along_axis(inside, before % count, axis=-1)
    changes = known[..., 1:] != known[..., :-1]
    edges = np.sort(np.where(changes, angle, np.nan), axis=-1)
    return edges[..., : int(changes.sum(axis=-1).max(initial=0))]
