"""Tasks of a series: the loops of one snapshot, and their fates and changes until the next."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

from loops import InputError
from loops.kinetics import order_events
from loops.tracking import LoopFates, exchange_counts
from patterns import Snapshot
from studies.output import DATASETS
from studies.series.dataset import is_finished, write_part
from studies.series.evolution import evolution_row, interval_row, probe_row
from studies.series.increments import fate_columns, increments, track_loops
from studies.series.packing import increment_columns, packing_predictions
from studies.series.plan import PlannedSnapshot
from studies.series.workers import Runner, one_blas_thread
from studies.snapshot.table import loop_table


@dataclass(frozen=True)
class Failure:
    """Reason of a failed task: the parts of an `InputError`, to send between processes."""

    number: int
    name: str
    where: str
    received: str
    expected: str
    remedy: str
    skippable: bool = True

    def error(self) -> InputError:
        """Return the error to raise in the main process."""
        skip = "; --skip-bad goes on without this one" if self.skippable else ""
        return InputError(
            f"snapshot {self.number} ({self.name}): {self.where}",
            self.received,
            self.expected,
            f"{self.remedy} What is finished is kept{skip}.",
        )


@dataclass(frozen=True)
class PartTask:
    """Task that writes the loops of one snapshot, or the changes between two successive ones.

    With `directions` the snapshot is probed as well.
    """

    snapshots: tuple[PlannedSnapshot, ...]
    out: Path
    yield_band: float | None = None
    directions: int | None = None
    by_events: bool = False

    @property
    def part(self) -> Path:
        """File of the result, in a dataset of the absolute result folder."""
        return self._part(DATASETS[len(self.snapshots) - 1])

    @property
    def packing_part(self) -> Path:
        """File of the packing's predictions."""
        return self._part(DATASETS[2])

    @property
    def fates_part(self) -> Path:
        """File of the fates of all loops."""
        return self._part(DATASETS[3])

    @property
    def fingerprint(self) -> str:
        """Digest of everything that the result depends on."""
        how = self.yield_band, self.directions
        band = [repr(one) for one in how if one is not None] + ["events"] * self.by_events
        return "-".join([*(one.fingerprint for one in self.snapshots), *band])

    @property
    def finished(self) -> bool:
        """Whether all its files exist and have its fingerprint."""
        parts = [self.part]
        if len(self.snapshots) > 1:
            parts += [self.fates_part, *([] if self.yield_band is None else [self.packing_part])]
        return all(is_finished(part, self.fingerprint) for part in parts)

    @property
    def name(self) -> str:
        """Name of the snapshots, for messages."""
        return " to ".join(one.name for one in self.snapshots)

    def _part(self, dataset: str) -> Path:
        numbers = "-".join(f"{one.number:05d}" for one in self.snapshots)
        return self.out / dataset / f"part-{numbers}.parquet"


@dataclass(frozen=True)
class Series:
    """Planned snapshots, result folder and optional extra predictors of a series.

    With `yield_band` the packing predicts each interval, with `by_events` its path and its replay
    too; `probe` are the yield band and the number of directions of the probes of each snapshot.
    """

    planned: Sequence[PlannedSnapshot]
    out: Path
    yield_band: float | None = None
    by_events: bool = False
    probe: tuple[float | None, int | None] = (None, None)

    @cached_property
    def snapshots(self) -> list[PartTask]:
        """A task for each snapshot."""
        return [PartTask((one,), self.out, *self.probe) for one in self.planned]

    @cached_property
    def intervals(self) -> list[PartTask]:
        """A task for each snapshot with the next."""
        asked = self.out, self.yield_band
        pairs = pairwise(self.planned)
        return [PartTask(pair, *asked, by_events=self.by_events) for pair in pairs]


