"""What stands in a file of tables: CSV, Parquet, npz and HDF5."""

from __future__ import annotations

import gzip
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from loops import InputError

Arrays = dict[str, NDArray[Any]]
ARRAY_FILES = (".npz", ".h5", ".hdf5")
ENDINGS = (".csv", ".csv.gz", ".parquet", *ARRAY_FILES)


def read_columns(path: Path) -> pyarrow.Table:
    """Columns of a file that holds one table.

    Parameters
    ----------
    path : Path
        File ending in one of `ENDINGS`.

    Returns
    -------
    pyarrow.Table
        As the file has them.

    Raises
    ------
    InputError
        If the file is missing, empty, truncated, of another kind, or no such table.
    """
    require_file(path)
    name = path.name.lower()
    if name.endswith(ARRAY_FILES):
        return as_table(str(path), read_arrays(path))
    with whole_file(path):
        if name.endswith(".parquet"):
            return pyarrow.parquet.read_table(path)
        if name.endswith((".csv", ".csv.gz")):
            return _read_csv(path)
    raise InputError(
        str(path),
        f"a file ending in {path.suffix!r}",
        f"{', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}",
        "Convert it, or name its format by --format.",
    )


def read_arrays(path: Path) -> Arrays:
    """Arrays of an npz or HDF5 file by name; those of groups as `group/name`.

    Parameters
    ----------
    path : Path
        File ending in `.npz`, `.h5` or `.hdf5`.

    Returns
    -------
    dict of str to array
        All arrays of numbers.

    Raises
    ------
    InputError
        If the file is missing, empty, truncated or damaged, or h5py is not installed.
    """
    require_file(path)
    with whole_file(path):
        return _read_npz(path) if path.suffix.lower() == ".npz" else _read_hdf5(path)
    raise AssertionError


def as_table(label: str, arrays: Arrays) -> pyarrow.Table:
    """Arrays of one length as a table.

    Parameters
    ----------
    label : str
        Where they come from, for messages.
    arrays : dict of str to (rows,) array
        Columns.

    Returns
    -------
    pyarrow.Table
        The same columns.

    Raises
    ------
    InputError
        If an array has more axes than one or another length, or there are none.
    """
    if not arrays:
        raise InputError(label, "no arrays", "one array a column", "Check the export.")
    rows = len(next(iter(arrays.values()))) if next(iter(arrays.values())).ndim else 0
    for name, values in arrays.items():
        if values.shape != (rows,):
            raise InputError(
                f"array {name!r} of {label}",
                f"shape {values.shape}",
                f"shape ({rows},), as the first column",
                "Store each column as an array of one axis.",
            )
    return pyarrow.table(arrays)


def require_file(path: Path) -> None:
    """Raise `InputError` if there is no such file or nothing in it."""
    if not path.is_file():
        raise InputError(str(path), "no such file", "a snapshot's file", "Check the path.")
    if path.stat().st_size == 0:
        raise InputError(str(path), "an empty file", "a snapshot's file", "Export it again.")


@contextmanager
def whole_file(path: Path) -> Iterator[None]:
    """Turn what libraries raise on damaged files into one `InputError`."""
    try:
        yield
    except InputError:
        raise
    except (
        *(pyarrow.ArrowException, OSError, EOFError, zlib.error, zipfile.BadZipFile),
        *(ValueError, KeyError, RuntimeError, NotImplementedError, UnicodeDecodeError),
    ) as error:
        raise InputError(
            str(path),
            f"an unreadable or truncated file ({error})",
            "a complete file",
            "Export or copy it again.",
        ) from None


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


def _read_npz(path: Path) -> Arrays:
    with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
        if not isinstance(file, np.lib.npyio.NpzFile):
            raise ValueError("one array, not an archive of arrays")
        try:
            return {name: file[name] for name in file.files}
        except (SyntaxError, tokenize.TokenError) as error:  # numpy parses headers as Python
            raise ValueError(f"a damaged header, {error}") from None


def _read_hdf5(path: Path) -> Arrays:
    try:
        import h5py
    except ImportError:
        raise InputError(
            str(path), "an HDF5 file", "h5py", "Install it: pip install 'grainloops[hdf5]'."
        ) from None
    arrays: Arrays = {}

    def collect(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "iufb":
            arrays[name] = item[()]

    with h5py.File(path, "r") as file:
        file.visititems(collect)
    return arrays
