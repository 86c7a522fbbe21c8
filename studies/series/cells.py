"""Periodic cells of a series from one table, as DEM codes write them beside their snapshots."""

from __future__ import annotations

import re
from pathlib import Path

from loops import InputError
from patterns.snapshots.tables import read_table
from studies.series.fingerprint import ENDINGS
from studies.snapshot import SnapshotInput

Cell = tuple[float, float, float, float]
COLUMNS = ("h_xx", "h_xy", "h_yx", "h_yy")


def cells_by_number(path: Path) -> dict[int, Cell]:
    """Cells of a table by the number of their snapshot.

    Parameters
    ----------
    path : Path
        Table with the columns `snap`, `h_xx`, `h_xy`, `h_yx`, `h_yy`; the columns of the cell
        matrix are its vectors (length).

    Returns
    -------
    dict of int to tuple of 4 floats
        HXX, HXY, HYX, HYY.

    Raises
    ------
    InputError
        If the table is missing or damaged, lacks a column, or has a number twice.
    """
    table = read_table(path)
    numbers = table.integers("snap").tolist()
    if len(set(numbers)) < len(numbers):
        repeated = next(n for n in numbers if numbers.count(n) > 1)
        raise InputError(
            f"column 'snap' of {path}", f"{repeated} twice", "each once", "Drop one of the rows."
        )
    rows = zip(*(table.column(name).tolist() for name in COLUMNS), strict=True)
    return dict(zip(numbers, rows, strict=True))


def number_of(source: SnapshotInput) -> int:
    """Number of a snapshot in a table of cells.

    Parameters
    ----------
    source : SnapshotInput
        What to read.

    Returns
    -------
    int
        Its frame; else the last number in the name of its file, the ending left out.

    Raises
    ------
    InputError
        If the name has no number.

    Examples
    --------
    >>> from pathlib import Path
    >>> from studies.series.cells import number_of
    >>> from studies.snapshot import SnapshotInput
    >>> number_of(SnapshotInput(Path("run2/grains_07.parquet")))
    7
    """
    if source.frame is not None:
        return source.frame
    found = re.findall(r"\d+", ENDINGS.sub("", source.path.name))
    if not found:
        raise InputError(
            f"name of {source.path}",
            "no number in it",
            "the number that column 'snap' of --cells has",
            "Number the files, or give --cell for all of them.",
        )
    return int(found[-1])
