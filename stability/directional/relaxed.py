"""Branches of a closure that relaxes: the regimes of all contacts depend on each other.

For each combination of regimes the motion is linear in `H'`; it solves the rate problem in the
directions in which every contact agrees with its rates. These are convex cones, one for each
combination, which may overlap (several solutions) or leave gaps (none).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from loops import (
    ContactLaw,
    GrainGraph,
    InputError,
    Regime,
    contact_state,
    macroscopic_tangent,
    reference_branch_vectors,
)
from loops.arrays import Flags, Floats, Integers, Regimes
from loops.assembly import contact_kinematics, motions
from loops.closures import Closure, Spins
from loops.closures.system import contact_springs, drive, form_of, relax, spring_sizes
from loops.closures.tangents import AMBIGUITY_LIMIT, RESIDUAL_LIMIT
from loops.graph import require_one_state
from stability.cones import plane_cone
from stability.directional.edge import Solutions, YieldingContacts, line_angles, works
from stability.rate_problem import SIGN_TOLERANCE, SOLUTION_RTOL, Choice, edge_options
from stability.spectra import restrict, subspace_basis

# All combinations of regimes are tried: eight contacts at yield.
COMBINATIONS = 256


@dataclass(frozen=True, eq=False)
class RelaxedBranches:
    """Operators of one graph for all R combinations of regimes of its contacts at the edge.

    `K` (R, m, m) are the operators, NaN where the equations have no single answer; `regime` (R, C)
    the regimes of all contacts. Of the E contacts at the edge, in the motion of each combination:
    `closing`, `shear` and `strength` (R, E, m) as in `YieldingContacts.rows`; `chosen` (R, E) the
    regime, `side` (R, E) the sign of `T` where it slides or would; and (E,) the possible regimes:
    `touching` (open), `yields` (slide to one side), `slides`, `frictional`.
    """

    K: Floats
    regime: Regimes
    closing: Floats
    shear: Floats
    strength: Floats
    touching: Flags
    yields: Flags
    slides: Flags
    frictional: Flags
    chosen: Regimes
    side: Floats

    @property
    def trusted(self) -> Flags:
        """(R,) combinations whose equations have a single answer."""
        return np.asarray(~np.isnan(self.K).any(axis=(-2, -1)))

    @property
    def singular(self) -> int:
        """Combinations whose equations have no single answer."""
        return int((~self.trusted).sum())

    def solve(self, directions: Floats) -> Solutions:
        """All solutions in each direction, (D, m)."""
        agrees = self._agrees(directions)
        stress = np.einsum("rij,dj->dri", self.K, directions)
        work, cosine = works(directions[:, None, :], np.where(agrees[..., None], stress, 0.0))
        least = np.argmin(np.where(agrees, work, np.inf), axis=-1)
        most = np.argmax(np.where(agrees, work, -np.inf), axis=-1)
        several = self._differ(agrees, least, stress, directions)
        count = np.where(several, 2, np.minimum(agrees.sum(axis=-1), 1))
        found = (count > 0)[:, None]
        both = np.stack([least, most], axis=-1)
        return Solutions(
            count=count,
            work=np.where(found, np.take_along_axis(work, both, axis=-1), np.nan),
            cosine=np.where(found, np.take_along_axis(cosine, both, axis=-1), np.nan),
            regime=np.where(found, self.regime[least], np.int8(-1)),
        )

    def critical_angles(self) -> Floats:
        """Ascending angles between which neither solutions nor sign(W2) change, in the plane."""
        trusted = self.trusted
        closing, shear, strength = (
            rows[trusted] for rows in (self.closing, self.shear, self.strength)
        )
        lines = [np.where(self.touching[:, None], closing, 0.0), shear - strength, shear + strength]
        ends = line_angles(np.concatenate(lines, axis=1).reshape(-1, 2))
        zeros = plane_cone(self.K[trusted], rtol=0.0).edges.ravel()
        zeros = zeros[~np.isnan(zeros)]
        every = np.concatenate([[0.0], ends, zeros, zeros + np.pi])
        return np.unique(np.mod(every, 2.0 * np.pi))

    def _agrees(self, directions: Floats) -> Flags:
        """(D, R) combinations in which every contact agrees with its rates."""
        closing, shear, strength = (
            np.einsum("rem,dm->dre", rows, directions)
            for rows in (self.closing, self.shear, self.strength)
        )
        size = np.maximum(np.abs(closing), np.abs(shear)).max(axis=-1, initial=0.0)
        tol = SIGN_TOLERANCE * size[..., None]
        excess = self.side * shear - strength
        beyond = np.where(self.yields, excess, np.abs(shear) - strength)
        held = ~self.slides | (beyond <= tol)
        agrees = np.where(self.chosen == Regime.SLIDING, (excess >= -tol) | ~self.frictional, held)
        closed = ~self.touching | (closing >= -tol)
        agrees = np.where(self.chosen == Regime.OPEN, closing <= tol, agrees & closed)
        return np.asarray(agrees.all(axis=-1) & self.trusted)

    def _differ(self, agrees: Flags, first: Integers, stress: Floats, directions: Floats) -> Flags:
        """Directions in which a solution has other rates than the first; neutral contacts aside."""
        rates = [stress]
        rates += [np.einsum("rem,dm->dre", own, directions) for own in (self.closing, self.shear)]
        every = np.concatenate(rates, axis=-1)
        chosen = np.take_along_axis(every, first[:, None, None], axis=1)
        gap = np.linalg.norm(every - chosen, axis=-1)
        size = np.maximum(np.linalg.norm(every, axis=-1), np.linalg.norm(chosen, axis=-1))
        return np.asarray((agrees & (gap > SOLUTION_RTOL * size)).any(axis=-1))


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
    which, basis = edge.anywhere, subspace_basis(subspace)
    choices = _combinations(graph, edge)
    count = len(choices)
    regime = np.repeat(edge.regime[None], count, axis=0)
    regime[:, which] = [[choice.regime for choice in row] for row in choices]
    side = np.array([[choice.side for choice in row] for row in choices]).reshape(count, -1)
    shear_force = np.repeat(graph.shear_force[None], count, axis=0)
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
    closing, _, shear, strength = edge.rows(-(un @ basis.T), -(ut @ basis.T), which)
    return RelaxedBranches(
        K=K,
        regime=regime,
        closing=closing,
        shear=shear,
        strength=strength,
        touching=edge.touching[which],
        yields=edge.at_yield[which],
        slides=edge.slides[which],
        frictional=edge.mu[which] > 0.0,
        chosen=regime[:, which],
        side=np.where(edge.at_yield[which], edge.side[which], side),
    )


def _combinations(graph: GrainGraph, edge: YieldingContacts) -> list[tuple[Choice, ...]]:
    require_one_state(graph)
    options = [_options(edge, int(c)) for c in edge.anywhere]
    count = float(np.prod([float(len(each)) for each in options]))
    if count > COMBINATIONS:
        raise InputError(
            "contacts at the edge of their law",
            f"{len(options)} with {count:.3g} combinations of regimes",
            f"at most {COMBINATIONS} combinations under a closure that relaxes",
            "Use the affine closure with spins blocked or affine, or rates_at for one direction.",
        )
    return list(product(*options))


def _options(edge: YieldingContacts, c: int) -> tuple[Choice, ...]:
    return edge_options(
        touching=bool(edge.touching[c]),
        at_yield=bool(edge.at_yield[c]),
        apex=bool(edge.apex[c]),
        frictionless=bool(edge.mu[c] == 0.0),
        side=float(edge.side[c]),
    )


def _contact_rates(
    graph: GrainGraph,
    law: ContactLaw,
    closure: Closure,
    spins: Spins,
    regime: Regimes,
    which: Integers,
) -> tuple[Floats, Floats, Flags]:
    """Relative displacement rates of some contacts per component of `H'`.

    The graph is a loop in R copies, which differ in shear forces alone. Returns `un`, `ut`
    (R, E, 4), positive when the contact opens and along `t`, spins included, and whether the
    equations determine them, (R,).
    """
    state, d0 = contact_state(graph), reference_branch_vectors(graph)
    size = float(np.hypot(d0[:, 0], d0[:, 1]).max())
    form = form_of(graph, closure, spins, np.asarray(size**2))
    # `un'`, then `ut'`, of motions with spins times radii.
    rows = contact_kinematics(state, law)[which]
    rows[..., 2:] /= graph.radii[graph.contacts[which], None].swapaxes(-1, -2)
    watched = np.zeros((2, len(which), graph.contact_count, 4))
    watched[:, np.arange(len(which)), which] = rows.swapaxes(0, 1)
    S = contact_springs(state, law, regime, spins)
    # No gear modes here: their unbalanced moments mean that the rate problem has no solution.
    sizes = spring_sizes(state, law, regime, spins)
    relaxed = relax(form, S, sizes, rows=watched.reshape(-1, graph.contact_count, 4))
    motion = drive(form) + motions(relaxed.v, form.ends)
    rates = size * (rows @ motion[:, which])
    known = (relaxed.residual <= RESIDUAL_LIMIT) & (relaxed.ambiguity <= AMBIGUITY_LIMIT)
    return rates[:, :, 0], rates[:, :, 1], known
