"""Checks of the arguments of the patterns' functions: finite float arrays in their ranges."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats
from loops.errors import InputError

Check = Callable[[str, ArrayLike], Floats]


def _checked(holds: Callable[[Floats], Flags], expected: str) -> Check:
    def check(name: str, value: ArrayLike) -> Floats:
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(name, repr(value), expected, f"Correct {name}.") from None
        for within, wanted in ((np.isfinite, "a finite number"), (holds, expected)):
            wrong = np.argwhere(~np.atleast_1d(within(array)))
            if len(wrong):
                first = tuple(wrong[0].tolist())
                where = name if array.ndim == 0 else f"{name}{list(first)}"
                received = f"{np.atleast_1d(array)[first]:.17g}"
                raise InputError(where, received, wanted, f"Correct {name}.")
        return array

    return check


# Each takes the argument's name and value, and returns a float64 array or raises `InputError`.
finite = _checked(np.isfinite, "a finite number")
nonnegative = _checked(lambda a: a >= 0.0, "zero or more")
positive = _checked(lambda a: a > 0.0, "a positive number")
acute_angle = _checked(
    lambda a: (a > 0.0) & (a < np.pi / 2),
    "an angle between 0 and pi/2 radians (0 and 90 degrees), both out",
)
# pi/2 means that nothing slides.
friction_angle = _checked(
    lambda a: (a >= 0.0) & (a <= np.pi / 2), "an angle from 0 to pi/2 radians (0 to 90 degrees)"
)
# The cost of a drained path grows with the ratio.
drained_kappa = _checked(lambda a: (a >= 0.0) & (a <= 1000.0), "a stiffness ratio from 0 to 1000")
# At 1 the side length would vanish.
strain = _checked(lambda a: a < 1.0, "a compressive strain below 1")
confining_strain = _checked(lambda a: (a >= 0.0) & (a < 1.0), "a compressive strain in [0, 1)")
sliding_sign = _checked(lambda a: np.abs(a) == 1.0, "+1 or -1, the sign of T")


def whole(name: str, value: int, least: int) -> int:
    """Return `value` as a whole number of at least `least`."""
    expected = f"a whole number of {'at least ' + str(least) if least else 'zero or more'}"
    try:
        ok = int(value) == value and value >= least
    except (TypeError, ValueError, OverflowError):
        ok = False
    if not ok:
        raise InputError(name, repr(value), expected, f"Correct {name}.")
    return int(value)
