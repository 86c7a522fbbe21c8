"""Figures, animation and page of a series, drawn from its finished parts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from loops.tracking import ExchangeCounts
from studies.report import write_report
from studies.series.animation import Picture, picked_snapshots
from studies.series.figures import MappedInterval, draw_series
from studies.series.increments import PREDICTIONS
from studies.series.kinetics_figures import kinetics_figure
from studies.series.skill_figures import nonaffinity_map, skill_by_interval, skill_by_predictor
from studies.series.survival_figure import survival_by_verdict
from studies.series.targets import part_columns
from studies.series.tasks import PartTask, Series, state_of, tracked
from studies.snapshot.polygons import MOST_LOOPS, LoopsForMap, loops_for_map
from studies.study import captions
from studies.style import save_figures

OF_INTERVAL = ("W2", "w2", *PREDICTIONS, "nonaffinity")
OF_PACKING = ("packing_w2", "packing_nonaffinity", "packing_opening", "packing_closing")
# Of a series on its page.
MOST_MAPS = 20

SMALLEST = "traction_lambda_min"
DRAWN = ("W2", "w2", *PREDICTIONS)


def draw(
    folder: Path,
    series: Series,
    tables: Mapping[str, Any],
    mapped: int | None,
    summary: dict[str, Any],
) -> None:
    """Draw a series as PNG and SVG, and write the page that shows it all."""
    tasks = series.intervals
    source = summary["provenance"]
    counts = ExchangeCounts(*(tables["exchange"][name] for name in ExchangeCounts._fields))
    interval = None if mapped is None else _interval(tasks[mapped])
    draw_series(folder, tables["evolution"], counts, _joined(tasks), interval, source)
    figures = {}
    if "survival" in tables:
        figures["survival"] = survival_by_verdict(tables["survival"])
    if "kinetics" in tables:
        figures["kinetics"] = kinetics_figure(tables)
    if "packing" in (skill := tables.get("skill", {"predictor": ()}))["predictor"]:
        figures["skill_by_predictor"] = skill_by_predictor(skill)
        figures["skill_by_interval"] = skill_by_interval(skill)
        if interval is not None and np.isfinite(interval.foretold["packing_nonaffinity"]).any():
            figures["nonaffinity_map"] = nonaffinity_map(interval)
    save_figures(figures, folder, source)
    counts = tables["evolution"]["loops"]
    maps = _maps(series, counts, mapped or 0)
    series_report(folder, summary, maps, source, max(counts))


def pictures(series: Series, evolution: Mapping[str, Sequence[Any]]) -> Iterator[Picture]:
    """Those of the animation of a series, 60 at most."""
    planned, parts = series.planned, [task.part for task in series.snapshots]
    mechanical = SMALLEST in pyarrow.parquet.read_schema(parts[0]).names
    for k in picked_snapshots(len(planned)):
        part = parts[k]
        title = f"snapshot {planned[k].number}, shear strain {evolution['shear_strain'][k]:.4f}"
        smallest = None
        if mechanical:
            table = pyarrow.parquet.read_table(part, columns=[SMALLEST])
            smallest = table.column(SMALLEST).to_numpy()
        yield Picture(state_of(planned[k]), title, smallest)


def _joined(tasks: Sequence[PartTask]) -> dict[str, NDArray[Any]]:
    """What is drawn of all increments."""
    if not tasks:
        return {}
    there = set(pyarrow.parquet.read_schema(tasks[0].part).names)
    columns = [name for name in DRAWN if name in there]
    table = pa.concat_tables([pyarrow.parquet.read_table(t.part, columns=columns) for t in tasks])
    return {name: table.column(name).to_numpy() for name in columns}


def _interval(task: PartTask) -> MappedInterval:
    before, _, fates = tracked(task)
    foretold = part_columns(task.packing_part) if task.packing_part.is_file() else {}
    return MappedInterval(before, fates, dict(_columns(task.part)), foretold)


def series_report(
    folder: Path,
    summary: Mapping[str, Any],
    maps: Sequence[LoopsForMap],
    source: Mapping[str, Any],
    count: int = 0,
) -> None:
    """Write `report.html` with the figures that stand in the folder."""
    figures = [
        (*told, path)
        for name, told in captions("series").items()
        for path in (folder / f"{name}.{ending}" for ending in ("png", "mp4", "gif"))
        if path.is_file()
    ]
    title = f"Loops of {summary['snapshots']} snapshots"
    write_report(folder, title, summary, figures, maps, source, count)


def _maps(series: Series, counts: Sequence[int], first: int) -> list[LoopsForMap]:
    """A map of every snapshot, or of as many, evenly spread, as a page can handle."""
    planned, intervals, about = series.planned, series.intervals, ""
    number = min(MOST_MAPS, MOST_LOOPS // max(*counts, 1))
    places = sorted({*picked_snapshots(len(planned), number), first}) if number else []
    if len(places) < len(planned):
        about = f"{len(places)} of {len(planned)} snapshots are shown, a page can't hold more. "
    found = []
    for k in places:
        state = state_of(planned[k])
        table = _rows(series.snapshots[k].part, intervals[k] if k < len(intervals) else None)
        name = f"{planned[k].number} ({planned[k].name})"
        of_series = {"name": name, "number": planned[k].number, "first": k == first}
        found += loops_for_map(state, table, **of_series, about=about)
    return found


def _rows(part: Path, task: PartTask | None) -> dict[str, Any]:
    """Loops of a snapshot, with what became of them in the interval that follows, if one does."""
    table = dict(_columns(part))
    for name in ("grains", "snapshot", "step"):
        table.pop(name, None)
    if task is None:
        return table
    size, fates, own = (
        len(table["loop"]),
        dict(_columns(task.fates_part)),
        dict(_columns(task.part)),
    )
    table |= {name: fates[name][:size] for name in ("fate", "successor", "order_after")}
    for name in OF_INTERVAL:
        if name in own:
            table[name] = np.full(size, np.nan)
            table[name][own["loop_before"]] = own[name]
    foretold = part_columns(task.packing_part) if task.packing_part.is_file() else {}
    return table | {name: foretold[name] for name in OF_PACKING if name in foretold}


def _columns(part: Path) -> list[tuple[str, NDArray[Any]]]:
    table = pyarrow.parquet.read_table(part)
    return [(name, table.column(name).to_numpy()) for name in table.column_names]
