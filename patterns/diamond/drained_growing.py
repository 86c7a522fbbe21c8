"""Yield on the elastic drained path where alpha grows, many paths at once.

Arrays are rows (n,) of one path each; lengths over `l0`, forces over `kn l0`, radians. With
`f = F2/(2 kn l0)` yield `T = mu N` reads `T sin(alpha - phi) = f sin(phi)`. The left side rises
from the larger of `alpha0` and `phi` on, because `T' = kappa l`: at most one root.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from patterns.diamond.arguments import FloatArray
from patterns.diamond.drained_shear import advance_shear
from patterns.diamond.drained_state import normal_force

_ITERATIONS = 100
# The last step of Newton's method squares this error.
_CLOSE = 1e-8

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class PathRows:
    """Elastic drained paths as rows: `alpha0`, `kappa`, `phi`, `confinement` of shape (n,)."""

    alpha0: FloatArray
    kappa: FloatArray
    phi: FloatArray
    confinement: FloatArray

    @property
    def f(self) -> FloatArray:
        """Half the lateral force, `F2/(2 kn l0)`."""
        return self.confinement * np.sin(self.alpha0)

    def take(self, rows: Rows | NDArray[np.bool_] | slice) -> PathRows:
        """The picked rows."""
        return PathRows(self.alpha0[rows], self.kappa[rows], self.phi[rows], self.confinement[rows])

    def shear_after(self, turn: FloatArray, T: FloatArray, step: FloatArray) -> FloatArray:
        """Shear force at `turn + step`, from `T` at `turn`."""
        return advance_shear(T, self.alpha0 + turn, step, self.f, self.kappa)


def growing_yield(paths: PathRows) -> tuple[FloatArray, FloatArray]:
    """Turn and shear force at yield; NaN where 90 degrees comes first.

    Newton's method inside a shrinking bracket. The shear force is carried from iterate to iterate
    by short quadratures and integrated anew from A for the last step.

    Parameters
    ----------
    paths : PathRows
        Paths whose angle grows.

    Returns
    -------
    turn, T : ndarray (n,)

    Examples
    --------
    Without lateral force `T = N tan(alpha)`, so that yield stands at `alpha = phi`:

    >>> paths = PathRows(np.array([0.4]), np.array([0.3]), np.array([0.5]), np.zeros(1))
    >>> turn, T = growing_yield(paths)
    >>> round(float(turn[0]), 12)
    0.1
    """
    low, ceiling = np.maximum(paths.phi - paths.alpha0, 0.0), 0.5 * np.pi - paths.alpha0
    bracket = _Bracket(low, ceiling.copy(), ceiling, np.zeros(low.shape, dtype=bool))
    turn = np.clip(_first_guess(paths), low, ceiling)
    T = paths.shear_after(np.zeros_like(turn), np.zeros_like(turn), turn)
    rows, active = np.arange(turn.size), paths
    for _ in range(_ITERATIONS):
        excess, slope = _excess(active, turn[rows], T[rows])
        goal = bracket.next_turn(rows, turn[rows], excess, slope)
        moving = np.abs(goal - turn[rows]) > _CLOSE * goal
        rows, goal, active = rows[moving], goal[moving], active.take(moving)
        if rows.size == 0:
            break
        T[rows] = active.shear_after(turn[rows], T[rows], goal - turn[rows])
        turn[rows] = goal
    turn[bracket.fails] = np.nan
    return _last_step(paths, turn)


@dataclass(frozen=True, eq=False)
class _Bracket:
    """Bounds of the root; `high` counts only once an iterate there or below had an excess."""

    low: FloatArray
    high: FloatArray
    ceiling: FloatArray
    closed: NDArray[np.bool_]

    @property
    def fails(self) -> NDArray[np.bool_]:
        return ~self.closed & (self.low >= self.ceiling)

    def next_turn(
        self, rows: Rows, turn: FloatArray, excess: FloatArray, slope: FloatArray
    ) -> FloatArray:
        """Take in an iterate; return Newton's next, or one that surely shrinks the bracket."""
        below = excess < 0.0
        self.low[rows] = np.where(below, turn, self.low[rows])
        self.high[rows] = np.where(below, self.high[rows], turn)
        self.closed[rows] |= ~below
        low, high = self.low[rows], self.high[rows]
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = turn - excess / slope
        inside = (newton >= low) & (newton <= high)
        middle = 0.5 * (low + high)
        return np.where(inside, newton, np.where(self.closed[rows], middle, high))


def _excess(paths: PathRows, turn: FloatArray, T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`T sin(alpha - phi) - f sin(phi)` and its derivative."""
    alpha, f = paths.alpha0 + turn, paths.f
    over = alpha - paths.phi
    length = 1.0 - normal_force(alpha, f, T)
    slope = paths.kappa * length * np.sin(over) + T * np.cos(over)
    return T * np.sin(over) - f * np.sin(paths.phi), slope


def _first_guess(paths: PathRows) -> FloatArray:
    """Root of the excess with `T = kappa (1 - E) turn` and `sin` of the turn to first order."""
    stiffness = paths.kappa * (1.0 - paths.confinement)
    over = paths.alpha0 - paths.phi
    half, need = 0.5 * stiffness * np.sin(over), paths.f * np.sin(paths.phi)
    root = np.sqrt(half**2 + stiffness * np.cos(over) * need)
    with np.errstate(divide="ignore", invalid="ignore"):
        rising = need / (half + root)
        falling = (root - half) / (stiffness * np.cos(over))
    return np.nan_to_num(np.where(half > 0.0, rising, falling), nan=np.inf)


def _last_step(paths: PathRows, turn: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shear force integrated from A in one go, and one Newton step with it."""
    T = np.full_like(turn, np.nan)
    found = np.flatnonzero(np.isfinite(turn))
    paths, start = paths.take(found), turn[found]
    shear = paths.shear_after(np.zeros_like(start), np.zeros_like(start), start)
    excess, slope = _excess(paths, start, shear)
    step = -excess / np.where(slope > 0.0, slope, np.inf)
    step = np.maximum(step, -start)
    turn[found] = start + step
    T[found] = paths.shear_after(start, shear, step)
    return turn, T
