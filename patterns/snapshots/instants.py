"""The instants of a file: found at once, each read when it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from loops import InputError
from patterns.snapshots.frame import Frame


@dataclass(frozen=True, eq=False)
class Instants:
    """What a format finds in a file: as many instants as it has, none of them read yet.

    Attributes
    ----------
    readers : sequence of callable
        One an instant in the order of the file; each reads its own instant alone.

    Examples
    --------
    >>> from patterns.snapshots.instants import Instants, refusal
    >>> from loops import InputError
    >>> len(Instants([refusal(InputError("a", "b", "c", "d"))]))
    1
    """

    readers: Sequence[Callable[[], Frame]]

    def __len__(self) -> int:
        """Return the number of instants."""
        return len(self.readers)

    def __getitem__(self, number: int) -> Frame:
        """Read one instant, counted from 0, or from -1 backwards."""
        return self.readers[number]()

    def __iter__(self) -> Iterator[Frame]:
        """Read one after the other."""
        return (read() for read in self.readers)


def refusal(error: InputError) -> Callable[[], Frame]:
    """Reader of an instant that is damaged: raises what is wrong, when it is asked for.

    Parameters
    ----------
    error : InputError
        What is wrong.

    Returns
    -------
    callable
        It raises `error`.
    """

    def read() -> Frame:
        raise error

    return read