def do_tasks(
    runner: Runner, tasks: Sequence[PartTask], title: str, *, skip_bad: bool
) -> list[Failure]:
    """Do the tasks that are not finished yet, with a progress bar; failures that may be skipped."""
    open_tasks = [task for task in tasks if not task.finished]
    if not open_tasks:
        return []
    console = Console(stderr=True)
    if len(open_tasks) < len(tasks):
        done = len(tasks) - len(open_tasks)
        console.print(f"{title}: {done} of {len(tasks)} were finished before", highlight=False)
    failures = []
    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    hidden = not console.is_terminal
    with (
        Progress(*columns, console=console, transient=True, disable=hidden) as bar,
        # However the loop ends, tasks that have not started are dropped.
        closing(runner(do_task, open_tasks)) as answers,
    ):
        row = bar.add_task(title, total=len(tasks), completed=len(tasks) - len(open_tasks))
        for answer in answers:
            bar.advance(row)
            if answer is not None and not (skip_bad and answer.skippable):
                raise answer.error()
            if answer is not None:
                failures.append(answer)
    return sorted(failures, key=lambda failure: failure.number)


def do_task(task: PartTask) -> Failure | None:
    """Write the files of a task, or return why it failed; a repetition writes the same bytes."""
    last = task.snapshots[-1]
    try:
        with one_blas_thread():
            (_write_snapshot if len(task.snapshots) == 1 else _write_pair)(task)
    except InputError as error:
        parts = error.where, error.received, error.expected, error.remedy
        return Failure(last.number, last.name, *parts)
    except OSError as error:
        # Errors of reading are InputErrors already.
        parts = str(task.part), error.strerror or str(error), "a place to write", "Make room."
        return Failure(last.number, last.name, *parts, skippable=False)
    return None


def _write_snapshot(task: PartTask) -> None:
    """Write the table of loops; its metadata keeps the row of the snapshot in `evolution`."""
    (planned,) = task.snapshots
    state = planned.read()
    # Tasks run at the same time, each on one core.
    table = loop_table(state, threads=1)
    row, notes = evolution_row(state, table), list(state.notes)
    if task.directions is not None and task.yield_band is not None:
        probed, why = probe_row(state, task.directions, task.yield_band)
        row, notes = row | probed, notes + why
    rows, step = len(table["loop"]), state.step
    place = {
        "snapshot": np.full(rows, planned.number),
        "step": np.full(rows, np.nan if step is None else float(step)),
    }
    about = {"fingerprint": task.fingerprint, "row": row, "notes": notes}
    write_part(task.part, place | table, about)


def _write_pair(task: PartTask) -> None:
    """Write the tables of fates and increments; metadata keep the row of the interval."""
    before, after, fates = tracked(task)
    table = increments(before, after, fates)
    own = {"fingerprint": task.fingerprint}
    columns = fate_columns(fates)
    write_part(task.fates_part, _numbers(task, len(columns["fate"])) | columns, own)
    about: dict[str, Any] = {
        "fingerprint": task.fingerprint,
        "row": interval_row(before, after, fates, table),
        "exchange": exchange_counts(fates)._asdict(),
        "events": order_events(fates)._asdict(),
    }
    if task.yield_band is not None:
        columns, row, about["notes"] = packing_predictions(
            before, after, fates, task.yield_band, task.by_events
        )
        about["row"] |= row
        table |= increment_columns(table, about["row"], columns)
        # A restart looks for the increments: they are written last.
        write_part(task.packing_part, _numbers(task, len(columns["loop"])) | columns, own)
    write_part(task.part, _numbers(task, len(table["loop_before"])) | table, about)


def _numbers(task: PartTask, rows: int) -> dict[str, Any]:
    names = ("snapshot_before", "snapshot_after")
    pairs = zip(names, task.snapshots, strict=True)
    return {name: np.full(rows, one.number) for name, one in pairs}


def tracked(task: PartTask) -> tuple[Snapshot, Snapshot, LoopFates]:
    """Two successive snapshots and the fates of the loops between them."""
    before, after = (planned.read() for planned in task.snapshots)
    return before, after, track_loops(before, after)
