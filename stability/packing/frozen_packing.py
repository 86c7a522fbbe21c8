"""A packing with frozen geometry: rates in any regimes from one factorisation.

Every pair has a normal and a shear rate: `q = (un', ut')` of its motion, and `-D q` is what its
force does, `D` being 0 where open, `diag(kn, kt)` where stuck, `[[kn, 0], [s mu kn, 0]]` where it
slides. A change of `D` on some rows is one of small rank: with `U = K^-1 p` for the rows concerned
the motion is `V h + U w`, `h` the strain rate and the load.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.laws.protocol import Regime
from stability.packing.pair_frame import KN, KT, MU, frame_of
from stability.packing.pairs import Pairs
from stability.packing.state import PackingState

# Over the typical stiffness: gear modes, and grains that carry nothing (docs/theory/packing.md).
GEARS, PAIRED, RATTLERS = 1e-7, 1e-4, 1e-3
# Columns from which on the system is factorised anew, and how many there is room for.
RANK, ROOM = 96, 192
# So many are solved for at once: that of an event, and those of the next that are foreseen.
BATCH = 8
# At yield is who has all of its strength but a millionth.
AT_YIELD = 1.0 - 1e-6
# An order of elimination serves until the factors have grown by this.
FILL = 1.25
OPEN, ELASTIC, SLIDING = (int(k) for k in (Regime.OPEN, Regime.ELASTIC, Regime.SLIDING))
UNITS = np.eye(4)
STILL = np.zeros(4)


class Combination(NamedTuple):
    """Strain rate and load `h` (5,), and coefficients `w` of the columns."""

    h: Floats
    w: Floats


class Small(NamedTuple):
    """`1 + C` of the columns as eliminated, the order of its rows, sign of det, `Y` under `h`."""

    factors: Floats
    order: Integers
    sign: float
    Y: Floats

    def solved(self, right: Floats) -> Floats:
        """Under right-hand sides (m, r)."""
        from stability.compiled.packing_columns import substitute

        x = right[self.order]
        substitute(self.factors, x)
        return x


class Order(NamedTuple):
    """Places of the freedoms in the elimination, and the entries that its factors had."""

    place: Integers
    entries: int


class FrozenPacking:
    """The system at one geometry; regimes change through `set_regime`."""

    def __init__(
        self,
        state: PackingState,
        pairs: Pairs,
        regime: Regimes,
        side: Floats,
        by_radii: bool,
        load: Floats,
        before: FrozenPacking | None = None,
    ) -> None:
        # Of the interval before: its order of elimination and its room for columns.
        self.order: Order | None = before.order if before else None
        self.U: Floats = before.U if before else np.empty((ROOM, 3 * len(state.x)))
        self.frame = frame_of(state, pairs, by_radii)
        self.regime, self.side = regime, side
        self.stiffest = float(self.frame.rows[:, KN].max())
        self.count, self.length = len(state.x), float(state.radii.mean())
        self.volume = abs(float(np.linalg.det(state.cell)))
        self.load, self.drag = load, np.zeros(self.count)
        # Time to the next event of every pair, as far as it is known.
        self.due = np.full(len(pairs), np.inf)
        # Of pairs at yield: rates of the edge under each motion, of how many, on which side.
        self.edges = np.empty((len(pairs), 5 + ROOM))
        self.known, self.sided = np.zeros(len(pairs), dtype=np.int64), np.zeros(len(pairs))
        self.factorise()

    def tangent(self, c: int) -> tuple[float, float, float]:
        """`D` of a pair: its entries (n, n), (s, n), (s, s); the fourth is 0."""
        regime, frame = self.regime[c], self.frame
        kn = float(frame.rows[c, KN]) if regime != OPEN else 0.0
        slope = float(self.side[c] * frame.rows[c, MU]) if regime == SLIDING else 0.0
        return kn, slope * kn, float(frame.rows[c, KT]) if regime == ELASTIC else 0.0

    def factorise(self) -> None:
        """Take the regimes as they are for reference."""
        from stability.compiled import packing_rates as kernels

        frame, size = self.frame, 3 * self.count
        self.reference = (self.regime.copy(), self.side.copy())
        room = 36 * len(frame.rows) + size
        at, values = np.empty((2, room), dtype=np.int32), np.empty(room)
        place = np.arange(size) if self.order is None else self.order.place
        k = kernels.blocks(*frame, *self.reference, place, at, values)
        unit = float(frame.rows[:, KN].mean())
        closed = self.regime != OPEN
        degree = np.bincount(frame.grains[closed].ravel(), minlength=self.count)
        own = np.select([degree < 2, degree < 3], [RATTLERS, PAIRED], GEARS)
        springs = np.repeat(np.maximum(own, self.drag), 3) * unit
        anchor = 3 * int(np.argmax(degree))
        springs[anchor : anchor + 2] += unit
        at[:, k : k + size] = np.arange(size)
        values[k + place] = springs
        self.lu = splu(
            sparse.csc_array((values[: k + size], tuple(at[:, : k + size])), (size, size)),
            permc_spec="NATURAL" if self.order else "MMD_AT_PLUS_A",
            diag_pivot_thresh=0.001,
            options={"SymmetricMode": True},
        )
        L, U = self.lu.L, self.lu.U
        # Where a freedom's force goes, and where its motion comes from.
        self.into, self.out_of = self.lu.perm_r[place], self.lu.perm_c[place]
        if self.order is None:
            self.order = Order(self.out_of, L.nnz)
        elif L.nnz > FILL * self.order.entries:
            self.order = None
        self.factors = (L.indptr, L.indices, L.data, U.indptr, U.indices, U.data)
        self.place, right = place, np.zeros((5, size))
        for column, strain in zip(right, UNITS, strict=False):
            kernels.resultants(*frame, *self.reference, np.zeros(size), strain, column)
        right[4] = self.load
        self.V = self._solved(right)
        self.known[:] = 0
        self.small: Small | None = None
        self.rows = np.empty(ROOM, dtype=np.int64)
        self.at: dict[int, int] = {}
        self.ready: dict[int, Floats] = {}
        # Rates of the pairs of the rows: under unit strains and the load, and under the columns.
        self.base = np.empty((2, ROOM, 5))
        self.mutual = np.empty((2, ROOM, ROOM))
        self.coefficients = np.zeros((2, ROOM))
        self.stress0, self.column_stress = np.zeros((4, 5)), np.zeros((4, ROOM))
        self.stressed = 0

    def set_load(self, load: Floats) -> None:
        """Another load for the reference as it stands, without columns yet."""
        self.load = load
        self.V[4] = self._solved(load[None])[0]

    def _solved(self, right: Floats) -> Floats:
        """Motions (k, 3G) under up to eight loads."""
        x = np.zeros((right.shape[1], BATCH))
        x[self.into, : len(right)] = right.T
        return self._eight(x, 0)[: len(right)]

    def _eight(self, x: Floats, first: int) -> Floats:
        from stability.compiled.packing_columns import solve_eight

        solve_eight(*self.factors, x, first)
        return np.ascontiguousarray(x[self.out_of].T)

    def column(self, row: int) -> int:
        """Number of the column of a row, solved for if need be."""
        from stability.compiled import packing_columns as kernels

        if row not in self.at:
            k = len(self.at)
            if k == ROOM:
                raise ArithmeticError("more changes of regime at once than there is room for")
            if row not in self.ready:
                self._make_ready(row)
            self.rows[k] = row
            self.at[row] = k
            self.U[k] = self.ready.pop(row)
            pairs = self.rows[: k + 1] % len(self.frame.rows)
            kernels.mutual_rates(*self.frame, pairs, self.V, self.U, self.base, self.mutual)
        return self.at[row]

    def _make_ready(self, row: int) -> None:
        """Solve for the column of a row, and for those of the events that come next."""
        from stability.compiled.packing_columns import unit_force

        pairs = len(self.due)
        soon = np.argpartition(self.due, min(4 * BATCH, pairs - 1))[: 4 * BATCH]
        wanted = [row]
        for c in soon[np.argsort(self.due[soon])].tolist():
            # To slide is a change of the shear row, to open and to close of both.
            rows = (pairs + c,) if self.regime[c] == ELASTIC else (c, pairs + c)
            if np.isfinite(self.due[c]):
                wanted += [r for r in rows if r not in self.at and r not in self.ready and r != row]
        x = np.zeros((self.U.shape[1], BATCH))
        first = [
            unit_force(*self.frame, r, self.into, x[:, k]) for k, r in enumerate(wanted[:BATCH])
        ]
        self.ready.update(zip(wanted, self._eight(x, min(first)), strict=False))

    def set_regime(self, c: int, regime: int, side: float = 0.0) -> None:
        """Change one pair."""
        self.regime[c], self.side[c] = self.reference[0][c], self.reference[1][c]
        was = self.tangent(c)
        self.regime[c], self.side[c] = regime, side
        nn, sn, ss = (a - b for a, b in zip(self.tangent(c), was, strict=True))
        for row, change in ((c, (nn, 0.0)), (len(self.frame.rows) + c, (sn, ss))):
            if row in self.at or change != (0.0, 0.0):
                self.coefficients[:, self.column(row)] = change
                self.small = None

    def solve(self, stress: Floats, strain: Floats, rate: Floats) -> Combination:
        """Rates under `stress @ P' + strain @ H' = rate`."""
        small, h = self._small(), np.ones(5)
        if small.sign == 0.0:
            raise ArithmeticError("it is singular in these regimes")
        if stress.any():
            A, whole, _ = self._controlled(stress, strain, small.Y)
            h[:4] = np.linalg.solve(A, rate - stress @ whole[:, 4])
        else:
            h[:4] = np.linalg.solve(strain, rate)
        return Combination(h, self._padded(-small.Y @ h))

    def driven(self, stress: Floats, strain: Floats, k: int) -> Combination:
        """Rates of a unit force on a column, under a control that stands still."""
        small, h = self._small(), np.zeros(5)
        m = len(small.Y)
        x = self._padded(-small.solved(self._changes(self.mutual[:, :, k : k + 1], m))[:, 0])
        x[k] += 1.0
        if stress.any():
            A, _, columns = self._controlled(stress, strain, small.Y)
            h[:4] = np.linalg.solve(A, -stress @ (columns @ x))
            x[:m] -= small.Y @ h
        return Combination(h, x)

    def _padded(self, w: Floats) -> Floats:
        """Columns that came since have had no part in the system yet."""
        return np.concatenate([w, np.zeros(len(self.at) - len(w))])

    def _small(self) -> Small:
        """The system in the columns, eliminated once for regimes as they are."""
        from stability.compiled.packing_columns import eliminate

        if self.small is None:
            m = len(self.at)
            a, order = self._changes(self.mutual[:, :, :m], m), np.arange(m)
            sign = eliminate(a, order)
            self.small = Small(a, order, sign, np.zeros((m, 5)))
            if sign != 0.0:
                self.small.Y[:] = self.small.solved(self._changes(self.base, m))
        return self.small

    def _changes(self, rates: Floats, m: int) -> Floats:
        """Changes of the forces on the first rows by rates (2, m, r) of their pairs."""
        p, q = self.coefficients[:, :m, None]
        return np.asarray(p * rates[0, :m] + q * rates[1, :m])

    def sign(self, stress: Floats, strain: Floats) -> float:
        """Sign of the determinant, over that of the reference."""
        small = self._small()
        if not stress.any() or small.sign == 0.0:
            return small.sign
        A, _, _ = self._controlled(stress, strain, small.Y)
        return float(small.sign * np.sign(np.linalg.det(A)))

    def _controlled(
        self, stress: Floats, strain: Floats, Y: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Control's matrix; stress rates of unit strains and the load, and of the columns."""
        m = len(self.at)
        self._stress_rates(m)
        columns = self.column_stress[:, :m]
        whole = self.stress0 - columns[:, : len(Y)] @ Y
        return stress @ whole[:, :4] + strain, whole, columns

    def _stress_rates(self, m: int) -> None:
        """Of the columns that have none yet; a column's own force is part of it."""
        from stability.compiled import packing_rates as kernels

        frame = self.frame
        out = np.empty(4)
        if not self.stressed:
            for k in range(5):
                h = UNITS[k] if k < 4 else STILL
                kernels.stress_rate(*frame, *self.reference, self.V[k], h, out)
                self.stress0[:, k] = out / self.volume
        for k in range(max(self.stressed - 1, 0), m):
            kernels.stress_rate(*frame, *self.reference, self.U[k], STILL, out)
            c, shear = self.rows[k] % len(frame.rows), self.rows[k] >= len(frame.rows)
            d, n, t = frame.rows[c, :6].reshape(3, 2)
            own = np.outer(t if shear else n, d).ravel()
            self.column_stress[:, k] = (out + own) / self.volume
        self.stressed = m + 1

    def relative(self, rates: Combination, c: int) -> tuple[float, float]:
        """`n . d'` and shear rate of a pair."""
        from stability.compiled.packing_columns import rates_of

        un, ut = rates_of(*self.frame, c, self.V, self.U, *rates)
        return un, ut

    def edge(self, rates: tuple[Combination, ...], c: Integers) -> Floats:
        """`w - z` (k, r) of pairs: how fast a stuck one leaves its cone, minus the slip."""
        from stability.compiled.packing_columns import edge_rates

        h, w = (np.array(parts) for parts in zip(*rates, strict=True))
        out = np.empty((len(c), len(rates)))
        kept = self.edges, self.known, self.sided
        edge_rates(*self.frame, self.side, c, self.V, self.U, *kept, h, w, out)
        return out

    def motion(self, rates: Combination) -> Floats:
        """(3G,) freedoms."""
        return np.asarray(rates.h @ self.V + rates.w @ self.U[: len(rates.w)])

    def at_yield(self, N: Floats, T: Floats, held: Flags) -> Integers:
        """Pairs that slide, or that stand on their cone."""
        from stability.compiled.packing_rates import at_yield

        found: Integers = at_yield(self.frame.rows, self.regime, held, N, T, AT_YIELD)
        return found
