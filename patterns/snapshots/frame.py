"""One snapshot as plain tables, into which every format is translated; files of plain tables."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeVar

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from loops import InputError
from loops.errors import counted, path_of
from loops.laws.frictional import ShearHistory, ShearIncrement
from loops.scene import Subject
from patterns.snapshots.columns import (
    KINDS,
    LAYOUTS,
    WHEN,
    is_column,
    names_beside,
    plain_tables,
    read_as,
)
from patterns.snapshots.files import Text, beside, head_of, unpacked_name
from patterns.snapshots.findings import Finding, few
from patterns.snapshots.geometry import as_periodic
from patterns.snapshots.snapshot import Snapshot, snapshot_of
from patterns.snapshots.source import CHOICES, LawName, Source, check_words
from patterns.snapshots.tables import (
    ARRAY_FILES,
    SPREADSHEETS,
    TABLE_ENDINGS,
    TEXTS,
    Table,
    layout_of,
    listed,
    read_arrays,
    read_body,
    read_table,
    table_of_arrays,
)

Notes = tuple[str, ...]  # guesses, and data that a file lacks


def contacts_path(source: Source, names: Sequence[str], lacks: str, wanted: str, hint: str) -> Path:
    """The file of contacts as given, else of one of these names beside the grains."""
    found = source.contacts or beside(source.path, *names)
    if found is None:
        raise InputError(f"contacts of {source.path}", lacks, wanted, hint)
    return found


@dataclass(frozen=True, eq=False)
class Frame:
    """One snapshot, columns by their plain names (see `read_snapshot`).

    `grains` may have `z`, where centres lie in a plane, `theta_z` (rad), `mass`, and `vx`, `vy`
    with `omega_z` (rad/time); of a wall the branch starts at its foot, the contact point. Those of
    `cell` (2, 2) are its vectors (length); `step` is the code's own number, a step, iteration or
    time, `time` the time, if known; `notes` name guesses and missing data, `findings` are those of
    the reader, and `shear_increment` is that of the code, if the source has it;
    `law` and `shear_history` are those that it names.
    `walls`, a row a contact with a wall, stands in for rows of `type` 1 and their contacts;
    `measured` forces are those of an experiment, a law of them needs their balance; `periodic`
    are the directions of the cell; `unused` names columns of the files that are none of these,
    `has_types` is set where the user names the column `type`.
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
    periodic: tuple[bool, bool] = (True, True)
    unused: Notes = ()
    has_types: bool = False
    law: LawName | None = None
    shear_history: ShearHistory | None = None


def require_column(
    name: str, column: str, names: Sequence[str], where: str, otherwise: str = ""
) -> None:
    """Raise `InputError` unless the column that a map gives is one of those `names`."""
    if column not in names:
        received, expected = f"no such column in {where}", f"one of {listed(names)}{otherwise}"
        raise InputError(f"--columns {name}={column}", received, expected, "Correct the name.")


class Moment(NamedTuple):
    """One snapshot in a file: what reads it, and its step, iteration or time, if known before."""

    read: Callable[[Source], Frame]
    step: float | None = None


Frames = Sequence[Moment]


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
            table = Table(self.where, body)
        rows = 0 if table is None else len(table)
        if table is None or self.count not in (None, rows):
            expected = f"{self.count} as the header says" if self.count else "at least one row"
            remedy = "The frame is cut short or mixed with another one: dump or copy it again."
            raise InputError(self.where, counted(rows, "row"), expected, remedy)
        return table


