"""The limit of strain control on the elastic drained path: `K22 = 0`, where `E1` stops growing.

Where alpha falls, K22 stays negative. Where it grows from A, K22 can reach zero only if
`kappa > 3`: at such a point `T >= 3 l tan(alpha)`, while balance keeps `T < kappa l tan(alpha)`.
"""

from __future__ import annotations

import numpy as np

from patterns.diamond.arguments import FloatArray
from patterns.diamond.drained_growing import PathRows
from patterns.diamond.drained_state import turning_stiffness

_SAMPLES = 256
_BISECTIONS = 60
_SMALLEST_KAPPA = 3.0


def strain_limit(paths: PathRows, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Turn and shear force at the first `K22 = 0` between A and `end`; NaN where there is none.

    The path is sampled at 256 angles, evenly in `ln tan(alpha/2)`: a K22 that dips below zero
    between two of them goes unseen.

    Parameters
    ----------
    paths : PathRows
        Paths whose angle grows.
    end : ndarray (n,)
        Turn up to which to look, radians.

    Returns
    -------
    turn, T : ndarray (n,)

    Examples
    --------
    >>> paths = PathRows(np.array([0.1]), np.array([6.0]), np.array([1.5]), np.array([0.1]))
    >>> turn, T = strain_limit(paths, np.array([1.0]))
    >>> round(float(turn[0]), 5)
    0.18581
    """
    turn, T = np.full_like(end, np.nan), np.full_like(end, np.nan)
    rows = np.flatnonzero(paths.kappa > _SMALLEST_KAPPA)
    paths, end = paths.take(rows), end[rows]
    last_turn, last_T = np.zeros_like(end), np.zeros_like(end)
    half_tan = np.tan(0.5 * paths.alpha0)
    growth = np.log(np.tan(0.5 * (paths.alpha0 + end)) / half_tan) / _SAMPLES
    for sample in range(1, _SAMPLES + 1):
        goal = 2.0 * np.arctan(half_tan * np.exp(sample * growth)) - paths.alpha0
        goal_T = paths.shear_after(last_turn, last_T, goal - last_turn)
        below = _stiffness(paths, goal, goal_T) < 0.0
        if below.any():
            found = rows[below]
            turn[found], T[found] = _bisect(
                paths.take(below), last_turn[below], last_T[below], goal[below]
            )
            rows, paths = rows[~below], paths.take(~below)
            half_tan, growth, goal, goal_T = (x[~below] for x in (half_tan, growth, goal, goal_T))
        last_turn, last_T = goal, goal_T
    return turn, T


def _bisect(
    paths: PathRows, low: FloatArray, low_T: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The zero of K22 between `low`, where it is positive, and `high`."""
    start, start_T = low, low_T
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        T = paths.shear_after(start, start_T, middle - start)
        below = _stiffness(paths, middle, T) < 0.0
        low, high = np.where(below, low, middle), np.where(below, middle, high)
    return low, paths.shear_after(start, start_T, low - start)


def _stiffness(paths: PathRows, turn: FloatArray, T: FloatArray) -> FloatArray:
    return turning_stiffness(paths.alpha0 + turn, paths.f, T, paths.kappa)
