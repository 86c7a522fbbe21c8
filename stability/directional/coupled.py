"""Branches of a closure that relaxes: the regimes of all contacts decide together.

For each combination of regimes the motion is linear in `H'`; it solves the rate problem in the
directions in which every contact agrees with the rates that it gets. These are convex cones, one a
combination, which may overlap (several solutions) or leave gaps (none).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import GrainGraph, InputError, LinearFrictional, Regime, macroscopic_tangent
from loops.closures import Closure, Spins
from stability.cones import plane_cone
from stability.directional.answer import Answer, works
from stability.directional.arcs import line_angles
from stability.directional.edge import SIGN_TOLERANCE, EdgeContacts
from stability.directional.motion import contact_rates
from stability.rate_problem import ELASTIC, LEFT, OPEN, RIGHT, SAME_RATES, Choice
from stability.subspaces import restrict, subspace_basis

Floats = NDArray[np.float64]
Regimes = NDArray[np.int8]
Mask = NDArray[np.bool_]

# All combinations of regimes are tried: eight contacts at yield.
COMBINATIONS = 256


@dataclass(frozen=True, eq=False)
class CoupledBranches:
    """Operators of one graph for all R combinations of regimes of its contacts at the edge.

    Attributes
    ----------
    K : (R, m, m) array
        Operators; NaN where the equations have no single answer.
    regime : (R, C) array of int8
        Regimes of all contacts.
    normal, shear : (R, E, m) array
        `N'` and `T'` per component of e as if the contact at the edge stuck, in the motion of the
        combination.
    mu : (E,) array
        Friction of the contacts at the edge; infinite where nothing slides.
    touching : (E,) array of bool
        Contacts that may open.
    chosen : (R, E) array of int8
        Regime, and
    side : (R, E) array
        sign of `T` where sliding; at yield the sign on which it would slide.
    """

    K: Floats
    regime: Regimes
    normal: Floats
    shear: Floats
    mu: Floats
    touching: Mask
    chosen: Regimes
    side: Floats

    @property
    def singular(self) -> int:
        """Combinations whose equations have no single answer."""
        return int(np.isnan(self.K).any(axis=(-2, -1)).sum())

    def answer(self, directions: Floats) -> Answer:
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
        return Answer(
            count=count,
            work=np.where(found, np.take_along_axis(work, both, axis=-1), np.nan),
            cosine=np.where(found, np.take_along_axis(cosine, both, axis=-1), np.nan),
            regime=np.where(found, self.regime[least], np.int8(-1)),
        )

    def critical_angles(self) -> Floats:
        """Ascending angles between which neither solutions nor sign(W2) change, in the plane."""
        trusted = ~np.isnan(self.K).any(axis=(-2, -1))
        normal, shear = self.normal[trusted], self.shear[trusted]
        mu = np.where(np.isfinite(self.mu), self.mu, 0.0)[:, None]
        lines = [np.where(self.touching[:, None], normal, 0.0)]
        lines += [shear - mu * normal, shear + mu * normal]
        ends = line_angles(np.concatenate(lines, axis=1).reshape(-1, 2))
        zeros = plane_cone(self.K[trusted], rtol=0.0).edges.ravel()
        zeros = zeros[~np.isnan(zeros)]
        every = np.concatenate([[0.0], ends, zeros, zeros + np.pi])
        return np.unique(np.mod(every, 2.0 * np.pi))

    def _agrees(self, directions: Floats) -> Mask:
        """(D, R) combinations in which every contact agrees with its rates."""
        normal = np.einsum("rem,dm->dre", self.normal, directions)
        shear = np.einsum("rem,dm->dre", self.shear, directions)
        size = np.maximum(np.abs(normal), np.abs(shear)).max(axis=-1, initial=0.0)
        tol = SIGN_TOLERANCE * size[..., None]
        mu = np.where(np.isfinite(self.mu), self.mu, 0.0)
        excess = self.side * shear - mu * normal
        both = np.abs(shear) - mu * normal
        held = np.where(self.touching, both, excess) <= tol
        parts, slides = self.chosen == Regime.OPEN, self.chosen == Regime.SLIDING
        closed = ~self.touching | (normal >= -tol)
        agrees = np.where(slides, (excess >= -tol) | (mu == 0.0), held | ~np.isfinite(self.mu))
        agrees = np.where(parts, normal <= tol, agrees & closed)
        trusted = ~np.isnan(self.K).any(axis=(-2, -1))
        return np.asarray(agrees.all(axis=-1) & trusted)

    def _differ(
        self, agrees: Mask, first: NDArray[np.int64], stress: Floats, directions: Floats
    ) -> Mask:
        """Where some solution has other rates than the first: neutral contacts don't count."""
        rates = [stress]
        for own in (self.normal, self.shear):
            rates.append(np.einsum("rem,dm->dre", own, directions))
        every = np.concatenate(rates, axis=-1)
        chosen = np.take_along_axis(every, first[:, None, None], axis=1)
        gap = np.linalg.norm(every - chosen, axis=-1)
        size = np.maximum(np.linalg.norm(every, axis=-1), np.linalg.norm(chosen, axis=-1))
        return np.asarray((agrees & (gap > SAME_RATES * size)).any(axis=-1))


