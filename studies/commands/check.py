"""`grainloops check`: what is wrong with snapshots, before any mechanics."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from loops.errors import InputError
from studies.commands import common
from studies.commands.clock import clock
from studies.commands.common import Csv, Force, Json, reads

VERDICTS = ("ok", "doubt", "error")


@reads("frame", "drop_crossings")
def check(
    paths: Annotated[
        list[Path], typer.Argument(help="Files, or those of the grains; every snapshot of each.")
    ],
    out: Annotated[
        Path | None, typer.Option(help="Result folder; created. Without it nothing is written.")
    ] = None,
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
    **how: Any,
) -> None:
    """Hold each snapshot against itself: signs, units, columns, balance, jamming.

    Exit status 0 whatever is found, 2 if a file can't be read.
    """
    from studies.output import as_json, provenance, result_folder, write_results

    rows, unread = _rows(paths, how)
    made = provenance("check", {"paths": paths, **how}, "numbers as their text")
    summary = _summary(rows, unread) | {"provenance": made}
    if out is not None:
        with result_folder(out, force=force) as folder:
            write_results(folder, summary, {"findings": rows}, csv=csv)
    clock.stop()
    if json:
        typer.echo(as_json(summary))
    elif not common.quiet:
        _print(rows, summary)
    if unread:
        raise unread[0]


def _rows(
    paths: list[Path], options: dict[str, Any]
) -> tuple[list[dict[str, Any]], list[InputError]]:
    """One row a finding, and what files could not be read for."""
    import numpy as np

    from patterns import read_frames

    if options["cell"] is not None:
        options = options | {"cell": np.reshape(options["cell"], (2, 2))}
    rows: list[dict[str, Any]] = []
    unread: list[InputError] = []
    for path in paths:
        try:
            for number, snapshot in enumerate(read_frames(path, strict=False, **options)):
                place = {"path": str(path), "snapshot": number}
                found = [*snapshot.findings, _crossings(snapshot)]
                rows += [place | one._asdict() for one in found]
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


def _print(rows: list[dict[str, Any]], summary: dict[str, Any]) -> None:
    place = None
    for row in rows:
        if place != (row["path"], row["snapshot"]):
            place = row["path"], row["snapshot"]
            typer.echo(f"{row['path']}, snapshot {row['snapshot']}")
        text = row["says"] + (f". {row['remedy']}" if row["remedy"] else "")
        typer.echo(f"  {row['severity']:<5}  {row['check']:<13}  {text}")
    found = ", ".join(f"{count} {name}" for name, count in summary["findings"].items())
    typer.echo(f"{summary['snapshots']} snapshots: {found}; verdict: {summary['verdict']}")
