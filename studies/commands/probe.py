"""`grainloops probe`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from studies.commands.common import (
    Answer,
    Hold,
    HoldStress,
    NoFigures,
    OneReading,
    Scheduler,
    Workers,
    Writing,
    YieldBand,
    answer,
    clock,
    out_or,
    shown,
)


def _probe_lines(summary: dict[str, Any]) -> list[str]:
    statuses = ", ".join(f"{count} {name}" for name, count in summary["statuses"].items())
    driven = "H'" if summary["control"] == "strain" else "P'"
    how = (
        f"followed by events to {summary['amplitude']:g}, increments over it; {summary['boundary']}"
        if summary["amplitude"] is not None
        else f"{summary['candidates']} contacts are allowed to slide (yield band "
        f"{summary['yield_band']:g}), {summary['pieces']} different sets of sliding contacts; "
        f"{summary['boundary']}"
    )
    lines = [
        f"{summary['directions']} directions of {driven} ({summary['subspace']}): {statuses}",
        how,
    ]
    if summary["undetermined"]:
        lines.insert(0, _unanswered(summary))
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


def _unanswered(summary: dict[str, Any]) -> str:
    """Headline where directions have no answer, with what can be done."""
    count, of = summary["undetermined"], summary["directions"]
    moves = any("the state moves" in note for note in summary["notes"])
    remedy = (
        "bring the state to rest first with --hold"
        if moves
        else "try another --yield-band, or take a state farther from failure"
    )
    if count == of:
        return f"none of {of} directions is answered; {remedy}"
    return f"{count} of {of} directions are not answered, shares are of the others; {remedy}"


def probe(
    path: Annotated[Path, Parameter(help="File of the snapshot, or of its grains.")],
    /,
    *,
    writing: Writing | None = None,
    directions: Annotated[int, Parameter(help="Number of directions.")] = 72,
    control: Annotated[
        str,
        Parameter(metavar="strain|stress", help="Which increment is prescribed in each direction."),
    ] = "strain",
    subspace: Annotated[
        str,
        Parameter(
            metavar="diagonal|symmetric",
            help="Directions (11, 22) on a circle, or with shear on a sphere.",
        ),
    ] = "diagonal",
    yield_band: YieldBand = 0.99,
    amplitude: Annotated[
        float | None,
        Parameter(help="Finite probe to this strain. Default: infinitesimal."),
    ] = None,
    hold: Hold = False,
    hold_stress: HoldStress = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
    no_figures: NoFigures = False,
    reading: OneReading | None = None,
) -> Answer:
    """Probe a DEM snapshot in many directions: response envelope, cones, unstable loops."""
    writing, reading = writing or Writing(), reading or OneReading()
    out = out_or(writing.out, "probe", path)
    words: Any = {"control": control, "subspace": subspace}
    with clock("grainloops probe"):
        from studies.probe import run_probe

        summary = run_probe(
            path,
            out,
            directions=directions,
            **words,
            yield_band=yield_band,
            amplitude=amplitude,
            hold=hold,
            hold_stress=hold_stress,
            workers=workers,
            scheduler=scheduler,
            figures=not no_figures,
            **writing.files(),
            **reading.how(),
        )
    said = answer(writing.json, out, _probe_lines(summary))
    # The question found no answer at all.
    return replace(said, status=int(summary["undetermined"] == summary["directions"]))
