"""`grainloops check`, `snapshot` and `series`: files before any mechanics, one snapshot, many."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from loops.errors import InputError
from studies.clock import clock
from studies.commands import (
    Answer,
    Contacts,
    Csv,
    Force,
    Json,
    OneReading,
    PlaneReading,
    Reading,
    Sharing,
    Writing,
    answered,
    printed,
    shown,
)
from studies.questions import FURTHER, AsGiven, Cells, Replaying, Snapshotting, Tracking

if TYPE_CHECKING:
    from studies.output import Row, Summary

# Options of malloc.h. Threads take memory from one place (each would keep what it freed), and large
# arrays use again what others freed: a fifth fewer page faults.
MALLOC = {"M_ARENA_MAX": (-8, 1), "M_MMAP_THRESHOLD": (-3, 2**30), "M_TRIM_THRESHOLD": (-1, 2**30)}


def _snapshot_lines(summary: Summary) -> list[str]:
    groups = summary["orders_grouped"].items()
    told: Summary = {
        "groups": "  ".join(f"{name}: {one['loops']}" for name, one in groups if one["loops"])
    }
    if "unstable_by_order" in summary:
        loaded = bool(summary["normal_force"]["mean"])
        told |= _verdicts(summary) if loaded else {"unloaded": True}
    return printed("snapshot", summary, **told)


def _verdicts(summary: Summary) -> Summary:
    """Shares of unstable loops by judge, and what each assumes."""
    from studies.output import definitions
    from studies.snapshot.summary import JUDGE_TITLES

    assumed = definitions("assumptions")
    told: Summary = {"assumed": assumed, "cut_out": assumed["cut_out"], "judged": {}}
    for judge, shares in summary["unstable_by_order"].items():
        every = summary["undetermined_by_order"][judge]
        text = "  ".join(
            f"{group}: {_percent(share['mean'])}"
            + (f" ({share['count']} of {all_of})" if share["count"] < all_of else "")
            for group, share in shares.items()
            for all_of in (every[group]["count"],)
            if shares["all"]["count"]
        )
        told["judged"][JUDGE_TITLES[judge]] = text or "-"
    told["certain"] = {
        f"certain sign, {closure}": "  ".join(
            f"{group}: {_percent(share['mean'])}" for group, share in shares.items()
        )
        for closure, shares in summary.get("certain_by_order", {}).items()
    }
    if "in_packing" in summary:
        medians = "  ".join(
            f"{group}: {shown(share['median'] if share['count'] else None)}"
            for group, share in summary["surroundings_share"].items()
        )
        around = assumed["in_packing"].format(**summary["in_packing"])
        positive = _percent(summary["surroundings_positive"]["all"]["mean"])
        told |= {"around": around, "medians": medians, "positive": positive, "cut_out": None}
    return told


def _percent(share: float) -> str:
    return "-" if share != share else f"{100 * share:.3g} %"


def snapshot_command(
    path: Path,
    /,
    *,
    writing: Writing = Writing(),
    asked: Snapshotting = Snapshotting(),
    reading: OneReading = OneReading(),
) -> Answer:
    """Find the loops of a DEM snapshot and judge the stability of each.

    Parameters
    ----------
    path
        File of the snapshot, or of its grains.
    """
    with suppress(OSError, AttributeError, TypeError):
        for option in MALLOC.values():
            ctypes.CDLL(None).mallopt(*option)
    return answered("snapshot", path, _snapshot_lines, writing, reading, asked)


def check_command(
    *paths: Annotated[Path, Parameter(required=True)],
    out: Path | None = None,
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
    cells: Cells = None,
    as_given: AsGiven = False,
    exit_zero: Annotated[bool, Parameter(group=FURTHER)] = False,
    contacts: Contacts = None,
    reading: Reading = Reading(),
) -> Answer:
    """Check each file for consistency: signs, units, columns, balance, jamming.

    Of several snapshots each is checked against the one before it: kt against the changes of T.
    Exit status 1 if the verdict is error, 2 if a file can't be read, or is refused by --strict.

    Parameters
    ----------
    paths
        Files of the snapshots, or of their grains; every snapshot of each file.
    out
        Result folder, created. If omitted, only print.
    exit_zero
        Exit with status 0 also if the verdict is error.
    """
    from patterns.snapshots.findings import SEVERITIES
    from studies.output import as_json, provenance
    from studies.study import study

    how, ordered = {"contacts": contacts, **reading.how()}, list(paths)
    strict = how.pop("strict")
    if not as_given:
        from studies.reading import in_order

        ordered, _ = in_order(paths, how)
    with clock("grainloops check"):
        rows, unread = _rows(ordered, cells, how)
        worst = max((SEVERITIES.index(row["severity"]) for row in rows), default=0)
        made = ("check", {"paths": paths, "cells": cells, **how})
        summary: Summary = {
            "verdict": "unreadable" if unread else SEVERITIES[worst],
            "snapshots": len({(row["path"], row["snapshot"]) for row in rows}),
            "findings": {name: sum(row["severity"] == name for row in rows) for name in SEVERITIES},
            "unread": [str(error) for error in unread],
            "checks": rows,
            "provenance": provenance(*made),
        }
        if out is not None:
            with study(made[0], out, *made[1:], force=force, csv=csv) as results:
                columns = {name: [row[name] for row in rows] for name in (rows or [{}])[0]}
                results.write_tables({"findings": columns} if columns else {})
                results.write_summary(summary)
    places = [f"{row['path']}, snapshot {row['snapshot']}" for row in rows]
    heads = [place if place != before else None for before, place in pairwise(["", *places])]
    told = [row | {"place": head} for row, head in zip(rows, heads, strict=True)]
    return Answer(
        printed("check", summary, checks=told),
        as_json(summary) if json else None,
        errors=tuple(map(str, unread)),
        status=2 if unread or (strict and worst) else int(worst == 2 and not exit_zero),
        out=out,
    )


def _rows(
    paths: Sequence[Path], cells: Path | None, options: dict[str, Any]
) -> tuple[list[Row], list[InputError]]:
    """One row per finding, and the errors of the files that could not be read."""
    import numpy as np

    from patterns import read_frames
    from patterns.snapshots.findings import crossings
    from patterns.snapshots.slip_check import check_kt

    if options["cell"] is not None:
        options["cell"] = np.reshape(options["cell"], (2, 2))
    rows: list[Row] = []
    unread: list[InputError] = []
    before = None
    for path in paths:
        try:
            found = read_frames(path, strict=False, cells=cells, **options)
            for number, snapshot in enumerate(found):
                place = {"path": str(path), "snapshot": number}
                # Loops need a plane network.
                told = [*snapshot.findings, crossings(snapshot.graph)]
                kt = None if before is None else check_kt(before, snapshot)
                told += [] if kt is None else [kt]
                rows += [place | one._asdict() for one in told]
                before = snapshot
        except InputError as error:
            unread.append(error)
    return rows, unread


# Notes that are printed, at most.
MOST_NOTES = 8


def _series_lines(summary: Summary) -> list[str]:
    last, told = summary["last"], {"rates": None, **_skills(summary)}
    rates = summary.get("followed", {}).get("replay_inertial_number")
    if rates is not None:
        told["rates"] = " to ".join(dict.fromkeys(f"{value:.2g}" for value in rates))
    strain = {name: last[name] for name in ("H11", "H12", "H21", "H22")}
    ends = {"first": summary["first"], "last": last}
    return printed("series", summary, ends=ends, strain=strain, **told)


def _skills(summary: Summary) -> Summary:
    """Skill of each prediction beside the base rate, and AUC for what else becomes of loops."""
    from studies.output import words

    every = words("lines")
    labels, plain = every["labels"], every["labels"]["predictors"] | every["words"]["predictor"]
    skill, targets = summary.get("skill"), summary.get("skill_of_targets")
    told: Summary = {}
    if skill is not None and (base := skill["traction"]["base"]) is not None:
        rows = []
        for name, row in skill.items():
            known = row["coverage"] is not None
            covered = f"{100 * row['coverage']:.3g} %" if known else "-"
            rows.append(row | {"words": plain[name], "covered": covered})
        told = {"base": base, "skills": rows}
    if targets is not None:
        skills = targets.values()
        columns = {"AUC of all predictors for": [labels["targets"][target] for target in targets]}
        columns["base rate"] = [shown(next(iter(one.values()))["base"]) for one in skills]
        for name in (one for one in plain if any(one in skill for skill in skills)):
            values = [shown(one.get(name, {}).get("auc")) for one in skills]
            columns[plain[name]] = values
        told["targets"] = {
            name: "  ".join(f"{value:>18}" for value in row) for name, row in columns.items()
        }
    return told


def series_command(
    *paths: Annotated[Path, Parameter(required=True)],
    writing: Writing = Writing(),
    sharing: Sharing = Sharing(),
    asked: Tracking = Tracking(),
    replaying: Replaying = Replaying(),
    reading: PlaneReading = PlaneReading(),
) -> Answer:
    """Follow the loops through a series of snapshots; after a stop the same command continues.

    Parameters
    ----------
    paths
        Files of the snapshots; of a file with several snapshots, all.
    """
    kept = "finished snapshots are kept: the same command continues"
    own: Any = {"kept": kept, "clocked": False, "most": MOST_NOTES}
    groups = writing, reading, sharing, asked, replaying
    return answered("series", paths, _series_lines, *groups, **own)
