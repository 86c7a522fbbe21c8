"""Result folders: written whole or not at all, with their provenance."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from loops import InputError

SIGNS = "forces, stresses and strains positive in compression; angles counter-clockwise"
UNITS_OF_A_LOOP = (
    "dimensionless: lengths over l0 (two radii), forces over kn l0, stresses over kn; "
    "angles in degrees"
)


def provenance(command: str, configuration: Mapping[str, Any], units: str) -> dict[str, Any]:
    """What made a result: command, configuration, version, units and sign convention.

    Parameters
    ----------
    command : str
        The command's name.
    configuration : mapping
        Its arguments.
    units : str
        Units of the results.

    Returns
    -------
    dict
        Plain values, for JSON and for the metadata of tables and figures.
    """
    try:
        number = version("grainloops")
    except PackageNotFoundError:
        number = "not installed"
    return {
        "command": f"grainloops {command}",
        "configuration": dict(configuration),
        "version": number,
        "units": units,
        "signs": SIGNS,
    }


@contextmanager
def result_folder(out: Path, *, force: bool) -> Iterator[Path]:
    """Folder to write into; its files move to `out` only when everything has been written.

    Parameters
    ----------
    out : Path
        Where the results go; created. With `force`, files of the same names are replaced and
        others stay.
    force : bool
        Whether results may be replaced.

    Yields
    ------
    Path
        A temporary folder beside `out`.

    Raises
    ------
    InputError
        If `out` is a file, or holds files and `force` is false.
    """
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}", "a file", "a folder", "Name another place.")
    if not force and out.is_dir() and any(out.iterdir()):
        raise InputError(
            f"--out {out}",
            "a folder that holds files",
            "a new or empty folder",
            "Name another place, or give --force to replace results of the same names.",
        )
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    except OSError as error:
        raise InputError(
            f"--out {out}", error.strerror or str(error), "a place to write", "Name another place."
        ) from None
    try:
        yield partial
        out.mkdir(exist_ok=True)
        for file in sorted(partial.iterdir()):
            os.replace(file, out / file.name)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def write_summary(folder: Path, summary: Mapping[str, Any]) -> None:
    """Write `summary.json` with sorted plain keys; numbers that are not finite become null.

    Parameters
    ----------
    folder : Path
        Where.
    summary : mapping
        Plain values and arrays.
    """
    (folder / "summary.json").write_text(as_json(summary) + "\n")


def as_json(summary: Mapping[str, Any]) -> str:
    """JSON text with sorted keys; arrays become lists, numbers that are not finite null.

    Parameters
    ----------
    summary : mapping
        Plain values and arrays.

    Returns
    -------
    str
        Strict JSON.

    Examples
    --------
    >>> import numpy as np
    >>> from studies.output import as_json
    >>> as_json({"b": np.array([1.0, np.nan]), "a": np.int64(3)}).split()
    ['{', '"a":', '3,', '"b":', '[', '1.0,', 'null', ']', '}']
    """
    return json.dumps(_plain(summary), indent=2, sort_keys=True, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value


def write_table(
    folder: Path, name: str, columns: Mapping[str, Any], source: Mapping[str, Any], *, csv: bool
) -> None:
    """Write a table as Parquet, and as CSV on request, its provenance in the Parquet metadata.

    Parameters
    ----------
    folder : Path
        Where.
    name : str
        Name without its ending.
    columns : mapping of str to array
        Columns of equal length; pyarrow arrays allowed.
    source : mapping
        From `provenance`.
    csv : bool
        Whether to write `name.csv` too; lists are joined by blanks there.
    """
    table = pa.table({key: pa.array(value) for key, value in columns.items()})
    metadata = {b"grainloops": as_json(source).encode()}
    # Columns of measurements hardly repeat: a dictionary of their values only costs time.
    repeating = [field.name for field in table.schema if not pa.types.is_floating(field.type)]
    pyarrow.parquet.write_table(
        table.replace_schema_metadata(metadata),
        folder / f"{name}.parquet",
        use_dictionary=repeating,
    )
    if csv:
        frame = table.to_pandas()
        for key in frame.columns:
            if frame[key].dtype == object and isinstance(frame[key].iloc[0], np.ndarray):
                frame[key] = [" ".join(map(str, row)) for row in frame[key]]
        frame.to_csv(folder / f"{name}.csv", index=False)
