"""Tables of cells or of times: a row a snapshot, found by the number of its file or its frame."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from loops.errors import InputError, path_of
from patterns.snapshots.tables import read_table

CELL_COLUMNS = ("h_xx", "h_xy", "h_yx", "h_yy")
FILE_ENDINGS = re.compile(r"(\.(csv|tsv|txt|dat|parquet|npz|h5|hdf5|json|gz|bz2|xz|zst))+$", re.I)


def rows_by_number(path: Path, names: Sequence[str] = CELL_COLUMNS) -> dict[int, tuple[float, ...]]:
    """Columns of a table, its cells if none are named, by the number of the snapshot."""
    table = read_table(path)
    numbers = table.integers("snap").tolist()
    if len(set(numbers)) < len(numbers):
        repeated = next(n for n in numbers if numbers.count(n) > 1)
        raise InputError(
            f"column 'snap' of {path}", f"{repeated} twice", "each once", "Drop one of the rows."
        )
    rows = zip(*(table.column(name).tolist() for name in names), strict=True)
    return dict(zip(numbers, rows, strict=True))


def number_reader(
    option: str, path: Path, names: Sequence[str]
) -> Callable[[Path, int | None], tuple[float, ...]]:
    """Function that gives the row of a snapshot in a table of an option."""
    if not path.is_file():
        expected = f"a table with the columns snap, {', '.join(names)}"
        received = "a folder" if path.is_dir() else "no such file"
        raise InputError(f"{option} {path}", received, expected, "Check the path.")
    table = rows_by_number(path, names)

    def row_of(file: Path, frame: int | None) -> tuple[float, ...]:
        number = number_of(file, frame)
        if number in table:
            return table[number]
        raise InputError(
            f"{option} {path}",
            f"no row with snap = {number}, for {file.name}",
            "one row a snapshot",
            "Add the row; snap is the last number in the name, or the place in a file of several.",
        )

    return row_of


def cell_reader(
    cells: str | Path | None, cell: ArrayLike | None = None
) -> Callable[[Path, int | None], ArrayLike | None]:
    """Function that gives the cell of a snapshot, by its file and its number in one of several.

    It is that of a table, else the one that is given.
    """
    if cells is None:
        return lambda file, frame: cell
    if cell is not None:
        raise InputError("--cell, --cells", "both", "one of them", "Leave one out.")
    row_of = number_reader("--cells", path_of("cells", cells, "Name a table."), CELL_COLUMNS)
    return lambda file, frame: np.reshape(row_of(file, frame), (2, 2))


def number_of(path: Path, frame: int | None = None) -> int:
    """Number of a snapshot in a table of cells: its frame, else the last number in the name."""
    if frame is not None:
        return frame
    found = re.findall(r"\d+", FILE_ENDINGS.sub("", path.name))
    if not found:
        raise InputError(
            f"name of {path}",
            "no number in it",
            "the number that column 'snap' of --cells or --times has",
            "Number the files; a cell for all of them is given by --cell.",
        )
    return int(found[-1])