def coupled_branches(
    graph: GrainGraph,
    law: LinearFrictional,
    edge: EdgeContacts,
    closure: Closure,
    spins: Spins,
    subspace: str,
    volume: ArrayLike | None,
) -> CoupledBranches:
    """Solve the closure for every combination of regimes.

    Parameters
    ----------
    graph, law, closure, spins, subspace, volume
        As in `directional_work`.
    edge : EdgeContacts
        Its contacts at the edge.

    Returns
    -------
    CoupledBranches

    Raises
    ------
    InputError
        If the graph carries batch axes or has too many combinations of regimes.
    """
    which, basis = edge.anywhere, subspace_basis(subspace)
    choices = _combinations(graph, edge)
    count = len(choices)
    regime = np.repeat(edge.regime[None], count, axis=0)
    regime[:, which] = [[choice.regime for choice in row] for row in choices]
    side = np.array([[choice.side for choice in row] for row in choices]).reshape(count, -1)
    shear_force = np.repeat(graph.shear_force[None], count, axis=0)
    # A sliding contact without force yet has a side all the same: its sign is all the law reads.
    shear_force[:, which] = np.where(
        edge.touching[which] & (side != 0.0), side * np.finfo(float).tiny, shear_force[:, which]
    )
    batch = graph.replace(shear_force=shear_force)
    tangent = macroscopic_tangent(batch, law, closure, spins=spins, regime=regime, volume=volume)
    un, ut, known = contact_rates(batch, law, closure, spins, regime, which)
    K = np.where(
        (tangent.trusted & known)[:, None, None], restrict(tangent.matrix, subspace), np.nan
    )
    return CoupledBranches(
        K=K,
        regime=regime,
        normal=-edge.kn[which, None] * (un @ basis.T),
        shear=-edge.kt[which, None] * (ut @ basis.T),
        mu=edge.mu[which],
        touching=edge.touching[which],
        chosen=regime[:, which],
        side=np.where(edge.touching[which], side, edge.side[which]),
    )


def _combinations(graph: GrainGraph, edge: EdgeContacts) -> list[tuple[Choice, ...]]:
    if graph.batch_shape:
        raise InputError(
            "graph", f"batch axes {graph.batch_shape}", "one state", "Take the states in turn."
        )
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


def _options(edge: EdgeContacts, c: int) -> tuple[Choice, ...]:
    if edge.at_yield[c]:
        return ELASTIC, LEFT if edge.side[c] > 0 else RIGHT
    if not np.isfinite(edge.mu[c]):
        return ELASTIC, OPEN
    return (LEFT, OPEN) if edge.mu[c] == 0 else (ELASTIC, OPEN, LEFT, RIGHT)
