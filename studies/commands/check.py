"""`grainloops check`: faults of snapshots, before any mechanics."""

from __future__ import annotations

from collections.abc import Sequence
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
    Reading,
    clock,
)

VERDICTS = ("ok", "doubt", "error")


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
    from studies.output import as_json, provenance, result_folder, write_results

    how = {"contacts": contacts, **(reading or Reading()).how()}
    with clock("grainloops check"):
        rows, unread = _rows(paths, cells, how)
        made = provenance("check", {"paths": paths, "cells": cells, **how}, "numbers as their text")
        summary = _summary(rows, unread) | {"provenance": made}
        if out is not None:
            with result_folder(out, force=force) as folder:
                write_results(folder, summary, {"findings": rows}, csv=csv)
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
    """One row a finding, and the errors of the files that could not be read."""
    import numpy as np

    from patterns import read_frames
    from patterns.snapshots.checks import check_kt

    if options["cell"] is not None and cells is not None:
        raise InputError("--cell, --cells", "both", "one of them", "Leave one out.")
    if cells is not None:
        from studies.series.plan import cells_by_number, number_of

        table = cells_by_number(cells)
    rows: list[dict[str, Any]] = []
    unread: list[InputError] = []
    before = None
    for path in paths:
        try:
            cell = options["cell"]
            if cells is not None and (cell := table.get(number_of(path))) is None:
                received = f"no row with snap = {number_of(path)}, for {path.name}"
                raise InputError(f"--cells {cells}", received, "one row a snapshot", "Add the row.")
            read = options | {"cell": None if cell is None else np.reshape(cell, (2, 2))}
            for number, snapshot in enumerate(read_frames(path, strict=False, **read)):
                place = {"path": str(path), "snapshot": number}
                found = [*snapshot.findings, _crossings(snapshot)]
                kt = None if before is None else check_kt(before, snapshot)
                found += [] if kt is None else [kt]
                rows += [place | one._asdict() for one in found]
                before = snapshot
        except InputError as error:
            unread.append(error)
    return rows, unread


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


def _summary(rows: list[dict[str, Any]], unread: list[InputError]) -> dict[str, Any]:
    worst = max((VERDICTS.index(row["severity"]) for row in rows), default=0)
    return {
        "verdict": "unreadable" if unread else VERDICTS[worst],
        "snapshots": len({(row["path"], row["snapshot"]) for row in rows}),
        "findings": {name: sum(row["severity"] == name for row in rows) for name in VERDICTS},
        "unread": [str(error) for error in unread],
        "checks": rows,
    }


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
