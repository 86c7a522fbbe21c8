"""One snapshot as plain tables, into which every format is translated; its files, and PeGS2's."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from loops import InputError
from loops.arrays import Floats
from loops.errors import check_choice
from loops.laws.frictional import ShearHistory, ShearIncrement, checked_increment
from patterns.snapshots.files import Text, beside, require_file, whole_file
from patterns.snapshots.findings import Finding
from patterns.snapshots.geometry import WALL
from patterns.snapshots.snapshot import Snapshot
from patterns.snapshots.tables import (
    ARRAY_FILES,
    SPREADSHEETS,
    TABLE_ENDINGS,
    Table,
    listed,
    read_arrays,
    read_body,
    read_table,
    table_of_arrays,
)

GRAIN_COLUMNS = (
    *("id", "type", "x", "y", "z", "radius", "diameter", "theta_z", "mass"),
    *("vx", "vy", "omega_z"),
)
CONTACT_COLUMNS = (
    *("id1", "id2", "branch_x", "branch_y", "nx", "ny", "cx", "cy", "cell_dx", "cell_dy"),
    *("fn", "ft", "fsx", "fsy", "fx_on_2", "fy_on_2", "kn", "ks", "mu", "sliding"),
    *("adhesion", "cohesion"),
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
    law: Literal["linear", "hertz", "cohesive", "bonded"] | None = None
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
            lines = (self.where, self.text, self.span, self.names)
            table = Table(
                self.where,
                read_body(*lines, columns),
                exact=lambda name: read_body(*lines, [name], pyarrow.int64()).column(name),
            )
        rows = 0 if table is None else len(table)
        if table is None or self.count not in (None, rows):
            expected = f"{self.count} as the header says" if self.count else "at least one row"
            remedy = "The frame is cut short or mixed with another one: dump or copy it again."
            raise InputError(self.where, f"{rows} rows", expected, remedy)
        return table


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


# Only Yade's tables have the force both in its parts and as a whole.
YADE_COLUMNS = ("fn", "fsx", "fsy", "fx_on_2", "fy_on_2", "kn", "ks")


def is_table(path: Path, head: bytes) -> bool:
    """Whether this is a plain table: by its ending, what is in it is checked on reading."""
    return path.name.lower().endswith((*TABLE_ENDINGS, *SPREADSHEETS))


def table_frames(source: Source) -> Frames:
    """The one snapshot of a pair of tables, or of one npz or HDF5 file with both and the `cell`.

    The contacts stand beside the grains, `grains` in the name replaced by `contacts`, and so may
    `cell_....json`: `{"cell": [[HXX, HXY], [HYX, HYY]], "iteration": 1000,
    "time": 0.5, "shear_increment": "radii", "law": "hertz", "shear_history": "force"}`, null for no
    cell, and `walls_...`, a row a contact with a wall, see `snapshot_from_tables`.
    """

    def read() -> Frame:
        wanted = known_spellings() | {*source.columns.values()}
        tables: tuple[Table, ...] = ()
        if source.contacts is None and source.path.name.lower().endswith(ARRAY_FILES):
            names, arrays = read_arrays(source.path, wanted | {"cell"})
            if any(name.startswith("contacts/") for name in names):
                cell, told = arrays.get("cell"), {}
                for group in ("grains/", "contacts/"):
                    own = [n.removeprefix(group) for n in names if n.startswith(group)]
                    values = {n: arrays[group + n] for n in own if group + n in arrays}
                    table = table_of_arrays(f"{group[:-1]} of {source.path}", own, values)
                    tables = (*tables, table)
        if not tables:
            grains = read_table(source.path, wanted)
            tables = grains, read_table(source.contacts or contacts_beside(source.path), wanted)
            told = _cell_beside(source.path)
            cell = told.pop("cell", None)
            walls = source.path.with_name(source.path.name.replace("grains", "walls"))
            if "grains" in source.path.name and walls.is_file():
                pushed = read_table(walls, wanted | {"fx", "fy"})
                told["walls"] = with_aliases(pushed, WALL_COLUMNS)[0]
        frame = frame_of_tables(source, *tables)
        return replace(frame, cell=cell if source.cell is None else source.cell, **told)

    return [read]


def frame_of_tables(source: Source, grains: Table, contacts: Table) -> Frame:
    """One saved state from its two tables, columns under their plain names."""
    grains, contacts = with_plain_names(source, grains, contacts)
    grains, other_grains = with_aliases(grains, GRAIN_COLUMNS)
    contacts, other_contacts = with_aliases(contacts, CONTACT_COLUMNS)
    grains, halved = with_radii(grains)
    increment: ShearIncrement | None = "radii" if contacts.has(*YADE_COLUMNS) else None
    notes = (*other_grains, *halved, *other_contacts)
    return Frame(grains, contacts, cell=source.cell, shear_increment=increment, notes=notes)


def contacts_beside(path: Path) -> Path:
    """Path of the contacts: `grains` in the name of the file replaced."""
    if "grains" not in path.name:
        expected = "grains_... with contacts_... beside it"
        remedy = "Name the table of contacts explicitly."
        raise InputError(f"name of {path}", "no 'grains' in it", expected, remedy)
    return path.with_name(path.name.replace("grains", "contacts"))


def _cell_beside(path: Path) -> dict[str, Any]:
    """Fields of a `Frame` that `cell_....json` beside the grains tells."""
    if "grains" not in path.name:
        return {}
    name = path.name.replace("grains", "cell")
    for ending in TABLE_ENDINGS:
        name = name.removesuffix(ending)
    file = path.with_name(f"{name}.json")
    if not file.is_file():
        return {}
    try:
        given = json.loads(file.read_text())
        found: dict[str, Any] = {}
        found["cell"] = None if given["cell"] is None else np.array(given["cell"], dtype=float)
        for name, field in (("iteration", "step"), ("time", "time")):
            if given.get(name) is not None:
                found[field] = float(given[name])
        if given.get("shear_increment") is not None:
            found["shear_increment"] = checked_increment(given["shear_increment"])
        for name, known in (
            ("law", ("linear", "hertz", "cohesive", "bonded")),
            ("shear_history", get_args(ShearHistory)),
        ):
            if given.get(name) is not None:
                check_choice(f"{name} of {file}", given[name], known)
                found[name] = given[name]
        return found
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OSError) as error:
        raise InputError(
            str(file),
            f"no cell ({type(error).__name__}: {str(error)[:100]})",
            '{"cell": [[HXX, HXY], [HYX, HYY]]}, null for none',
            "Correct or remove the file, or give --cell.",
        ) from None


def write_snapshot(path: str | Path, snapshot: Snapshot) -> None:
    """Write the tables that `read_snapshot` reads.

    Parameters
    ----------
    path : str or Path
        The table of grains, `grains` in its name, ending in `.parquet` or `.csv`. The contacts,
        those with walls (`walls`), and in a JSON file (`cell`) the cell of a periodic snapshot, the
        shear increment `radii` and Hertz's law are written beside it; files of these names are
        replaced, each when its successor is complete.
    snapshot : Snapshot
        What to write; without forces the tables have none.

    Raises
    ------
    InputError
        For another name or ending.

    Examples
    --------
    >>> import tempfile
    >>> from patterns import read_snapshot, sample_path, write_snapshot
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_snapshot(f"{folder}/grains_1.parquet", read_snapshot(sample_path()))
    ...     read_snapshot(f"{folder}/grains_1.parquet").graph.contact_count
    819
    """
    path = Path(path)
    if "grains" not in path.name or path.suffix not in (".parquet", ".csv"):
        raise InputError(
            str(path), "this name", "grains... ending in .parquet or .csv", "Rename it."
        )
    tables = snapshot.tables()
    _write(path, tables["grains"])
    _write(path.with_name(path.name.replace("grains", "contacts")), tables["contacts"])
    walls = path.with_name(path.name.replace("grains", "walls"))
    if tables["walls"] is None:
        # Those of an earlier snapshot of this name would be taken for this one's.
        walls.unlink(missing_ok=True)
    else:
        _write(walls, tables["walls"])
    cell = path.with_name(path.name.replace("grains", "cell").removesuffix(path.suffix) + ".json")
    matrix, increment = tables["cell"], tables["shear_increment"]
    given: dict[str, object] = {"cell": None if matrix is None else matrix.tolist()}
    if increment not in (None, "branch"):
        given["shear_increment"] = increment
    given |= {name: tables[name] for name in ("law", "shear_history") if name in tables}
    if given == {"cell": None}:
        cell.unlink(missing_ok=True)
    else:
        partial = cell.with_name(f".{cell.name}.partial")
        partial.write_text(json.dumps(given) + "\n")
        os.replace(partial, cell)


def _write(path: Path, columns: Mapping[str, NDArray[np.generic]]) -> None:
    table = pyarrow.table({name: np.ascontiguousarray(values) for name, values in columns.items()})
    partial = path.with_name(f".{path.name}.partial")
    write = pyarrow.parquet.write_table if path.suffix == ".parquet" else pyarrow.csv.write_csv
    # Opened here, since pyarrow takes no file names that are not UTF-8.
    with open(partial, "wb") as file:
        write(table, file)
    os.replace(partial, path)


# Columns of `particle_positions.txt`, and of `Adjacency_list.txt`; neither has a header.
POSITIONS = ("frame", "id", "x", "y", "r", "edge")
ADJACENCY = ("frame", "id1", "id2", "tangential", "normal")
LIST = "Adjacency_list.txt"
DECIMAL = rb"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?"
LISTED = re.compile(rb"\s*" + rb"\s*,\s*".join([rb"\d+", rb"\d+", *[DECIMAL] * 4]) + rb"\s*\r?\n")
OUTSIDE = -1  # id of a wall in the list


def is_pegs(path: Path, head: bytes) -> bool:
    """Whether the first line is one of tracked positions: six numbers between commas."""
    return LISTED.match(head) is not None


def pegs_frames(source: Source) -> Frames:
    """Frames of `particle_positions.txt` with `Adjacency_list.txt` beside it.

    Lengths in pixels, y of the image turned upwards; forces in newtons, those of a contact that
    both grains have are averaged. The list has no direction of contacts with walls.
    """
    if source.columns:
        remedy = "PeGS2 writes no names of columns: leave --columns out."
        raise InputError("--columns", str(dict(source.columns)), "none for PeGS2", remedy)
    wanted, hint = f"{LIST} of PeGS2's adjacencyMatrix", "Name it by --contacts."
    lists = contacts_path(source, [LIST], "no list of contacts beside it", wanted, hint)
    grains, contacts = _rows(source.path, POSITIONS), _rows(lists, ADJACENCY)
    found = [number for number in np.unique(grains[:, 0]) if (contacts[:, 0] == number).any()]
    if not found:
        where, received = str(lists), "no contacts in any frame of the positions"
        raise InputError(where, received, "contacts", "Take both files of one run.")

    def read(number: float) -> Frame:
        x = grains[grains[:, 0] == number]
        rows = contacts[contacts[:, 0] == number]
        bodies = {
            "id": np.append(x[:, 1], OUTSIDE),
            "type": np.append(np.zeros(len(x)), WALL),
            "x": np.append(x[:, 2], 0.0),
            "y": np.append(-x[:, 3], 0.0),
            "radius": np.append(x[:, 4], 0.0),
        }
        # One row a pair, whichever grain it was solved on.
        ends = np.sort(rows[:, 1:3], axis=1)
        ends[ends[:, 0] == OUTSIDE] = ends[ends[:, 0] == OUTSIDE][:, ::-1]
        pairs, which, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
        which = which.ravel()
        force = np.stack([np.bincount(which, f) / count for f in (rows[:, 4], rows[:, 3])], axis=1)
        apart = np.hypot(*(rows[:, [4, 3]] - force[which]).T)[count[which] > 1]
        between = pairs[:, 1] != OUTSIDE
        mean = float(np.hypot(*force[between].T).mean()) if between.any() else 1.0
        single, walls = np.count_nonzero(between & (count == 1)), np.count_nonzero(~between)
        spread = float(np.sqrt(np.mean(apart**2))) / mean if len(apart) else 0.0
        notes = [
            "PeGS2: lengths in pixels, y turned upwards; N and T as of its force balance",
            "the force of a contact is the mean of those solved on its two grains, which differ by "
            f"{spread:.2g} mean forces from it (root mean square); {single} contacts were solved "
            "on one grain alone",
        ]
        if walls:
            notes.append(f"{walls} contacts with walls have no direction in the list: left out")
        table = {"id1": pairs[:, 0], "id2": pairs[:, 1], "fn": force[:, 0], "ft": force[:, 1]}
        return Frame(
            Table(source.path, bodies),
            Table(lists, table),
            source.cell,
            float(number),
            tuple(notes),
            measured=True,
        )

    return [partial(read, number) for number in found]


def _rows(path: Path, names: tuple[str, ...]) -> Floats:
    require_file(path)
    with whole_file(path):
        rows = np.loadtxt(path, delimiter=",", ndmin=2)
    if rows.shape[1] != len(names):
        received, expected = f"{rows.shape[1]} columns", f"{len(names)}: {', '.join(names)}"
        raise InputError(str(path), received, expected, "Write it by PeGS2 again.")
    return rows
