"""The study behind `grainloops series`: its tasks, then tables, summary, figures and report."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pandas as pd
import pyarrow as pa

from loops import InputError, order_kinetics
from loops.errors import check_choice, counted, number, whole_number
from loops.kinetics import FATES, OrderEvents
from loops.stress_strain import rotation_and_stretch
from loops.tracking import ExchangeCounts, Fate
from stability import COMPONENTS
from stability.packing.response import SOLVED
from stability.path import Past
from studies.output import SERIES, Row, Summary, values_of
from studies.questions import Replaying, Tracking, taken
from studies.reading import in_order, plan_series, reading
from studies.series.evolution import chain_summary, verdict_row
from studies.series.packing import STRESS_ERROR, WAYS, Following, read_strains
from studies.series.regions import require_series_regions, series_regions
from studies.series.skill import (
    LONG_STEP,
    part_columns,
    skill_summary,
    skill_tables,
    survival_summary,
    write_fates,
)
from studies.series.tasks import (
    Extras,
    Series,
    do_tasks,
    keep_only,
    require_about,
    require_one_schema,
    series_folder,
    write_csv,
)
from studies.series.workers import open_runner
from studies.snapshot.table import PLACE
from studies.study import Figures, Results, study


def run_series(
    paths: Sequence[Path],
    out: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    force: bool = False,
    csv: bool = False,
    figures: Figures | bool = True,
    **how: Any,
) -> Summary:
    """Find the loops of every snapshot of a series and their fates; return the summary.

    `how` are the options of `Tracking`, `Replaying` and `read_planar`. Finished parts in `out` are
    kept: the same call continues an interrupted run. A script calls this under
    `if __name__ == "__main__"`, because the processes import the script.
    """
    asked: Any = taken(Tracking, how)
    rate = asdict(taken(Replaying, how))
    cells, times, indicators = asked.cells, rate.pop("times"), asked.indicators
    how, moved = reading(**how), list[str]()
    if not asked.as_given:
        paths, moved = in_order(paths, how)
    planned = plan_series(paths, cells, how, times)
    read = {name: value for name, value in how.items() if name not in ("contacts", "frame")}
    in_packing = asked.in_packing or indicators
    check_choice("--in-packing", in_packing, (False, True, "rates", "events"))
    share, by_events, probe = None, in_packing == "events", None
    if in_packing:
        share = number("candidates", asked.candidates, 0.0, 1.0, open_low=True)
    check_choice("--past", asked.past, get_args(Past))
    for name, value in rate.items():
        if value is not None:
            number(f"--{name.replace('_', '-')}", value, 0.0, open_low=True)
    number("--damping", asked.damping, 0.0)
    way = asked.programme
    table = None if way in WAYS else read_strains(Path(way))
    way = way if table is None else table.name
    following = Following(asked.past, **rate, damping=asked.damping, programme=way, table=table)
    if not by_events and (following != Following() or times is not None):
        received = "the rates alone" if in_packing else "no path and no replay"
        remedy = "Add --in-packing events, or leave the options of paths and replays out."
        raise InputError("--in-packing", received, "events", remedy)
    read["in_packing"] = [share, "events", *following[:-1]] if by_events else share
    if indicators:
        read["indicators"] = True
    if asked.probe is not None:
        whole_number("--probe", asked.probe, 1)
        probe = number("yield_band", asked.yield_band, 0.0, 1.0, open_low=True), asked.probe
        read["probe"] = list(probe)
    configuration = {"paths": paths, "cells": cells, "times": times, **read}
    if asked.regions is not None:
        require_series_regions(asked.regions, len(planned))
        configuration["regions"] = asked.regions
    read["cells"] = None if cells is None else cells.name
    out = out.absolute()
    with series_folder(out, read, [one.name for one in planned], force=force):
        files = [out / SERIES, *dict.fromkeys(one.path for one in planned)]
        extras = Extras(probe, share, following if by_events else None, indicators)
        series = Series(planned, out, extras)
        with open_runner(workers, scheduler, files) as runner:
            failures = do_tasks(runner, series.snapshots, "snapshots", skip_bad=asked.skip_bad)
            bad = {failure.number for failure in failures}
            series = replace(series, planned=[one for one in planned if one.number not in bad])
            if not series.planned:
                raise failures[0].error()
            do_tasks(runner, series.intervals, "pairs", skip_bad=False)
        with study(
            "series", out, configuration, csv=csv, figures=figures, continued=True
        ) as results:
            # Parts of other series in the folder are removed.
            for name, files in series.parts.items():
                keep_only(out / name, {file.name for file in files})
                require_one_schema(files)
            about = {name: [*map(require_about, files)] for name, files in series.parts.items()}
            tables, summary = series_tables(series, about)
            summary["notes"] = [*moved, *summary["notes"]]
            if asked.regions is not None:
                tables["regions"], summary["regions"] = series_regions(series, asked.regions)
            summary["skipped"] = [
                {"snapshot": one.number, "name": one.name, "reason": one.reason} for one in failures
            ]
            fates = results.folder / "fates.parquet"
            parts = series.parts
            survival = write_fates(parts.pop("fates"), parts["loops"], fates, results.source)
            if len(survival):
                tables["survival"] = survival
                summary["survival"] = survival_summary(survival)
            results.write_tables(tables)
            if csv:
                whole = {"fates": [fates]} if fates.is_file() else {}
                for name, parted in (parts | whole).items():
                    write_csv(parted, results.folder / f"{name}.csv")
            summary = results.write_summary(summary)
            _draw(results, series, tables, summary, animated=asked.animation)
    return summary


def _draw(
    results: Results, series: Series, tables: Mapping[str, Any], summary: Summary, *, animated: bool
) -> None:
    """Draw the animation, the figures and the report of a series that is written."""
    evolution, pictures = tables["evolution"], list[Path]()
    # matplotlib is loaded only when there is something to draw.
    if animated:
        from studies.series.figures import animate_series, animation_frames

        frames = animation_frames(series, evolution)
        pictures = animate_series(results.folder, frames, results.source)
    if results.figures:
        from studies.series import figures as drawing

        mapped = mapped_interval(evolution)
        interval = None if mapped is None else drawing.map_data(series.intervals[mapped])
        drawn = drawing.series_figures(tables, interval)
        maps = drawing.maps_of(series, evolution["loops"].tolist(), mapped or 0)
        largest = int(evolution["loops"].max())
        title = f"Loops of {counted(summary['snapshots'], 'snapshot')}"
        results.write_report(title, summary, drawn, maps, largest, pictures)


def series_tables(
    series: Series, about: Mapping[str, list[dict[str, Any]]]
) -> tuple[dict[str, pd.DataFrame], dict[str, Any]]:
    """Tables and summary of a series from its parts and their metadata."""
    states = [
        {"snapshot": one.number, "name": one.name} | kept["row"]
        for one, kept in zip(series.planned, about["loops"], strict=True)
    ]
    intervals, parts = [kept["row"] for kept in about["increments"]], series.parts
    for row, part in zip(states, parts.get("packing", ()), strict=False):
        row |= verdict_row(PLACE, part_columns(part)[f"{PLACE}_lambda_min_held"])
    evolution = evolution_table(states, intervals)
    ends = evolution.astype(object).where(evolution.notna(), None).iloc[[0, -1]].to_dict("records")
    mapped = mapped_interval(evolution)
    notes = [note for one in about.values() for kept in one for note in kept.get("notes", ())]
    pairs = ("snapshot_before", "snapshot_after", *ExchangeCounts._fields)
    rows = [
        (one.number, other.number, *counts)
        for (one, other), kept in zip(pairwise(series.planned), about["increments"], strict=True)
        for counts in zip(*(kept["exchange"][name] for name in ExchangeCounts._fields), strict=True)
    ]
    exchanged = np.array(rows, dtype=np.int64).reshape(-1, len(pairs))
    tables = {"evolution": evolution, "exchange": pd.DataFrame(exchanged, columns=pairs)}
    summary: Summary = {
        "snapshots": len(states),
        "intervals": len(intervals),
        "loops": int(evolution["loops"].sum()),
        "fates": {
            fate.name.lower(): sum(row[fate.name.lower()] for row in intervals) for fate in Fate
        },
        "first": ends[0],
        "last": ends[1],
        "work_map": None if mapped is None else evolution["snapshot"][mapped : mapped + 2].tolist(),
        "notes": list(dict.fromkeys(notes)),
    }
    if sum(row["segments"] for row in intervals):
        summary["chains"] = chain_summary(intervals)
    events = [kept["events"] for kept in about["increments"]]
    if any(one["pairs"] for one in events):
        own, summary["kinetics"] = kinetics(events, evolution)
        tables |= own
    skill, by_order = skill_tables(parts["loops"], parts["increments"], parts.get("packing", ()))
    if len(skill):
        tables["skill"] = skill
        summary |= skill_summary(skill, by_order)
    if series.extras.candidates is not None:
        tables["skill_by_order"] = by_order
        summary["packing"] = solved_summary(intervals, series.extras.candidates)
    if series.extras.following is not None:
        numbers = [one.number for one in series.planned]
        summary["followed"] = followed_summary(intervals, numbers, series.extras.following)
        summary["notes"] = [*missed_stresses(summary["followed"]), *summary["notes"]]
    if len(skill):
        summary["notes"] = [*long_steps(evolution), *summary["notes"]]
    return tables, summary


def long_steps(evolution: pd.DataFrame) -> list[str]:
    """Warning of the intervals whose strain is too long for any rate of their start."""
    ends, steps = evolution["snapshot"].tolist(), evolution["step_strain"].tolist()
    intervals = zip(pairwise(ends), steps[1:], strict=True)
    found = [f"{start} to {end} by {step:.2g}" for (start, end), step in intervals
             if pd.notna(step) and step > LONG_STEP]  # fmt: skip
    told = (
        f"the sample strains by more than 1e-4 from snapshot {', '.join(found)}: rates of the "
        "start (packing, grains' own motion, closures) do not hold over such an interval; "
        "follow it by --in-packing events, or take snapshots closer together"
    )
    return [told] if found else []


def evolution_table(states: Sequence[Row], intervals: Sequence[Row]) -> pd.DataFrame:
    """Join the rows of a series to one table, one row a snapshot; unknown values are missing.

    `H11..H22` are of `F = F_n ... F_1`; `shear_strain` sums `(e1 - e2)/2` of the stretches.
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
            half = np.hypot(0.5 * (stretch[0, 0] - stretch[1, 1]), stretch[0, 1])
            row["step_strain"] = float(0.5 * abs(np.trace(stretch)) + half)
            shear += half
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
        **{name: values[order] for name, values in found.by_order().items()},
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
    tables = {"kinetics": found.columns(), "kinetics_orders": orders}
    return {name: pd.DataFrame(table) for name, table in tables.items()}, summary