Found = TypeVar("Found", bound=Listing)
ReadPair = Callable[[Found, Found, Notes, Source], Frame]


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

    Snapshots without grains or contacts, as before the grains meet, are left out.
    """
    found = list(contacts)
    good = [one for one in found if not isinstance(one, InputError)]
    damaged = [one for one in found if isinstance(one, InputError)]
    steps = np.array([one.step for one in good], dtype=float)
    readers: list[Moment] = []
    empty = 0
    for own in grains:
        if isinstance(own, InputError):
            readers.append(Moment(partial(_refuse, own)))
            continue
        same = np.flatnonzero(np.abs(steps - own.step) <= tolerance * abs(own.step))
        if not len(same):
            received = f"{by}s {few(steps, '{:.15g}'.format)}" if good else f"no {by}"
            expected = f"{by} {own.step:.15g} of {own.where}"
            remedy = f"Take both files from the same {by}s of one run."
            missing = InputError(str(contacts_path), received, expected, remedy)
            error = damaged[0] if damaged else missing
            readers.append(Moment(partial(_refuse, error), own.step))
        elif own.is_empty or good[same[0]].is_empty:
            empty += 1
        else:
            said = (f"{empty} earlier snapshots without contacts left out",) if empty else ()
            whole = partial(read, own, good[same[0]], (*notes, *said))
            readers.append(Moment(whole, own.step))
    if not readers:
        where = str(contacts_path)
        raise InputError(where, "no contacts in any snapshot", "contacts", "Check the export.")
    return readers


def _refuse(error: InputError, source: Source) -> Frame:
    raise error


# Only Yade's tables have the force both in its parts and as a whole.
YADE_COLUMNS = ("fn", "fsx", "fsy", "fx_on_2", "fy_on_2", "kn", "ks")


def is_table(path: Path, head: bytes) -> bool:
    """Whether this is a plain table: by its ending, what is in it is checked on reading."""
    return unpacked_name(path.name.lower()).endswith((*TABLE_ENDINGS, *SPREADSHEETS))


def table_frames(source: Source) -> Frames:
    """Snapshots of a pair of tables, or of one npz or HDF5 file with both and the `cell`.

    Contacts, `walls_...`, a row a contact with a wall, see `snapshot_from_tables`, and
    `cell_....json` stand beside the grains under names of `columns.WORDS`. The latter is
    `{"cell": [[HXX, HXY], [HYX, HYY]], "iteration": 1000, "time": 0.5, "periodic": "xy",
    "shear_increment": "radii", "law": "hertz", "shear_history": "force"}`, null for no cell. Tables
    with a column `step` or `time` of several values hold a snapshot each.
    """

    @cache
    def whole() -> Frame:
        tables, told = _in_one_file(source) or _in_files(source)
        return frame_of_tables(source, tables, **told)

    def read(name: str, value: float, notes: Notes, _: Source) -> Frame:
        parts: dict[str, Any] = {kind: getattr(whole(), kind) for kind in KINDS}
        parts = {k: t and t.take(t.column(name) == value) for k, t in parts.items()}
        parts[name] = value
        return replace(whole(), **parts, notes=(*whole().notes, *notes))

    if not _may_be_long(source):
        return [Moment(lambda _: whole(), _cell_beside(source.path).get("step"))]
    tables = [table for kind in KINDS if (table := getattr(whole(), kind))]
    long = [name for name in WHEN if any(t.has(name) and np.ptp(t.column(name)) for t in tables)]
    if not long:
        return [Moment(lambda _: whole(), whole().step)]
    for table in tables:
        if not table.has(long[0]):
            received, wanted = f"columns {listed(table.names)}", f"a column {long[0]!r}"
            remedy = "Give each table the column, or one snapshot to each file."
            raise InputError(table.path, received, f"{wanted}, as in the other table", remedy)
    moments, touched = (np.unique(table.column(long[0])) for table in tables[:2])
    left = len(moments) - len(moments := np.intersect1d(moments, touched))
    if not len(moments):
        remedy = "Take both tables from one run."
        raise InputError(tables[1].path, f"no {long[0]} of the grains", "contacts", remedy)
    said = (f"{counted(left, 'snapshot')} without contacts left out",) if left else ()
    return [Moment(partial(read, long[0], value, said), value) for value in moments.tolist()]


def _may_be_long(source: Source) -> bool:
    """Whether the table of grains may hold several snapshots, by the names of its columns."""
    if set(WHEN) & set(source.columns):
        return True
    path, name = source.path, unpacked_name(source.path.name.lower())
    names: Sequence[str] = ()
    if name.endswith(TEXTS) and path.is_file():
        with suppress(InputError):  # told when it is read
            names = layout_of(path, head_of(path), is_column).names
    elif name.endswith(ARRAY_FILES) and path.is_file():
        names = read_arrays(path, lambda name: False)[0]
    elif name.endswith(".parquet") and path.is_file():
        names = read_table(path, lambda name: False).names
    return any(read_as(name.rpartition("/")[2], "grains") in WHEN for name in names)


Told = dict[str, Any]  # fields of a `Frame` besides its tables


def _in_one_file(source: Source) -> tuple[dict[str, Table], Told] | None:
    """Tables of the groups of one file and its cell, None if it has no groups."""
    if source.contacts is not None or not source.path.name.lower().endswith(ARRAY_FILES):
        return None
    names, arrays = read_arrays(source.path, lambda name: is_column(name) or name == "cell")
    if not any(name.startswith("contacts/") for name in names):
        return None
    found: dict[str, Table] = {}
    for group in ("grains", "contacts"):
        own = [n.removeprefix(f"{group}/") for n in names if n.startswith(f"{group}/")]
        values = {n: arrays[f"{group}/{n}"] for n in own if f"{group}/{n}" in arrays}
        found[group] = table_of_arrays(f"{group} of {source.path}", own, values)
    return found, {"cell": arrays.get("cell")}


def _in_files(source: Source) -> tuple[dict[str, Table], Told]:
    """Tables of the file of grains and of those beside it, and what stands in that of the cell."""
    mapped = {*source.columns.values()}

    def own(path: Path) -> Table:
        return read_table(path, lambda name: is_column(name) or name in mapped)

    read = {"grains": own(source.path)}
    names, hint = names_beside(source.path, "contacts"), "Name it by --contacts."
    expected = few(names) or "contacts_... beside grains_..., particles_, nodes_, ..."
    lacks = "no table of contacts beside it"
    read["contacts"] = own(contacts_path(source, names, lacks, expected, hint))
    if walls := beside(source.path, *names_beside(source.path, "walls")):
        read["walls"] = own(walls)
    return _with_layout(read, source), _cell_beside(source.path)


def _with_layout(tables: dict[str, Table], source: Source) -> dict[str, Table]:
    """Tables without header under the names of a known layout, if they have its columns."""
    shape = tuple(len(tables[kind].names) for kind in ("grains", "contacts"))
    bare = all(tables[kind].names[0] == "0" for kind in ("grains", "contacts"))
    if source.columns or not bare or shape not in LAYOUTS:
        return tables
    for kind, names in zip(("grains", "contacts"), LAYOUTS[shape], strict=True):
        numbered = {name: str(k) for k, name in enumerate(names)}
        tables[kind] = tables[kind].renamed(numbered)
    return tables


def frame_of_tables(source: Source, tables: Mapping[str, Table], **told: Any) -> Frame:
    """One saved state from its tables, columns under their plain names."""
    found, notes, unused = plain_tables(tables, source.columns)
    grains = found["grains"]
    for name in WHEN:
        if grains.has(name) and not np.ptp(when := grains.column(name)):
            told.setdefault(name, float(when[0]))
    if grains.has("type") and (of_walls := grains.are("type", "wall")) is not None:
        grains = grains.with_column("type", of_walls.astype(float))
    if grains.has("diameter") and not grains.has("radius"):
        grains = grains.with_column("radius", 0.5 * grains.column("diameter"))
        notes.append(f"radius is half the column 'diameter' of {grains.path}")
    if found["contacts"].has(*YADE_COLUMNS):
        told.setdefault("shear_increment", "radii")
    told["notes"] = (*told.get("notes", ()), *notes)
    told.setdefault("has_types", "type" in source.columns)
    walls = found.get("walls")
    return Frame(grains, found["contacts"], walls=walls, unused=tuple(unused), **told)


def _cell_beside(path: Path) -> dict[str, Any]:
    """Fields of a `Frame` that `cell_....json` beside the grains tells."""
    name = unpacked_name(path.name)
    ending = next((one for one in TABLE_ENDINGS if name.endswith(one)), "")
    plain = path.with_name(name.removesuffix(ending))
    file = beside(path, *(f"{name}.json" for name in names_beside(plain, "cell")))
    if file is None:
        return {}
    try:
        given = json.loads(file.read_text())
        check_words(given, f" of {file}")
        matrix, periodic = given["cell"], as_periodic(given.get("periodic"))
        told: Told = {name: given[name] for name in CHOICES if given.get(name) is not None}
        told |= {"periodic": periodic} if periodic else {}
        for name, own in (("step", "iteration"), ("time", "time")):
            if given.get(own) is not None:
                told[name] = float(given[own])
        return told | {"cell": None if matrix is None else np.array(matrix, dtype=float)}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OSError) as error:
        raise InputError(
            str(file),
            f"no cell ({type(error).__name__}: {str(error)[:100]})",
            '{"cell": [[HXX, HXY], [HYX, HYY]]}, null for none',
            "Correct or remove the file, or give --cell.",
        ) from None


def write_snapshot(path: str | Path, snapshot: Snapshot | Subject) -> None:
    """Write the tables that `read_snapshot` reads.

    Parameters
    ----------
    path : str or Path
        The table of grains, `grains` in its name, ending in `.parquet` or `.csv`. The contacts,
        those with walls (`walls`), and in a JSON file (`cell`) the cell of a periodic snapshot, the
        shear increment `radii` and Hertz's law are written beside it; files of these names are
        replaced, each when its successor is complete.
    snapshot : Snapshot, Scene or HeldPacking
        What to write; without forces the tables have none.

    Raises
    ------
    InputError
        For another name or ending, or what is no snapshot and no scene.

    Examples
    --------
    >>> import tempfile
    >>> from patterns import read_snapshot, sample_path, write_snapshot
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_snapshot(f"{folder}/grains_1.parquet", read_snapshot(sample_path()))
    ...     read_snapshot(f"{folder}/grains_1.parquet").graph.contact_count
    819
    """
    path = path_of("path", path, "Name a file: 'grains_1.parquet'.")
    snapshot = snapshot_of(snapshot, "snapshot")
    if "grains" not in path.name or path.suffix not in (".parquet", ".csv"):
        raise InputError(
            str(path), "this name", "grains... ending in .parquet or .csv", "Rename it."
        )
    tables = snapshot.tables()
    write = pyarrow.parquet.write_table if path.suffix == ".parquet" else pyarrow.csv.write_csv
    for kind in KINDS:
        columns = tables[kind] and {n: np.ascontiguousarray(v) for n, v in tables[kind].items()}
        file = path.with_name(path.name.replace("grains", kind))
        _replace(file, columns and pyarrow.table(columns), write)
    matrix, words = tables["cell"], ("shear_increment", "periodic", "law", "shear_history")
    given = {"cell": None if matrix is None else matrix.tolist()}
    given |= {name: tables[name] for name in words if tables.get(name) not in (None, "branch")}
    name = path.name.replace("grains", "cell").removesuffix(path.suffix)
    text = None if given == {"cell": None} else f"{json.dumps(given)}\n"
    _replace(path.with_name(f"{name}.json"), text, lambda text, file: file.write(text.encode()))


def _replace(path: Path, content: Any, write: Callable[[Any, BinaryIO], object]) -> None:
    """Write a file whole or not at all; without content remove that of an earlier snapshot."""
    if content is None:
        path.unlink(missing_ok=True)
        return
    partial = path.with_name(f".{path.name}.partial")
    # Opened here, since pyarrow takes no file names that are not UTF-8.
    with open(partial, "wb") as file:
        write(content, file)
    os.replace(partial, path)
