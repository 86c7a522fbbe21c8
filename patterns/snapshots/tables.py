"""Columns of numbers from CSV, CSV.gz and Parquet files."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from loops import InputError


class Table:
    """A table of a file, its columns taken by name as arrays of float64.

    Parameters
    ----------
    path : Path
        File ending in `.csv`, `.csv.gz` or `.parquet`.

    Raises
    ------
    InputError
        If the file is missing, empty, truncated, of another kind, or no such table.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._table = _read(path)
        self._names = _column_names(path, self._table)
        if self._table.num_rows == 0:
            raise InputError(str(path), "no rows", "at least one row", "Check the export.")

    def __len__(self) -> int:
        return int(self._table.num_rows)

    def has(self, *names: str) -> bool:
        """Whether all these columns are there."""
        return all(name in self._names for name in names)

    def column(self, name: str) -> NDArray[np.float64]:
        """Numbers of a column; `InputError` if it is missing or holds anything else."""
        if not self.has(name):
            raise InputError(
                f"column {name!r} of {self.path}",
                f"columns {', '.join(self._names)}",
                f"a column {name!r}",
                "Add it, or rename the one that holds it.",
            )
        column = self._table.column(self._names.index(name))
        try:
            if pyarrow.types.is_boolean(column.type):
                column = column.cast(pyarrow.int8())
            values = column.cast(pyarrow.float64()).to_numpy(zero_copy_only=False)
        except (pyarrow.ArrowException, UnicodeDecodeError) as error:
            raise InputError(
                f"column {name!r} of {self.path}",
                str(error),
                "numbers",
                "Correct the file.",
            ) from None
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise InputError(
                f"column {name!r} of {self.path}, row {bad[0]}",
                str(values[bad[0]]),
                "a finite number",
                "Correct or drop the row.",
            )
        return np.asarray(values, dtype=np.float64)

    def integers(self, name: str) -> NDArray[np.int64]:
        """Whole numbers of a column; `InputError` as `column`, and for fractions."""
        values = self.column(name)
        whole = np.rint(values)
        bad = np.flatnonzero(whole != values)
        if len(bad):
            raise InputError(
                f"column {name!r} of {self.path}, row {bad[0]}",
                str(values[bad[0]]),
                "a whole number",
                "Correct the file.",
            )
        return whole.astype(np.int64)


def _column_names(path: Path, table: pyarrow.Table) -> list[str]:
    try:
        names = list(table.column_names)
    except UnicodeDecodeError as error:
        raise InputError(
            f"header of {path}", f"bytes that are no text ({error})", "column names", "Correct it."
        ) from None
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InputError(
            f"header of {path}",
            f"the column {repeated[0]!r} more than once",
            "each column once",
            "Rename or drop one of them.",
        )
    return names


def _read(path: Path) -> pyarrow.Table:
    if not path.is_file():
        raise InputError(str(path), "no such file", "a table", "Check the path.")
    if path.stat().st_size == 0:
        raise InputError(str(path), "an empty file", "a table", "Export it again.")
    name = path.name.lower()
    try:
        if name.endswith(".parquet"):
            return pyarrow.parquet.read_table(path)
        if name.endswith((".csv", ".csv.gz")):
            return _read_csv(path)
    except (pyarrow.ArrowException, OSError, EOFError, zlib.error) as error:
        raise InputError(
            str(path),
            f"an unreadable or truncated file ({error})",
            "a complete table",
            "Export or copy it again.",
        ) from None
    raise InputError(
        str(path), f"a file ending in {path.suffix!r}", ".csv, .csv.gz or .parquet", "Convert it."
    )


def _read_csv(path: Path) -> pyarrow.Table:
    opener = gzip.open if path.name.lower().endswith(".gz") else open
    with opener(path, "rb") as file:
        content = file.read()
    # A number cut short still reads as a number: only the missing line end gives it away.
    if not content.endswith(b"\n"):
        raise InputError(
            str(path),
            "a last line without its end",
            "complete lines",
            "Export or copy it again; if the line is complete, end it.",
        )
    return pyarrow.csv.read_csv(pyarrow.BufferReader(content))