def solved_summary(intervals: Sequence[Row], candidates: float) -> Summary:
    """Number of intervals whose rate problem is solved, largest residual, boundary."""
    status = [row["packing_status"] for row in intervals]
    solved = sum(one in SOLVED for one in status)
    worst = {
        f"worst {name}": max(
            (row[f"packing_{name}"] for row in intervals if f"packing_{name}" in row), default=None
        )
        for name in ("residual", "disagreeing", "beyond")
    }
    # Numbers of contacts and grains differ from one interval to the next.
    boundaries = [
        re.sub(r"\d+ ", "", row["packing_boundary"])
        for row in intervals
        if "packing_boundary" in row
    ]
    return {
        "candidates": candidates,
        "intervals": len(intervals),
        "solved": solved,
        "share_solved": solved / len(intervals) if intervals else None,
        **{f"intervals {one}": status.count(one) for one in sorted(set(status))},
        **worst,
        "boundary": "; ".join(dict.fromkeys(boundaries)),
    }


def followed_summary(
    intervals: Sequence[Row], numbers: Sequence[int], following: Following
) -> Summary:
    """Summary of paths and replays: statuses, instabilities, distances, rates.

    `numbers` are those of the snapshots.
    """
    rows = [row for row in intervals if "path_status" in row]
    replayed = [row for row in rows if row["replay_inertial_number"] is not None]
    rates = [row["replay_inertial_number"] for row in replayed]
    errors = known_values(intervals, "replay_stress_error")
    beyond = [k for k, error in errors.items() if error > STRESS_ERROR]
    missed = [
        {"snapshots": [numbers[k], numbers[k + 1]], "replay_stress_error": errors[k]}
        for k in beyond
    ]
    return {
        **values_of(following, "past", "programme", "damping"),
        "path_statuses": dict(Counter(row["path_status"] for row in rows)),
        "path_instabilities": sum(row["path_instabilities"] for row in rows),
        "path_from_replay": largest_of(known_values(intervals, "path_from_replay"), numbers),
        "replay_inertial_number": [min(rates), max(rates)] if rates else None,
        "replay_rate_from": dict(Counter(row["replay_rate_from"] for row in replayed)),
        "replay_stress_error": largest_of(errors, numbers),
        "replay_missed_stress": missed,
    }


def known_values(intervals: Sequence[Row], name: str) -> dict[int, float]:
    """Numbers of a column of the intervals, by interval, where there is one."""
    return {k: row[name] for k, row in enumerate(intervals) if row.get(name) is not None}


def largest_of(values: Mapping[int, float], numbers: Sequence[int]) -> dict[str, Any] | None:
    """Median, largest value and its two snapshots; None without a value."""
    if not values:
        return None
    k = max(values, key=lambda one: values[one])
    median = float(np.median([*values.values()]))
    return {"median": median, "largest": values[k], "snapshots": [numbers[k], numbers[k + 1]]}


def missed_stresses(followed: Row) -> list[str]:
    """Warnings of the intervals whose replay ends away from the stress of the later snapshot."""
    return [
        f"from snapshot {one['snapshots'][0]} to {one['snapshots'][1]} the replay ends "
        f"{100 * one['replay_stress_error']:.3g} % of p from the later snapshot's stress: its "
        "loops are not predicted"
        for one in followed["replay_missed_stress"]
    ]
