"""The table of contents of a series' folder: which series it holds, and whether it may go on."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from loops import InputError
from studies.output import SERIES, as_json, remove_listed, remove_results
from studies.series.dataset import UNFINISHED
from studies.series.plan import PlannedSnapshot, SeriesInput

HOW = ("format", "columns", "cell", "kn", "kt", "mu", "drop_crossings", "shear_increment")


def open_folder(
    out: Path, series: SeriesInput, planned: Sequence[PlannedSnapshot], *, force: bool
) -> None:
    """Begin a series in a folder, or take up the one that an earlier run began there.

    The same series, read in the same way, goes on; snapshots may follow after its last one. With
    `force` what any command wrote there before is removed.
    """
    contents = _contents(series, planned)
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


def _contents(series: SeriesInput, planned: Sequence[PlannedSnapshot]) -> dict[str, Any]:
    how = {name: getattr(series, name) for name in HOW}
    cells = None if series.cells is None else series.cells.name
    return {"read": how | {"cells": cells}, "snapshots": [one.name for one in planned]}


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
        f"--{name.replace('_', '-')}" for name in now["read"] if now["read"][name] != read.get(name)
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
