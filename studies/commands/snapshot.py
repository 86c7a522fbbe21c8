"""`grainloops snapshot`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from studies.commands.common import (
    Columns,
    Csv,
    DropCrossings,
    Force,
    Format,
    Json,
    Kn,
    Kt,
    Mu,
    Out,
    cell_of,
    columns_of,
    report,
    shown,
)

# Loop orders from this one on are printed together.
LAST_SHOWN = 7


def register(app: typer.Typer) -> None:
    """Add the command to the application."""
    app.command()(snapshot)


def snapshot(
    path: Annotated[Path, typer.Argument(help="The file, or that of the grains.")],
    out: Out,
    contacts: Annotated[
        Path | None, typer.Option(help="File of contacts; found beside PATH by its name.")
    ] = None,
    cell: Annotated[
        str | None,
        typer.Option(metavar="HXX,HXY,HYX,HYY", help="Periodic cell; columns are its vectors."),
    ] = None,
    kn: Kn = None,
    kt: Kt = None,
    mu: Mu = None,
    format: Format = "auto",
    columns: Columns = None,
    frame: Annotated[
        int | None, typer.Option(help="Instant of a file with several: 0 the first, -1 the last.")
    ] = None,
    drop_crossings: DropCrossings = False,
    no_figures: Annotated[
        bool, typer.Option("--no-figures", help="Tables and summary alone, no figures, no report.")
    ] = False,
    vtk: Annotated[bool, typer.Option("--vtk", help="Write loops.vtp for ParaView.")] = False,
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
) -> None:
    """Find the loops of a DEM snapshot and judge the stability of each."""
    from studies.snapshot import SnapshotInput, run_snapshot

    source = SnapshotInput(
        path,
        contacts,
        cell_of(cell),
        kn,
        kt,
        mu,
        format,
        columns_of(columns),
        frame,
        drop_crossings,
    )
    summary = run_snapshot(source, out, force=force, csv=csv, figures=not no_figures, paraview=vtk)
    report(summary, out, json, _snapshot_lines)


def _snapshot_lines(summary: dict[str, Any]) -> list[str]:
    orders = "  ".join(f"{n}: {count:.0f}" for n, count in _grouped(summary, None).items())
    lines = [
        f"{summary['grains']} grains, {summary['contacts']} contacts, "
        f"coordination {summary['coordination']:.3f} without {summary['dangling_grains']} dangling",
        f"{summary['loops']} loops, mean order {shown(summary['mean_order'])} ({orders})",
        f"Euler's formula {'holds' if summary['euler_ok'] else 'FAILS'}",
    ]
    if "sliding_fraction" in summary:
        lines.append(f"{100 * summary['sliding_fraction']:.1f} % of the contacts slide")
    for closure, shares in summary.get("unstable_fraction", {}).items():
        unstable = _grouped(summary, shares)
        text = "  ".join(f"{n}: {100 * share:.2g} %" for n, share in unstable.items())
        lines.append(f"unstable loops by order, {closure}: {text}")
    return lines + [f"note: {note}" for note in summary["notes"]]


def _grouped(summary: dict[str, Any], shares: dict[str, float] | None) -> dict[str, float]:
    """Loops of orders 3 to 6 and beyond; with shares, their mean over the loops of each group."""
    counts: dict[str, float] = {}
    sums: dict[str, float] = {}
    for n, count in summary["orders"].items():
        group = n if int(n) < LAST_SHOWN else f"{LAST_SHOWN}+"
        counts[group] = counts.get(group, 0) + count
        sums[group] = sums.get(group, 0.0) + count * (0.0 if shares is None else shares[n])
    if shares is None:
        return counts
    return {group: sums[group] / counts[group] for group in counts}
