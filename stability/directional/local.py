"""Branches of the affine closure: each contact picks its regime by itself.

Branch rates follow `H'` whatever the forces do, and so do spins that are blocked or turn with the
loop. Every contact at the edge then has one answer, which is a continuous function of direction:
there is always one solution, and W2 is continuous and piecewise quadratic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import GrainGraph, LinearFrictional, Regime, affine_tangent, reference_branch_vectors
from loops.closures import Spins
from loops.closures.spins import affine_spin
from loops.geometry import reference_volume
from stability.cones import plane_cone
from stability.directional.answer import Answer, one_answer
from stability.directional.arcs import line_angles, middles, plane_directions
from stability.directional.edge import EdgeContacts
from stability.subspaces import restrict, subspace_basis

Floats = NDArray[np.float64]
Regimes = NDArray[np.int8]


class _Choice(NamedTuple):
    """What contacts at the edge do, (..., D, E); `friction` is `s mu`."""

    opens: NDArray[np.bool_]
    slides: NDArray[np.bool_]
    friction: Floats


@dataclass(frozen=True, eq=False)
class LocalBranches:
    """Operators of a graph under the affine closure, and the contacts at the edge.

    Attributes
    ----------
    K : (..., m, m) array
        Operator with all contacts at the edge elastic.
    edge : EdgeContacts
        Of all contacts; the arrays below hold those at the edge somewhere in the batch.
    which : (E,) array of int
        Contacts at the edge somewhere.
    nu, tau : (..., E, m) array
        `n (x) d0` and `t (x) d0` in the subspace: `un' = -nu . e`, and the stress rate per `N'`
        and `T'` times `V0`.
    sigma : (..., E, m) array
        `ut' = -sigma . e`, spins included.
    volume : (...) array
        V0.
    """

    K: Floats
    edge: EdgeContacts
    which: NDArray[np.int64]
    nu: Floats
    tau: Floats
    sigma: Floats
    volume: Floats

    @property
    def singular(self) -> int:
        """No equations are solved: none is singular."""
        return 0

    def answer(self, directions: Floats) -> Answer:
        """The one solution in each direction, (..., D, m)."""
        normal, shear = self._sticking(directions)
        choice = self._choice(normal, shear)
        elastic = np.einsum("...ij,...dj->...di", self.K, directions)
        return one_answer(
            directions, elastic + self._change(choice, normal, shear), self._regimes(choice)
        )

    def critical_angles(self) -> Floats:
        """(..., A) ascending angles in [0, 2 pi) between which neither regimes nor sign(W2) change.

        In the plane only. The zeros of W2 are those of the operator of each sector.
        """
        lines = np.concatenate(self._switching(), axis=-2)
        ends = line_angles(lines)
        if ends.shape[-1] == 0:
            ends = np.zeros((*self.K.shape[:-2], 1))
        zeros = plane_cone(self._operators(middles(ends)), rtol=0.0).edges
        zeros = np.where(np.isnan(zeros), ends[..., None], zeros)
        zeros = zeros.reshape(*zeros.shape[:-2], -1)
        every = np.concatenate([ends, zeros, zeros + np.pi], axis=-1)
        return np.sort(np.mod(every, 2.0 * np.pi), axis=-1)

    def _sticking(self, directions: Floats) -> tuple[Floats, Floats]:
        """(..., D, E) `N'` and `T'` as if every contact at the edge stuck."""
        kn, kt = self.edge.kn[..., self.which], self.edge.kt[..., self.which]
        normal = kn[..., None, :] * np.einsum("...em,...dm->...de", self.nu, directions)
        shear = kt[..., None, :] * np.einsum("...em,...dm->...de", self.sigma, directions)
        return normal, shear

    def _choice(self, normal: Floats, shear: Floats) -> _Choice:
        """What every contact does, given its rates as if it stuck."""
        edge, which = self.edge, self.which
        touching = edge.touching[..., None, which]
        mu = edge.mu[..., None, which]
        side = np.where(touching, np.sign(shear), edge.side[..., None, which])
        friction = side * np.where(np.isfinite(mu), mu, 0.0)
        opens = touching & ~(normal > 0.0)
        slides = ~opens & (side != 0.0) & np.isfinite(mu)
        return _Choice(opens, slides & (side * (shear - friction * normal) >= 0.0), friction)

    def _change(self, choice: _Choice, normal: Floats, shear: Floats) -> Floats:
        """(..., D, m) stress rate beyond that of sticking contacts; linear in the rates."""
        slid = np.where(choice.slides, choice.friction * normal - shear, 0.0)
        change = np.einsum("...de,...em->...dm", np.where(choice.opens, -normal, 0.0), self.nu)
        change += np.einsum("...de,...em->...dm", np.where(choice.opens, -shear, slid), self.tau)
        return np.asarray(change / self.volume[..., None, None])

    def _operators(self, angle: Floats) -> Floats:
        """(..., A, 2, 2) operators of the regimes that hold at each angle."""
        choice = self._choice(*self._sticking(plane_directions(angle)))
        columns = [
            self._change(choice, *self._sticking(np.broadcast_to(unit, (*angle.shape, 2))))
            for unit in np.eye(2)
        ]
        return np.asarray(self.K[..., None, :, :] + np.stack(columns, axis=-1))

    def _regimes(self, choice: _Choice) -> Regimes:
        """(..., D, C) regimes of all contacts."""
        base = self.edge.regime
        regime = np.broadcast_to(base[..., None, :], (*choice.slides.shape[:-1], base.shape[-1]))
        regime = regime.copy()
        chosen = np.where(choice.slides, Regime.SLIDING, regime[..., self.which])
        regime[..., self.which] = np.where(choice.opens, Regime.OPEN, chosen)
        return regime

    def _switching(self) -> list[Floats]:
        """Rows (..., E, m) whose zeros bound the regimes; zero rows where there is no question."""
        edge, which = self.edge, self.which
        mu = np.where(np.isfinite(edge.mu), edge.mu, 0.0)[..., which, None]
        normal = edge.kn[..., which, None] * self.nu
        shear = edge.kt[..., which, None] * self.sigma
        yields, touches = edge.at_yield[..., which, None], edge.touching[..., which, None]
        side = edge.side[..., which, None]
        sides = np.where(yields, side * shear - mu * normal, 0.0)
        if not touches.any():
            return [sides]
        return [
            np.where(touches, normal, sides),
            np.where(touches, shear - mu * normal, 0.0),
            np.where(touches, shear + mu * normal, 0.0),
        ]


def local_branches(
    graph: GrainGraph,
    law: LinearFrictional,
    edge: EdgeContacts,
    spins: Spins,
    subspace: str,
    volume: ArrayLike | None,
) -> LocalBranches:
    """Gather the branches of the affine closure with spins blocked or affine.

    Parameters
    ----------
    graph, law, volume
        As in `directional_work`.
    edge : EdgeContacts
        Its contacts at the edge.
    spins : {'blocked', 'affine'}
        Spin rule.
    subspace : str
        Subspace of directions.

    Returns
    -------
    LocalBranches
    """
    v0 = np.asarray(reference_volume(graph) if volume is None else volume, dtype=float)
    A = affine_tangent(graph, law, spins=spins, regime=edge.regime, volume=v0).matrix
    batch = np.broadcast_shapes(A.shape[:-2], edge.regime.shape[:-1])
    basis, which = subspace_basis(subspace), edge.anywhere
    d0, state = reference_branch_vectors(graph)[..., which, :], edge.state
    nu = _components(state.n[..., which, :], d0, basis)
    tau = _components(state.t[..., which, :], d0, basis)
    g, b_i, b_j = (np.asarray(a)[..., which, None] for a in law.shear_kinematics(state))
    sigma = g * tau
    if spins == "affine":
        sigma = sigma + (b_i + b_j) * (affine_spin(graph) @ basis.T)[..., None, :]

    def spread(rows: Floats) -> Floats:
        return np.broadcast_to(rows, (*batch, *rows.shape[-2:]))

    K = np.broadcast_to(restrict(A, subspace), (*batch, len(basis), len(basis)))
    nu, tau, sigma = spread(nu), spread(tau), spread(sigma)
    return LocalBranches(K, edge, which, nu, tau, sigma, np.broadcast_to(v0, batch))


def _components(v: Floats, d0: Floats, basis: Floats) -> Floats:
    """(..., E, m) `v (x) d0` in the subspace."""
    outer = v[..., :, None] * d0[..., None, :]
    return np.asarray(outer.reshape(*outer.shape[:-2], 4) @ basis.T)
