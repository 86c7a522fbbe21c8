"""The page of a series: its figures, its summary, and a map of the loops by their actual work."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet

from studies.series.increments import PREDICTIONS
from studies.series.work_figures import MappedInterval
from studies.snapshot.report import write_report
from studies.snapshot.report_map import LoopsForMap, loops_for_map

CAPTIONS = {
    "orders_over_strain": ("Orders", "Shares of the loops by order along the series."),
    "stress_strain": (
        "Stress and strain",
        "Love-Weber stress of the sample; unstable loops, loops that did negative work, contacts "
        "that slide.",
    ),
    "fates": ("Fates", "What became of the loops of each snapshot by the next one."),
    "exchange": ("Exchange of orders", "Loops by order before and after, all intervals together."),
    "work_signs": (
        "Work and its prediction",
        "Second-order work that the survived loops did, and the sign that three closures predict.",
    ),
    "work_map": ("Map of the work", "The interval with most loops of negative work."),
    "animation": ("Animation", "Loops along the series."),
}
OF_INTERVAL = ("W2", "w2", *PREDICTIONS)


def series_report(
    folder: Path,
    summary: Mapping[str, Any],
    mapped: MappedInterval | None,
    part: Path | None,
    source: Mapping[str, Any],
) -> None:
    """Write `report.html` with the figures that stand in the folder.

    Parameters
    ----------
    folder : Path
        Where.
    summary : mapping
        Of the series.
    mapped : MappedInterval or None
        The interval of the map.
    part : Path or None
        The rows of its earlier snapshot.
    source : mapping
        Provenance.
    """
    figures = [
        (*told, path)
        for name, told in CAPTIONS.items()
        for path in (folder / f"{name}.{ending}" for ending in ("png", "mp4", "gif"))
        if path.is_file()
    ]
    loops = None if mapped is None or part is None else _loops(mapped, part)
    title = f"Loops of {summary['snapshots']} snapshots"
    count = 0 if mapped is None else len(mapped.before.faces.loops)
    write_report(folder, title, summary, figures, loops, source, count)


def _loops(mapped: MappedInterval, part: Path) -> LoopsForMap | None:
    """Loops of the earlier snapshot, with their fate and the work of those that survived."""
    table: dict[str, Any] = {
        name: column.to_numpy()
        for name, column in _columns(part)
        if name not in ("grains", "snapshot", "step")
    }
    rows = mapped.increments["loop_before"]
    for name in OF_INTERVAL:
        if name in mapped.increments:
            table[name] = np.full(len(table["loop"]), np.nan)
            table[name][rows] = mapped.increments[name]
    return loops_for_map(*mapped.before, table)


def _columns(part: Path) -> list[tuple[str, Any]]:
    table = pyarrow.parquet.read_table(part)
    return list(zip(table.column_names, table.columns, strict=True))
