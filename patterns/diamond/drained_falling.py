"""Yield on the elastic drained path where alpha falls, many paths at once.

With `K22 < 0` at A a growing `E1` turns the branches towards axis 1. Then N and E1 grow all the
way, and `|T| - mu N` is a concave function of the turn: Newton's method from A approaches the
first root from below and never passes it. Units as in `drained_growing`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from patterns.diamond.arguments import FloatArray
from patterns.diamond.drained_growing import PathRows
from patterns.diamond.drained_state import normal_force

_ITERATIONS = 100
_EPS = float(np.finfo(np.float64).eps)


def falling_yield(paths: PathRows) -> tuple[FloatArray, FloatArray]:
    """Turn (negative) and shear force at yield; NaN where the grains' centres meet first.

    Parameters
    ----------
    paths : PathRows
        Paths whose angle falls.

    Returns
    -------
    turn, T : ndarray (n,)

    Examples
    --------
    >>> paths = PathRows(np.array([0.5]), np.array([1.5]), np.array([0.1]), np.array([0.65]))
    >>> turn, T = falling_yield(paths)
    >>> N = normal_force(paths.alpha0 + turn, paths.f, T)
    >>> round(float(turn[0]), 5), round(float(T[0] / N[0]), 12), round(float(np.tan(0.1)), 12)
    (-0.14359, -0.100334672085, 0.100334672085)
    """
    turn, T = np.zeros_like(paths.alpha0), np.zeros_like(paths.alpha0)
    fails = np.zeros(turn.shape, dtype=bool)
    rows, active = np.arange(turn.size), paths
    for _ in range(_ITERATIONS):
        lack, slope = _lack(active, turn[rows], T[rows])
        with np.errstate(divide="ignore", invalid="ignore"):
            step = -np.where(lack > 0.0, lack / slope, 0.0)
        # Once the excess falls, or l is used up, yield is out of reach.
        alive = (step <= 0.0) & (active.alpha0 + turn[rows] + step > 0.0)
        fails[rows[~alive]] = True
        moving = alive & (-step > -4.0 * _EPS * turn[rows])
        rows, step, active = rows[moving], step[moving], active.take(moving)
        if rows.size == 0:
            break
        T[rows] = active.shear_after(turn[rows], T[rows], step)
        turn[rows] += step
    return np.where(fails, np.nan, turn), np.where(fails, np.nan, T)


def _lack(paths: PathRows, turn: FloatArray, T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`N sin(phi) - |T| cos(phi)` and the rate at which a falling angle uses it up."""
    alpha = paths.alpha0 + turn
    N = normal_force(alpha, paths.f, T)
    shear_rate = paths.kappa * (1.0 - N)
    normal_rate = (N - shear_rate) / np.tan(alpha) + T
    sin, cos = np.sin(paths.phi), _friction_cosine(paths.phi)
    return N * sin + T * cos, shear_rate * cos - normal_rate * sin


def _friction_cosine(phi: FloatArray) -> NDArray[np.float64]:
    """`cos(phi)`, exactly zero at pi/2, where nothing slides."""
    return np.where(phi == 0.5 * np.pi, 0.0, np.cos(phi))
