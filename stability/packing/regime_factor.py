"""Rates of a packing with frozen geometry in any regimes, from one factorisation.

Every pair has a normal and a shear rate `q = (un', ut')`, and its force changes by `-D q`: `D` is
0 where it is open, `diag(kn, kt)` where it sticks, `[[kn, 0], [s mu kn, 0]]` where it slides. A
change of `D` in some rows is one of small rank: with the columns `U = K^-1 p` of these rows the
motion is `V h + U w`, `h` being the strain rate and the load.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.linalg import lapack

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.contacts import AT_YIELD, Contacts
from loops.laws.frictional import Regime
from loops.system import REGULARISATION
from stability.factor import Edge
from stability.programmes import MixedControl
from stability.regimes import SlipProblem, agreeing

if TYPE_CHECKING:
    from stability.compiled.packing_system import Order

# Columns from which on the system is factorised anew; from half of the room on it always is.
RANK = 96
# Columns that there is room for: an event may bring many at once.
ROOM = 192
# Right-hand sides that are solved together: that of an event and those of the next likely ones.
BATCH = 8
# Rates of the wrong sign below this share of the largest of all contacts are rounding.
RATE_RTOL = 1e-9
# Regimes as plain numbers, as the array of regimes holds them.
OPEN = int(Regime.OPEN)
ELASTIC = int(Regime.ELASTIC)
SLIDING = int(Regime.SLIDING)


class Small(NamedTuple):
    """Columns whose forces have changed, and factors of their matrix `1 + C`, sign of its det.

    `Y` (k, 5) are its solutions for unit strains and the load.
    """

    columns: Integers
    factors: Floats
    pivots: Integers
    sign: float
    Y: Floats


# Factors, pivots, sign and solutions without a column.
NONE = np.eye(0), np.zeros(0, dtype=np.int64), 1.0, np.zeros((0, 5))


class RegimeFactor:
    """A factor of `K` in reference regimes, and `K` in other ones through its columns.

    `frame` are the records of the pairs, with springs as over `reach`, then of their springs
    against rolling if there are any; `regime` and `side` of each its regime and the sign of its
    slip, `time_to_event` as far as known. `set_regime` changes them.
    """

    def __init__(
        self,
        state: Contacts,
        regime: Regimes,
        side: Floats,
        reach: float = 0.0,
        order: Order | None = None,
    ) -> None:
        freedoms = 3 * len(state.x)
        # Under unit strains and the load, then of the columns.
        self.order, self.motions = order, np.empty((5 + ROOM, freedoms))
        self.frame, self.reach = state.records(reach), reach
        self.regime, self.side, self.pair_count = regime.copy(), side.copy(), len(state.contacts)
        self.stiffest = float(self.frame["kn"].max())
        self.count, self.length = len(state.x), state.mean_radius
        self.walls = self.count - state.count
        self.volume = abs(float(np.linalg.det(state.cell)))
        self.load = np.zeros(freedoms)
        # Walls stand still.
        self.ground_spring = np.where(np.arange(self.count) < state.count, 0.0, np.inf)
        self.time_to_event = np.full(len(self.frame), np.inf)
        # `n . d'` and shear rates of pairs under so many of the motions.
        self.pair_rates = np.empty((2, len(self.frame), 5 + ROOM))
        self.motion_count = np.zeros(len(self.frame), dtype=np.int64)
        self.factorise()

    def rounding(self, rates: Floats) -> float:
        """Return the rate of the yield function below which it is rounding."""
        size = float(np.abs(rates[:4]).max())
        return RATE_RTOL * (size * self.stiffest * 2.0 * self.length)

    def tangent(self, c: int, regime: int, side: float) -> tuple[float, float, float]:
        """Return `D` of a pair in a regime: entries (n, n), (s, n), (s, s); the fourth is 0."""
        pair = self.frame[c]
        kn = float(pair["kn"]) if regime != OPEN else 0.0
        push = float(pair["push"]) * kn
        if regime == ELASTIC:
            return push, float(pair["coupling"]), float(pair["kt"])
        slope = float(side * pair["mu"]) if regime == SLIDING else 0.0
        return push, slope * kn, 0.0

    def factorise(self) -> None:
        """Factorise the system in its present regimes: the reference without any column."""
        from stability.compiled.packing_system import factorise, stiffnesses

        self.reference = (self.regime.copy(), self.side.copy())
        closed = self.regime[: self.pair_count] != OPEN
        self.touched: Flags = np.zeros(self.count, dtype=bool)
        self.touched[self.frame["grains"][: self.pair_count][closed]] = True
        springs = np.maximum(REGULARISATION, self.ground_spring)[:, None]
        ends, elements = stiffnesses(self.frame, *self.reference)
        springs = springs * np.full(3, self.frame["kn"].mean())
        d = self.frame["d"][self.regime != OPEN]
        self.factors = factorise(ends, elements, d, springs, self.order)
        self.order = self.factors.order
        if not self.factors.regular:
            raise ArithmeticError("it is singular in these regimes")
        self.motions[:4] = self._relative(self.factors.motions(self.factors.strained[0].T))
        self.set_load(self.load)

    def set_load(self, load: Floats) -> None:
        """Replace the load, in the reference regimes."""
        self.load = load
        # On grains with contacts; in a cell without the resultant of all.
        held = self._relative(np.where(np.repeat(self.touched, 3), load, 0.0)[None])
        self.motions[4] = self._relative(self.factors.motions(held.T))[0] if held.any() else 0.0
        # Forget the columns, and rates and stresses under them and the load before.
        self.motion_count[:] = 0
        self.small: Small | None = None
        self.at: dict[int, int] = {}
        self.ready: dict[int, Floats] = {}
        self.coefficients, self.unit_stress = np.zeros((2, ROOM)), np.empty((4, 5 + ROOM))
        # Stress rates under each of the motions, and its strain or force.
        self.unit_stress[:, :5] = self._stress(self.motions[:5])
        self.unit_stress[:, :4] += self.factors.affine / self.volume

    def _stress(self, motions: Floats) -> Floats:
        """Return stress rates (4, k) of motions (k, 3B) in the reference regimes."""
        return self.factors.stress(motions) / self.volume

    def _relative(self, motions: Floats) -> Floats:
        """Take the mean of the grains with contacts from motions (k, 3B); walls hold the others.

        Nothing but the weak springs resists it in a cell: it is the rounding of loads over them.
        """
        if not self.walls and self.touched.any():
            of_grains = motions.reshape(len(motions), -1, 3)[:, :, :2]
            mean = np.einsum("kgx,g->kx", of_grains, self.touched) / self.touched.sum()
            of_grains -= mean[:, None] * self.touched[:, None]
        return motions

    def add_ground_springs(self, grains: Integers, spring: float) -> None:
        """Hold grains by springs of at least `spring` times the mean kn."""
        self.ground_spring[grains] = np.maximum(self.ground_spring[grains], spring)
        self.factorise()

    def column(self, row: int) -> int:
        """Return the number of the column of a row, which is solved for if it is new."""
        if row not in self.at:
            k = len(self.at)
            if k == ROOM:
                raise ArithmeticError("more changes of regime at once than there is room for")
            if row not in self.ready:
                rows, time, pairs = [row], self.time_to_event, len(self.frame)
                # With it the rows that change at the events that come next.
                soon = np.argpartition(time, min(4 * BATCH, pairs - 1))[: 4 * BATCH]
                for c in soon[np.argsort(time[soon])].tolist():
                    # Yield changes the shear row, opening and closing change both.
                    if np.isfinite(time[c]):
                        sheared = self.regime[c] == ELASTIC or c >= self.pair_count
                        rows += (pairs + c,) if sheared else (c, pairs + c)
                self._solve_ahead(rows)
            self.at[row], self.small = k, None
            self.motions[5 + k] = self.ready.pop(row)
            pair = self.frame[row % len(self.frame)]
            own = np.outer(pair["t"] if row >= len(self.frame) else pair["n"], pair["d"]).ravel()
            self.unit_stress[:, 5 + k] = self._stress(self.motions[5 + k]) + own / self.volume
        return self.at[row]

    def _solve_ahead(self, rows: list[int]) -> None:
        """Solve for the columns of the first eight of these rows that have none."""
        new = [r for r in dict.fromkeys(rows) if r not in self.at and r not in self.ready][:BATCH]
        motions = self._relative(self.factors.motions_of_rows(self.frame, np.array(new)))
        self.ready.update(zip(new, motions, strict=True))

    def set_regime(self, c: int, regime: int, side: float = 0.0) -> None:
        """Change the regime of a pair, and the sign of its slip."""
        regimes, sides = self.reference
        self.regime[c], self.side[c] = regime, side
        now, was = self.tangent(c, regime, side), self.tangent(c, regimes[c], sides[c])
        nn, sn, ss = (a - b for a, b in zip(now, was, strict=True))
        for row, change in ((c, (nn, 0.0)), (len(self.frame) + c, (sn, ss))):
            if row in self.at or change != (0.0, 0.0):
                self.coefficients[:, self.column(row)] = change
                self.small = None

    def set_regimes(self, contacts: Integers, regimes: Regimes | int) -> None:
        """Change the regimes of many pairs at once, and factorise anew."""
        self.regime[contacts] = regimes
        self.factorise()

    def flip(self, c: int) -> None:
        """Make a stuck contact slide on its side, or a sliding one stick."""
        self.set_regime(c, SLIDING if self.regime[c] == ELASTIC else ELASTIC, self.side[c])

    def solve(self, control: MixedControl) -> Floats:
        """Return rates `x` under a control: strain rate (4,), 1 for the load, and of the columns.

        The motion is that of the `motions` times `x`.
        """
        small, x = self._small(), np.zeros(5 + len(self.at))
        if small.sign == 0.0:
            raise ArithmeticError("it is singular in these regimes")
        stress, x[4] = self._stress_of_strain(small), 1.0
        x[:4] = control.strains(stress[:, :4], stress[:, 4])
        x[5 + small.columns] = -small.Y @ x[:5]
        return x

    def driven(self, control: MixedControl, column: int) -> Floats:
        """Return rates under a unit force on the row of a column, at a control that stands."""
        small, x = self._small(), np.zeros(5 + len(self.at))
        x[5 + column] = 1.0
        if len(small.columns):
            changes = self._changes(small.columns, np.array([5 + column]))
            solution = lapack.dgetrs(small.factors, small.pivots, changes)[0][:, 0]
            x[5 + small.columns] -= solution
        if control.stress.any():
            still = control._replace(rate=np.zeros(4))
            x[:4] = still.strains(self._stress_of_strain(small)[:, :4], self.stress(x))
            x[5 + small.columns] -= small.Y @ x[:5]
        return x

    def _small(self) -> Small:
        """Return the system in the columns, eliminated once for the present regimes."""
        if self.small is None:
            columns = np.flatnonzero(self.coefficients.any(axis=0))
            self.small, m = Small(columns, *NONE), len(columns)
            if m:
                changes = self._changes(columns, np.concatenate([np.arange(5), 5 + columns]))
                lu, pivots, _ = lapack.dgetrf(np.eye(m) + changes[:, 5:])
                swaps = np.count_nonzero(pivots != np.arange(m))
                sign = float(np.prod(np.sign(np.diag(lu)))) * (-1.0) ** swaps
                Y = lapack.dgetrs(lu, pivots, changes[:, :5])[0] if sign else np.zeros((m, 5))
                self.small = Small(columns, lu, pivots, sign, Y)
        return self.small

    def _changes(self, columns: Integers, motions: Integers) -> Floats:
        """Return changes of the forces on the rows of columns by motions, of their pairs."""
        pairs = np.array(list(self.at))[columns] % len(self.frame)
        un, ut = self._known(pairs, 5 + len(self.at))[:, pairs[:, None], motions]
        p, q = self.coefficients[:, columns, None]
        return np.asarray(p * un + q * ut)

    def _known(self, pairs: Integers, motions: int) -> Floats:
        """Return `pair_rates`, for these pairs known under so many motions."""
        from stability.compiled.packing_rates import pair_rates

        pair_rates(self.frame, pairs, self.motions[:motions], self.pair_rates, self.motion_count)
        return self.pair_rates

    def sign(self, control: MixedControl) -> float:
        """Return the sign of the determinant under a control, over that of the reference."""
        small = self._small()
        if not control.stress.any() or small.sign == 0.0:
            return small.sign
        stress = self._stress_of_strain(small)[:, :4]
        return float(small.sign * np.sign(np.linalg.det(control.matrix(stress))))

    def _stress_of_strain(self, small: Small) -> Floats:
        """Return stress rates (4, 5) of unit strains and the load in the present regimes."""
        columns = self.unit_stress[:, 5 + small.columns]
        return np.asarray(self.unit_stress[:, :5] - columns @ small.Y)

    def stress(self, rates: Floats) -> Floats:
        """Return the stress rate (4,) in the present regimes."""
        return np.asarray(self.unit_stress[:, : len(rates)] @ rates)

    def relative(self, rates: Floats, c: int) -> tuple[float, float]:
        """Return `n . d'` and the shear rate of a pair."""
        un, ut = self._known(np.array([c]), len(rates))[:, c, : len(rates)] @ rates
        return float(un), float(ut)

    def edge(self, rates: Sequence[Floats], c: Integers) -> Floats:
        """Return `w - z` (k, r) of pairs: rate of the yield function if stuck, minus slip rate."""
        x = np.array(rates)
        return self._yield(c, self._known(c, x.shape[1])[:, c, : x.shape[1]] @ x.T)

    def _yield(self, c: Integers, rates: Floats) -> Floats:
        """Return rates of the yield function (k, r) of stuck pairs from rates (2, k, r)."""
        un, ut = rates
        names = "kn", "kt", "mu", "coupling"
        kn, kt, mu, coupling = (self.frame[name][c][:, None] for name in names)
        return np.asarray(self.side[c][:, None] * (kt * ut + coupling * un) - mu * kn * un)

    def problem(self, control: MixedControl, contacts: Integers) -> tuple[Floats, Floats]:
        """Return `q` and `M` of contacts at yield on their sides; slips are times stiffness."""
        from stability.compiled.packing_rates import pair_rates

        sliding, m = contacts[self.regime[contacts] == SLIDING], len(contacts)
        self.set_regimes(sliding, ELASTIC)
        rows = len(self.frame) + contacts
        units = self._relative(self.factors.motions_of_rows(self.frame, rows))
        pairs, side, rates = self.frame[contacts], self.side[contacts], np.empty((2, m, 5 + m))
        motions = np.vstack([self.motions[:5], units])
        pair_rates(pairs, np.arange(m), motions, rates, np.zeros(m, dtype=np.int64))
        leaving, stress = self._yield(contacts, rates), self.unit_stress[:, :5]
        own = np.einsum("ki,kj->ijk", pairs["t"], pairs["d"]).reshape(4, m) / self.volume
        # A force -s on the shear row is one unit of slip.
        of_slip = np.eye(m) - side * leaving[:, 5:], -side * (self._stress(units) + own)
        parts = leaving[:, :4], of_slip[0], stress[:, :4], of_slip[1], units.T
        found = Edge(*parts, 0.0, leaving[:, 4], stress[:, 4]).problem(control)
        self.set_regimes(sliding, SLIDING)
        return found

    def motion(self, rates: Floats) -> Floats:
        """Return the motion (3G,) of all freedoms."""
        return np.asarray(rates @ self.motions[: len(rates)])

    def at_yield(self, N: Floats, T: Floats, held: Flags) -> Integers:
        """Return pairs that slide or stand on the friction limit, but for held ones."""
        mu, cohesion = self.frame["mu"], self.frame["cohesion"]
        most, rough = mu * N + cohesion, (mu > 0) | (cohesion > 0)
        stuck = (self.regime == ELASTIC) & (most > 0) & (np.abs(T) >= AT_YIELD * most)
        return np.flatnonzero(rough & ~held & (stuck | (self.regime == SLIDING)))


# Grains that move by more than this share of the largest displacement are in an unstable mode.
MODE_SHARE = 0.1
# Changes of regime within one pivot.
PIVOT_STEPS = 40


def unstable_mode(motion: Floats, turns: bool) -> dict[str, Any]:
    """Facts of a motion that nothing stops, as `Event` has them: its grains, and what det K does.

    `turns` tells whether det K changes sign.
    """
    square = np.sum(motion.reshape(-1, 3)[:, :2] ** 2, axis=1)
    size = np.linalg.norm(motion.reshape(-1, 3), axis=1)
    return {
        "taking_part": float(square.sum() ** 2 / max(float(np.sum(square**2)), 1e-300)),
        "sign_changes": turns,
        "grains": tuple(np.flatnonzero(size > MODE_SHARE * size.max()).tolist()),
    }


def pivot(
    packing: RegimeFactor,
    control: MixedControl,
    c: int,
    critical: Integers,
    rounding: float,
) -> tuple[list[int] | None, dict[str, Any]]:
    """Bring one contact at yield to agree with its rates; all pairs that changed regime.

    The method of Cottle and Dantzig: the slip rate of the contact (or the distance of its rates
    from the cone) is raised from zero until it agrees with its regime, and others change regime
    where they would disagree. `critical` are the pairs at yield that agree, or have an event to
    come. Where that meets no end regimes are as before: None, and the facts of `unstable_mode`.
    """
    others = critical[critical != c]
    every = np.append(others, c)
    changed: list[int] = []
    column = packing.column(len(packing.frame) + c)
    raised, base = 0.0, packing.solve(control)
    for _ in range(PIVOT_STEPS):
        unit = packing.driven(control, column)
        # A force -s on the shear row is one unit of slip, or of the distance from the cone.
        push = -packing.side[c]
        value, along = packing.edge((base, unit), every).T
        sticks = np.where(packing.regime[every] == ELASTIC, 1.0, -1.0)
        value, along = sticks * value, push * sticks * along
        along[-1] += 1.0
        now = value + raised * along
        if now[-1] >= -rounding:
            packing.flip(c)
            return [*changed, c], {}
        own = raised - now[-1] / along[-1] if along[-1] > 1e-12 else np.inf
        falls = (along[:-1] < -1e-12) & (now[:-1] > -rounding)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(falls, raised + np.maximum(now[:-1], 0.0) / -along[:-1], np.inf)
        if changed:
            reach[others == changed[-1]] = np.inf
        k = int(np.argmin(reach)) if len(reach) else -1
        if k >= 0 and reach[k] < own:
            raised = float(reach[k])
            packing.flip(int(others[k]))
            base = packing.solve(control)
            changed.append(int(others[k]))
        elif np.isfinite(own):
            packing.flip(c)
            return [*changed, c], {}
        else:
            break
    for other in changed:
        packing.flip(other)
    turns = packing.sign(control)
    packing.flip(c)
    turns *= packing.sign(control)
    packing.flip(c)
    return None, unstable_mode(packing.motion(unit), bool(turns < 0))


def seek(
    packing: RegimeFactor, control: MixedControl, contacts: Integers, rounding: float
) -> tuple[list[int] | None, str]:
    """Seek regimes of all contacts at yield that agree, where a pivot meets no end.

    All that changed regime, or None and the cause: a proof that there are none, or not.
    """
    found = agreeing(SlipProblem(*packing.problem(control, contacts), low=rounding))
    if not found.solutions:
        return None, "no_regimes" if found.proof else "none_found"
    active = found.taken.rates
    changed = contacts[active != (packing.regime[contacts] == SLIDING)].tolist()
    packing.set_regimes(contacts, np.where(active, SLIDING, ELASTIC))
    return changed, ""


def disagreeing(
    packing: RegimeFactor, rates: Floats, critical: Integers, rounding: float
) -> Integers:
    """Pairs at yield whose regime disagrees with their rates, the worst first."""
    sticks = np.where(packing.regime[critical] == ELASTIC, 1.0, -1.0)
    value = sticks * packing.edge((rates,), critical)[:, 0]
    wrong = np.flatnonzero(value < -rounding)
    return critical[wrong[np.argsort(value[wrong])]]
