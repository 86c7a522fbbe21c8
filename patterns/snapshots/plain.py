"""Tables of grains and contacts: plain ones, read and written, and those of PeGS2."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from loops import InputError
from loops.arrays import Floats
from loops.errors import check_choice
from loops.laws.frictional import ShearIncrement, checked_increment
from loops.laws.hertz_mindlin import ShearHistory
from patterns.snapshots.frame import (
    CONTACT_COLUMNS,
    GRAIN_COLUMNS,
    WALL_COLUMNS,
    Frame,
    Frames,
    Source,
    contacts_path,
    known_spellings,
    with_aliases,
    with_plain_names,
    with_radii,
)
from patterns.snapshots.geometry import WALL
from patterns.snapshots.snapshot import Snapshot
from patterns.snapshots.tables import (
    ARRAY_FILES,
    SPREADSHEETS,
    TABLE_ENDINGS,
    Table,
    read_arrays,
    read_table,
    table_of_arrays,
)
from patterns.snapshots.text import require_file, whole_file

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
    return [partial(_table_frame, source)]


def _table_frame(source: Source) -> Frame:
    wanted = known_spellings() | {*source.columns.values()}
    tables: Sequence[Table] = ()
    if source.contacts is None and source.path.name.lower().endswith(ARRAY_FILES):
        names, arrays = read_arrays(source.path, wanted | {"cell"})
        if any(name.startswith("contacts/") for name in names):
            tables = [
                table_of_arrays(
                    f"{group[:-1]} of {source.path}",
                    [name.removeprefix(group) for name in names if name.startswith(group)],
                    {n.removeprefix(group): v for n, v in arrays.items() if n.startswith(group)},
                )
                for group in ("grains/", "contacts/")
            ]
            cell, beside = arrays.get("cell"), {}
    if not tables:
        grains = read_table(source.path, wanted)
        tables = grains, read_table(source.contacts or contacts_beside(source.path), wanted)
        beside = _cell_beside(source.path)
        cell = beside.pop("cell", None)
        walls = source.path.with_name(source.path.name.replace("grains", "walls"))
        if "grains" in source.path.name and walls.is_file():
            beside["walls"] = with_aliases(read_table(walls, wanted | {"fx", "fy"}), WALL_COLUMNS)[
                0
            ]
    frame = frame_of_tables(source, *tables)
    return replace(frame, cell=cell if source.cell is None else source.cell, **beside)


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
            ("law", ("linear", "hertz")),
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
ROW = re.compile(rb"\s*" + rb"\s*,\s*".join([rb"\d+", rb"\d+", *[DECIMAL] * 4]) + rb"\s*\r?\n")
OUTSIDE = -1  # id of a wall in the list


def is_pegs(path: Path, head: bytes) -> bool:
    """Whether the first line is one of tracked positions: six numbers between commas."""
    return ROW.match(head) is not None


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
    both = (source.path, grains), (lists, contacts)
    return [partial(_pegs_frame, source, number, *both) for number in found]


def _rows(path: Path, names: tuple[str, ...]) -> Floats:
    require_file(path)
    with whole_file(path):
        rows = np.loadtxt(path, delimiter=",", ndmin=2)
    if rows.shape[1] != len(names):
        received, expected = f"{rows.shape[1]} columns", f"{len(names)}: {', '.join(names)}"
        raise InputError(str(path), received, expected, "Write it by PeGS2 again.")
    return rows


def _pegs_frame(
    source: Source, number: float, grains: tuple[Path, Floats], contacts: tuple[Path, Floats]
) -> Frame:
    x = grains[1][grains[1][:, 0] == number]
    rows = contacts[1][contacts[1][:, 0] == number]
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
        f"{spread:.2g} mean forces from it (root mean square); {single} contacts were solved on "
        "one grain alone",
    ]
    if walls:
        notes.append(f"{walls} contacts with walls have no direction in the list: left out")
    table = {"id1": pairs[:, 0], "id2": pairs[:, 1], "fn": force[:, 0], "ft": force[:, 1]}
    return Frame(
        Table(grains[0], bodies),
        Table(contacts[0], table),
        source.cell,
        float(number),
        tuple(notes),
        measured=True,
    )
