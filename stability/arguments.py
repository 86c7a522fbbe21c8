"""Checks of numbers that a caller gives."""

from __future__ import annotations

import numpy as np

from loops.errors import InputError


def whole_number(name: str, value: object, least: int) -> None:
    """Raise `InputError` unless the value is a whole number of at least so much."""
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not (whole and value >= least):  # type: ignore[operator]
        raise InputError(name, repr(value), f"a whole number, {least} or more", "Correct it.")


def number(name: str, value: object, low: float, *, open_low: bool = False) -> None:
    """Raise `InputError` unless the value is a finite number of at least (or above) so much."""
    try:
        x = float(value)  # type: ignore[arg-type]
        ok = bool(np.isfinite(x)) and (x > low if open_low else x >= low)
    except (TypeError, ValueError):
        ok = False
    if not ok:
        expected = f"a finite number {'above' if open_low else 'of at least'} {low:g}"
        raise InputError(name, repr(value), expected, "Correct it.")
