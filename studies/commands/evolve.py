"""`grainloops evolve`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from studies.commands.common import NoFigures, runs


def _evolve_lines(summary: dict[str, Any]) -> list[str]:
    counts = ", ".join(f"{count} {kind}" for kind, count in summary["events"].items())
    lines = [
        f"{summary['status']} at {summary['driven']} = {summary['reached']:.4g} of "
        f"{summary['to']:g}: {summary['message']}",
        f"{summary['intervals']} intervals, events: {counts or 'none'}",
    ]
    if summary["unstable_contacts"]:
        passed = ", ".join(f"{count} {name}" for name, count in summary["passed"].items())
        lines.append(f"{summary['unstable_contacts']} unstable contacts, passed: {passed}")
    end = "  ".join(f"{name} = {value:.6g}" for name, value in summary["end"].items())
    lines.append(f"end: {end}")
    if summary["negative_loops"] is not None:
        lines.append(
            f"W2 < 0 in {100 * summary['negative_loops']:.1f} % of {summary['loops']} loops"
        )
    return lines + [f"note: {note}" for note in summary["notes"]]


@runs("studies.evolve.run_evolve", _evolve_lines, "contacts", "frame")
def evolve(
    paths: Annotated[
        list[Path],
        typer.Argument(help="The snapshot to start from; more are laid over as the DEM's own."),
    ],
    to: Annotated[
        float, typer.Option(help="Change of what is driven, negative in extension; 1e-4, say.")
    ],
    programme: Annotated[
        str,
        typer.Option(metavar="drained|isotropic|isotropic-stress|oedometric|undrained"),
    ] = "drained",
    axis: Annotated[int, typer.Option(help="Axis that is driven: 1 or 2.")] = 1,
    rows: Annotated[int, typer.Option(help="Rows of the path, evenly spaced.")] = 20,
    interval: Annotated[
        float, typer.Option(help="Strain in which geometry is constant; halves the error.")
    ] = 5e-6,
    instabilities: Annotated[
        int, typer.Option(help="Stop at so many contacts whose regimes don't agree.")
    ] = 20,
    past: Annotated[
        str, typer.Option(metavar="viscous|dynamic|stop", help="Way past such a contact.")
    ] = "viscous",
    hold: Annotated[
        bool,
        typer.Option(
            "--hold", help="Bring the state to rest first, at fixed cell or between its walls."
        ),
    ] = False,
    hold_stress: Annotated[
        bool, typer.Option("--hold-stress", help="Bring the state to rest at fixed stress.")
    ] = False,
    cells: Annotated[
        Path | None,
        typer.Option(help="Table of cells: snap, h_xx, h_xy, h_yx, h_yy (CSV, Parquet)."),
    ] = None,
    no_figures: NoFigures = False,
    animation: Annotated[
        bool, typer.Option("--animation", help="Draw the loops' work row by row, as a GIF.")
    ] = False,
) -> None:
    """Follow a periodic DEM snapshot from event to event: stresses, events, what loops do."""
