"""Figures of a series, drawn from its finished parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from loops.tracking import ExchangeCounts
from studies.series.animation import Frame, animate_series, picked_frames
from studies.series.figures import draw_series
from studies.series.increments import PREDICTIONS, increments
from studies.series.plan import PlannedSnapshot
from studies.series.report import series_report
from studies.series.tasks import PairTask, SnapshotTask, pairs, state_of, tracked
from studies.series.work_figures import MappedInterval

SMALLEST = "traction_lambda_min"
DRAWN = ("W2", "w2", *PREDICTIONS)


def draw(
    folder: Path,
    planned: Sequence[PlannedSnapshot],
    out: Path,
    evolution: Mapping[str, Sequence[Any]],
    exchange: Mapping[str, NDArray[np.int64]],
    mapped: int | None,
    summary: dict[str, Any],
) -> None:
    """Draw a series as PNG and SVG, and write the page that shows it all.

    Parameters
    ----------
    folder : Path
        Where to write.
    planned : sequence of PlannedSnapshot
        The snapshots.
    out : Path
        Result folder that holds the parts.
    evolution, exchange : mapping of str to array
        Tables of the series.
    mapped : int, optional
        Which interval to draw a map of.
    summary : dict
        Of the series, with the provenance that is written into the files.
    """
    tasks = pairs(planned, out)
    source = summary["provenance"]
    counts = ExchangeCounts(*(exchange[name] for name in ExchangeCounts._fields))
    interval = None if mapped is None else _interval(tasks[mapped])
    draw_series(folder, evolution, counts, _joined(tasks), interval, source)
    part = None if mapped is None else SnapshotTask(planned[mapped], out).part
    series_report(folder, summary, interval, part, source)


def animate(
    folder: Path,
    planned: Sequence[PlannedSnapshot],
    out: Path,
    evolution: Mapping[str, Sequence[Any]],
    source: dict[str, Any],
) -> None:
    """Write an animation of a series, of 60 snapshots at most.

    Parameters
    ----------
    folder, planned, out, evolution
        See `draw`.
    source : dict
        Provenance.
    """
    animate_series(folder, _frames(planned, out, evolution), source)


def _frames(
    planned: Sequence[PlannedSnapshot], out: Path, evolution: Mapping[str, Sequence[Any]]
) -> Iterator[Frame]:
    mechanical = SMALLEST in pyarrow.parquet.read_schema(SnapshotTask(planned[0], out).part).names
    for k in picked_frames(len(planned)):
        part = SnapshotTask(planned[k], out).part
        title = f"snapshot {planned[k].number}, shear strain {evolution['shear_strain'][k]:.4f}"
        smallest = None
        if mechanical:
            table = pyarrow.parquet.read_table(part, columns=[SMALLEST])
            smallest = table.column(SMALLEST).to_numpy()
        yield Frame(state_of(planned[k]), title, smallest)


def _joined(tasks: Sequence[PairTask]) -> dict[str, NDArray[Any]]:
    """What is drawn of all increments."""
    if not tasks:
        return {}
    there = set(pyarrow.parquet.read_schema(tasks[0].part).names)
    columns = [name for name in DRAWN if name in there]
    table = pa.concat_tables([pyarrow.parquet.read_table(t.part, columns=columns) for t in tasks])
    return {name: table.column(name).to_numpy() for name in columns}


def _interval(task: PairTask) -> MappedInterval:
    before, after, fates = tracked(task)
    return MappedInterval(before, fates, increments(before, after, fates))
