"""Columns of numbers, and the files they come from: CSV, Parquet, npz and HDF5."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.table_files import read_columns


class Table:
    """Columns taken by name as arrays of float64.

    Parameters
    ----------
    path : str or Path
        Where the columns come from, for messages.
    columns : pyarrow.Table or mapping of str to (rows,) array
        The columns.

    Raises
    ------
    InputError
        If a name stands there twice or is no text, or there are no rows.
    """

    def __init__(
        self, path: str | Path, columns: pyarrow.Table | Mapping[str, NDArray[np.generic]]
    ) -> None:
        self.path = str(path)
        if not isinstance(columns, pyarrow.Table):
            columns = pyarrow.table({name: np.asarray(values) for name, values in columns.items()})
        self._table = columns
        self.names = _column_names(self.path, columns)
        if columns.num_rows == 0:
            raise InputError(self.path, "no rows", "at least one row", "Check the export.")

    def __len__(self) -> int:
        return int(self._table.num_rows)

    def has(self, *names: str) -> bool:
        """Whether all these columns are there."""
        return all(name in self.names for name in names)

    def renamed(self, columns: Mapping[str, str]) -> Table:
        """Return the table with the plain names of a column map: `{plain name: column}`.

        A column that already has the plain name, and is not the one mapped, gives way. Entries
        whose column is not here are left alone: a map may speak of two tables.
        """
        new = {column: name for name, column in columns.items() if column in self.names}
        kept = [name for name in self.names if name in new or name not in new.values()]
        table = self._table.select([self.names.index(name) for name in kept])
        return Table(self.path, table.rename_columns([new.get(name, name) for name in kept]))

    def column(self, name: str) -> NDArray[np.float64]:
        """Numbers of a column; `InputError` if it is missing or holds anything else."""
        if not self.has(name):
            raise InputError(
                f"column {name!r} of {self.path}",
                f"columns {', '.join(self.names)}",
                f"a column {name!r}",
                f"Add it, or name the one that holds it: --columns {name}=COLUMN.",
            )
        column = self._table.column(self.names.index(name))
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

    def columns(self, *names: str) -> NDArray[np.float64]:
        """(rows, names) array of several columns."""
        return np.column_stack([self.column(name) for name in names])

    def optional(self, *names: str) -> NDArray[np.float64] | None:
        """`columns`, or None if none of them is there; some without the others is an error."""
        return self.columns(*names) if any(name in self.names for name in names) else None

    def integers(self, name: str) -> NDArray[np.int64]:
        """Whole numbers of a column; `InputError` as `column`, and for fractions."""
        values = self.column(name)
        # Beyond 2^53 a float64 no longer tells neighbours apart.
        bad = np.flatnonzero((np.rint(values) != values) | (np.abs(values) > 2.0**53))
        if len(bad):
            raise InputError(
                f"column {name!r} of {self.path}, row {bad[0]}",
                str(values[bad[0]]),
                "a whole number",
                "Correct the file.",
            )
        return values.astype(np.int64)


def read_table(path: Path) -> Table:
    """Read a file that holds one table.

    Parameters
    ----------
    path : Path
        File ending in `.csv`, `.csv.gz`, `.parquet`, `.npz`, `.h5` or `.hdf5`; arrays of the
        last three are columns.

    Returns
    -------
    Table
        Its columns.

    Raises
    ------
    InputError
        If the file is missing, empty, truncated, of another kind, or no such table.
    """
    return Table(path, read_columns(path))


def _column_names(path: str, table: pyarrow.Table) -> list[str]:
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
