"""From the files of a series to one dataset, its evolution and figures."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from loops import InputError
from loops.arrays import Integers
from loops.tracking import ExchangeCounts, Fate
from stability.arguments import whole_number
from stability.packing.edge import checked_band
from stability.packing.response import SOLVED
from studies.columns import definitions
from studies.output import (
    SERIES,
    errors_of,
    folder_lock,
    move_files,
    provenance,
    require_folder,
    write_summary,
    write_table,
)
from studies.paths.options import one_of
from studies.series.dataset import (
    UNFINISHED,
    has_parts,
    keep_only,
    open_folder,
    require_about,
    require_one_schema,
    write_csv,
)
from studies.series.evolution import evolution_table
from studies.series.fates import survival_summary, write_fates
from studies.series.kinetics import kinetics_of, kinetics_summary, kinetics_tables
from studies.series.plan import PlannedSnapshot, plan_series
from studies.series.skill import skill_tables, summarised
from studies.series.tasks import Failure, Series
from studies.series.workers import Runner, do_tasks, open_runner
from studies.snapshot.source import reading

UNITS = (
    "as the input's: lengths, forces, stress = force/length (two dimensions); eigenvalues over the "
    "mean kn; work per area; angles in degrees"
)
# What the parts of each dataset keep beside their rows.
About = dict[str, list[dict[str, Any]]]


def run_series(
    paths: Sequence[Path],
    out: Path,
    *,
    cells: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    skip_bad: bool = False,
    force: bool = False,
    csv: bool = False,
    figures: bool = True,
    animation: bool = False,
    in_packing: bool | str = False,
    yield_band: float = 0.99,
    probe: int | None = None,
    **how: Any,
) -> dict[str, Any]:
    """Find the loops of every snapshot of a series and what becomes of them; the summary.

    Snapshots are read with the options `how` of `read_planar`, their cells from a table `cells`.
    With `in_packing` the packing's rate problem foretells each interval, and `skill.parquet` says
    what that is worth; if 'events' its path and its replay as well. With `probe` every snapshot is
    probed along so many directions of strain. What is finished in `out` is not done again: an
    interrupted run goes on with the same call. A script calls this under
    `if __name__ == "__main__"`, for the processes import it.
    """
    how = reading(**how)
    planned = plan_series(paths, cells, how)
    read = {name: value for name, value in how.items() if name not in ("contacts", "frame")}
    one_of("--in-packing", in_packing or False, (False, True, "rates", "events"))
    band, by_events = checked_band(yield_band) if in_packing else None, in_packing == "events"
    read["in_packing"] = [band, "events"] if by_events else band
    probed: tuple[float | None, int | None] = (None, None)
    if probe is not None:
        whole_number("probe", probe, 1)
        probed = checked_band(yield_band), probe
        read["probe"] = list(probed)
    made = provenance("series", {"paths": paths, "cells": cells, **read}, UNITS)
    read["cells"] = None if cells is None else cells.name
    out = out.absolute()
    require_folder(out, force=True)
    with errors_of(out):
        new = not out.exists()
        out.mkdir(parents=True, exist_ok=True)
        with folder_lock(out):
            open_folder(out, read, [one.name for one in planned], force=force)
            try:
                with open_runner(workers, scheduler, _needed(planned, out)) as runner:
                    series = Series(planned, out, band, by_events, probed)
                    series, failures = _do_all(runner, series, skip_bad=skip_bad)
            except InputError:
                if new and not has_parts(out):
                    shutil.rmtree(out)
                raise
            drawn = {"figures": figures, "animation": animation}
            return _gather(series, failures, made, csv=csv, **drawn)


def _needed(planned: Sequence[PlannedSnapshot], out: Path) -> list[Path]:
    """Files that whoever does the tasks must see."""
    return [out / SERIES, *dict.fromkeys(one.path for one in planned)]


def _do_all(runner: Runner, series: Series, *, skip_bad: bool) -> tuple[Series, list[Failure]]:
    """The series of the snapshots that could be read, and why the others could not."""
    failures = do_tasks(runner, series.snapshots, "snapshots", skip_bad=skip_bad)
    bad = {failure.number for failure in failures}
    good = replace(series, planned=[one for one in series.planned if one.number not in bad])
    if not good.planned:
        raise failures[0].error()
    do_tasks(runner, good.intervals, "pairs", skip_bad=False)
    return good, failures


def _gather(
    series: Series,
    failures: Sequence[Failure],
    made: dict[str, Any],
    *,
    csv: bool,
    figures: bool,
    animation: bool,
) -> dict[str, Any]:
    """Put the finished parts of a series together; the summary."""
    out = series.out
    datasets = {
        "loops": [task.part for task in series.snapshots],
        "increments": [task.part for task in series.intervals],
        "fates": [task.fates_part for task in series.intervals],
    }
    band = series.yield_band
    if band is not None:
        datasets["packing"] = [task.packing_part for task in series.intervals]
    for name, parts in datasets.items():
        keep_only(out / name, {part.name for part in parts})
        require_one_schema(parts)
    about = {name: [require_about(part) for part in parts] for name, parts in datasets.items()}
    evolution, exchange = _evolution(series.planned, about), _exchange(series.planned, about)
    tables: dict[str, Any] = {"evolution": evolution, "exchange": exchange}
    summary = _summary(evolution, about, failures) | {"provenance": made}
    fates = datasets.pop("fates")
    events = [kept["events"] for kept in about["increments"]]
    kinetics, per = kinetics_of(events, evolution["shear_strain"])
    if kinetics is not None:
        tables |= kinetics_tables(kinetics)
        counts = (sum(kept["row"][n] for kept in about["increments"]) for n in ("opened", "closed"))
        summary["kinetics"] = kinetics_summary(kinetics, per, *counts)
    skill, by_order = skill_tables(**datasets)
    if skill["predictor"]:
        tables["skill"] = skill
        summary |= summarised(skill, by_order)
    if band is not None:
        tables["skill_by_order"] = by_order
        summary["packing"] = _solved(about["increments"], band)
    with _put_in_place(out) as folder:
        survived = write_fates(fates, datasets["loops"], folder / "fates.parquet", made)
        if survived:
            tables["survival"] = survived
            summary["survival"] = survival_summary(survived)
        for name, table in tables.items():
            write_table(folder, name, table, made, csv=csv)
        if csv:
            whole = {"fates": [folder / "fates.parquet"]} if fates else {}
            for name, parts in (datasets | whole).items():
                write_csv(parts, folder / f"{name}.csv")
        # Drawing is loaded only when there is something to draw.
        if animation:
            from studies.series.animation import animate_series
            from studies.series.report import pictures

            animate_series(folder, pictures(series, evolution), made)
        if figures:
            from studies.series.report import draw

            draw(folder, series, tables, _mapped(evolution), summary)
        summary["files"] = sorted(path.name for path in folder.iterdir())
        write_summary(folder, summary)
    return summary


def _mapped(evolution: dict[str, list[Any]]) -> int | None:
    """The interval with most loops of negative work, the first of several; a solved one if any."""
    negative = evolution.get("negative_W2", ())[1:]
    solved = [status in SOLVED for status in evolution.get("packing_status", ())[1:]]
    if any(solved):
        negative = np.where(solved, negative, -1).tolist()
    return int(np.argmax(negative)) if negative else None


def _places(evolution: dict[str, list[Any]], interval: int | None) -> list[int] | None:
    return None if interval is None else evolution["snapshot"][interval : interval + 2]


@contextmanager
def _put_in_place(out: Path) -> Iterator[Path]:
    """A folder within `out`, its files moved to `out` when all are written, the summary last."""
    partial = out / UNFINISHED
    partial.mkdir()
    try:
        yield partial
        move_files(partial, out)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _evolution(planned: Sequence[PlannedSnapshot], about: About) -> dict[str, list[Any]]:
    rows = [
        {"snapshot": one.number, "name": one.name} | kept["row"]
        for one, kept in zip(planned, about["loops"], strict=True)
    ]
    return evolution_table(rows, [kept["row"] for kept in about["increments"]])


def _exchange(planned: Sequence[PlannedSnapshot], about: About) -> dict[str, Integers]:
    """One row a pair of orders that occurs in an interval."""
    rows = [
        (one.number, other.number, *counts)
        for (one, other), kept in zip(pairwise(planned), about["increments"], strict=True)
        for counts in zip(*(kept["exchange"][name] for name in ExchangeCounts._fields), strict=True)
    ]
    columns = np.array(rows, dtype=np.int64).reshape(len(rows), 2 + len(ExchangeCounts._fields)).T
    return dict(
        zip(("snapshot_before", "snapshot_after", *ExchangeCounts._fields), columns, strict=True)
    )


def _solved(about: Sequence[dict[str, Any]], band: float) -> dict[str, Any]:
    """How often the packing's rate problem was solved, and how well."""
    rows = [kept["row"] for kept in about]
    status = [row["packing_status"] for row in rows]
    solved = sum(one in SOLVED for one in status)
    worst = {
        name: max((row[name] for row in rows if name in row), default=None)
        for name in ("packing_residual", "packing_disagreeing")
    }
    return {
        "yield_band": band,
        "intervals": len(rows),
        "solved": solved,
        "share_solved": solved / len(rows) if rows else None,
        **{f"intervals {one}": status.count(one) for one in sorted(set(status))},
        **{f"worst {name.removeprefix('packing_')}": value for name, value in worst.items()},
        # Without the numbers, which differ from one interval to the next.
        "boundary": "; ".join(
            dict.fromkeys(
                re.sub(r"\d+ ", "", row["packing_boundary"])
                for row in rows
                if "packing_boundary" in row
            )
        ),
    }


def _summary(
    evolution: dict[str, list[Any]], about: About, failures: Sequence[Failure]
) -> dict[str, Any]:
    intervals = [kept["row"] for kept in about["increments"]]
    names = [fate.name.lower() for fate in Fate]
    return {
        "snapshots": len(about["loops"]),
        "intervals": len(intervals),
        "loops": sum(evolution["loops"]),
        "fates": {name: sum(row[name] for row in intervals) for name in names},
        "first": {name: column[0] for name, column in evolution.items()},
        "last": {name: column[-1] for name, column in evolution.items()},
        "skipped": [
            {"snapshot": one.number, "name": one.name, "reason": f"{one.where}: got {one.received}"}
            for one in failures
        ],
        "work_map": _places(evolution, _mapped(evolution)),
        "notes": list(
            dict.fromkeys(
                note for one in about.values() for kept in one for note in kept.get("notes", ())
            )
        ),
        "definitions": definitions("series"),
    }
