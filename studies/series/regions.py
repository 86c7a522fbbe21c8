"""Loops of a series inside a region and all others: what becomes of them over each interval."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from loops import InputError
from loops.tracking import Fate
from stability import COMPONENTS
from studies.output import DATASETS, Columns, Summary, described
from studies.series.skill import part_columns
from studies.series.tasks import Series
from studies.snapshot.regions import (
    UNKNOWN,
    Property,
    loop_regions,
    parsed,
    places_table,
    region_summary,
)
from studies.snapshot.summary import verdict_properties

SURVIVED = Fate.SURVIVED.name.lower()
# Columns of the loops of all intervals together.
POOLED = ("order", "area", "fate", "W2")


def series_regions(series: Series, regions: str) -> tuple[pd.DataFrame, Summary]:
    """Return the table of regions by interval, and the summary of all intervals together."""
    tables, pooled, named = list[pd.DataFrame](), list[Columns](), list[str]()
    require_series_regions(regions, len(series.planned))
    for earlier, interval in zip(series.snapshots, series.intervals, strict=False):
        table = earlier_loops(earlier.parts["loops"], interval.parts)
        place, names = loop_regions(table, regions)
        properties = verdict_properties(table) | fate_properties(table)
        before, after = (one.number for one in interval.snapshots)
        rows = places_table(table["order"], place, names, properties)
        tables.append(pd.DataFrame({"snapshot_before": before, "snapshot_after": after, **rows}))
        pooled.append({name: table[name] for name in POOLED if name in table} | {"place": place})
        named = max(named, names.tolist(), key=len)
    whole = {name: np.concatenate([one[name] for one in pooled]) for name in pooled[0]}
    whole["region"] = np.array(named)[whole["place"]]
    properties, found = fate_properties(whole), pd.concat(tables, ignore_index=True)
    lost = whole["fate"] != SURVIVED
    if lost.any() and (whole["region"][lost] == UNKNOWN).all():
        # The column is measured of loops that survived: their region says nothing on survival.
        del properties["survived"]
        found = found.drop(columns=["survived", "survived_error"])
    places = places_table(whole["order"], whole["place"], named, properties)
    return found, region_summary(places, whole)


def require_series_regions(regions: str, snapshots: int) -> None:
    """Raise `InputError` for regions that no series of so many snapshots has."""
    asked, tables = parsed(regions), (f"series/{name}" for name in DATASETS)
    column = asked[0] if isinstance(asked, tuple) else "shear"
    if column != "shear" and not any(described(at, column) for at in tables):
        expected = "shear, or a column of the loops, fates, increments or packing of a series"
        remedy = "docs/columns.md lists them."
        raise InputError("--regions", f"column {column}", expected, remedy)
    if snapshots < 2:
        remedy = "Give later ones, or take grainloops snapshot --regions."
        raise InputError("--regions", "one snapshot", "a series of two at least", remedy)


def earlier_loops(loops: Path, parts: dict[str, Path]) -> Columns:
    """Return what the parts of an interval have of its earlier loops.

    The columns of a part without a row for some loop, as of increments, are nan there; `shear` is
    half the difference of the principal strains.
    """
    table = part_columns(loops)
    for name in ("fates", "increments", "packing"):
        columns = part_columns(parts[name]) if name in parts else {}
        at = columns.get("loop_before", columns.get("loop", np.empty(0, dtype=int)))
        earlier = at >= 0
        for column, values in columns.items():
            if column == "fate":
                table[column] = values[earlier]
            elif column not in table and values.dtype.kind in "iufb":
                table[column] = np.full(len(table["loop"]), np.nan)
                table[column][at[earlier]] = values[earlier]
    H11, H12, H21, H22 = (table[f"H{ij}"] for ij in COMPONENTS)
    return table | {"shear": 0.5 * np.hypot(H11 - H22, H12 + H21)}


def fate_properties(table: Columns) -> dict[str, Property]:
    """Return which loops survived, and which of those have negative second-order work."""
    survived = table["fate"] == SURVIVED
    found = {"survived": Property(survived, np.ones(len(survived), dtype=bool))}
    if "W2" in table:
        found["negative"] = Property(table["W2"] < 0, np.isfinite(table["W2"]))
    return found
