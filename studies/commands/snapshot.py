"""`grainloops snapshot` and `check`: one snapshot, or the files before any mechanics."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from loops.errors import InputError
from studies.commands.common import (
    Answer,
    Cells,
    Contacts,
    Csv,
    Force,
    Json,
    NoFigures,
    OneReading,
    Reading,
    Writing,
    answer,
    clock,
    out_or,
    shown,
)

M_ARENA_MAX = -8  # of malloc.h
JUDGE_WORDS = {
    "affine": "affine closure, spins blocked",
    "traction": "traction closure, spins blocked",
    "traction_free": "traction closure, spins free",
    "packing": "in its packing, spins free",
}
SEVERITIES = ("ok", "doubt", "error")


def _snapshot_lines(summary: dict[str, Any]) -> list[str]:
    orders = "  ".join(f"{n}: {count}" for n, count in _grouped(summary["orders"]).items())
    lines = [
        f"{summary['grains']} grains, {summary['contacts']} contacts; mean contacts per grain "
        f"{summary['coordination']:.3f}, excluding {summary['dangling_grains']} grains with fewer "
        "than two",
        f"{summary['loops']} loops, mean order {shown(summary['mean_order'])} ({orders})",
        f"Euler's formula {'holds' if summary['euler_ok'] else 'FAILS'}",
    ]
    if "sliding_fraction" in summary:
        lines.append(f"{100 * summary['sliding_fraction']:.1f} % of the contacts slide")
    if "unstable_by_order" in summary:
        lines += _verdicts(summary)
    return lines + [f"note: {note}" for note in summary["notes"]]


def _verdicts(summary: dict[str, Any]) -> list[str]:
    """Shares of unstable loops, with what each assumes."""
    from studies.output import definitions

    assumed = definitions("assumptions")
    lines = ["unstable loops by order:"]
    for judge in summary["unstable_by_order"]:
        name = JUDGE_WORDS[judge]
        text = "  ".join(
            f"{group}: {_percent(share['mean'])}"
            for group, share in summary["unstable_by_order"][judge].items()
        )
        unknown = summary["untrusted_loops"][judge]
        lines.append(f"  {name:<32} {text}" + (f"  ({unknown} undetermined)" if unknown else ""))
    lines += [f"spins {case}: {assumed[f'spins_{case}']}" for case in ("blocked", "free")]
    if "in_packing" not in summary:
        return [*lines, assumed["cut_out"]]
    return [
        *lines,
        f"in its packing: {assumed['in_packing'].format(**summary['in_packing'])}",
        *_around(summary),
    ]


def _around(summary: dict[str, Any]) -> list[str]:
    """Lines on the surroundings of the loops and the stated error."""
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
        f"surroundings' share of a loop's stiffness, median by order: {parts} "
        "(without loops undetermined when cut out)",
        f"loops whose surroundings have positive stiffness in all directions: "
        f"{_percent(positive)} ({known})",
    ]


def _percent(share: float) -> str:
    return "-" if share != share else f"{100 * share:.3g} %"


def _grouped(orders: dict[str, int]) -> dict[str, int]:
    """Loops by order, those of the last one and beyond together."""
    from studies.snapshot.table import LAST_ORDER

    counts: dict[str, int] = {}
    for n, count in orders.items():
        group = n if int(n) < LAST_ORDER else f"{LAST_ORDER}+"
        counts[group] = counts.get(group, 0) + count
    return counts


def snapshot(
    path: Annotated[Path, Parameter(help="File of the snapshot, or of its grains.")],
    /,
    *,
    writing: Writing | None = None,
    in_packing: Annotated[
        str | None,
        Parameter(
            metavar="auto|whole|blocks",
            help="Judge the loops in their packing too: the whole packing at once, blocks of it "
            "(less memory, larger errors), or auto (by the number of grains).",
        ),
    ] = None,
    no_figures: NoFigures = False,
    paraview: Annotated[
        bool, Parameter(name="--vtk", help="Write loops.vtp for ParaView.")
    ] = False,
    reading: OneReading | None = None,
) -> Answer:
    """Find the loops of a DEM snapshot and judge the stability of each."""
    writing, reading = writing or Writing(), reading or OneReading()
    out = out_or(writing.out, "snapshot", path)
    # The study checks the words itself, and says what is expected.
    words: Any = {"in_packing": in_packing}
    # The cores have threads of their own; numpy, loaded after this, would add as many.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Threads take memory from one place (glibc); each would keep what it freed.
    with suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, 1)
    with clock("grainloops snapshot"):
        from studies.snapshot import run_snapshot

        summary = run_snapshot(
            path,
            out,
            **words,
            figures=not no_figures,
            paraview=paraview,
            **writing.files(),
            **reading.how_of(path),
        )
    return answer(writing.json, out, _snapshot_lines(summary))


def check(
    *paths: Annotated[
        Path,
        Parameter(
            required=True,
            help="Files of the snapshots, or of their grains; every snapshot of each file.",
        ),
    ],
    out: Annotated[
        Path | None, Parameter(help="Result folder, created. If omitted, only print.")
    ] = None,
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
    cells: Cells = None,
    exit_zero: Annotated[
        bool, Parameter(help="Exit with status 0 also if the verdict is error.")
    ] = False,
    contacts: Contacts = None,
    reading: Reading | None = None,
) -> Answer:
    """Check each file for consistency: signs, units, columns, balance, jamming.

    Of several snapshots each is checked against the one before it: kt against the changes of T.
    Exit status 1 if the verdict is error, 2 if a file can't be read.
    """
    from studies.output import as_json, provenance
    from studies.study import study

    how = {"contacts": contacts, **(reading or Reading()).how()}
    with clock("grainloops check"):
        rows, unread = _rows(paths, cells, how)
        worst = max((SEVERITIES.index(row["severity"]) for row in rows), default=0)
        made = ("check", {"paths": paths, "cells": cells, **how}, "numbers as their text")
        summary = {
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
    return Answer(
        _check_lines(rows, summary),
        as_json(summary) if json else None,
        errors=tuple(map(str, unread)),
        status=2 if unread else int(summary["verdict"] == "error" and not exit_zero),
        out=out,
    )


def _rows(
    paths: Sequence[Path], cells: Path | None, options: dict[str, Any]
) -> tuple[list[dict[str, Any]], list[InputError]]:
    """One row per finding, and the errors of the files that could not be read."""
    from patterns.snapshots.checks import check_kt

    if options["cell"] is not None and cells is not None:
        raise InputError("--cell, --cells", "both", "one of them", "Leave one out.")
    rows: list[dict[str, Any]] = []
    unread: list[InputError] = []
    before = None
    for path in paths:
        try:
            for number, snapshot in enumerate(_snapshots(path, cells, options)):
                place = {"path": str(path), "snapshot": number}
                found = [*snapshot.findings, _crossings(snapshot)]
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
    from studies.series.plan import cell_reader

    cell_of, how = cell_reader(cells), {n: options[n] for n in ("format", "columns")}
    count = count_frames(path, options["contacts"], **how)
    for frame in range(count):
        place = frame if count > 1 else None
        own = {"cell": np.reshape(cell_of(path, place), (2, 2)), "frame": place}
        yield read_snapshot(path, strict=False, **options | own)


def _crossings(snapshot: Any) -> Any:
    """Whether the network is plane, which loops need."""
    from loops import find_crossings
    from patterns.snapshots.checks import Finding

    count = len(find_crossings(snapshot.graph, 1_000_000))
    found = Finding("crossings", float(count), f"{count} pairs of branches cross")
    if count == 0:
        return found
    return found.error(
        ": opposite grains of a loop overlap, or the cell is wrong",
        "Give the right cell, or leave out one of each pair by --drop-crossings.",
    )


def _check_lines(rows: list[dict[str, Any]], summary: dict[str, Any]) -> list[str]:
    lines = []
    place = None
    for row in rows:
        if place != (row["path"], row["snapshot"]):
            place = row["path"], row["snapshot"]
            lines.append(f"{row['path']}, snapshot {row['snapshot']}")
        text = row["says"] + (f". {row['remedy']}" if row["remedy"] else "")
        lines.append(f"  {row['severity']:<5}  {row['check']:<13}  {text}")
    found = ", ".join(f"{count} {name}" for name, count in summary["findings"].items())
    return [*lines, f"{summary['snapshots']} snapshots: {found}; verdict: {summary['verdict']}"]
