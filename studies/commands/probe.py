"""`grainloops probe`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from studies.commands.common import (
    NoFigures,
    Scheduler,
    Workers,
    YieldBand,
    runs,
    shown,
)


def _probe_lines(summary: dict[str, Any]) -> list[str]:
    statuses = ", ".join(f"{count} {name}" for name, count in summary["statuses"].items())
    driven = "H'" if summary["control"] == "strain" else "P'"
    how = (
        f"followed by events to {summary['amplitude']:g}, increments over it; {summary['boundary']}"
        if summary["amplitude"] is not None
        else f"{summary['candidates']} contacts may slide (yield band {summary['yield_band']:g}), "
        f"{summary['pieces']} pieces met; {summary['boundary']}"
    )
    lines = [
        f"{summary['directions']} directions of {driven} ({summary['subspace']}): {statuses}",
        how,
    ]
    if summary["smallest_w2"] is not None:
        lines.append(
            f"smallest w2 {summary['smallest_w2']:.4f} at {summary['softest_theta_deg']:.1f} "
            f"degrees; W2 < 0 in {100 * summary['unstable_fraction']:.2f} % of directions"
        )
    lines += [
        f"cone from {cone['begin_deg']:.2f} to {cone['end_deg']:.2f} degrees"
        + ("" if all(cone["refined"]) else " (an end is not sharp)")
        for cone in summary["cones"]
    ]
    if summary["undetermined"]:
        lines.append(f"W2 undetermined in {summary['undetermined']} directions")
    control = summary["destabilising"]
    if control["status"] == "found":
        held = ", ".join(f"{value:.4f}" for value in control["held"])
        lines.append(f"loses its strength when this combination of strains is held: {held}")
    if summary["orders"]:
        lines.append("softest direction, loops by order: share of W2, of its negative part")
        lines += [
            f"  {order:>3}  {shown(row['W2_share']):>7}  {shown(row['negative_share']):>7}"
            for order, row in summary["orders"].items()
            if row["loops"]
        ]
    return lines + [f"note: {note}" for note in summary["notes"]]


@runs("studies.probe.run_probe", _probe_lines)
def probe(
    path: Annotated[Path, typer.Argument(help="The file, or that of the grains.")],
    directions: Annotated[int, typer.Option(help="Number of directions.")] = 72,
    control: Annotated[
        str, typer.Option(metavar="strain|stress", help="What runs over the unit circle.")
    ] = "strain",
    subspace: Annotated[
        str,
        typer.Option(
            metavar="diagonal|symmetric", help="(11, 22) on a circle, or with shear on a sphere."
        ),
    ] = "diagonal",
    yield_band: YieldBand = 0.99,
    amplitude: Annotated[
        float | None,
        typer.Option(help="Follow each direction by events to this strain; else rates alone."),
    ] = None,
    hold: Annotated[
        bool,
        typer.Option(
            "--hold", help="Bring the state to rest first, at fixed cell or between its walls."
        ),
    ] = False,
    hold_stress: Annotated[
        bool, typer.Option("--hold-stress", help="Bring the state to rest at fixed stress.")
    ] = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    no_figures: NoFigures = False,
) -> None:
    """Probe a DEM snapshot along many directions: response envelope, cones, who is unstable."""
