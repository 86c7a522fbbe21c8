"""The error that bad input raises, and checks of the numbers that a caller gives."""

from __future__ import annotations

import errno
import math
from numbers import Integral

# What the system and libraries say where memory for a thread or a library is used up.
NO_MEMORY = (
    *("can't start new thread", "failed to launch worker thread"),
    *("failed to map segment", "cannot allocate memory"),
)


class InputError(ValueError):
    """Bad input, said in one line: what was received, where, what was expected, what to do.

    Parameters
    ----------
    where : str
        The place of the fault: a file, a column, a grain, a contact, an argument.
    received : str
        What stood there.
    expected : str
        What should have stood there.
    remedy : str
        What the user can do about it.

    Examples
    --------
    >>> from loops import InputError
    >>> str(InputError("radius of grain 3", "-0.1", "a positive length", "Correct the file."))
    'radius of grain 3: got -0.1, expected a positive length. Correct the file.'
    """

    def __init__(self, where: str, received: str, expected: str, remedy: str) -> None:
        # The arguments as they came: so the error can be sent between processes.
        super().__init__(where, received, expected, remedy)
        self.where = where
        self.received = received
        self.expected = expected
        self.remedy = remedy

    def __str__(self) -> str:
        message = f"{self.where}: got {self.received}, expected {self.expected}. {self.remedy}"
        return " ".join(message.split())


def out_of_memory(error: BaseException) -> bool:
    """Whether an error says that the memory is used up, in whatever words."""
    if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM:
        return True
    return any(words in str(error).lower() for words in NO_MEMORY)


def whole_number(name: str, value: object, least: int) -> None:
    """Raise `InputError` unless the value is a whole number of at least so much."""
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not (whole and value >= least):  # type: ignore[operator]
        raise InputError(name, repr(value), f"a whole number, {least} or more", "Correct it.")


def number(name: str, value: object, low: float, *, open_low: bool = False) -> None:
    """Raise `InputError` unless the value is a finite number of at least (or above) so much."""
    try:
        x = float(value)  # type: ignore[arg-type]
        ok = math.isfinite(x) and (x > low if open_low else x >= low)
    except (TypeError, ValueError):
        ok = False
    if not ok:
        expected = f"a finite number {'above' if open_low else 'of at least'} {low:g}"
        raise InputError(name, repr(value), expected, "Correct it.")


def check_choice(name: str, value: object, choices: tuple[object, ...]) -> None:
    """Raise `InputError` unless `value` is one of the choices."""
    if value not in choices:
        *others, last = map(str, choices)
        expected = f"{', '.join(others)} or {last}"
        raise InputError(name, repr(value), expected, "Pick one of these.")
