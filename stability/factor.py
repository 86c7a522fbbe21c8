"""Factors of a packing's matrix in given regimes, and motions under loads as without springs.

The matrix is factorised on weak springs, as that of paths is, and solutions are refined against it.
Motions that meet no force are taken out.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import sparse

from loops.arrays import Floats
from loops.assembly import RELATIVE
from loops.errors import InputError
from loops.system import REGULARISATION, System, relative_motion, stiffness_matrix
from stability.programmes import NOTHING, ROUNDED, MixedControl

if TYPE_CHECKING:
    from stability.compiled.packing_system import Factors, Order

# Relative residual at which refinement ends; one step reaches rounding.
REFINED = 1e-14
# Steps of refinement at most.
REFINEMENTS = 8
# Right-hand sides that are solved at a time: fastest with a few.
PANEL = 32
# Stiffness over the typical one against which a mechanism moves under its load: so fast that
# regimes without it are preferred, and so slow that forces keep nine digits.
MECHANISM = 1e-7
# Typical stiffness over a pivot from which on it counts as none: that of a mechanism.
SOFT = 1e8
# So many mechanisms are told apart at most.
MOST = 64
# H' = e_i (x) e_j for the four components in the order 11, 12, 21, 22.
UNIT_STRAINS: Floats = np.moveaxis(np.eye(4).reshape(4, 2, 2), 0, -1)
# Motion of a contact from that of its first grain, then of its second: `x, y, w` each.
BY_GRAIN = RELATIVE[:, [0, 1, 4, 2, 3, 5]]


class Mechanisms(NamedTuple):
    """Motions `R` (size, m) that meet no force, and `L` (m, size): `K R = 0`, `L K = 0`, `L R = 1`.

    `R L` takes from a load what no motion balances, from a motion its mechanisms. `compliance`
    (m, 1) moves them under a load, translations by none.
    """

    R: Floats
    L: Floats
    compliance: Floats


class Edge(NamedTuple):
    """Contacts at yield in a linear packing: rates at which they leave the friction limit, or slip.

    Of them all under unit strains (m, 4) and unit slips (m, k); the stress rates (4, 4), (4, k) of
    these, and the motions under unit slips, in columns; `left` is the largest share of their loads
    that no motion balances. Then rates (m,) and stress rates (4,) of a load that is there besides.
    """

    of_strain: Floats
    of_slip: Floats
    stress: Floats
    stress_of_slip: Floats
    motion: Floats
    left: float = 0.0
    of_load: Floats | float = 0.0
    stress_of_load: Floats = NOTHING

    def problem(self, control: MixedControl) -> tuple[Floats, Floats]:
        """Return `q` and `M` of `w = q + M z`, strain that the stress drives eliminated."""
        still = control._replace(rate=np.zeros((4, 1)))
        driven = self.of_strain @ still.strains(self.stress, self.stress_of_slip)
        M = self.of_slip + driven
        M = np.where(np.abs(M) < ROUNDED * (1.0 + np.abs(driven)), 0.0, M)
        h = control.strains(self.stress, self.stress_of_load)
        return self.of_strain @ h + self.of_load, M


class Factor:
    """Factors of `K` of a system on weak springs, anchors on stiff ones without load.

    `matrix` is `K` without the springs; `stiffness` (E, 4, 4) replaces the contacts' own, `order`
    is that of another factor.
    """

    def __init__(
        self, system: System, stiffness: Floats | None = None, order: Order | None = None
    ) -> None:
        self.system, self.order = system, order
        self.stiffness = system.stiffness if stiffness is None else stiffness
        self.matrix = stiffness_matrix(system, self.stiffness).tocsr()
        self.moves = np.flatnonzero(system.freedom >= 0)
        self.factors = self._factorised(self.stiffness)
        self.order = self.factors.order
        # Of unit strain rates 11, 12, 21, 22 of grains that don't move, (size, 4).
        self.loads = self.factors.strained[0][:, self.moves].T

    @cached_property
    def motion(self) -> Floats:
        """(size, 4) motions under unit strain rates."""
        return self.solve(self.loads)

    @cached_property
    def relative(self) -> Floats:
        """(E, 4, 4) relative motions of the contacts under unit strain rates."""
        return relative_motion(self.system, self.motion, UNIT_STRAINS)

    @cached_property
    def tangent(self) -> Floats:
        """(4, 4) `A` of `P' = A H'`."""
        return self.factors.affine / self.system.volume + self.stress(self.motion)

    def stress(self, motion: Floats) -> Floats:
        """Return the stress rates (4, k) of motions (size, k) at a strain rate of zero."""
        return np.asarray(-self.factors.strained[1][:, self.moves] @ motion) / self.system.volume

    def _factorised(self, stiffness: Floats) -> Factors:
        from stability.compiled.packing_system import factorise

        system, rows, graph = self.system, self.system.rows, self.system.graph
        bodies = graph.grain_count + len(rows.ends) - graph.contact_count
        # What has no freedom goes with the strain.
        springs = np.full((bodies, 3), np.inf)
        springs.ravel()[self.moves] = REGULARISATION * system.unit
        springs[system.carrying.anchors, :2] += system.unit
        pairs = rows.ends[system.kept], BY_GRAIN.T @ stiffness @ BY_GRAIN, system.branches
        factors = factorise(*pairs, springs, self.order)
        if not factors.regular:
            expected = "contacts that hold the grains"
            raise InputError("packing", "a singular system", expected, "See the law.")
        return factors

    def solve(self, loads: Floats) -> Floats:
        """Return motions (size, k) as without springs.

        What mechanisms cannot carry of a load is left out of balance, and moves them.
        """
        if loads.shape[1] > PANEL:
            parts = range(0, loads.shape[1], PANEL)
            return np.hstack([self.solve(loads[:, k : k + PANEL]) for k in parts])
        R, L, compliance = self.mechanisms
        left = (loads.T @ L.T).T
        loads = loads - R @ left
        v = self.once(loads)
        goal, before = REFINED * np.linalg.norm(loads, axis=0), np.inf
        for _ in range(REFINEMENTS):
            rest = loads - self.matrix @ v
            size = np.linalg.norm(rest, axis=0)
            better = (size > goal) & (size <= 0.5 * before)
            if not better.any():
                break
            v, before = v + self.once(rest * better), size
        return np.asarray(v + R @ (compliance * left - (v.T @ L.T).T))

    def once(self, loads: Floats, factors: Factors | None = None) -> Floats:
        """Return motions (size, k) on the springs, without refinement."""
        return (factors or self.factors).motions(loads, self.moves)[:, self.moves].T

    @cached_property
    def mechanisms(self) -> Mechanisms:
        """Translations, and other motions that meet no force, if they are few."""
        alone = _translations(self.system)
        T, R = alone.R, self._null(self.matrix, self.factors)
        if not R.shape[1]:
            return alone
        transposed = self._factorised(np.swapaxes(self.stiffness, 1, 2))
        L = self._null(self.matrix.T, transposed)
        if L.shape != R.shape:
            return alone
        R, L = np.hstack([T, R - T @ (T.T @ R)]), np.hstack([T, L])
        compliance = np.full((R.shape[1], 1), 1.0 / (MECHANISM * self.system.unit))
        compliance[: T.shape[1]] = 0.0
        return Mechanisms(R, np.asarray(np.linalg.solve(L.T @ R, L.T)), compliance)

    def _null(self, matrix: sparse.csr_array, factors: Factors) -> Floats:
        """Return null vectors (size, m) of a matrix, one for each pivot that vanishes."""
        reciprocal = np.diagonal(factors.pivot, axis1=1, axis2=2)[factors.order.place]
        weak = np.abs(reciprocal.ravel()[self.moves]) * self.system.unit > SOFT
        # Spins that nothing resists and nothing loads stay where they are.
        weak &= abs(matrix).sum(axis=0) + abs(matrix).sum(axis=1) > 0
        x = np.zeros((len(weak), int(np.count_nonzero(weak))))
        if x.shape[1] > MOST:
            return x[:, :0]
        x[weak] = np.eye(x.shape[1])
        for _ in range(3):
            x = np.linalg.qr(self.once(x, factors))[0]
        _, stiffness, vectors = np.linalg.svd(matrix @ x, full_matrices=False)
        return np.asarray(x @ vectors[stiffness <= 2.0 * REGULARISATION * self.system.unit].T)


def _translations(system: System) -> Mechanisms:
    """Return the translations of the components that nothing holds."""
    carrying = system.carrying
    T = np.zeros((system.size, 2 * len(carrying.anchors)))
    for k, anchor in enumerate(carrying.anchors):
        together = np.flatnonzero(carrying.component == carrying.component[anchor])
        for axis in (0, 1):
            T[system.freedom[together, axis], 2 * k + axis] = len(together) ** -0.5
    return Mechanisms(T, T.T, np.zeros((T.shape[1], 1)))
