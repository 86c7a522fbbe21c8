"""The finished parts of a series put together: tables, summary, figures, report."""

from __future__ import annotations

import re
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from loops import order_kinetics
from loops.kinetics import FATES, OrderEvents
from loops.stress_strain import rotation_and_stretch
from loops.tracking import ExchangeCounts, Fate
from stability import COMPONENTS
from stability.packing.response import SOLVED
from studies.output import definitions, move_files
from studies.series.skill import skill_summary, skill_tables, survival_summary, write_fates
from studies.series.tasks import (
    UNFINISHED,
    Failure,
    Series,
    keep_only,
    require_about,
    require_one_schema,
    write_csv,
)
from studies.study import Results

Row = Mapping[str, Any]


def gather(
    series: Series,
    failures: Sequence[Failure],
    made: dict[str, Any],
    *,
    csv: bool,
    figures: bool,
    animation: bool,
) -> dict[str, Any]:
    """Put the finished parts of a series together; return the summary."""
    out, band = series.out, series.yield_band
    parts = {
        "loops": [task.part for task in series.snapshots],
        "increments": [task.part for task in series.intervals],
        "fates": [task.fates_part for task in series.intervals],
    }
    if band is not None:
        parts["packing"] = [task.packing_part for task in series.intervals]
    for name, files in parts.items():
        keep_only(out / name, {file.name for file in files})
        require_one_schema(files)
    about = {name: [require_about(file) for file in files] for name, files in parts.items()}
    tables, summary = series_tables(series, about, parts)
    summary["skipped"] = [
        {"snapshot": one.number, "name": one.name, "reason": f"{one.where}: got {one.received}"}
        for one in failures
    ]
    evolution = tables["evolution"]
    mapped = mapped_interval(evolution)
    if mapped is not None:
        summary["work_map"] = evolution["snapshot"][mapped : mapped + 2].tolist()
    with _put_in_place(out) as folder:
        results = Results(folder, made, csv)
        fates = folder / "fates.parquet"
        survival = write_fates(parts.pop("fates"), parts["loops"], fates, made)
        if len(survival):
            tables["survival"] = survival
            summary["survival"] = survival_summary(survival)
        results.write_tables(tables)
        if csv:
            whole = {"fates": [fates]} if fates.is_file() else {}
            for name, files in (parts | whole).items():
                write_csv(files, folder / f"{name}.csv")
        # matplotlib is loaded only when there is something to draw.
        pictures: list[Path] = []
        if animation:
            from studies.series.figures import animate_series, animation_frames

            pictures = animate_series(folder, animation_frames(series, evolution), made)
        if figures:
            from studies.series.figures import joined_increments, map_data, maps_of, series_figures

            interval = None if mapped is None else map_data(series.intervals[mapped])
            drawn = series_figures(tables, joined_increments(series), interval)
            pictures = results.save_figures(drawn) + pictures
            maps = maps_of(series, evolution["loops"].tolist(), mapped or 0)
            largest = int(evolution["loops"].max())
            title = f"Loops of {summary['snapshots']} snapshots"
            results.write_report(title, {**summary, "provenance": made}, pictures, maps, largest)
        summary["files"] = sorted(path.name for path in folder.iterdir())
        return results.write_summary(summary)


