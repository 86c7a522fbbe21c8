"""Parameters of a contact law: float arrays, checked once at the door."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.errors import InputError
from loops.laws.protocol import Floats


def positive(name: str, value: ArrayLike, what: str = "stiffness") -> Floats:
    """Return positive finite parameters as an array, or raise `InputError`."""
    array = np.asarray(value, dtype=float)
    return _checked(name, array, np.isfinite(array) & (array > 0), f"a positive finite {what}")


def not_negative(name: str, value: ArrayLike) -> Floats:
    """Return finite stiffnesses, zero or more, as an array, or raise `InputError`."""
    array = np.asarray(value, dtype=float)
    ok = np.isfinite(array) & (array >= 0)
    return _checked(name, array, ok, "a finite stiffness, zero or more")


def friction(name: str, value: ArrayLike) -> Floats:
    """Return coefficients of friction, zero to inf, as an array, or raise `InputError`."""
    array = np.asarray(value, dtype=float)
    return _checked(name, array, array >= 0, "a coefficient of friction, zero or more")


def poisson_ratio(name: str, value: ArrayLike) -> Floats:
    """Return Poisson's ratios above -1, up to 0.5, as an array, or raise `InputError`."""
    array = np.asarray(value, dtype=float)
    return _checked(name, array, (array > -1) & (array <= 0.5), "a ratio above -1, up to 0.5")


def take(value: Floats, contacts: NDArray[np.int64]) -> Floats:
    """Parameters of the picked contacts; a scalar stays scalar."""
    return value if value.ndim == 0 else value[..., contacts]


def _checked(name: str, value: Floats, ok: NDArray[np.bool_], expected: str) -> Floats:
    if not ok.all():
        bad = str(value[~ok].flat[0])
        raise InputError(f"{name} of the contact law", bad, expected, "Correct it.")
    return value
