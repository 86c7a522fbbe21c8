"""Arguments of the diamond's functions: float arrays, checked once at the door."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.errors import InputError

FloatArray = NDArray[np.float64]


def finite(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as a float64 array, every entry finite.

    Examples
    --------
    >>> finite("E1", 0.25).tolist()
    0.25
    """
    array = np.asarray(value, dtype=np.float64)
    _demand(np.isfinite(array), name, array, "a finite number")
    return array


def nonnegative(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as a finite float64 array, every entry zero or more."""
    array = finite(name, value)
    _demand(array >= 0.0, name, array, "zero or more")
    return array


def positive(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as a finite float64 array, every entry above zero."""
    array = finite(name, value)
    _demand(array > 0.0, name, array, "a positive number")
    return array


def acute_angle(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as angles strictly between 0 and 90 degrees, in radians."""
    array = finite(name, value)
    inside = (array > 0.0) & (array < np.pi / 2)
    _demand(inside, name, array, "an angle between 0 and pi/2 radians (0 and 90 degrees), both out")
    return array


def friction_angle(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as friction angles in [0, pi/2] radians; pi/2 means that nothing slides."""
    array = finite(name, value)
    inside = (array >= 0.0) & (array <= np.pi / 2)
    _demand(inside, name, array, "an angle from 0 to pi/2 radians (0 to 90 degrees)")
    return array


def drained_kappa(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as stiffness ratios in [0, 1000]; the cost of a drained path grows with it."""
    array = finite(name, value)
    _demand((array >= 0.0) & (array <= 1000.0), name, array, "a stiffness ratio from 0 to 1000")
    return array


def strain(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as compressive strains below 1, where the side length would vanish."""
    array = finite(name, value)
    _demand(array < 1.0, name, array, "a compressive strain below 1")
    return array


def confining_strain(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as isotropic compressive strains in [0, 1)."""
    array = finite(name, value)
    _demand((array >= 0.0) & (array < 1.0), name, array, "a compressive strain in [0, 1)")
    return array


def sliding_sign(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as the sign of T in a sliding contact, every entry +1 or -1."""
    array = finite(name, value)
    _demand(np.abs(array) == 1.0, name, array, "+1 or -1, the sign of T")
    return array


def _demand(holds: NDArray[np.bool_], name: str, array: FloatArray, expected: str) -> None:
    if np.all(holds):
        return
    first = tuple(int(i) for i in np.argwhere(~np.atleast_1d(holds))[0])
    where = name if array.ndim == 0 else f"{name}{list(first)}"
    value = np.atleast_1d(array)[first]
    raise InputError(where, f"{value:.17g}", expected, f"Correct {name}.")
