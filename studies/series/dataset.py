"""The folder of a series: which series it holds, and the parts of its two datasets.

Each part is written whole or not at all, and recognised when it is finished.
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
# Readers of a folder of Parquet files pass over names that begin with a dot.
UNFINISHED = ".unfinished"


def open_folder(out: Path, read: Mapping[str, Any], names: Sequence[str], *, force: bool) -> None:
    """Begin a series in a folder, or take up the one that an earlier run began there.

    The same series, read in the same way, goes on; snapshots may follow after its last one. With
    `force` what any command wrote there before is removed.
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
    """Whether anything is finished in the folder of a series."""
    return any(out.glob("*/part-*.parquet"))


def _require_same(out: Path, contents: dict[str, Any]) -> None:
    try:
        before = json.loads((out / SERIES).read_text())
        read, names = before["read"], before["snapshots"]
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(
            f"--out {out}",
            "a folder that holds other files",
            "a new or empty folder, or one that a series was begun in",
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
    # Where nothing is finished there is nothing to lose: a first try with a wrong option.
    if differing and has_parts(out):
        raise InputError(
            f"--out {out}",
            f"a folder with another series ({', '.join(differing)})",
            "the same series, or more snapshots after its last one",
            "Name another place, or give --force to replace its results.",
        )


def write_part(path: Path, columns: Mapping[str, Any], about: Mapping[str, Any]) -> None:
    """Write one part under a temporary name, then give it its own."""
    arrays = {name: pa.array(values) for name, values in columns.items()}
    table = described_table(f"series/{path.parent.name}", arrays, {KEY: as_json(about).encode()})
    path.parent.mkdir(parents=True, exist_ok=True)
    # Two workers may be at the same part when one was given up for lost.
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
    """What was kept in a part's metadata; None if there is no such part, or no whole one."""
    try:
        metadata = pyarrow.parquet.read_schema(path).metadata or {}
        about: dict[str, Any] = json.loads(metadata[KEY])
    except (OSError, pa.ArrowException, KeyError, ValueError):
        return None
    return about


def require_about(path: Path) -> dict[str, Any]:
    """As `read_about`, of a part that must be there."""
    about = read_about(path)
    if about is None:
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    return about


def is_finished(path: Path, fingerprint: str) -> bool:
    """Whether the part is there and was made from the same input by the same configuration."""
    about = read_about(path)
    return about is not None and about.get("fingerprint") == fingerprint


def keep_only(folder: Path, parts: set[str]) -> None:
    """Remove parts of other names, and what interrupted runs left."""
    for path in folder.glob("part-*.parquet"):
        if path.name not in parts:
            path.unlink()
    remove_unfinished(folder)


def remove_unfinished(folder: Path) -> None:
    """Remove what interrupted runs left in a dataset."""
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
