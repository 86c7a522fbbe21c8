"""Snapshots listed in a text one after the other: where their rows stand, their contacts beside."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import pyarrow

from loops import InputError
from patterns.snapshots.frame import Frame, Frames, Notes
from patterns.snapshots.tables import Table
from patterns.snapshots.text import Text, read_body


@dataclass(frozen=True, eq=False)
class Listing:
    """Where the rows of one snapshot stand: so many, if the header tells; `step` or time."""

    where: str
    step: float
    names: tuple[str, ...]
    text: Text
    span: tuple[int, int]
    count: int | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there are no rows, and the header says nothing else."""
        return self.span[0] == self.span[1] and not self.count

    def read(self, wanted: Sequence[str] | None = None) -> Table:
        """Columns of the rows, all of them if not told which."""
        table = None
        if self.span[0] < self.span[1]:
            columns = self.names if wanted is None else wanted
            body = read_body(self.where, self.text, self.span, self.names, columns)
            table = Table(self.where, body, exact=self._whole)
        rows = 0 if table is None else len(table)
        if table is None or self.count not in (None, rows):
            expected = f"{self.count} as the header says" if self.count else "at least one row"
            remedy = "The frame is cut short or mixed with another one: dump or copy it again."
            raise InputError(self.where, f"{rows} rows", expected, remedy)
        return table

    def _whole(self, name: str) -> pyarrow.ChunkedArray:
        body = read_body(self.where, self.text, self.span, self.names, [name], pyarrow.int64())
        return body.column(name)


Found = TypeVar("Found", bound=Listing)
ReadPair = Callable[[Found, Found, Notes], Frame]


def paired(
    grains: Iterable[Found | InputError],
    contacts: Iterable[Found | InputError],
    read: ReadPair[Found],
    contacts_path: Path,
    by: str,
    tolerance: float = 0.0,
    notes: Notes = (),
) -> Frames:
    """Snapshots of grains with their contacts, `by` step or time; what is wrong is told on reading.

    Those without contacts, as before the grains meet, are left out.
    """
    found = list(contacts)
    good = [one for one in found if not isinstance(one, InputError)]
    damaged = [one for one in found if isinstance(one, InputError)]
    steps = np.array([one.step for one in good], dtype=float)
    readers: list[Callable[[], Frame]] = []
    empty = 0
    for own in grains:
        if isinstance(own, InputError):
            readers.append(partial(_refuse, own))
            continue
        same = np.flatnonzero(np.abs(steps - own.step) <= tolerance * abs(own.step))
        if not len(same):
            shown = ", ".join(f"{step:.15g}" for step in steps[:3]) + (", ..." * (len(steps) > 3))
            received = f"{by}s {shown}" if good else f"no {by}"
            expected = f"{by} {own.step:.15g} of {own.where}"
            remedy = f"Take both files from the same {by}s of one run."
            missing = InputError(str(contacts_path), received, expected, remedy)
            readers.append(partial(_refuse, damaged[0] if damaged else missing))
        elif good[same[0]].is_empty:
            empty += 1
        else:
            said = (f"{empty} earlier snapshots without contacts left out",) if empty else ()
            readers.append(partial(read, own, good[same[0]], (*notes, *said)))
    if not readers:
        where = str(contacts_path)
        raise InputError(where, "no contacts in any snapshot", "contacts", "Check the export.")
    return readers


def _refuse(error: InputError) -> Frame:
    raise error
