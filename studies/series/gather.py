"""What all snapshots of a series come to: evolution, exchange of orders, summary, figures."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops.tracking import ExchangeCounts, Fate
from studies.output import move_files, provenance, write_summary, write_table
from studies.series.dataset import (
    UNFINISHED,
    keep_only,
    require_about,
    require_one_schema,
    write_csv,
)
from studies.series.evolution import evolution_table
from studies.series.plan import PlannedSnapshot, SeriesInput
from studies.series.skill import mean_skill, skill_table
from studies.series.tasks import Failure, SnapshotTask, pairs

UNITS = (
    "as the input's: lengths, forces, stress = force/length (two dimensions); eigenvalues over the "
    "mean kn; work per area; angles in degrees"
)
# What the parts of each dataset keep beside their rows.
About = dict[str, list[dict[str, Any]]]
DEFINITIONS = {
    "files": "tables and figures of the whole series; its parts are in loops and increments",
    "fates": "loops by what became of them in all intervals; born counts later loops, the others "
    "earlier ones",
    "intervals": "pairs of successive snapshots",
    "loops": "of all snapshots together",
    "work_map": "snapshots of the interval mapped: the one with most loops of negative W2",
    "skill": "how well each predictor foresees the survived loops of negative corotated work W2, "
    "means over the intervals weighted by loops. base: share of such loops among those that moved; "
    "coverage: share of these that have a prediction; agreement, precision, recall: of its sign; "
    "auc: chance that of two loops the one of negative work is ranked first, 0.5 by chance; "
    "rank_correlation: Spearman's. affine, traction (blocked spins), traction_free foretell from "
    "the strain that the loop really took; *_lambda_min, order and sliding (contacts) from the "
    "earlier snapshot alone; persistence from the loop's own work in the interval before",
    "skipped": "snapshots that could not be read; the interval goes over them",
}


def gather(
    series: SeriesInput,
    planned: Sequence[PlannedSnapshot],
    failures: Sequence[Failure],
    out: Path,
    *,
    csv: bool,
    figures: bool,
    animation: bool,
) -> dict[str, Any]:
    """Put the finished parts of a series together.

    Parameters
    ----------
    series : SeriesInput
        What was asked.
    planned : sequence of PlannedSnapshot
        The snapshots whose parts are there.
    failures : sequence of Failure
        Why others are not.
    out : Path
        Result folder of the series.
    csv : bool
        Whether to write the tables as CSV too.
    figures, animation : bool
        Whether to draw.

    Returns
    -------
    dict
        The summary.

    Raises
    ------
    InputError
        If the snapshots don't have the same columns.
    """
    datasets = {
        "loops": [SnapshotTask(one, out).part for one in planned],
        "increments": [task.part for task in pairs(planned, out)],
    }
    for name, parts in datasets.items():
        keep_only(out / name, {part.name for part in parts})
        require_one_schema(parts)
    about = {name: [require_about(part) for part in parts] for name, parts in datasets.items()}
    evolution, exchange = _evolution(planned, about), _exchange(planned, about)
    made = provenance("series", asdict(series), UNITS)
    skill = skill_table(datasets["increments"], datasets["loops"])
    summary = _summary(evolution, about, failures) | {"provenance": made}
    if skill["predictor"]:
        summary["skill"] = mean_skill(skill)
    with _put_in_place(out) as folder:
        write_table(folder, "evolution", evolution, made, csv=csv)
        write_table(folder, "exchange", exchange, made, csv=csv)
        if skill["predictor"]:
            write_table(folder, "skill", skill, made, csv=csv)
        if csv:
            for name, parts in datasets.items():
                write_csv(parts, folder / f"{name}.csv")
        if animation:
            # Drawing is loaded only when there is something to draw.
            from studies.series.draw import animate

            animate(folder, planned, out, evolution, made)
        if figures:
            from studies.series.draw import draw

            draw(folder, planned, out, evolution, exchange, _mapped(evolution), summary)
        summary["files"] = sorted(path.name for path in folder.iterdir())
        write_summary(folder, summary)
    return summary


def _mapped(evolution: dict[str, list[Any]]) -> int | None:
    """The interval with most loops of negative work, the first of several."""
    negative = evolution.get("negative_W2", ())[1:]
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


def _exchange(planned: Sequence[PlannedSnapshot], about: About) -> dict[str, NDArray[np.int64]]:
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
        "notes": list(dict.fromkeys(note for kept in about["loops"] for note in kept["notes"])),
        "definitions": DEFINITIONS,
    }
