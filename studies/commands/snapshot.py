"""`grainloops check`, `snapshot` and `series`: files before any mechanics, one snapshot, many."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from loops.errors import InputError
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
    answer,
    answered,
    clock,
    out_or,
    shown,
)
from studies.questions import FURTHER, AsGiven, Cells, Replaying, Snapshotting, Tracking

if TYPE_CHECKING:
    from studies.output import Row, Summary

# Options of malloc.h. Threads take memory from one place (each would keep what it freed), and large
# arrays use again what others freed: a fifth fewer page faults.
MALLOC = {"M_ARENA_MAX": (-8, 1), "M_MMAP_THRESHOLD": (-3, 2**30), "M_TRIM_THRESHOLD": (-1, 2**30)}


def _snapshot_lines(summary: Summary) -> list[str]:
    from studies.snapshot.table import LAST_ORDER

    # Loops of the last order and beyond are counted together.
    counts: dict[str, int] = {}
    for n, count in summary["orders"].items():
        group = n if int(n) < LAST_ORDER else f"{LAST_ORDER}+"
        counts[group] = counts.get(group, 0) + count
    orders = "  ".join(f"{n}: {count}" for n, count in counts.items())
    lines = [
        f"{summary['grains']} grains, {summary['contacts']} contacts; mean contacts per grain "
        f"{summary['coordination']:.3f}, excluding {summary['dangling_grains']} grains with fewer "
        "than two",
        f"{summary['loops']} loops, mean order {shown(summary['mean_order'])} ({orders})",
        f"Euler's formula {'holds' if summary['euler_ok'] else 'FAILS'}",
    ]
    if "sliding_fraction" in summary:
        lines.append(f"{100 * summary['sliding_fraction']:.1f} % of the contacts slide")
    if "unstable_by_order" in summary and not summary["normal_force"]["mean"]:
        lines.append("all contact forces are zero: no verdict on the loops")
    elif "unstable_by_order" in summary:
        lines += _verdicts(summary)
    return lines


def _verdicts(summary: Summary) -> list[str]:
    """Shares of unstable loops, with what each assumes."""
    from studies.output import definitions
    from studies.snapshot.summary import JUDGE_TITLES

    assumed = definitions("assumptions")
    lines = ["unstable loops by order, in % of those judged (judged of all, where some are not):"]
    for judge in summary["unstable_by_order"]:
        every, shares = (
            summary[f"{kind}_by_order"][judge] for kind in ("undetermined", "unstable")
        )
        text = "  ".join(
            f"{group}: {_percent(share['mean'])}"
            + (f" ({share['count']} of {all_of})" if share["count"] < all_of else "")
            for group, share in shares.items()
            for all_of in (every[group]["count"],)
            if shares["all"]["count"]
        )
        lines.append(f"  {JUDGE_TITLES[judge]:<24} {text or '-'}")
    lines += [f"spins {case}: {assumed[f'spins_{case}']}" for case in ("blocked", "free")]
    if "in_packing" not in summary:
        return [*lines, assumed["cut_out"]]
    parts = "  ".join(
        f"{group}: {shown(share['median'] if share['count'] else None)}"
        for group, share in summary["surroundings_share"].items()
    )
    positive = summary["surroundings_positive"]["all"]["mean"]
    error = summary["packing_error"]
    known = (
        f"stated errors of the operators: median {error['median']:.1g}" if error["count"] else ""
    )
    return [
        *lines,
        summary["packing_at_rest"]["says"],
        f"in its packing: {assumed['in_packing'].format(**summary['in_packing'])}",
        f"surroundings' share of a loop's stiffness, median by order: {parts} "
        "(without loops undetermined when cut out)",
        f"loops whose surroundings have positive stiffness in all directions: "
        f"{_percent(positive)} ({known})",
    ]


def _percent(share: float) -> str:
    return "-" if share != share else f"{100 * share:.3g} %"


def snapshot_command(
    path: Path,
    /,
    *,
    writing: Writing | None = None,
    asked: Snapshotting | None = None,
    reading: OneReading | None = None,
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
    return answered("snapshot", path, _snapshot_lines, writing, reading or OneReading(), asked)


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
    reading: Reading | None = None,
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

    how, ordered = {"contacts": contacts, **(reading or Reading()).how()}, list(paths)
    strict = how.pop("strict")
    if not as_given:
        from studies.reading import in_order

        ordered, _ = in_order(paths, how)
    with clock("grainloops check"):
        rows, unread = _rows(ordered, cells, how)
        worst = max((SEVERITIES.index(row["severity"]) for row in rows), default=0)
        made = ("check", {"paths": paths, "cells": cells, **how}, "numbers as their text")
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
    lines = []
    place = None
    for row in rows:
        if place != (row["path"], row["snapshot"]):
            place = row["path"], row["snapshot"]
            lines.append(f"{row['path']}, snapshot {row['snapshot']}")
        text = row["says"] + (f". {row['remedy']}" if row["remedy"] else "")
        lines.append(f"  {row['severity']:<5}  {row['check']:<13}  {text}")
    found = ", ".join(f"{count} {name}" for name, count in summary["findings"].items())
    lines.append(f"{summary['snapshots']} snapshots: {found}; verdict: {summary['verdict']}")
    return Answer(
        lines,
        as_json(summary) if json else None,
        errors=tuple(map(str, unread)),
        status=2 if unread or (strict and worst) else int(worst == 2 and not exit_zero),
        out=out,
    )


def _rows(
    paths: Sequence[Path], cells: Path | None, options: dict[str, Any]
) -> tuple[list[Row], list[InputError]]:
    """One row per finding, and the errors of the files that could not be read."""
    from patterns.snapshots.findings import crossings
    from patterns.snapshots.slip_check import check_kt

    if options["cell"] is not None and cells is not None:
        raise InputError("--cell, --cells", "both", "one of them", "Leave one out.")
    rows: list[Row] = []
    unread: list[InputError] = []
    before = None
    for path in paths:
        try:
            for number, snapshot in enumerate(_snapshots(path, cells, options)):
                place = {"path": str(path), "snapshot": number}
                # Loops need a plane network.
                found = [*snapshot.findings, crossings(snapshot.graph)]
                kt = None if before is None else check_kt(before, snapshot)
                found += [] if kt is None else [kt]
                rows += [place | one._asdict() for one in found]
                before = snapshot
        except InputError as error:
            unread.append(error)
    return rows, unread


def _snapshots(path: Path, cells: Path | None, options: dict[str, Any]) -> Iterator[Any]:
    """Snapshots of a file, each with its own cell if there is a table of cells."""
    import numpy as np

    from patterns import count_frames, read_frames, read_snapshot

    if cells is None:
        cell = options["cell"]
        read = options | {"cell": None if cell is None else np.reshape(cell, (2, 2))}
        yield from read_frames(path, strict=False, **read)
        return
    from studies.reading import cell_reader

    cell_of, how = cell_reader(cells), {n: options[n] for n in ("format", "columns")}
    count = count_frames(path, options["contacts"], **how)
    for frame in range(count):
        place = frame if count > 1 else None
        own = {"cell": np.reshape(cell_of(path, place), (2, 2)), "frame": place}
        yield read_snapshot(path, strict=False, **options | own)


# Notes that are printed, at most.
MOST_NOTES = 8
# Characters that are printed of the reason why a snapshot was skipped, at most.
LONGEST_REASON = 300


def _series_lines(summary: Summary) -> list[str]:
    fates = "  ".join(f"{name}: {count}" for name, count in summary["fates"].items())
    lines = [
        f"{summary['snapshots']} snapshots, {summary['loops']} loops in all",
        f"loops in {summary['intervals']} intervals: {fates}",
    ]
    for when in ("first", "last"):
        row = summary[when]
        lines.append(
            f"{when} snapshot: {row['loops']} loops, mean order {shown(row['mean_order'])}, "
            f"mean contacts per grain {shown(row['coordination'])}"
        )
    strains = {name: summary["last"][name] for name in ("H11", "H12", "H21", "H22")}
    said = (f"{name} = {'-' if e is None else f'{e:.6g}'}" for name, e in strains.items())
    lines.append(f"strain between them: {'  '.join(said)}")
    if "packing" in summary:
        packing = summary["packing"]
        lines.insert(
            0,
            f"increments of the packing ({packing['boundary'] or 'none'}): solved in "
            f"{packing['solved']} of {packing['intervals']} intervals, nearest regimes in "
            f"{packing.get('intervals nearest', 0)}",
        )
    if "followed" in summary:
        lines[1:1] = _followed_lines(summary["followed"])
    if "skill" in summary:
        lines += _skill_lines(summary["skill"])
    if "skill_of_targets" in summary:
        lines += _target_lines(summary["skill_of_targets"])
    lines += [
        f"skipped: snapshot {one['snapshot']} ({one['name']}): {one['reason'][:LONGEST_REASON]}"
        for one in summary["skipped"]
    ]
    return lines


def _followed_lines(followed: dict[str, Any]) -> list[str]:
    """Rate of the replays and where it is from; how the paths ended."""
    if followed["replay_inertial_number"] is None:
        return []
    low, high = (f"{value:.2g}" for value in followed["replay_inertial_number"])
    sources = ", ".join(
        f"{source}: {count} intervals" for source, count in followed["replay_rate_from"].items()
    )
    ends = ", ".join(f"{status}: {count}" for status, count in followed["path_statuses"].items())
    lines = [
        f"replay at inertial number {low if low == high else f'{low} to {high}'} ({sources}), "
        f"damping {followed['damping']:g}, programme {followed['programme']}",
        f"path by events ({ends}), {followed['path_instabilities']} instabilities passed by "
        f"{followed['past']}",
    ]
    apart = followed["path_from_replay"]
    if apart is not None:
        before, after = apart["snapshots"]
        lines.append(
            f"forces of path and replay differ by {apart['median']:.2g} of what the replay changes "
            f"(median), at most by {apart['largest']:.2g}, from snapshot {before} to {after}"
        )
    missed = followed["replay_stress_error"]
    if missed is not None:
        before, after = missed["snapshots"]
        lines.append(
            f"replays end {100 * missed['median']:.2g} % of p from the later snapshot's stress "
            f"(median), at most {100 * missed['largest']:.2g} %, from snapshot {before} to {after}"
        )
    return lines


def _skill_lines(skill: dict[str, Any]) -> list[str]:
    """Skill of each prediction beside the base rate and persistence."""
    base = skill["traction"]["base"]
    if base is None:
        return []
    lines = [
        f"{100 * base:.1f} % of the loops that survived and moved did negative second-order work "
        "(base rate); how well it is predicted:",
        f"  {'':<33} predicted  precision  recall    AUC   (lowest to highest)",
    ]
    for name, row in skill.items():
        covered = "-" if row["coverage"] is None else f"{100 * row['coverage']:.3g} %"
        values = "  ".join(f"{shown(row[key]):>7}" for key in ("precision", "recall", "auc"))
        values = f"{covered:>8}   {values}"
        spread = f"   ({row['auc_min']:.3f} to {row['auc_max']:.3f})" if "auc_min" in row else ""
        lines.append(f"  {_predictor(name):<33}  {values}{spread}")
    return [
        *lines,
        "  (predicted: share of these loops, the numbers beside it are of them; precision: compare "
        "with the base rate; AUC: 0.5 is chance, 1 is perfect)",
    ]


def _predictor(name: str) -> str:
    """The name of a predictor in plain text."""
    from studies.series.skill import PREDICTORS

    said = PREDICTORS[name].replace(r"$\lambda_{\min}$", "least eigenvalue")
    return said.replace(r"$D^2_{\min}$", "D2min")


def _target_lines(targets: dict[str, Any]) -> list[str]:
    """AUC of every predictor for what else becomes of loops, below the base rates."""
    from studies.series.skill import PREDICTORS, TARGETS

    skills = targets.values()
    rows = {"base rate": [next(iter(skill.values()))["base"] for skill in skills]}
    for name in (one for one in PREDICTORS if any(one in skill for skill in skills)):
        rows[_predictor(name)] = [skill.get(name, {}).get("auc") for skill in skills]
    head = "  ".join(f"{TARGETS[target]:>18}" for target in targets)
    return [f"  {'AUC of all predictors for':<33}  {head}"] + [
        f"  {name:<33}  " + "  ".join(f"{shown(value):>18}" for value in values)
        for name, values in rows.items()
    ]


def series_command(
    *paths: Annotated[Path, Parameter(required=True)],
    writing: Writing | None = None,
    sharing: Sharing | None = None,
    asked: Tracking | None = None,
    replaying: Replaying | None = None,
    reading: PlaneReading | None = None,
) -> Answer:
    """Follow the loops through a series of snapshots; after a stop the same command continues.

    Parameters
    ----------
    paths
        Files of the snapshots; of a file with several snapshots, all.
    """
    from studies.series.run import run_series

    writing, reading = writing or Writing(), reading or PlaneReading()
    out = out_or(writing.out, "series", paths[0] if paths else None)
    try:
        summary = run_series(
            paths,
            out,
            **asdict(sharing or Sharing()),
            **asdict(asked or Tracking()),
            **asdict(replaying or Replaying()),
            **writing.files(),
            **reading.how(),
        )
    except KeyboardInterrupt:
        kept = "finished snapshots are kept: the same command continues"
        raise KeyboardInterrupt(kept) from None
    return answer(writing.json, out, _series_lines(summary), summary["notes"], MOST_NOTES)