def series_tables(
    series: Series, about: Mapping[str, list[dict[str, Any]]], parts: Mapping[str, Sequence[Path]]
) -> tuple[dict[str, pd.DataFrame], dict[str, Any]]:
    """Tables and summary of a series from its parts and their metadata."""
    states = [
        {"snapshot": one.number, "name": one.name} | kept["row"]
        for one, kept in zip(series.planned, about["loops"], strict=True)
    ]
    intervals = [kept["row"] for kept in about["increments"]]
    evolution = evolution_table(states, intervals)
    ends = evolution.astype(object).where(evolution.notna(), None).iloc[[0, -1]].to_dict("records")
    notes = [note for one in about.values() for kept in one for note in kept.get("notes", ())]
    tables = {"evolution": evolution, "exchange": exchange_table(series, about["increments"])}
    summary: dict[str, Any] = {
        "snapshots": len(states),
        "intervals": len(intervals),
        "loops": int(evolution["loops"].sum()),
        "fates": {
            fate.name.lower(): sum(row[fate.name.lower()] for row in intervals) for fate in Fate
        },
        "first": ends[0],
        "last": ends[1],
        "work_map": None,
        "notes": list(dict.fromkeys(notes)),
        "definitions": definitions("series"),
    }
    events = [kept["events"] for kept in about["increments"]]
    if any(one["pairs"] for one in events):
        own, summary["kinetics"] = kinetics(events, evolution)
        tables |= own
    skill, by_order = skill_tables(parts["loops"], parts["increments"], parts.get("packing", ()))
    if len(skill):
        tables["skill"] = skill
        summary |= skill_summary(skill, by_order)
    if series.yield_band is not None:
        tables["skill_by_order"] = by_order
        summary["packing"] = solved_summary(intervals, series.yield_band)
    if series.following is not None:
        summary["followed"] = followed_summary(
            intervals, [one.number for one in series.planned], series.following.past
        )
    return tables, summary


@contextmanager
def _put_in_place(out: Path) -> Iterator[Path]:
    """A folder within `out`; its files move to `out` when all are written, the summary last."""
    partial = out / UNFINISHED
    partial.mkdir()
    try:
        yield partial
        move_files(partial, out)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def evolution_table(states: Sequence[Row], intervals: Sequence[Row]) -> pd.DataFrame:
    """Join the rows of a series to one table, one row a snapshot; unknown values are missing.

    Adds `H11..H22`, the displacement gradient since the first snapshot (`F = F_n ... F_1`),
    `shear_strain`, the sum of `(e1 - e2)/2` of the intervals' stretches, and the interval that led
    to each snapshot.
    """
    joined = [dict(row) for row in states]
    F, shear = np.eye(2), 0.0
    for row, interval in zip(joined, [{}, *intervals], strict=True):
        if interval:
            # JSON has no number for an unknown strain.
            steps = [interval[f"dH{ij}"] for ij in COMPONENTS]
            H = np.array(steps, dtype=float).reshape(2, 2)
            F = (np.eye(2) - H) @ F
            stretch = rotation_and_stretch(H)[1]
            shear += np.hypot(0.5 * (stretch[0, 0] - stretch[1, 1]), stretch[0, 1])
        total = (np.eye(2) - F).ravel().tolist()
        row |= {f"H{ij}": value for ij, value in zip(COMPONENTS, total, strict=True)}
        row["shear_strain"] = float(shear)
        row |= interval
    names = dict.fromkeys(name for row in joined for name in row)
    columns = {name: pa.array([row.get(name) for row in joined]) for name in names}
    # Counts stay whole numbers where some are missing.
    return pa.table(columns).to_pandas(types_mapper=pd.ArrowDtype)


def mapped_interval(evolution: pd.DataFrame) -> int | None:
    """The interval with most loops of negative work, among those whose packing is solved if any."""
    if "negative_W2" not in evolution:
        return None
    negative = evolution["negative_W2"][1:].to_numpy(dtype=float)
    if "packing_status" in evolution:
        solved = evolution["packing_status"][1:].isin(SOLVED).to_numpy(dtype=bool)
        if solved.any():
            negative = np.where(solved, negative, -1)
    return int(np.argmax(negative))


def exchange_table(series: Series, about: Sequence[Row]) -> pd.DataFrame:
    """One row for each pair of orders that occurs in an interval."""
    names = ("snapshot_before", "snapshot_after", *ExchangeCounts._fields)
    rows = [
        (one.number, other.number, *counts)
        for (one, other), kept in zip(pairwise(series.planned), about, strict=True)
        for counts in zip(*(kept["exchange"][name] for name in ExchangeCounts._fields), strict=True)
    ]
    return pd.DataFrame(np.array(rows, dtype=np.int64).reshape(-1, len(names)), columns=names)


