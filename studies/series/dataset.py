"""The folder of a series: the series that it holds, and the parts of its datasets.

A part is written whole or not at all; its metadata identify a finished one.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import uuid
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from loops import InputError
from studies.output import (
    SERIES,
    as_json,
    described_table,
    flat_frame,
    remove_listed,
    remove_results,
)

KEY = b"grainloops"
# Readers of a folder of Parquet files skip names that begin with a dot.
UNFINISHED = ".unfinished"


def open_folder(out: Path, read: Mapping[str, Any], names: Sequence[str], *, force: bool) -> None:
    """Start a series in a folder, or continue the one that an earlier run started there.

    The series and the options of reading must be the same; more snapshots may follow the last one.
    With `force` the results of any command in the folder are removed.
    """
    contents = {"read": dict(read), "snapshots": list(names)}
    if any(out.iterdir()):
        try:
            _require_same(out, contents)
        except InputError:
            if not force:
                raise
            remove_results(out)
    remove_listed(out)
    shutil.rmtree(out / UNFINISHED, ignore_errors=True)
    partial = out / f".{SERIES}"
    partial.write_text(as_json(contents) + "\n")
    os.replace(partial, out / SERIES)


def has_parts(out: Path) -> bool:
    """Whether the folder of a series has a finished part."""
    return any(out.glob("*/part-*.parquet"))


def _require_same(out: Path, contents: dict[str, Any]) -> None:
    try:
        before = json.loads((out / SERIES).read_text())
        read, names = before["read"], before["snapshots"]
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(
            f"--out {out}",
            "a folder that holds other files",
            "a new or empty folder, or one in which a series was started",
            "Name another place, or give --force to replace results of the same names.",
        ) from None
    now = json.loads(as_json(contents))
    differing = [
        f"--{name.replace('_', '-')}"
        for name in {**now["read"], **read}
        if now["read"].get(name) != read.get(name)
    ]
    if now["snapshots"][: len(names)] != names:
        differing.append("other snapshots")
    # Without a finished part nothing is lost: the first try had a wrong option.
    if differing and has_parts(out):
        raise InputError(
            f"--out {out}",
            f"a folder with another series ({', '.join(differing)})",
            "the same series, or more snapshots after its last one",
            "Name another place, or give --force to replace its results.",
        )


def write_part(path: Path, columns: Mapping[str, Any], about: Mapping[str, Any]) -> None:
    """Write one part under a temporary name, then rename it."""
    arrays = {name: pa.array(values) for name, values in columns.items()}
    table = described_table(f"series/{path.parent.name}", arrays, {KEY: as_json(about).encode()})
    path.parent.mkdir(parents=True, exist_ok=True)
    # Two workers may write the same part if one of them was believed lost.
    partial = path.with_name(f"{UNFINISHED}-{uuid.uuid4().hex}")
    try:
        with open(partial, "wb") as file:
            pyarrow.parquet.write_table(table, file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def read_about(path: Path) -> dict[str, Any] | None:
    """Metadata of a part; None if it is missing or incomplete."""
    try:
        metadata = pyarrow.parquet.read_schema(path).metadata or {}
        about: dict[str, Any] = json.loads(metadata[KEY])
    except (OSError, pa.ArrowException, KeyError, ValueError):
        return None
    return about


def require_about(path: Path) -> dict[str, Any]:
    """Metadata of a part; `FileNotFoundError` if it is missing."""
    about = read_about(path)
    if about is None:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    return about


def is_finished(path: Path, fingerprint: str) -> bool:
    """Whether the part exists and was made from the same input with the same configuration."""
    about = read_about(path)
    return about is not None and about.get("fingerprint") == fingerprint


def keep_only(folder: Path, parts: set[str]) -> None:
    """Remove parts with other names, and unfinished files of interrupted runs."""
    for path in folder.glob("part-*.parquet"):
        if path.name not in parts:
            path.unlink()
    for path in folder.glob(f"{UNFINISHED}-*"):
        path.unlink(missing_ok=True)


def require_one_schema(paths: list[Path]) -> None:
    """Check that all parts have the same columns of the same types."""
    schemas = [pyarrow.parquet.read_schema(path) for path in paths]
    for path, schema in zip(paths, schemas, strict=True):
        if not schema.equals(schemas[0]):
            differing = set(schema.names) ^ set(schemas[0].names)
            raise InputError(
                f"columns of {path}",
                f"others than in {paths[0].name} ({', '.join(sorted(differing))})",
                "the same columns in every part",
                "Put snapshots with forces and without them in two series.",
            )


def write_csv(paths: list[Path], out: Path) -> None:
    """All parts as one CSV file, part by part; lists are joined by blanks."""
    with open(out, "w", newline="") as file:
        for number, path in enumerate(paths):
            frame = flat_frame(pyarrow.parquet.read_table(path))
            frame.to_csv(file, index=False, header=number == 0)
