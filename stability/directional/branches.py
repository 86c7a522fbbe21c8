"""Branches of the rate problem of a loop: contact regimes, motion and W2 in every direction.

Affine closure: branch rates follow `H'` whatever the forces, and so do spins that are blocked or
turn with the loop. The regime of a contact depends on no other contact, its force rate is one
continuous function of direction: there is one solution, and W2 is continuous, piecewise quadratic.

Closures that relax: the regimes of all contacts depend on each other. For each combination of
regimes the motion is linear in `H'`; it solves the rate problem in the directions in which every
contact agrees with its rates. These are convex cones, one for each combination, which may overlap
(several solutions) or leave gaps (none).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops import (
    ContactLaw,
    ContactState,
    GrainGraph,
    InputError,
    Regime,
    affine_tangent,
    contact_state,
    macroscopic_tangent,
)
from loops.arrays import ROUNDING, Flags, Floats, Integers, Regimes
from loops.assembly import contact_kinematics, motions
from loops.closures import Closure, Spins
from loops.closures.null_space import AMBIGUITY_LIMIT, RESIDUAL_LIMIT
from loops.closures.spins import affine_spin
from loops.closures.system import contact_springs, drive, form_of, relax, spring_sizes
from loops.geometry import checked_volume, reference_volume
from loops.graph import require_one_state
from loops.laws.frictional import edge_of, with_sides
from loops.validation import checked_regimes
from stability.regimes import (
    SOLUTION_RTOL,
    EdgeRates,
    agreement,
    combination_count,
    combinations_of,
    edge_options,
    sides,
)
from stability.second_order_work import plane_cone
from stability.spectra import restrict, subspace_basis

# Rounding of rates over the largest one of all contacts.
ROUNDED = 1e-10
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
    state = contact_state(graph)
    count = graph.contact_count
    read = law.regime(state) if regime is None else checked_regimes(regime, count)
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
class BranchSolutions:
    """BranchSolutions in each of D directions, batch axes `...` first.

    `count` (..., D) is 0 for none, 1, or 2 for several; `work` and `cosine` (..., D, 2) are the
    smallest and largest W2 of the solutions per unit strain rate and the same normalised, NaN where
    there is none; `regime` (..., D, C) that of the smallest, -1 where there is none; `neutral`
    (..., D, C) contacts of which another regime agrees with the same rates.
    """

    count: Integers
    work: Floats
    cosine: Floats
    regime: Regimes
    neutral: Flags


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


class _Picked(NamedTuple):
    """Regimes of the contacts at the edge, (..., D, E), and the side on which they slide."""

    opens: Flags
    slides: Flags
    side: Floats
    neutral: Flags


class _Sticking(NamedTuple):
    """Rates (..., D, E) as if every contact at the edge stuck."""

    closing: Floats
    normal: Floats
    shear: Floats
    strength: Floats


@dataclass(frozen=True, eq=False)
class AffineBranches:
    """Operators of a graph under the affine closure, and the contacts at the edge.

    `K` (..., m, m) has all contacts at the edge elastic; `which` (E,) are those at the edge
    somewhere in the batch; `nu`, `tau` (..., E, m) are `n (x) d0` and `t (x) d0` in the subspace,
    the stress rate per `N'` and `T'` times `volume`; `rows` as `YieldingContacts.rows`.
    """

    K: Floats
    edge: YieldingContacts
    which: Integers
    nu: Floats
    tau: Floats
    rows: tuple[Floats, ...]
    volume: Floats

    @property
    def singular(self) -> int:
        """No equations are solved: none is singular."""
        return 0

    def solve(self, directions: Floats) -> BranchSolutions:
        """The one solution in each direction, (..., D, m)."""
        sticking = self._sticking(directions)
        picked = self._pick(sticking)
        elastic = np.einsum("...ij,...dj->...di", self.K, directions)
        stress = elastic + self._change(picked, sticking)
        base = self.edge.regime
        regime = np.broadcast_to(base[..., None, :], (*picked.slides.shape[:-1], base.shape[-1]))
        regime, neutral = regime.copy(), np.zeros(regime.shape, dtype=bool)
        chosen = np.where(picked.slides, Regime.SLIDING, regime[..., self.which])
        regime[..., self.which] = np.where(picked.opens, Regime.OPEN, chosen)
        neutral[..., self.which] = picked.neutral
        work, cosine = (np.stack([one] * 2, axis=-1) for one in works(directions, stress))
        return BranchSolutions(np.ones(work.shape[:-1], np.int64), work, cosine, regime, neutral)

    def critical_angles(self) -> Floats:
        """(..., A) ascending angles in [0, 2 pi) between which neither regimes nor sign(W2) change.

        In the plane only. The zeros of W2 are those of the operator of each sector.
        """
        edge, which = self.edge, self.which
        closing, _, shear, strength = self.rows
        yields, touches = edge.at_yield[..., which, None], edge.touching[..., which, None]
        apex = touches & edge.slides[..., which, None] & ~yields
        # Rows (..., E, m) whose zeros bound the regimes; zero rows where nothing can change.
        sides = np.where(yields, edge.side[..., which, None] * shear - strength, 0.0)
        bounds = [sides]
        if touches.any():
            bounds = [
                np.where(touches, closing, 0.0),
                np.where(apex, shear - strength, sides),
                np.where(apex, shear + strength, 0.0),
            ]
        ends = line_angles(np.concatenate(bounds, axis=-2))
        if ends.shape[-1] == 0:
            ends = np.zeros((*self.K.shape[:-2], 1))
        # (..., A, 2, 2) operators of the regimes that hold between two ends.
        middle = middles(ends)
        picked = self._pick(self._sticking(plane_directions(middle)))
        columns = [
            self._change(picked, self._sticking(np.broadcast_to(unit, (*middle.shape, 2))))
            for unit in np.eye(2)
        ]
        operators = self.K[..., None, :, :] + np.stack(columns, axis=-1)
        zeros = plane_cone(operators, rtol=0.0).edges
        zeros = np.where(np.isnan(zeros), ends[..., None], zeros)
        zeros = zeros.reshape(*zeros.shape[:-2], -1)
        every = np.concatenate([ends, zeros, zeros + np.pi], axis=-1)
        return np.sort(np.mod(every, 2.0 * np.pi), axis=-1)

    def _sticking(self, directions: Floats) -> _Sticking:
        return _Sticking(*(np.einsum("...em,...dm->...de", row, directions) for row in self.rows))

    def _pick(self, rates: _Sticking) -> _Picked:
        """Regime of every contact, given its rates as if it stuck."""
        edge, which = self.edge, self.which
        touching, slides = edge.touching[..., None, which], edge.slides[..., None, which]
        yields, side = edge.at_yield[..., None, which], edge.side[..., None, which]
        side = np.where(yields, side, np.sign(rates.shear))
        tol = ROUNDING * np.linalg.norm(self.rows, axis=-1).sum(axis=0)[..., None, :]
        beyond = side * rates.shear - rates.strength
        opens = touching & ~(rates.closing > tol)
        slides = slides & ~opens & (side != 0.0)
        neutral = (touching & (np.abs(rates.closing) <= tol)) | (slides & (np.abs(beyond) <= tol))
        return _Picked(opens, slides & (beyond > tol), side, neutral)

    def _change(self, picked: _Picked, rates: _Sticking) -> Floats:
        """(..., D, m) stress rate beyond that of sticking contacts; linear in the rates."""
        slid = np.where(picked.slides, picked.side * rates.strength - rates.shear, 0.0)
        normal = np.where(picked.opens, -rates.normal, 0.0)
        change = np.einsum("...de,...em->...dm", normal, self.nu)
        shear = np.where(picked.opens, -rates.shear, slid)
        change += np.einsum("...de,...em->...dm", shear, self.tau)
        return np.asarray(change / self.volume[..., None, None])


def affine_branches(
    graph: GrainGraph,
    law: ContactLaw,
    edge: YieldingContacts,
    spins: Spins,
    subspace: str,
    volume: ArrayLike | None,
) -> AffineBranches:
    """Gather the branches of the affine closure with spins blocked or affine."""
    v0 = reference_volume(graph) if volume is None else checked_volume(volume, graph)
    A = affine_tangent(graph, law, spins=spins, regime=edge.regime, volume=v0).matrix
    batch = np.broadcast_shapes(A.shape[:-2], edge.regime.shape[:-1])
    basis, which = subspace_basis(subspace), edge.anywhere
    d0, state = graph.reference_branches[..., which, :], edge.state
    nu = _components(state.n[..., which, :], d0, basis)
    tau = _components(state.t[..., which, :], d0, basis)
    g, b_i, b_j = (np.asarray(a)[..., which, None] for a in law.shear_kinematics(state))
    sigma = g * tau
    if spins == "affine":
        sigma = sigma + (b_i + b_j) * (affine_spin(graph).row @ basis.T)[..., None, :]

    def spread(rows: Floats) -> Floats:
        return np.broadcast_to(rows, (*batch, *rows.shape[-2:]))

    K = np.broadcast_to(restrict(A, subspace), (*batch, len(basis), len(basis)))
    rows = tuple(spread(row) for row in edge.rows(nu, sigma, which))
    return AffineBranches(K, edge, which, spread(nu), spread(tau), rows, np.broadcast_to(v0, batch))


def _components(v: Floats, d0: Floats, basis: Floats) -> Floats:
    """(..., E, m) `v (x) d0` in the subspace."""
    outer = v[..., :, None] * d0[..., None, :]
    return np.asarray(outer.reshape(*outer.shape[:-2], 4) @ basis.T)


# All combinations of regimes are tried: eight contacts at yield.
COMBINATIONS = 256


@dataclass(frozen=True, eq=False)
class RelaxedBranches:
    """Operators of one graph for all R combinations of regimes of its contacts at the edge.

    `K` (R, m, m) are the operators, NaN where the equations have no single answer; `regime` (R, C)
    the regimes of all contacts. Of the E contacts at the edge, in the motion of each combination:
    `closing`, `shear` and `strength` (R, E, m) as in `YieldingContacts.rows`; `chosen` (R, E) the
    regime, as `stability.regimes` has it, `options` (E, 4) those that each may take. `error` (R,)
    is what rates may err by along unit directions, from those of all contacts.
    """

    K: Floats
    regime: Regimes
    closing: Floats
    shear: Floats
    strength: Floats
    options: Flags
    chosen: Regimes
    error: Floats

    @property
    def trusted(self) -> Flags:
        """(R,) combinations whose equations have a single answer."""
        return np.asarray(~np.isnan(self.K).any(axis=(-2, -1)))

    @property
    def singular(self) -> int:
        """Combinations whose equations have no single answer."""
        return int((~self.trusted).sum())

    def solve(self, directions: Floats) -> BranchSolutions:
        """All solutions in each direction, (D, m)."""
        stress, closing, shear, strength = (
            np.einsum("rem,dm->dre", rows, directions)
            for rows in (self.K, self.closing, self.shear, self.strength)
        )
        # (D, R) combinations in which every contact agrees with its rates.
        edge = EdgeRates(-closing, shear, strength, self.error[:, None])
        agrees = agreement(self.options, self.chosen, edge).all(axis=-1) & self.trusted
        work, cosine = works(directions[:, None, :], np.where(agrees[..., None], stress, 0.0))
        least = np.argmin(np.where(agrees, work, np.inf), axis=-1)
        most = np.argmax(np.where(agrees, work, -np.inf), axis=-1)
        # Solutions with other rates than the first; they may differ in neutral contacts alone.
        rates = np.concatenate([stress, closing, shear], axis=-1)
        first = np.take_along_axis(rates, least[:, None, None], axis=1)
        gap = np.linalg.norm(rates - first, axis=-1)
        norm = np.maximum(np.linalg.norm(rates, axis=-1), np.linalg.norm(first, axis=-1))
        other = gap > SOLUTION_RTOL * norm + self.error + self.error[least][:, None]
        several = (agrees & other).any(axis=-1)
        count = np.where(several, 2, np.minimum(agrees.sum(axis=-1), 1))
        # Of combinations with the same rates the first, in which most contacts stick.
        alike = agrees & ~other
        named = self.regime[np.argmax(alike, axis=-1)]
        neutral = (alike[..., None] & (self.regime != named[:, None])).any(axis=1)
        found = (count > 0)[:, None]
        both = np.stack([least, most], axis=-1)
        return BranchSolutions(
            count=count,
            work=np.where(found, np.take_along_axis(work, both, axis=-1), np.nan),
            cosine=np.where(found, np.take_along_axis(cosine, both, axis=-1), np.nan),
            regime=np.where(found, named, np.int8(-1)),
            neutral=neutral,
        )

    def critical_angles(self) -> Floats:
        """Ascending angles between which neither solutions nor sign(W2) change, in the plane."""
        trusted = self.trusted
        closing, shear, strength = (
            rows[trusted] for rows in (self.closing, self.shear, self.strength)
        )
        lines = [np.where(self.options[:, 1:2], closing, 0.0), shear - strength, shear + strength]
        ends = line_angles(np.concatenate(lines, axis=1).reshape(-1, 2))
        zeros = plane_cone(self.K[trusted], rtol=0.0).edges.ravel()
        zeros = zeros[~np.isnan(zeros)]
        every = np.concatenate([[0.0], ends, zeros, zeros + np.pi])
        return np.unique(np.mod(every, 2.0 * np.pi))


def relaxed_branches(
    graph: GrainGraph,
    law: ContactLaw,
    edge: YieldingContacts,
    closure: Closure,
    spins: Spins,
    subspace: str,
    volume: ArrayLike | None,
) -> RelaxedBranches:
    """Solve the closure for every combination of regimes, as in `directional_work`."""
    require_one_state(graph)
    which, basis = edge.anywhere, subspace_basis(subspace)
    options = _options(edge)
    chosen = combinations_of(options)
    regime = np.repeat(edge.regime[None], len(chosen), axis=0)
    regime[:, which], side = np.abs(chosen), sides(chosen)
    shear_force = np.repeat(graph.shear_force[None], len(chosen), axis=0)
    # The law reads the side of a sliding contact from the sign of `T`, also without force yet.
    shear_force[:, which] = np.where(
        edge.touching[which] & (side != 0.0) & (shear_force[:, which] == 0.0),
        side * np.finfo(float).tiny,
        shear_force[:, which],
    )
    batch = graph.replace(shear_force=shear_force)
    tangent = macroscopic_tangent(batch, law, closure, spins=spins, regime=regime, volume=volume)
    un, ut, known = _contact_rates(batch, law, closure, spins, regime, which)
    K = np.where(
        (tangent.trusted & known)[:, None, None], restrict(tangent.matrix, subspace), np.nan
    )
    un, ut = un @ basis.T, ut @ basis.T
    closing, _, shear, strength = edge.rows(-un[:, which], -ut[:, which], which)
    return RelaxedBranches(
        K=K,
        regime=regime,
        closing=closing,
        shear=shear,
        strength=strength,
        options=options,
        chosen=chosen,
        error=ROUNDED * edge.unit * np.linalg.norm([un, ut], axis=-1).max(axis=(0, 2)),
    )


def _options(edge: YieldingContacts) -> Flags:
    own = edge.touching, edge.at_yield, edge.apex, edge.mu == 0.0, edge.side
    options = edge_options(*own)[edge.anywhere]
    count = combination_count(options)
    if count > COMBINATIONS:
        raise InputError(
            "contacts at the edge of their law",
            f"{len(options)} with {count:.3g} combinations of regimes",
            f"at most {COMBINATIONS} combinations under a closure that relaxes",
            "Use the affine closure with spins blocked or affine, or rates_at for one direction.",
        )
    return options


def _contact_rates(
    graph: GrainGraph,
    law: ContactLaw,
    closure: Closure,
    spins: Spins,
    regime: Regimes,
    which: Integers,
) -> tuple[Floats, Floats, Flags]:
    """Relative displacement rates of all contacts per component of `H'`.

    The graph is a loop in R copies, which differ in shear forces alone. Returns `un`, `ut`
    (R, C, 4), positive when the contact opens and along `t`, spins included, and whether the
    equations determine those of some contacts, (R,).
    """
    state, d0 = contact_state(graph), graph.reference_branches
    size = float(np.hypot(d0[:, 0], d0[:, 1]).max())
    form = form_of(graph, closure, spins, np.asarray(size**2))
    # `un'`, then `ut'`, of motions with spins times radii.
    rows = contact_kinematics(state, law)
    rows[..., 2:] /= graph.radii[graph.contacts][:, None]
    watched = np.zeros((2, len(which), graph.contact_count, 4))
    watched[:, np.arange(len(which)), which] = rows[which].swapaxes(0, 1)
    S = contact_springs(state, law, regime, spins)
    # No gear modes here: their unbalanced moments mean that the rate problem has no solution.
    sizes = spring_sizes(state, law, regime, spins)
    relaxed = relax(form, S, sizes, rows=watched.reshape(-1, graph.contact_count, 4))
    motion = drive(form) + motions(relaxed.v, form.ends)
    rates = size * (rows @ motion)
    known = (relaxed.residual <= RESIDUAL_LIMIT) & (relaxed.ambiguity <= AMBIGUITY_LIMIT)
    return rates[:, :, 0], rates[:, :, 1], known
