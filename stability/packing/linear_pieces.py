"""A packing with frozen geometry: rates in any regimes from one factorisation.

Every pair has a normal and a shear row: `q = (un', ut')` of its motion, and `-D q` is what its
force does, `D` being 0 where open, `diag(kn, kt)` where stuck, `[[kn, 0], [s mu kn, 0]]` where it
slides. A change of `D` on some rows is one of small rank: with `U = K^-1 p` for the rows concerned
the motion is `V h + U w`, `h` the strain rate and the load. Rows: normal of every pair, then shear,
then `t . d'` for the stiffness that forces have of their own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.laws.protocol import Regime
from stability.packing.pairs import Pairs
from stability.packing.state import PackingState

# Over the typical stiffness: gear modes, and grains that carry nothing (theory, 11.6).
GEARS, PAIRED, RATTLERS = 1e-7, 1e-4, 1e-3
# Columns from which on the system is factorised anew, and how many there is room for.
RANK, ROOM = 48, 160
# At yield is who has all of its strength but a millionth.
AT_YIELD = 1.0 - 1e-6


class Rates(NamedTuple):
    """Strain rate and load `h` (5,), coefficients `w` of the columns."""

    h: Floats
    w: Floats


class Pieces:
    """The system at one geometry; regimes change through `set_regime`."""

    def __init__(
        self,
        state: PackingState,
        pairs: Pairs,
        regime: Regimes,
        side: Floats,
        by_radii: bool,
        load: Floats,
    ) -> None:
        self.pairs, self.regime, self.side = pairs, regime, side
        self.mu = np.where(np.isfinite(pairs.mu), pairs.mu, 0.0)
        count = len(state.x)
        d = state.branches
        length = np.linalg.norm(d, axis=1)
        n = d / length[:, None]
        t = np.column_stack([-n[:, 1], n[:, 0]])
        i, j = pairs.grains.T
        r_i, r_j = state.radii[i], state.radii[j]
        arm_i = 0.5 * (length + r_i - r_j)
        arm_j = length - arm_i
        self.length = float(state.radii.mean())
        turn = (r_i + r_j) / length if by_radii else np.ones_like(length)
        b_i, b_j = (r_i, r_j) if by_radii else (arm_i, arm_j)
        N, T = state.normal_force, state.shear_force
        none = np.zeros_like(length)
        normal = self._rows(count, i, j, n, none, none)
        shear = self._rows(count, i, j, turn[:, None] * t, -b_i, -b_j)
        across = self._rows(count, i, j, t, none, none)
        self.gauge = sparse.vstack([normal, shear, across]).tocsr()
        self.push = sparse.vstack([normal, self._rows(count, i, j, t, -arm_i, -arm_j)]).tocsr()
        own = (N[:, None] * t - T[:, None] * n) / length[:, None]
        # What forces do as they turn with their branch, and as their arms grow with it.
        self.geometric_push = self._rows(count, i, j, own, none, none)
        self.moment_push = self._rows(count, i, j, 0.0 * n, -0.5 * T, -0.5 * T)
        self.geometric = self.geometric_push.T @ across + self.moment_push.T @ normal
        volume = abs(np.linalg.det(state.cell))

        def outer(a: Floats) -> Floats:
            return (a[:, :, None] * d[:, None, :]).reshape(-1, 4) / volume

        # Motions of unit strains, and the stress of unit forces.
        self.affine = -volume * np.concatenate([outer(n), outer(turn[:, None] * t), outer(t)])
        self.stress_of = np.concatenate([outer(n), outer(t), outer(own)])
        self.load, self.drag = load, np.zeros(count)
        self.factorise()

    def _rows(
        self, count: int, i: Integers, j: Integers, a: Floats, w_i: Floats, w_j: Floats
    ) -> sparse.csr_array:
        values = np.column_stack([-a, a, w_i / self.length, w_j / self.length])
        at = np.column_stack([3 * i, 3 * i + 1, 3 * j, 3 * j + 1, 3 * i + 2, 3 * j + 2])
        start = np.arange(0, values.size + 1, 6)
        shape = (len(i), 3 * count)
        return sparse.csr_array((values.ravel(), at.ravel(), start), shape=shape)

    def tangent(self, rows: Integers | slice = slice(None)) -> tuple[Floats, Floats, Floats]:
        """`D` of pairs: its entries (n, n), (s, n), (s, s); the fourth is 0."""
        regime = self.regime[rows]
        kn = np.where(regime != Regime.OPEN, self.pairs.kn[rows], 0.0)
        slope = np.where(regime == Regime.SLIDING, self.side[rows] * self.mu[rows], 0.0)
        return kn, slope * kn, np.where(regime == Regime.ELASTIC, self.pairs.kt[rows], 0.0)

    def factorise(self) -> None:
        """Take the regimes as they are for reference."""
        pairs = len(self.pairs)
        self.reference = self.tangent()
        nn, sn, ss = self.reference
        D = sparse.block_array(
            [[sparse.diags_array(nn), None], [sparse.diags_array(sn), sparse.diags_array(ss)]]
        )
        self.D = D.tocsr()
        K = self.push.T @ (self.D @ self.gauge[: 2 * pairs]) - self.geometric
        unit = float(self.pairs.kn.mean())
        closed = self.regime != Regime.OPEN
        degree = np.bincount(self.pairs.grains[closed].ravel(), minlength=K.shape[0] // 3)
        own = np.select([degree < 2, degree < 3], [RATTLERS, PAIRED], GEARS)
        springs = np.repeat(np.maximum(own, self.drag), 3) * unit
        anchor = 3 * int(np.argmax(degree))
        springs[anchor : anchor + 2] += unit
        matrix = (K + sparse.diags_array(springs)).tocsc()
        # Open pairs have left zeros that would fill the factors.
        matrix.eliminate_zeros()
        self.lu = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.001,
            options={"SymmetricMode": True},
        )
        affine = self.affine
        right = np.empty((K.shape[0], 5), order="F")
        right[:, :4] = -(self.push.T @ (self.D @ affine[: 2 * pairs]))
        right[:, :4] += self.geometric_push.T @ affine[2 * pairs :]
        right[:, :4] += self.moment_push.T @ affine[:pairs]
        right[:, 4] = self.load
        self.V = self.lu.solve(right)
        self.q0 = self.gauge @ self.V
        self.q0[:, :4] += affine
        self.stress0 = self._stress(self.q0)
        size = K.shape[0]
        self.rows: list[int] = []
        self.at: dict[int, int] = {}
        self.U = np.empty((size, ROOM), order="F")
        self.Q = np.empty((3 * pairs, ROOM), order="F")
        self.column_stress = np.empty((4, ROOM))
        self.coefficients = np.zeros((ROOM, 2))

    def set_load(self, load: Floats) -> None:
        """Another load for the reference as it stands."""
        self.load = load
        self.V[:, 4] = self.lu.solve(load)
        self.q0[:, 4] = self.gauge @ self.V[:, 4]
        self.stress0[:, 4] = self._stress(self.q0[:, 4])

    def _stress(self, q: Floats) -> Floats:
        pairs = len(self.pairs)
        forces = np.concatenate([-(self.D @ q[: 2 * pairs]), q[2 * pairs :]])
        return np.asarray(self.stress_of.T @ forces)

    def column(self, row: int) -> int:
        """Number of the column of a row, solved for if need be."""
        if row not in self.at:
            k = len(self.rows)
            if k == ROOM:
                raise ArithmeticError("more changes of regime at once than there is room for")
            p, six = np.zeros(len(self.U)), slice(6 * row, 6 * row + 6)
            np.add.at(p, self.push.indices[six], self.push.data[six])
            self.U[:, k] = self.lu.solve(p)
            self.Q[:, k] = self.gauge @ self.U[:, k]
            self.column_stress[:, k] = self._stress(self.Q[:, k]) + self.stress_of[row]
            self.coefficients[k] = 0.0
            self.rows.append(row)
            self.at[row] = k
        return self.at[row]

    def set_regime(self, c: int, regime: Regime, side: float = 0.0) -> None:
        """Change one pair."""
        self.regime[c], self.side[c] = regime, side
        one = np.array([c])
        nn, sn, ss = (float(k[0]) for k in self.tangent(one))
        was = [float(k[c]) for k in self.reference]
        pairs = len(self.pairs)
        for row, change in ((c, (nn - was[0], 0.0)), (pairs + c, (sn - was[1], ss - was[2]))):
            if row in self.at or change != (0.0, 0.0):
                self.coefficients[self.column(row)] = change

    def solve(
        self, stress: Floats, strain: Floats, rate: Floats, driven: int = -1
    ) -> tuple[Rates, Rates, float]:
        """Rates under `stress @ P' + strain @ H' = rate`; of a unit force on the column `driven`.

        Beside them the sign of the determinant, over that of the reference.
        """
        m, pairs = len(self.rows), len(self.pairs)
        pair = np.array(self.rows, dtype=np.int64) % pairs if m else np.zeros(0, dtype=np.int64)
        a = self.coefficients[:m]
        C = a[:, :1] * self.Q[pair, :m] + a[:, 1:] * self.Q[pairs + pair, :m]
        c0 = a[:, :1] * self.q0[pair] + a[:, 1:] * self.q0[pairs + pair]
        right = np.column_stack([c0, C[:, driven] if driven >= 0 else np.zeros(m)])
        matrix = np.eye(m) + C
        solved = np.linalg.solve(matrix, right)
        unit = np.zeros(m)
        if driven >= 0:
            unit[driven] = 1.0
        x = unit - solved[:, 5]
        Y, columns = solved[:, :5], self.column_stress[:, :m]
        whole = self.stress0 - columns @ Y
        A = stress @ whole[:, :4] + strain
        both = np.linalg.solve(
            A, np.column_stack([rate - stress @ whole[:, 4], -stress @ (columns @ x)])
        )
        h = np.append(both[:, 0], 1.0)
        h_x = np.append(both[:, 1], 0.0)
        sign = float(np.linalg.slogdet(matrix)[0] * np.sign(np.linalg.det(A)))
        return Rates(h, -Y @ h), Rates(h_x, x - Y @ h_x), sign

    def q(self, rates: Rates, rows: Integers | slice = slice(None)) -> Floats:
        """`q` of some rows."""
        m = len(rates.w)
        return np.asarray(self.q0[rows] @ rates.h + self.Q[rows, :m] @ rates.w)

    def motion(self, rates: Rates) -> Floats:
        """(3G,) freedoms."""
        return np.asarray(self.V @ rates.h + self.U[:, : len(rates.w)] @ rates.w)

    def stress(self, rates: Rates) -> Floats:
        """(4,) `P'`."""
        return np.asarray(self.stress0 @ rates.h + self.column_stress[:, : len(rates.w)] @ rates.w)

    def edge(self, rates: Rates, c: Integers) -> Floats:
        """`w - z` of pairs at yield: how fast a stuck one leaves its cone, minus the slip."""
        pairs = len(self.pairs)
        un, ut = self.q(rates, c), self.q(rates, pairs + c)
        return np.asarray(self.side[c] * self.pairs.kt[c] * ut - self.mu[c] * self.pairs.kn[c] * un)

    def at_yield(self, N: Floats, T: Floats, held: Flags) -> Integers:
        """Pairs that slide, or that stand on their cone."""
        frictional = (self.mu > 0) & np.isfinite(self.pairs.mu) & ~held
        loaded = (N > 0) & (np.abs(T) >= AT_YIELD * self.mu * N)
        stuck = (self.regime == Regime.ELASTIC) & loaded
        return np.flatnonzero(frictional & (stuck | (self.regime == Regime.SLIDING)))
