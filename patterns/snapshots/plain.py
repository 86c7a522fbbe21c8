"""Snapshots in the plain table form: one table of grains, one of contacts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from loops import InputError
from loops.arrays import Floats
from loops.laws.frictional import ShearIncrement, checked_increment
from patterns.snapshots.frame import PLAIN_NAMES, Frame, Source, with_plain_names
from patterns.snapshots.instants import Instants
from patterns.snapshots.tables import (
    ARRAY_FILES,
    ENDINGS,
    Arrays,
    Table,
    read_arrays,
    read_table,
    table_of_arrays,
)

# Yade's tables give the force twice, in its parts and as a whole; no other source does.
YADE_COLUMNS = ("fn", "fsx", "fsy", "fx_on_2", "fy_on_2", "kn", "ks")


def recognises(path: Path, head: bytes) -> bool:
    """Whether this is a plain table: by its ending, what is in it is checked on reading."""
    return path.name.lower().endswith(ENDINGS)


def frames(source: Source) -> Instants:
    """The one instant of a pair of tables, or of a file that holds both.

    CSV, CSV.gz, Parquet, npz or HDF5, columns by name as in `Frame`; a column map gives them
    others. The contacts stand beside the grains, `grains` in the name replaced by `contacts`; the
    cell may stand there as well, in `cell_....json`:
    `{"cell": [[HXX, HXY], [HYX, HYY]], "iteration": 1000, "shear_increment": "radii"}`,
    null for no cell. One npz or HDF5 file may hold it all: `grains/x`, `contacts/id1`, ..., `cell`.

    Parameters
    ----------
    source : Source
        What the user gave.

    Returns
    -------
    Instants
        One; reading it raises `InputError` for a missing, empty, truncated or damaged file.
    """
    return Instants([partial(_frame, source)])


def _frame(source: Source) -> Frame:
    wanted = {*PLAIN_NAMES, *source.columns.values()}
    if source.contacts is None and source.path.name.lower().endswith(ARRAY_FILES):
        names, arrays = read_arrays(source.path, wanted | {"cell"})
        if any(name.startswith("contacts/") for name in names):
            tables = tuple(_group(source, names, arrays, group) for group in ("grains", "contacts"))
            return _plain_frame(source, tables, arrays.get("cell"), None, None)
    contacts = source.contacts or beside(source.path, "contacts")
    tables = read_table(source.path, wanted), read_table(contacts, wanted)
    return _plain_frame(source, tables, *_cell_beside(source.path))


def _plain_frame(
    source: Source,
    tables: Sequence[Table],
    cell: Floats | None,
    step: float | None,
    increment: ShearIncrement | None,
) -> Frame:
    grains, contacts = tables
    if increment is None and contacts.has(*YADE_COLUMNS):
        increment = "radii"
    return Frame(
        *with_plain_names(source, grains, contacts),
        cell=cell if source.cell is None else source.cell,
        step=step,
        shear_increment=increment,
    )


def _group(source: Source, names: Sequence[str], arrays: Arrays, group: str) -> Table:
    start = f"{group}/"
    return table_of_arrays(
        f"{group} of {source.path}",
        [name.removeprefix(start) for name in names if name.startswith(start)],
        {name.removeprefix(start): v for name, v in arrays.items() if name.startswith(start)},
    )


def beside(path: Path, what: str) -> Path:
    """Path of the file whose name has `what` where this one has `grains`."""
    if "grains" not in path.name:
        raise InputError(
            f"name of {path}",
            "no 'grains' in it",
            f"grains_... with {what}_... beside it",
            f"Name the table of {what} explicitly.",
        )
    return path.with_name(path.name.replace("grains", what))


def _cell_beside(path: Path) -> tuple[Floats | None, float | None, ShearIncrement | None]:
    """Cell, iteration and shear increment of `cell_....json` beside the grains, if it is there."""
    if "grains" not in path.name:
        return None, None, None
    name = path.name.replace("grains", "cell")
    for ending in ENDINGS:
        name = name.removesuffix(ending)
    file = path.with_name(f"{name}.json")
    if not file.is_file():
        return None, None, None
    try:
        told = json.loads(file.read_text())
        cell = None if told["cell"] is None else np.array(told["cell"], dtype=float)
        step = None if told.get("iteration") is None else float(told["iteration"])
        increment = told.get("shear_increment")
        return cell, step, None if increment is None else checked_increment(increment)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OSError) as error:
        raise InputError(
            str(file),
            f"no cell ({type(error).__name__}: {str(error)[:100]})",
            '{"cell": [[HXX, HXY], [HYX, HYY]]}, null for none',
            "Correct or remove the file, or give --cell.",
        ) from None
