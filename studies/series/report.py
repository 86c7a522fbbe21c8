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
from studies.series.animation import Picture, animate_series, picked_snapshots
from studies.series.figures import MappedInterval, draw_series
from studies.series.increments import PREDICTIONS
from studies.series.kinetics_figures import kinetics_figure
from studies.series.plan import PlannedSnapshot
from studies.series.skill_figures import nonaffinity_map, skill_by_interval, skill_by_predictor
from studies.series.survival_figure import survival_by_verdict
from studies.series.targets import part_columns
from studies.series.tasks import PartTask, pairs, singles, state_of, tracked
from studies.snapshot.report import MOST_LOOPS, LoopsForMap, loops_for_map, write_report
from studies.style import save_figures

CAPTIONS = {
    "orders_over_strain": ("Orders", "Shares of the loops by order along the series."),
    "stress_strain": (
        "Stress and strain",
        "Love-Weber stress of the sample; unstable loops, loops that did negative work, contacts "
        "that slide.",
    ),
    "probes": (
        "Probes of the sample",
        "Smallest normalised second-order work over the directions of strain, and the share of "
        "directions where it is negative; gaps where the rate problem has no solution anywhere.",
    ),
    "fates": (
        "Fates",
        "What became of the loops of each snapshot that the next one does not have.",
    ),
    "survival": (
        "Survival",
        "Share of the loops that survive an interval, by what was judged of them before. Bars hold "
        "95 % (Wilson): what so few loops can tell. Larger loops have more contacts to lose, "
        "whatever their verdict: compare within an order.",
    ),
    "exchange": ("Exchange of orders", "Loops by order before and after, all intervals together."),
    "kinetics": (
        "Kinetics of the orders",
        "Left: contacts that opened between loops of two orders against those that closed and made "
        "the same two, with Poisson's errors; pairs far from balance (p < 0.01) are named. Right: "
        "orders seen, and the steady state that the rates lead to.",
    ),
    "work_signs": (
        "Work and its prediction",
        "Second-order work that the survived loops did, and the sign that two closures predict, "
        "spins blocked or free.",
    ),
    "skill_by_predictor": (
        "Skill",
        "How well each predictor ranks the loops for what came true: a dot an interval. 0.5 is "
        "chance, persistence what the loop's own past tells; own motions are an upper bound.",
    ),
    "skill_by_interval": (
        "Skill from interval to interval",
        "The same along the series, above the base rate. No dot: the rate problem of the packing "
        "was not solved, or nothing is known of the past.",
    ),
    "nonaffinity_map": (
        "Map of the non-affinity",
        "How far each loop's strain is from the sample's: foretold and actual.",
    ),
    "work_map": ("Map of the work", "The interval with most loops of negative work."),
    "animation": ("Animation", "Loops along the series."),
}
OF_INTERVAL = ("W2", "w2", *PREDICTIONS, "nonaffinity")
OF_PACKING = ("packing_w2", "packing_nonaffinity", "packing_opening", "packing_closing")
# Of a series on its page.
MOST_MAPS = 20

SMALLEST = "traction_lambda_min"
DRAWN = ("W2", "w2", *PREDICTIONS)


def draw(
    folder: Path,
    planned: Sequence[PlannedSnapshot],
    out: Path,
    tables: Mapping[str, Any],
    mapped: int | None,
    summary: dict[str, Any],
) -> None:
    """Draw a series as PNG and SVG, and write the page that shows it all."""
    tasks = pairs(planned, out)
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
    maps = _maps(planned, out, counts, mapped or 0)
    series_report(folder, summary, maps, source, max(counts))


def animate(
    folder: Path,
    planned: Sequence[PlannedSnapshot],
    out: Path,
    evolution: Mapping[str, Sequence[Any]],
    source: dict[str, Any],
) -> None:
    """Write an animation of a series, of 60 snapshots at most."""
    animate_series(folder, _pictures(planned, out, evolution), source)


def _pictures(
    planned: Sequence[PlannedSnapshot], out: Path, evolution: Mapping[str, Sequence[Any]]
) -> Iterator[Picture]:
    parts = [task.part for task in singles(planned, out)]
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
        for name, told in CAPTIONS.items()
        for path in (folder / f"{name}.{ending}" for ending in ("png", "mp4", "gif"))
        if path.is_file()
    ]
    title = f"Loops of {summary['snapshots']} snapshots"
    write_report(folder, title, summary, figures, maps, source, count)


def _maps(
    planned: Sequence[PlannedSnapshot], out: Path, counts: Sequence[int], first: int
) -> list[LoopsForMap]:
    """A map of every snapshot, or of as many, evenly spread, as a page can handle."""
    number = min(MOST_MAPS, MOST_LOOPS // max(*counts, 1))
    places = sorted({*picked_snapshots(len(planned), number), first}) if number else []
    intervals, about = pairs(planned, out), ""
    if len(places) < len(planned):
        about = f"{len(places)} of {len(planned)} snapshots are shown, a page can't hold more. "
    found = []
    for k in places:
        state = state_of(planned[k])
        table = _rows(singles(planned, out)[k].part, intervals[k] if k < len(intervals) else None)
        name = f"{planned[k].number} ({planned[k].name})"
        of_series = {"name": name, "number": planned[k].number, "first": k == first}
        loops = loops_for_map(state, state.faces, table, **of_series, about=about)
        found += [] if loops is None else [loops]
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
