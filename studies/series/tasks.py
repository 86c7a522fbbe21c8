"""Folder and tasks of a series: the loops of one snapshot, their fates and changes until the next.

Each task writes a part of a dataset, whole or not at all; its metadata identify a finished one.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

from loops import InputError
from loops.arrays import one_blas_thread
from loops.kinetics import order_events
from loops.tracking import LoopFates, exchange_counts
from patterns import Snapshot
from studies.output import (
    DATASETS,
    SERIES,
    UNFINISHED,
    as_json,
    described_table,
    errors_of,
    flat_frame,
    folder_lock,
    remove_listed,
    remove_results,
    require_folder,
    write_whole,
)
from studies.reading import PlannedSnapshot
from studies.series.evolution import (
    chain_bends,
    chain_row,
    evolution_row,
    fate_columns,
    interval_row,
    loop_increments,
    probe_row,
    track_loops,
)
from studies.series.packing import (
    Following,
    increment_columns,
    indicator_columns,
    packing_predictions,
)
from studies.series.workers import Runner, do_all
from studies.snapshot.table import loop_columns

KEY = b"grainloops"


@contextmanager
def series_folder(
    out: Path, read: Mapping[str, Any], names: Sequence[str], *, force: bool
) -> Iterator[None]:
    """Start a series in the folder `out`, or continue the one that an earlier run started there.

    A new folder is removed if no part of it could be finished.
    """
    require_folder(out, force=True)
    contents = {"read": dict(read), "snapshots": list(names)}
    with errors_of(out):
        new = not out.exists()
        out.mkdir(parents=True, exist_ok=True)
        with folder_lock(out):
            if any(out.iterdir()):
                try:
                    _require_same(out, contents)
                except InputError:
                    if not force:
                        raise
                    remove_results(out)
            remove_listed(out)
            described = (as_json(contents) + "\n").encode()
            write_whole(out / SERIES, lambda file: file.write(described))
            try:
                yield
            except InputError:
                if new and not has_parts(out):
                    shutil.rmtree(out)
                raise


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
    """Write one part, whole or not at all."""
    arrays = {name: pa.array(values) for name, values in columns.items()}
    table = described_table(f"series/{path.parent.name}", arrays, {KEY: as_json(about).encode()})
    write_whole(path, partial(pyarrow.parquet.write_table, table))


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


@dataclass(frozen=True)
class Failure:
    """Reason of a failed task."""

    number: int
    name: str
    cause: InputError
    skippable: bool = True

    @property
    def reason(self) -> str:
        """Place of the error, and the value received there."""
        return f"{self.cause.where}: got {self.cause.received}"

    def error(self) -> InputError:
        """Return the error to raise in the main process."""
        where, received, expected, remedy = self.cause.args
        skip = "; --skip-bad leaves this one out" if self.skippable else ""
        remedy = f"{remedy} Finished snapshots are kept{skip}."
        return InputError(
            f"snapshot {self.number} ({self.name}): {where}", received, expected, remedy
        )


@dataclass(frozen=True)
class Extras:
    """Probes and predictors that are asked for besides; `probe` are yield band and directions.

    `candidates` is the share of its strength from which a contact may slide in a prediction.
    """

    probe: tuple[float, int] | None = None
    candidates: float | None = None
    following: Following | None = None
    indicators: bool = False


@dataclass(frozen=True)
class PartTask:
    """Task that writes the loops of one snapshot, or the changes between two successive ones.

    `previous` is the snapshot before it, if there is one.
    """

    snapshots: tuple[PlannedSnapshot, ...]
    out: Path
    extras: Extras
    previous: PlannedSnapshot | None = None

    @property
    def parts(self) -> dict[str, Path]:
        """Files of the results by dataset, in the absolute result folder."""
        numbers = "-".join(f"{one.number:05d}" for one in self.snapshots)
        names = DATASETS[:1] if len(self.snapshots) == 1 else ("increments", "fates")
        if len(self.snapshots) > 1 and self.extras.candidates is not None:
            names = (*names, "packing")
        return {name: self.out / name / f"part-{numbers}.parquet" for name in names}

    @property
    def fingerprint(self) -> str:
        """Digest of everything that the result depends on."""
        before = "" if self.previous is None else self.previous.fingerprint
        return "-".join([*(one.fingerprint for one in self.snapshots), repr(self.extras), before])

    @property
    def finished(self) -> bool:
        """Whether all its files exist and have its fingerprint."""
        told = (read_about(part) or {} for part in self.parts.values())
        return all(about.get("fingerprint") == self.fingerprint for about in told)

    @property
    def name(self) -> str:
        """Name of the snapshots, for messages."""
        return " to ".join(one.name for one in self.snapshots)


@dataclass(frozen=True)
class Series:
    """Planned snapshots, result folder, and what is asked for besides of a series."""

    planned: Sequence[PlannedSnapshot]
    out: Path
    extras: Extras = Extras()

    @cached_property
    def snapshots(self) -> list[PartTask]:
        """A task for each snapshot."""
        return [PartTask((one,), self.out, self.extras) for one in self.planned]

    @cached_property
    def intervals(self) -> list[PartTask]:
        """A task for each snapshot with the next."""
        earlier: list[PlannedSnapshot | None] = [None] * len(self.planned)
        if self.extras.indicators:
            earlier[1:] = self.planned[:-1]
        pairs = zip(pairwise(self.planned), earlier, strict=False)
        return [PartTask(pair, self.out, self.extras, previous) for pair, previous in pairs]

    @property
    def parts(self) -> dict[str, list[Path]]:
        """Files of each dataset, in order."""
        files: dict[str, list[Path]] = {name: [] for name in DATASETS}
        for task in (*self.snapshots, *self.intervals):
            for name, part in task.parts.items():
                files[name].append(part)
        if self.extras.candidates is None:
            del files["packing"]
        return files


def do_tasks(
    runner: Runner, tasks: Sequence[PartTask], title: str, *, skip_bad: bool
) -> list[Failure]:
    """Do the tasks that are not finished yet, with a progress bar; failures that may be skipped."""
    open_tasks = [task for task in tasks if not task.finished]
    if not open_tasks:
        return []
    console = Console(stderr=True)
    if done := len(tasks) - len(open_tasks):
        console.print(f"{title}: {done} of {len(tasks)} were finished before", highlight=False)
    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    hidden = not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=hidden) as bar:
        row = bar.add_task(title, total=len(tasks), completed=done)
        answers = do_all(
            *(runner, partial(do_task, skip_bad=skip_bad), open_tasks),
            progress=lambda ended, *_: bar.update(row, completed=done + ended),
        )
    return [answer for answer in answers if answer is not None]


def do_task(task: PartTask, *, skip_bad: bool) -> Failure | None:
    """Write the files of a task, or return why it is left out; a repetition writes the same bytes.

    `InputError` for a failure that is not skipped.
    """
    last = task.snapshots[-1]
    try:
        with one_blas_thread():
            (_write_snapshot if len(task.snapshots) == 1 else _write_pair)(task)
    except InputError as error:
        # What is refused on purpose is not left out.
        failure = Failure(last.number, last.name, error, skippable=not last.how["strict"])
    except OSError as error:
        # Errors of reading are InputErrors already.
        said = error.strerror or str(error)
        full = InputError(
            str(next(iter(task.parts.values()))), said, "a place to write", "Make room."
        )
        failure = Failure(last.number, last.name, full, skippable=False)
    else:
        return None
    if skip_bad and failure.skippable:
        return failure
    raise failure.error()


def _write_snapshot(task: PartTask) -> None:
    """Write the table of loops; its metadata keeps the row of the snapshot in `evolution`."""
    (planned,) = task.snapshots
    state = planned.read()
    # Tasks run at the same time, each on one core.
    table = loop_columns(state, threads=1)
    row, notes = evolution_row(state, table), list(state.notes)
    if task.extras.probe is not None:
        probed, why = probe_row(state, *task.extras.probe)
        row, notes = row | probed, notes + why
    rows, step = len(table["loop"]), state.step
    place = {
        "snapshot": np.full(rows, planned.number),
        "step": np.full(rows, np.nan if step is None else float(step)),
    }
    about = {"fingerprint": task.fingerprint, "row": row, "notes": notes}
    write_part(task.parts["loops"], place | table, about)


def _write_pair(task: PartTask) -> None:
    """Write the tables of fates and increments; metadata keep the row of the interval."""
    before, after, fates = tracked(task)
    table, extras, parts = loop_increments(before, after, fates), task.extras, task.parts
    own = {"fingerprint": task.fingerprint}
    bends, beside = chain_bends(before, after)
    columns = fate_columns(fates, beside)
    write_part(parts["fates"], _numbers(task, len(columns["fate"])) | columns, own)
    about: dict[str, Any] = {
        "fingerprint": task.fingerprint,
        "row": interval_row(before, after, fates, table) | chain_row(bends, beside, fates, table),
        "exchange": exchange_counts(fates)._asdict(),
        "events": order_events(fates)._asdict(),
    }
    if extras.candidates is not None:
        columns, row, about["notes"] = packing_predictions(
            *(before, after, fates, extras.candidates, extras.following),
            [one.time for one in task.snapshots],
        )
        if extras.indicators:
            previous = None if task.previous is None else task.previous.read()
            columns |= indicator_columns(before, previous)
        about["row"] |= row
        table |= increment_columns(table, about["row"], columns)
        # A restart looks for the increments: they are written last.
        write_part(parts["packing"], _numbers(task, len(columns["loop"])) | columns, own)
    write_part(parts["increments"], _numbers(task, len(table["loop_before"])) | table, about)


def _numbers(task: PartTask, rows: int) -> dict[str, Any]:
    names = ("snapshot_before", "snapshot_after")
    pairs = zip(names, task.snapshots, strict=True)
    return {name: np.full(rows, one.number) for name, one in pairs}


def tracked(task: PartTask) -> tuple[Snapshot, Snapshot, LoopFates]:
    """Two successive snapshots and the fates of the loops between them."""
    before, after = (planned.read() for planned in task.snapshots)
    return before, after, track_loops(before, after)
