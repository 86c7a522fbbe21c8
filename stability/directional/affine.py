"""Branches of the affine closure: the regime of a contact depends on no other contact.

Branch rates follow `H'` whatever the forces, and so do spins that are blocked or turn with the
loop. The force rate of every contact at the edge is then one continuous function of direction:
there is always one solution, and W2 is continuous and piecewise quadratic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops import ContactLaw, GrainGraph, Regime, affine_tangent, reference_branch_vectors
from loops.arrays import Flags, Floats, Integers
from loops.closures import Spins
from loops.closures.system import affine_spin
from loops.geometry import reference_volume
from stability.cones import plane_cone
from stability.directional.edge import (
    Solutions,
    YieldingContacts,
    line_angles,
    middles,
    one_solution,
    plane_directions,
)
from stability.spectra import restrict, subspace_basis


class _Picked(NamedTuple):
    """Regimes of the contacts at the edge, (..., D, E), and the side on which they slide."""

    opens: Flags
    slides: Flags
    side: Floats


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

    def solve(self, directions: Floats) -> Solutions:
        """The one solution in each direction, (..., D, m)."""
        sticking = self._sticking(directions)
        picked = self._pick(sticking)
        elastic = np.einsum("...ij,...dj->...di", self.K, directions)
        stress = elastic + self._change(picked, sticking)
        base = self.edge.regime
        regime = np.broadcast_to(base[..., None, :], (*picked.slides.shape[:-1], base.shape[-1]))
        regime = regime.copy()
        chosen = np.where(picked.slides, Regime.SLIDING, regime[..., self.which])
        regime[..., self.which] = np.where(picked.opens, Regime.OPEN, chosen)
        return one_solution(directions, stress, regime)

    def critical_angles(self) -> Floats:
        """(..., A) ascending angles in [0, 2 pi) between which neither regimes nor sign(W2) change.

        In the plane only. The zeros of W2 are those of the operator of each sector.
        """
        ends = line_angles(np.concatenate(self._switching(), axis=-2))
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
        opens = touching & ~(rates.closing > 0.0)
        slides = slides & ~opens & (side != 0.0) & (side * rates.shear - rates.strength >= 0.0)
        return _Picked(opens, slides, side)

    def _change(self, picked: _Picked, rates: _Sticking) -> Floats:
        """(..., D, m) stress rate beyond that of sticking contacts; linear in the rates."""
        slid = np.where(picked.slides, picked.side * rates.strength - rates.shear, 0.0)
        normal = np.where(picked.opens, -rates.normal, 0.0)
        change = np.einsum("...de,...em->...dm", normal, self.nu)
        shear = np.where(picked.opens, -rates.shear, slid)
        change += np.einsum("...de,...em->...dm", shear, self.tau)
        return np.asarray(change / self.volume[..., None, None])

    def _switching(self) -> list[Floats]:
        """Rows (..., E, m) whose zeros bound the regimes; zero rows where nothing can change."""
        edge, which = self.edge, self.which
        closing, _, shear, strength = self.rows
        yields, touches = edge.at_yield[..., which, None], edge.touching[..., which, None]
        apex = touches & edge.slides[..., which, None] & ~yields
        sides = np.where(yields, edge.side[..., which, None] * shear - strength, 0.0)
        if not touches.any():
            return [sides]
        return [
            np.where(touches, closing, 0.0),
            np.where(apex, shear - strength, sides),
            np.where(apex, shear + strength, 0.0),
        ]


def affine_branches(
    graph: GrainGraph,
    law: ContactLaw,
    edge: YieldingContacts,
    spins: Spins,
    subspace: str,
    volume: ArrayLike | None,
) -> AffineBranches:
    """Gather the branches of the affine closure with spins blocked or affine."""
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
