"""Reading of snapshots: one with its loops, or those of a series in order, each with a digest."""

from __future__ import annotations

import hashlib
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow

from loops import InputError
from patterns import Snapshot, count_frames, planar, read_snapshot
from patterns.snapshots.cells import FILE_ENDINGS, cell_reader, number_reader
from patterns.snapshots.columns import WORDS
from patterns.snapshots.formats import frame_steps
from patterns.snapshots.source import Source
from patterns.snapshots.tables import read_table
from studies.output import as_json, code_version, provenance, readable

# Names of the files of one snapshot differ in these words and in their endings only.
CONTENTS = re.compile(
    "|".join(sorted({*chain(*WORDS.values()), "data", "fstat"}, key=len, reverse=True)), re.I
)


def reading(**how: Any) -> dict[str, Any]:
    """All options of `read_planar` but the path: the given ones, defaults for the others."""
    names = [one.name for one in fields(Source) if one.name != "path"]
    defaults = dict.fromkeys([*names, "frame"]) | {"format": "auto", "strict": False}
    return {**defaults, "drop_crossings": False, **how}


def read_planar(
    path: Path, *, drop_crossings: bool = False, strict: bool = False, **how: Any
) -> Snapshot:
    """Read a snapshot, find its faces; `InputError` for crossing branches, unless dropped.

    Contradictory input is always refused; if `strict` what leaves a doubt as well.
    """
    if how.get("cell") is not None:
        how["cell"] = np.reshape(how["cell"], (2, 2))
    snapshot = read_snapshot(path, **how)
    doubts = [str(one) for one in snapshot.findings if one.severity == "doubt"]
    if strict and doubts:
        remedy = "Mend the file, or leave --strict out."
        raise InputError(str(path), " ".join(doubts), "no doubt under --strict", remedy)
    # Otherwise Arrow keeps memory, a quarter of the size of a large file, for later tables.
    pyarrow.default_memory_pool().release_unused()
    # Crossings and faces are found on two cores. If branches cross, the result and the errors of
    # the search for faces mean nothing.
    with ThreadPoolExecutor(1) as other:
        found = other.submit(getattr, snapshot, "faces")
        plane = planar(snapshot, str(path), drop=drop_crossings)
    if plane is snapshot:
        found.result()
    return plane


@dataclass(frozen=True)
class PlannedSnapshot:
    """One snapshot of a series: its number, its file, the options of `read_planar`, its time."""

    number: int
    path: Path
    how: dict[str, Any]
    time: float | None = None
    fingerprint: str = ""

    @property
    def name(self) -> str:
        """Name of the file, and number in a file of several, for messages and tables."""
        frame = self.how["frame"]
        return readable(self.path.name) + (f", frame {frame}" if frame is not None else "")

    def read(self) -> Snapshot:
        """Read the snapshot and find its faces; `InputError` as `read_planar`."""
        return read_planar(self.path, **self.how)


NUMBERS_IN_NAMES = re.compile(r"(0\.\d+|\d+)")


def in_order(paths: Sequence[Path], how: Mapping[str, Any]) -> tuple[list[Path], list[str]]:
    """Files by the steps in them, else by the numbers in their names, and a note if they moved."""

    def by_name(path: Path) -> list[tuple[float, str]]:
        parts = NUMBERS_IN_NAMES.split(str(path))
        return [(float(part), "") if k % 2 else (0.0, part) for k, part in enumerate(parts)]

    steps: dict[Path, float] = {}
    for path in paths:
        with suppress(InputError):
            first = frame_steps(path, how)[0]
            if first is not None:
                steps[path] = first
    told = len(set(steps.values())) == len(paths)
    ordered = sorted(paths, key=steps.__getitem__) if told else sorted(paths, key=by_name)
    which = "the steps that the files tell" if told else "the numbers in their names"
    moved = [f"snapshots in the order of {which}, not as given: --as-given keeps that"]
    return ordered, moved if ordered != list(paths) else []


def plan_series(
    paths: Sequence[Path], cells: Path | None, how: dict[str, Any], times: Path | None = None
) -> list[PlannedSnapshot]:
    """Snapshots of a series in order: one a file, or all of a file that holds several.

    `times` is a table with their times; by default that of the cells, if it has the column `time`.
    """
    if not paths:
        raise InputError("PATHS", "none", "the files of the snapshots", "Name them in order.")
    seen: set[Path] = set()
    for path in paths:
        if not path.is_file():
            what = "a folder" if path.is_dir() else "no such file"
            raise InputError(str(path), what, "a snapshot's file", "Name files: FOLDER/grains_*.")
        if path.resolve() in seen:
            raise InputError(
                "PATHS", f"{path} twice", "each snapshot once", "Leave the repeated one out."
            )
        seen.add(path.resolve())
    cell = cell_reader(cells, how["cell"])
    if times is None and cells is not None and read_table(cells).has("time"):
        times = cells
    time = None if times is None else number_reader("--times", times, ("time",))
    planned: list[PlannedSnapshot] = []
    for path in paths:
        try:
            count = count_frames(path, format=how["format"], columns=how["columns"])
        except InputError:  # the task of an unreadable file tells why
            count = 1
        for frame in range(count):
            own = how if count == 1 else how | {"frame": frame}
            own = own | {"cell": cell(path, own["frame"])}
            at = None if time is None else time(path, own["frame"])[0]
            planned.append(PlannedSnapshot(len(planned), path.absolute(), own, at))
    return with_fingerprints(planned)


def with_fingerprints(planned: Sequence[PlannedSnapshot]) -> list[PlannedSnapshot]:
    """Add the digest of each snapshot's number, code, options and files."""
    # The files of one snapshot: their folder, and the common part of their names.
    states = defaultdict(list)
    for folder in {one.path.parent for one in planned}:
        for file in sorted(folder.iterdir()):
            if file.is_file():
                found = file.stat()
                states[_snapshot_name(file)].append((file.name, found.st_size, found.st_mtime_ns))
    digests = []
    for one in planned:
        files = states.get(_snapshot_name(one.path), [])
        known = {"number": one.number, "path": one.path.name, "how": one.how, "files": files}
        known["time"] = one.time
        text = as_json(provenance("series", known, code_version()))
        digests.append(hashlib.blake2b(text.encode(), digest_size=16).hexdigest())
    return [replace(one, fingerprint=digest) for one, digest in zip(planned, digests, strict=True)]


def _snapshot_name(path: Path) -> tuple[Path, str]:
    """Folder and common part of the names of the files of one snapshot."""
    return path.parent, CONTENTS.sub("", FILE_ENDINGS.sub("", path.name))
