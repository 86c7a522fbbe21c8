"""`grainloops evolve` and `forecast`: a snapshot's packing followed through a programme."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from studies.commands import (
    Answer,
    OneReading,
    PlaneReading,
    Writing,
    answered,
    driven_line,
    spread_words,
)
from studies.questions import (
    FURTHER,
    Cells,
    Damping,
    Driving,
    Evolving,
    Holding,
    Instabilities,
    Replaying,
    Whole,
)

if TYPE_CHECKING:
    from studies.output import Summary

# How the path went on past an instability.
PASSED_WORDS = {
    "dragged": "continued with viscous damping",
    "held": "continued with the contact held",
    "replayed": "continued by the equations of motion",
    "stopped": "ended the path",
    "lost": "where the path ends without a solution",
    "other": "of another kind",
}
FORECAST_WORDS = {"events": "path by events", "replay": "replay"}


def _evolve_lines(summary: Summary) -> list[str]:
    counts = ", ".join(f"{count} {kind}" for kind, count in summary["events"].items())
    lines = [
        driven_line(summary),
        f"{summary['status']} at {summary['driven']} = {summary['reached']:.4g} of "
        f"{summary['to']:g}: {summary['message']}",
        f"{summary['intervals']} intervals, events: {counts or 'none'}",
    ]
    if summary["limit"] is not None:
        told = spread_words(summary["limit_spread"], summary["limit_spread"] is not None)
        lines.append(f"limit at {summary['driven']} = {summary['limit']:.4g}{told}")
    if summary["unstable_contacts"]:
        ways = ", ".join(
            f"{count} {PASSED_WORDS.get(name, name)}" for name, count in summary["passed"].items()
        )
        told = "not computed (use --spread)"
        if summary["stress_spread"] is not None:
            told = f"{100 * summary['stress_spread']:.2g} % of its change"
        lines.append(
            f"{summary['unstable_contacts']} unstable contacts; instabilities: {ways}; spread of "
            f"the stress after the first instability: {told}"
        )
    if summary["replay"] is not None:
        rate = summary["replay"]
        lines.append(f"replay at inertial number {rate['inertial_number']:.2g} ({rate['source']})")
    lines.append(f"end: {_values(summary['end'])}")
    beside = summary["replay"] or {}
    if "end" in beside:
        share, apart = beside["negative_loops"], beside["path_from_replay"]
        lines.append(
            f"end of the replay: {_values(beside['end'])}"
            + ("" if share is None else f"; W2 < 0 in {100 * share:.1f} % of loops")
            + (
                ""
                if apart is None
                else f"; forces of path and replay differ by {apart:.2g} of what the replay changes"
            )
        )
    lines += [
        f"{FORECAST_WORDS[name]}: P{summary['driven'][1:]} misses the DEM by {row['error']:.4g}, "
        f"assuming no change misses by {row['persistence_error']:.4g}, over {row['snapshots']} "
        f"snapshots; below half of that up to {row['holds_to']:.3g}; drops of stress: "
        f"{row['drops_predicted']} of {row['drops']} predicted, {row['drops_false']} false"
        for name, row in (summary["forecast"] or {}).items()
        if row["error"] is not None
    ]
    if summary["negative_loops"] is not None:
        lines.append(
            f"W2 < 0 in {100 * summary['negative_loops']:.1f} % of {summary['loops']} loops"
        )
    return lines


def _values(row: dict[str, float]) -> str:
    return "  ".join(f"{name} = {value:.6g}" for name, value in row.items())


def evolve_command(
    *paths: Annotated[Path, Parameter(required=True)],
    asked: Evolving,
    writing: Writing | None = None,
    replaying: Replaying | None = None,
    holding: Holding | None = None,
    cells: Cells = None,
    animation: Annotated[bool, Parameter(group=FURTHER)] = False,
    reading: PlaneReading | None = None,
) -> Answer:
    """Follow a DEM snapshot through a loading programme: stresses, events, loops.

    Parameters
    ----------
    paths
        Snapshot to start from; further snapshots are plotted for comparison.
    animation
        Animate the loops' second-order work, as GIF.
    """
    return answered(
        *("evolve", paths, _evolve_lines, writing, reading or PlaneReading()),
        *(asked, replaying, holding),
        progress=_reached(asked),
        cells=cells,
        animation=animation,
    )


def _reached(asked: Driving) -> Callable[[float], str]:
    return lambda reached: f"{reached:.3g} of {abs(asked.to):g}"


COUNTED_WORDS = {"opens": "loses a contact", "lost": "lost", "unstable": "W2 < 0"}


def _forecast_lines(summary: Summary) -> list[str]:
    lines = [driven_line(summary)]
    lines += [
        f"{name}: {one['status']} at {summary['driven']} = {one['reached']:.4g} of "
        f"{summary['to']:g}, residual {one['residual']:.1g}: {one['message']}"
        for name, one in summary["ways"].items()
    ]
    for kind, row in summary["kinds"].items():
        told = f"no probabilities for {summary['loops']} loops"
        if row["expected"] is not None:
            told = (
                f"{row['expected']:.1f} of {summary['loops']} loops expected, {row['likely']} "
                f"likely (p > 0.5); base rate {100 * row['base']:.2g} %"
            )
        ways = ("no answer" if row[way] is None else row[way] for way in ("path", "replay"))
        said = "{}; by the path {}, by the replay {}".format(told, *ways)
        lines.append(f"{COUNTED_WORDS[kind]}: {said}")
    for what, one in summary["next"].items():
        told = f"next {what}: found by {one['found']} of {one['ways']} ways"
        if one["found"]:
            told += f", at {summary['driven']} = {one['low']:.4g} to {one['high']:.4g}"
        lines.append(told)
    return lines


def forecast_command(
    path: Path,
    /,
    *,
    asked: Driving,
    writing: Writing | None = None,
    rows: Annotated[Whole, Parameter(group=FURTHER)] = 40,
    instabilities: Instabilities = 1000,
    no_spread: Annotated[bool, Parameter(group=FURTHER, negative="")] = False,
    inertial_number: Annotated[float, Parameter(group=FURTHER)] = 2e-6,
    damping: Damping = 0.3,
    holding: Holding | None = None,
    reading: OneReading | None = None,
) -> Answer:
    """Say which loops of a DEM snapshot will be lost, how likely, and where the stress drops next.

    No later snapshot is needed. Probabilities are frequencies in samples of Yade.

    Parameters
    ----------
    path
        Snapshot with forces, periodic or between known walls.
    rows
        Number of equal steps of the path after which the loops are looked at.
    no_spread
        Skip the repeated paths (half the interval, renumbered grains) that estimate the spread.
    inertial_number
        Inertial number of the replay.
    """
    return answered(
        *("forecast", path, _forecast_lines, writing, reading or OneReading(), asked, holding),
        progress=_reached(asked),
        unanswered=lambda summary: not summary["answered"],
        instabilities=instabilities,
        rows=rows,
        spread=not no_spread,
        inertial_number=inertial_number,
        damping=damping,
    )
