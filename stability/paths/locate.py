"""Where event functions change their sign."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from scipy.optimize import brentq

from loops.arrays import Floats, Integers

Anything = TypeVar("Anything")
# Points at which the polynomial through the samples looks for an excursion between them.
FINE = np.linspace(0.0, 1.0, 41)


def first_crossing(
    table: Floats, thetas: Floats, tolerance: Floats, values: Callable[[float], Floats]
) -> tuple[float, int] | None:
    """First place within a step where a function rises through zero, and which one.

    Excursions between the samples are looked for along the polynomial through them.
    """
    places, rows = _with_excursions(table, thetas, tolerance, values)
    for k in range(1, len(places)):
        crossed = np.flatnonzero(rows[k] > tolerance)
        if len(crossed):
            return _earliest(values, crossed, tolerance, places[k - 1 : k + 1], rows[k - 1 : k + 1])
    return None


def polish(
    at: Callable[[float], tuple[Floats, Anything, Floats]],
    which: int,
    theta: float,
    interpolated: Callable[[float], float],
) -> tuple[Floats, Anything, Floats]:
    """Correct a root of the interpolant by the integrator itself: Newton with a fixed slope."""
    low, high = max(theta - 1e-4, 0.0), min(theta + 1e-4, 1.0)
    slope = (interpolated(high) - interpolated(low)) / (high - low)
    best = at(theta)
    for _ in range(3):
        error = float(best[2][which])
        if not slope > 0 or not abs(error) > 1e-16:
            break
        moved = min(max(theta - error / slope, 0.0), 1.0)
        trial = at(moved)
        if not abs(trial[2][which]) < abs(error):
            break
        theta, best = moved, trial
    return best


def _earliest(
    values: Callable[[float], Floats],
    crossed: Integers,
    tolerance: Floats,
    places: Floats,
    rows: Floats,
) -> tuple[float, int]:
    """Earliest root of the functions that cross within an interval, and which it is.

    The root of the likeliest function bounds the interval for those that cross before it.
    """
    a, b = float(places[0]), float(places[1])
    low, high = np.minimum(rows[0, crossed], 0.0), rows[1, crossed]
    while True:
        # A function that starts above zero, by rounding, has its root at the start.
        first = int(np.argmin(-low / (high - low)))
        which = int(crossed[first])
        if not low[first] < 0:
            return a, which
        b = _root(values, which, a, b)
        here = values(b)
        earlier = np.flatnonzero((here[crossed] > tolerance[crossed]) & (crossed != which))
        if len(earlier) == 0:
            return b, which
        crossed, low, high = crossed[earlier], low[earlier], here[crossed[earlier]]


def _root(values: Callable[[float], Floats], which: int, a: float, b: float) -> float:
    try:
        return float(brentq(lambda theta: values(theta)[which], a, b, xtol=1e-15, rtol=1e-14))
    except ValueError:
        # Next to a singular state the interpolant is rough: not a number somewhere, or not of the
        # signs that its samples have.
        return _first_not_below(lambda theta: float(values(theta)[which]), a, b)


def _first_not_below(value: Callable[[float], float], a: float, b: float) -> float:
    """Halve the interval towards where the function stops being negative; nan is not negative."""
    while b - a > np.finfo(float).eps:
        middle = 0.5 * (a + b)
        a, b = (middle, b) if value(middle) < 0 else (a, middle)
    return b


def _with_excursions(
    table: Floats, thetas: Floats, tolerance: Floats, values: Callable[[float], Floats]
) -> tuple[Floats, Floats]:
    """Samples, and those places between them where a function turns out to be above zero."""
    quiet = np.flatnonzero((table <= tolerance).all(axis=0))
    if len(quiet) == 0:
        return thetas, table
    powers = np.linalg.solve(np.vander(thetas), table[:, quiet])
    peaks = np.vander(FINE, len(thetas)) @ powers
    above = np.flatnonzero((peaks > tolerance[quiet]).any(axis=0))
    places, rows = list(thetas), list(table)
    for column in above:
        theta = float(FINE[np.argmax(peaks[:, column])])
        row = values(theta)
        if row[quiet[column]] > tolerance[quiet[column]]:
            places.append(theta)
            rows.append(row)
    order = np.argsort(places, kind="stable")
    return np.asarray(places)[order], np.asarray(rows)[order]
