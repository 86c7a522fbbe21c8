"""One snapshot as plain tables, into which every format is translated."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
import pyarrow
from numpy.typing import NDArray

from loops import InputError
from loops.laws.frictional import ShearIncrement
from loops.laws.hertz_mindlin import ShearHistory
from patterns.snapshots.checks import Finding
from patterns.snapshots.tables import Table
from patterns.snapshots.text import Text, beside, listed, read_body

GRAIN_COLUMNS = (
    *("id", "type", "x", "y", "z", "radius", "diameter", "theta_z", "mass"),
    *("vx", "vy", "omega_z"),
)
CONTACT_COLUMNS = (
    *("id1", "id2", "branch_x", "branch_y", "nx", "ny", "cx", "cy", "cell_dx", "cell_dy"),
    *("fn", "ft", "fsx", "fsy", "fx_on_2", "fy_on_2", "kn", "ks", "mu", "sliding"),
    "mz_on_2",
)
Notes = tuple[str, ...]  # guesses, and data that a file lacks
PLAIN_NAMES = GRAIN_COLUMNS + CONTACT_COLUMNS
# Those of a table of contacts with walls that have other names.
WALL_COLUMNS = ("id", "kn", "ks", "mu")
# Other names of the columns; case does not matter.
ALIASES: dict[str, tuple[str, ...]] = {
    "id": ("grain", "grain_id", "particle", "particle_id", "body", "body_id"),
    "x": ("pos_x", "x_pos", "posx", "position_x"),
    "y": ("pos_y", "y_pos", "posy", "position_y"),
    "radius": ("rad", "r", "radii"),
    "diameter": ("diam", "d"),
    "id1": ("id_1", "i", "grain1", "grain_1", "particle1", "body1", "i1"),
    "id2": ("id_2", "j", "grain2", "grain_2", "particle2", "body2", "i2"),
    "nx": ("n_x", "normal_x"),
    "ny": ("n_y", "normal_y"),
    "fn": ("f_n", "normal_force", "force_n"),
    "ft": ("f_t", "f_s", "fs", "shear_force", "tangential_force", "force_t"),
    "kn": ("k_n",),
    "ks": ("k_s", "kt", "k_t"),
    "mu": ("friction", "mu_g"),
    "sliding": ("is_sliding", "slides"),
    "mz_on_2": ("rolling_moment", "moment_on_2"),
}


@dataclass(frozen=True, eq=False)
class Source:
    """Files, cell and column map given by the user."""

    path: Path
    contacts: Path | None = None
    cell: NDArray[np.float64] | None = None
    columns: Mapping[str, str] = field(default_factory=dict)


def contacts_path(source: Source, names: Sequence[str], lacks: str, wanted: str, hint: str) -> Path:
    """The file of contacts as given, else of one of these names beside the grains', gzip or not."""
    found = source.contacts or beside(source.path, *names)
    if found is None:
        raise InputError(f"contacts of {source.path}", lacks, wanted, hint)
    return found


@dataclass(frozen=True, eq=False)
class Frame:
    """One snapshot, columns by their plain names (see `read_snapshot`).

    `grains` may have `z`, which must be one plane, `theta_z` (rad), `mass`, and `vx`, `vy` with
    `omega_z` (rad/time); of a wall the branch starts at its foot, the contact point. Columns of
    `cell` (2, 2) are its vectors (length); `step` is the code's own number, a step, iteration or
    time, `time` the time, if known; `notes` name guesses and missing data, `findings` are those of
    the reader, and `shear_increment` is that of the code, if the source has it;
    `law` and `shear_history` are those that it names.
    `walls`, a row a contact with a wall, stands in for rows of `type` 1 and their contacts;
    `measured` forces are those of an experiment, a law of them needs their balance.
    """

    grains: Table
    contacts: Table
    cell: NDArray[np.float64] | None = None
    step: float | None = None
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    shear_increment: ShearIncrement | None = None
    walls: Table | None = None
    measured: bool = False
    time: float | None = None
    law: Literal["linear", "hertz"] | None = None
    shear_history: ShearHistory | None = None


def check_names(source: Source, known: Collection[str]) -> None:
    """Raise `InputError` for names in the column map that the format does not know."""
    for name, column in source.columns.items():
        if name not in known:
            where = f"--columns {name}={column}"
            remedy = "Write NAME=COLUMN, the column as the file calls it."
            raise InputError(where, f"the name {name!r}", f"one of {', '.join(known)}", remedy)


def require_column(
    name: str, column: str, names: Sequence[str], where: str, otherwise: str = ""
) -> None:
    """Raise `InputError` unless the column that a map gives is one of those `names`."""
    if column not in names:
        received, expected = f"no such column in {where}", f"one of {listed(names)}{otherwise}"
        raise InputError(f"--columns {name}={column}", received, expected, "Correct the name.")


def with_plain_names(source: Source, grains: Table, contacts: Table) -> tuple[Table, Table]:
    """Rename the columns of two tables by the user's column map.

    `InputError` for an unknown plain name, or a column that neither table has.
    """
    check_names(source, PLAIN_NAMES)
    for name, column in source.columns.items():
        if not grains.has(column) and not contacts.has(column):
            raise InputError(
                f"--columns {name}={column}",
                f"columns {listed(grains.names)} of {grains.path} and {listed(contacts.names)} of "
                f"{contacts.path}",
                f"a column {column!r}",
                "Write NAME=COLUMN, the column as the file calls it.",
            )
    maps = [
        {name: source.columns[name] for name in plain if name in source.columns}
        for plain in (GRAIN_COLUMNS, CONTACT_COLUMNS)
    ]
    return grains.renamed(maps[0]), contacts.renamed(maps[1])


def known_spellings() -> set[str]:
    """Every name that a column of a table may have, in the usual cases."""
    names = {*PLAIN_NAMES, *(alias for several in ALIASES.values() for alias in several)}
    cases = (str, str.upper, str.capitalize, str.title)
    return {case(name) for name in names for case in cases}


def with_aliases(table: Table, plain: Sequence[str]) -> tuple[Table, list[str]]:
    """Rename columns that have one of their other names, and say so."""
    found: dict[str, str] = {}
    spelt = {name.lower(): name for name in table.names}
    for name in plain:
        hits = [spelt[other] for other in (name, *ALIASES.get(name, ())) if other in spelt]
        if not table.has(name) and len(hits) == 1:
            found[name] = hits[0]
    notes = [
        f"column {column!r} of {table.path} read as {name!r}" for name, column in found.items()
    ]
    return table.renamed(found) if found else table, notes


def with_radii(grains: Table) -> tuple[Table, list[str]]:
    """Radii of a table that has diameters instead, with a note."""
    if grains.has("radius") or not grains.has("diameter"):
        return grains, []
    note = f"radius is half the column 'diameter' of {grains.path}"
    return grains.replaced("diameter", "radius", 0.5 * grains.column("diameter")), [note]


# Snapshots that a format finds in a file, each read by a call.
Frames = Sequence[Callable[[], Frame]]


@dataclass(frozen=True, eq=False)
class Listing:
    """Place of the rows of one snapshot in a text; `count` of them if the header has it."""

    where: str
    step: float
    names: tuple[str, ...]
    text: Text
    span: tuple[int, int]
    count: int | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there are no rows, and the header does not announce any."""
        return self.span[0] == self.span[1] and not self.count

    def read(self, wanted: Sequence[str] | None = None) -> Table:
        """Columns of the rows, those `wanted` or all."""
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
    """Snapshots of grains with their contacts, `by` step or time; errors are raised on reading.

    Snapshots without contacts, as before the grains meet, are left out.
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