def kinetics(
    events: Sequence[Row], evolution: pd.DataFrame
) -> tuple[dict[str, pd.DataFrame], dict[str, Any]]:
    """Tables `kinetics` and `kinetics_orders` of the events of a series, and their summary."""
    intervals = []
    for kept in events:
        names = ("before", "after", "pairs", "opened", "closed")
        before, after, pairs, opened, closed = (np.array(kept[n], dtype=np.int64) for n in names)
        fates = {name: int(kept[name]) for name in FATES}
        intervals.append(OrderEvents(before, after, pairs.reshape(-1, 2), opened, closed, **fates))
    steps = np.diff(evolution["shear_strain"].to_numpy(dtype=float, na_value=np.nan))
    known = bool((steps > 0).all())
    found = order_kinetics(intervals, steps if known else None)
    steady, touched = found.steady(), found.stoichiometry.any(axis=1)
    order = np.flatnonzero((found.loops > 0) | touched)
    # The rates say nothing about orders without an event.
    orders = {
        "order": order,
        "observed_share": (found.loops / found.loops.sum())[order],
        "steady_share": np.where(touched, steady.share, np.nan)[order],
        "steady_error": np.where(touched, steady.error, np.nan)[order],
    }
    balance, earlier = found.balance(), max(sum(getattr(found, name) for name in FATES), 1)
    all_opened, all_closed = (int(evolution[name].sum()) for name in ("opened", "closed"))
    summary = {
        "per": "accumulated shear strain" if known else "interval",
        "openings": int(found.opened.sum()),
        "closings": int(found.closed.sum()),
        "share_of_opened": float(found.opened.sum() / max(all_opened, 1)),
        "share_of_closed": float(found.closed.sum() / max(all_closed, 1)),
        **{f"share_{name}": getattr(found, name) / earlier for name in FATES},
        **{name: value for name, value in vars(balance).items() if name not in ("z", "p")},
    }
    tables = {"kinetics": found.table(), "kinetics_orders": orders}
    return {name: pd.DataFrame(table) for name, table in tables.items()}, summary


def solved_summary(intervals: Sequence[Row], band: float) -> dict[str, Any]:
    """Number of intervals whose rate problem is solved, largest residual, boundary."""
    status = [row["packing_status"] for row in intervals]
    solved = sum(one in SOLVED for one in status)
    worst = {
        f"worst {name}": max(
            (row[f"packing_{name}"] for row in intervals if f"packing_{name}" in row), default=None
        )
        for name in ("residual", "disagreeing")
    }
    # Numbers of contacts and grains differ from one interval to the next.
    boundaries = [
        re.sub(r"\d+ ", "", row["packing_boundary"])
        for row in intervals
        if "packing_boundary" in row
    ]
    return {
        "yield_band": band,
        "intervals": len(intervals),
        "solved": solved,
        "share_solved": solved / len(intervals) if intervals else None,
        **{f"intervals {one}": status.count(one) for one in sorted(set(status))},
        **worst,
        "boundary": "; ".join(dict.fromkeys(boundaries)),
    }


def followed_summary(intervals: Sequence[Row], numbers: Sequence[int], past: str) -> dict[str, Any]:
    """Summary of paths and replays: statuses, instabilities, distance, rates.

    `numbers` are those of the snapshots.
    """
    rows = [row for row in intervals if "path_status" in row]
    rates = [row["replay_inertial_number"] for row in rows]
    apart = {
        k: row["path_from_replay"]
        for k, row in enumerate(intervals)
        if row.get("path_from_replay") is not None
    }
    farthest = max(apart, key=lambda k: apart[k], default=None)
    return {
        "past": past,
        "path_statuses": dict(Counter(row["path_status"] for row in rows)),
        "path_instabilities": sum(row["path_instabilities"] for row in rows),
        "path_from_replay": None
        if farthest is None
        else {
            "median": float(np.median([*apart.values()])),
            "largest": apart[farthest],
            "snapshots": [numbers[farthest], numbers[farthest + 1]],
        },
        "replay_inertial_number": [min(rates), max(rates)] if rates else None,
        "replay_rate_from": dict(Counter(row["replay_rate_from"] for row in rows)),
    }
