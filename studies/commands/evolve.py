"""`grainloops evolve`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from studies.commands.common import (
    Answer,
    Cells,
    Hold,
    HoldStress,
    NoFigures,
    PlaneReading,
    Writing,
    answer,
    clock,
    out_or,
)

# How the path went on past an instability.
WAYS = {
    "dragged": "continued with viscous damping",
    "held": "continued with the contact held",
    "replayed": "continued by the equations of motion",
    "stopped": "ended the path",
    "lost": "without a way past",
    "other": "of another kind",
}


def _evolve_lines(summary: dict[str, Any]) -> list[str]:
    counts = ", ".join(f"{count} {kind}" for kind, count in summary["events"].items())
    lines = [
        f"{summary['status']} at {summary['driven']} = {summary['reached']:.4g} of "
        f"{summary['to']:g}: {summary['message']}",
        f"{summary['intervals']} intervals, events: {counts or 'none'}",
    ]
    if summary["unstable_contacts"]:
        ways = ", ".join(
            f"{count} {WAYS.get(name, name)}" for name, count in summary["passed"].items()
        )
        lines.append(f"{summary['unstable_contacts']} unstable contacts; instabilities: {ways}")
    end = "  ".join(f"{name} = {value:.6g}" for name, value in summary["end"].items())
    lines.append(f"end: {end}")
    if summary["negative_loops"] is not None:
        lines.append(
            f"W2 < 0 in {100 * summary['negative_loops']:.1f} % of {summary['loops']} loops"
        )
    return lines + [f"note: {note}" for note in summary["notes"]]


def evolve(
    *paths: Annotated[
        Path,
        Parameter(
            required=True,
            help="Snapshot to start from; further snapshots are plotted for comparison.",
        ),
    ],
    writing: Writing | None = None,
    to: Annotated[
        float,
        Parameter(help="Change of the driven strain or stress, negative in extension; say 1e-4."),
    ],
    programme: Annotated[
        str,
        Parameter(
            metavar="NAME",
            help="Loading programme: drained, isotropic, isotropic-stress, oedometric, undrained.",
        ),
    ] = "drained",
    axis: Annotated[int, Parameter(help="Driven axis: 1 or 2.")] = 1,
    rows: Annotated[int, Parameter(help="Rows of the path, evenly spaced.")] = 20,
    interval: Annotated[
        float,
        Parameter(help="Strain over which the geometry is kept; the error is proportional to it."),
    ] = 5e-6,
    instabilities: Annotated[int, Parameter(help="Stop after this many unstable contacts.")] = 20,
    past: Annotated[
        str,
        Parameter(
            metavar="viscous|dynamic|stop",
            help="How the path continues past an unstable contact.",
        ),
    ] = "viscous",
    hold: Hold = False,
    hold_stress: HoldStress = False,
    cells: Cells = None,
    no_figures: NoFigures = False,
    animation: Annotated[
        bool, Parameter(help="Draw the second-order work of the loops row by row, as GIF.")
    ] = False,
    reading: PlaneReading | None = None,
) -> Answer:
    """Follow a DEM snapshot from event to event: stresses, events, second-order work of loops."""
    writing, reading = writing or Writing(), reading or PlaneReading()
    out = out_or(writing.out, "evolve", paths[0])
    words: Any = {"programme": programme, "past": past}
    with clock("grainloops evolve") as tell:
        from studies.evolve import run_evolve

        summary = run_evolve(
            paths,
            out,
            to=to,
            **words,
            axis=axis,
            rows=rows,
            interval=interval,
            instabilities=instabilities,
            hold=hold,
            hold_stress=hold_stress,
            cells=cells,
            figures=not no_figures,
            animation=animation,
            progress=lambda reached: tell(f"{reached:.3g} of {abs(to):g}"),
            **writing.files(),
            **reading.how(),
        )
    return answer(writing.json, out, _evolve_lines(summary))
