"""The two tasks of a series: the loops of one snapshot, and what became of them by the next."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import _fblas as fblas

from loops import InputError
from loops.kinetics import order_events
from loops.tracking import LoopFates, exchange_counts
from patterns import Snapshot
from studies.output import DATASETS
from studies.series.dataset import is_finished, write_part
from studies.series.evolution import evolution_row, interval_row
from studies.series.fates import fate_columns
from studies.series.increments import increments, track_loops
from studies.series.packing import foretold, gained
from studies.series.plan import PlannedSnapshot
from studies.series.probing import probe_row
from studies.snapshot.source import read_planar
from studies.snapshot.table import loop_table

# How OpenBLAS calls its number of threads, in numpy's wheels and elsewhere.
BLAS = tuple(
    (f"{prefix}openblas_get_num_threads{suffix}", f"{prefix}openblas_set_num_threads{suffix}")
    for prefix in ("scipy_", "")
    for suffix in ("64_", "")
)


@dataclass(frozen=True)
class Failure:
    """Why a task could not be done: an `InputError` in parts that travel between processes."""

    number: int
    name: str
    where: str
    received: str
    expected: str
    remedy: str
    skippable: bool = True

    def error(self) -> InputError:
        """Return the error itself, to raise where the tasks are handed out."""
        skip = "; --skip-bad goes on without this one" if self.skippable else ""
        return InputError(
            f"snapshot {self.number} ({self.name}): {self.where}",
            self.received,
            self.expected,
            f"{self.remedy} What is finished is kept{skip}.",
        )


@dataclass(frozen=True)
class PartTask:
    """One part to write: the loops of a snapshot, or what became of them by the next one.

    With `directions` the snapshot is probed as well.
    """

    snapshots: tuple[PlannedSnapshot, ...]
    out: Path
    yield_band: float | None = None
    directions: int | None = None
    by_events: bool = False

    @property
    def part(self) -> Path:
        """Where the result goes, below the absolute result folder."""
        return self._part(DATASETS[len(self.snapshots) - 1])

    @property
    def packing_part(self) -> Path:
        """Where what the packing foretells goes."""
        return self._part(DATASETS[2])

    @property
    def fates_part(self) -> Path:
        """Where the fates of all loops go."""
        return self._part(DATASETS[3])

    @property
    def fingerprint(self) -> str:
        """Of what the result depends on."""
        how = self.yield_band, self.directions
        band = [repr(one) for one in how if one is not None] + ["events"] * self.by_events
        return "-".join([*(one.fingerprint for one in self.snapshots), *band])

    @property
    def finished(self) -> bool:
        """Whether all it writes is there, made from the same."""
        parts = [self.part]
        if len(self.snapshots) > 1:
            parts += [self.fates_part, *([] if self.yield_band is None else [self.packing_part])]
        return all(is_finished(part, self.fingerprint) for part in parts)

    @property
    def name(self) -> str:
        """For messages."""
        return " to ".join(one.name for one in self.snapshots)

    def _part(self, dataset: str) -> Path:
        numbers = "-".join(f"{one.number:05d}" for one in self.snapshots)
        return self.out / dataset / f"part-{numbers}.parquet"


@dataclass(frozen=True)
class Series:
    """A series as it was asked for: its snapshots, the result folder, who else tells of them.

    With `yield_band` the packing foretells each interval, with `by_events` its path and its replay
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


def do_task(task: PartTask) -> Failure | None:
    """Write a part, or say why it could not be done; doing it again writes the same."""
    last = task.snapshots[-1]
    try:
        with one_blas_thread():
            (_write_snapshot if len(task.snapshots) == 1 else _write_pair)(task)
    except InputError as error:
        parts = error.where, error.received, error.expected, error.remedy
        return Failure(last.number, last.name, *parts)
    except OSError as error:
        # What goes wrong with reading is an InputError already.
        parts = str(task.part), error.strerror or str(error), "a place to write", "Make room."
        return Failure(last.number, last.name, *parts, skippable=False)
    return None


def _write_snapshot(task: PartTask) -> None:
    """The loops, one row each, with the row of the series beside them."""
    (planned,) = task.snapshots
    state = state_of(planned)
    # Tasks run side by side, each on one core.
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
    """What became of the loops, one row a survived one, and the exchange of orders."""
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
        columns, row, about["notes"] = foretold(
            before, after, fates, task.yield_band, task.by_events
        )
        about["row"] |= row
        table |= gained(table, about["row"], columns)
        # The increments come last: they are what a restart finds finished.
        write_part(task.packing_part, _numbers(task, len(columns["loop"])) | columns, own)
    write_part(task.part, _numbers(task, len(table["loop_before"])) | table, about)


def _numbers(task: PartTask, rows: int) -> dict[str, Any]:
    names = ("snapshot_before", "snapshot_after")
    pairs = zip(names, task.snapshots, strict=True)
    return {name: np.full(rows, one.number) for name, one in pairs}


def tracked(task: PartTask) -> tuple[Snapshot, Snapshot, LoopFates]:
    """Two successive snapshots, and what became of the loops between them."""
    before, after = map(state_of, task.snapshots)
    return before, after, track_loops(before, after)


def state_of(planned: PlannedSnapshot) -> Snapshot:
    """A snapshot and its faces; `InputError` as `read_planar`."""
    return read_planar(planned.path, **planned.how)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Linear algebra of numpy and scipy in one thread, in whatever process the task is done.

    How OpenBLAS shares out a decomposition changes its last digit, from some 40 unknowns on; the
    same bytes must come from one process, several, or a cluster of other machines.
    """
    libraries = _blas_threads()
    before = [get() for get, _ in libraries]
    for _, put in libraries:
        put(1)
    try:
        yield
    finally:
        for (_, put), number in zip(libraries, before, strict=True):
            put(number)


def _blas_threads() -> list[tuple[Any, Any]]:
    """How many threads OpenBLAS takes, to ask and to set: numpy has a library, scipy another."""
    found = []
    for module in (np.linalg._umath_linalg, fblas):
        try:
            library = ctypes.CDLL(module.__file__)
        except (OSError, AttributeError):
            continue
        for get, put in BLAS:
            if hasattr(library, get) and hasattr(library, put):
                found.append((getattr(library, get), getattr(library, put)))
    return found
