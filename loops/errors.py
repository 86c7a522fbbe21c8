"""The error that bad input raises, checks of the numbers that a caller gives, words of messages."""

from __future__ import annotations

import errno
import math
import os
import reprlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from numbers import Integral, Number, Real
from pathlib import Path
from string import Formatter
from typing import Any

# What the system and libraries say where memory for a thread or a library is used up.
NO_MEMORY = (
    *("can't start new thread", "failed to launch worker thread"),
    *("failed to map segment", "cannot allocate memory"),
)
SHORT = reprlib.Repr()
SHORT.maxstring = SHORT.maxother = 80


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


@contextmanager
def library(where: str, name: str, extra: str = "") -> Iterator[None]:
    """Raise `InputError` with the remedy if a library that is imported here is not installed."""
    try:
        yield
    except ImportError:
        remedy = f"Install it: pip install {extra or name}."
        raise InputError(where, f"no {name}", f"{name}, installed", remedy) from None


def out_of_memory(error: BaseException) -> bool:
    """Whether an error says that the memory is used up, in whatever words."""
    if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM:
        return True
    return any(words in str(error).lower() for words in NO_MEMORY)


def whole_number(name: str, value: Any, least: int) -> int:
    """Return a whole number of at least so much, or raise `InputError`."""
    x = plain(value)
    if not isinstance(x, Integral) or x < least:
        raise InputError(name, short(value), f"a whole number, {least} or more", f"Correct {name}.")
    return int(x)


def number(
    name: str, value: Any, low: float = -math.inf, high: float = math.inf, *,
    open_low: bool = False, open_high: bool = False,
) -> float:  # fmt: skip
    """Return a finite number between bounds that are out of the range or not, or `InputError`."""
    x = plain(value)
    x = float(x) if isinstance(x, Real) else math.nan
    inside = math.isfinite(x) and low <= x <= high
    if not inside or (open_low and x == low) or (open_high and x == high):
        least = "" if low == -math.inf else f" {'above' if open_low else 'of at least'} {low:g}"
        most = "" if high == math.inf else f", {'below' if open_high else 'at most'} {high:g}"
        raise InputError(name, short(value), f"a finite number{least}{most}", f"Correct {name}.")
    return x


def plain(value: Any) -> Any:
    """Return a value, or that of an array without axes; None for true and false."""
    x = value.item() if getattr(value, "shape", None) == () else value
    return None if isinstance(x, bool) else x


def check_choice(name: str, value: Any, choices: Iterable[object]) -> None:
    """Raise `InputError` unless `value` is one of the choices."""
    known = tuple(choices)
    kinds = tuple(map(type, known))
    of_kind = isinstance(value, kinds) and (bool in kinds or not isinstance(value, bool))
    if not (of_kind and value in known):
        *others, last = map(str, known)
        expected = f"{', '.join(others)} or {last}" if others else last
        raise InputError(name, short(value), expected, "Pick one of these.")


def check_type(name: str, value: object, kind: Any, remedy: str) -> None:
    """Raise `InputError` unless `value` is of this type, or one of these."""
    if not isinstance(value, kind):
        raise InputError(name, short(value), named(kind), remedy)


def listed(name: str, values: Any, kind: Any, remedy: str) -> list[Any]:
    """Return one or several of a type as a list; `InputError` for none, or others."""
    found = [values] if isinstance(values, kind) else values
    if not isinstance(found, Iterable) or isinstance(found, str | Mapping):
        raise InputError(name, short(values), f"a list: {named(kind)}, one at least", remedy)
    found = list(found)
    for place, one in enumerate(found):
        check_type(f"{name}[{place}]", one, kind, remedy)
    if not found:
        raise InputError(name, "none", f"{named(kind)}, one at least", remedy)
    return found


def named(kind: Any) -> str:
    """Return the names of a type, or of several."""
    kinds = kind if isinstance(kind, tuple) else (kind,)
    return " or ".join(f"a {one.__name__}" for one in kinds)


def path_of(name: str, value: Any, remedy: str = "Name a file.") -> Path:
    """Return a path, or raise `InputError`."""
    check_type(name, value, (str, os.PathLike), remedy)
    return Path(value)


def short(value: object) -> str:
    """Return a value as messages name it; an array by its shape, other things by their type."""
    x, shape = value if isinstance(value, bool) else plain(value), getattr(value, "shape", ())
    if x is None or isinstance(x, str | bytes | Number | list | tuple | Mapping):
        return SHORT.repr(x)
    return f"{type(value).__name__} of shape {shape}" if shape else type(value).__name__


class Counting(Formatter):
    """Format strings with counts.

    >>> Counting().format("{n:#pair}, {n:#grain moves/grains move}", n=1)
    '1 pair, 1 grain moves'
    """

    def format_field(self, value: Any, format_spec: str) -> Any:
        """A count and what is counted after `#`, else as Python formats it."""
        if format_spec.startswith("#"):
            return counted(int(value), *format_spec[1:].split("/"))
        return super().format_field(value, format_spec)


def counted(count: object, one: str, many: str = "") -> str:
    """Return a count and what is counted.

    >>> counted(1, "pair"), counted(2, "pair"), counted(1, "grain moves", "grains move")
    ('1 pair', '2 pairs', '1 grain moves')
    """
    return f"{count} {one if count == 1 else many or f'{one}s'}"
