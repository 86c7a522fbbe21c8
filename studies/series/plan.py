"""Plan of a series: its snapshots in order, each with a digest of everything it depends on."""

from __future__ import annotations

import hashlib
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from loops import InputError
from patterns import Snapshot, count_frames
from patterns.snapshots.tables import read_table
from studies.output import as_json, code_version, provenance, readable
from studies.snapshot.source import read_planar

Cell = tuple[float, float, float, float]
CELL_COLUMNS = ("h_xx", "h_xy", "h_yx", "h_yy")
# Names of the files of one snapshot differ in these words and in their endings only.
CONTENTS = re.compile(
    "grains|atoms?|spheres|contacts?|local|pairs?|intrs?|cell|walls?|data|fstat", re.IGNORECASE
)
FILE_ENDINGS = re.compile(r"(\.(csv|parquet|npz|h5|hdf5|json|vtu|vtp|vtk|gz))+$", re.IGNORECASE)


@dataclass(frozen=True)
class PlannedSnapshot:
    """One snapshot of a series: its number, its file, the options of `read_planar`."""

    number: int
    path: Path
    how: dict[str, Any]
    fingerprint: str = ""

    @property
    def name(self) -> str:
        """Name of the file, and number in a file of several, for messages and tables."""
        frame = self.how["frame"]
        return readable(self.path.name) + (f", frame {frame}" if frame is not None else "")

    def read(self) -> Snapshot:
        """Read the snapshot and find its faces; `InputError` as `read_planar`."""
        return read_planar(self.path, **self.how)


def plan_series(
    paths: Sequence[Path], cells: Path | None, how: dict[str, Any]
) -> list[PlannedSnapshot]:
    """Snapshots of a series in order: one a file, or all of a file that holds several."""
    _require_distinct(paths)
    if how["cell"] is not None and cells is not None:
        raise InputError("--cell, --cells", "both", "one of them", "Leave one out.")
    asked = [(path.absolute(), one) for path in paths for one in _frames(path, how)]
    planned = [PlannedSnapshot(number, *one) for number, one in enumerate(asked)]
    if cells is not None:
        table = cells_by_number(cells)
        planned = [
            replace(one, how=one.how | {"cell": _cell_of(one, table, cells)}) for one in planned
        ]
    return with_fingerprints(planned)


def _require_distinct(paths: Sequence[Path]) -> None:
    if not paths:
        raise InputError("PATHS", "none", "the files of the snapshots", "Name them in order.")
    seen: dict[Path, Path] = {}
    for path in paths:
        if not path.is_file():
            what = "a folder" if path.is_dir() else "no such file"
            raise InputError(str(path), what, "a snapshot's file", "Name files: FOLDER/grains_*.")
        if path.resolve() in seen:
            raise InputError(
                "PATHS", f"{path} twice", "each snapshot once", "Leave the repeated one out."
            )
        seen[path.resolve()] = path


def _frames(path: Path, how: dict[str, Any]) -> list[dict[str, Any]]:
    """Options for each snapshot of a file; an unreadable file is left to its task."""
    try:
        count = count_frames(path, format=how["format"], columns=how["columns"])
    except InputError:
        count = 1
    return [how] if count == 1 else [how | {"frame": frame} for frame in range(count)]


def cells_by_number(path: Path) -> dict[int, Cell]:
    """Cells of a table by the number of their snapshot."""
    table = read_table(path)
    numbers = table.integers("snap").tolist()
    if len(set(numbers)) < len(numbers):
        repeated = next(n for n in numbers if numbers.count(n) > 1)
        raise InputError(
            f"column 'snap' of {path}", f"{repeated} twice", "each once", "Drop one of the rows."
        )
    rows = zip(*(table.column(name).tolist() for name in CELL_COLUMNS), strict=True)
    return dict(zip(numbers, rows, strict=True))


def _cell_of(snapshot: PlannedSnapshot, cells: dict[int, Cell], table: Path) -> Cell:
    number = number_of(snapshot.path, snapshot.how["frame"])
    if number not in cells:
        raise InputError(
            f"--cells {table}",
            f"no row with snap = {number}, for {snapshot.path.name}",
            "one row a snapshot",
            "Add the row; snap is the last number in the name, or the place in a file of several.",
        )
    return cells[number]


def number_of(path: Path, frame: int | None = None) -> int:
    """Number of a snapshot in a table of cells: its frame, else the last number in the name."""
    if frame is not None:
        return frame
    found = re.findall(r"\d+", FILE_ENDINGS.sub("", path.name))
    if not found:
        raise InputError(
            f"name of {path}",
            "no number in it",
            "the number that column 'snap' of --cells has",
            "Number the files, or give --cell for all of them.",
        )
    return int(found[-1])


def with_fingerprints(planned: Sequence[PlannedSnapshot]) -> list[PlannedSnapshot]:
    """Add the digest of each snapshot's number, code, options and files."""
    folders = {folder: _by_name(folder) for folder in {one.path.parent for one in planned}}
    return [
        replace(one, fingerprint=_digest(one, folders[one.path.parent].get(_common(one.path), [])))
        for one in planned
    ]


def _digest(one: PlannedSnapshot, files: list[Path]) -> str:
    states = [(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files]
    known = {"number": one.number, "path": one.path.name, "how": one.how, "files": states}
    made = provenance("series", known, code_version())
    return hashlib.blake2b(as_json(made).encode(), digest_size=16).hexdigest()


def _by_name(folder: Path) -> dict[str, list[Path]]:
    """Files of a folder by the common part of the names of one snapshot's files."""
    found: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(folder.iterdir()):
        if path.is_file():
            found[_common(path)].append(path)
    return found


def _common(path: Path) -> str:
    return CONTENTS.sub("", FILE_ENDINGS.sub("", path.name))
