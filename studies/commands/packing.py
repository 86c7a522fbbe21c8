"""`grainloops probe` and `sustain`: the response of a snapshot's packing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from studies.commands import (
    Answer,
    OneReading,
    Sharing,
    Writing,
    answered,
)
from studies.commands.printed import printed
from studies.questions import FURTHER, Holding, Probing, Sustaining

if TYPE_CHECKING:
    from studies.output import Summary

# Folds that one line names at most.
SHOWN_FOLDS = 8


def _probe_lines(summary: Summary) -> list[str]:
    least, angles, control = (
        summary[name] for name in ("solutions_smallest_w2", "folds_deg", "destabilising")
    )
    folds = None
    if len(angles) and {"none", "none found"} & set(summary["statuses"]):
        folds, more = ", ".join(f"{angle:.2f}" for angle in angles[:SHOWN_FOLDS]), len(angles)
        folds += f" and {more - SHOWN_FOLDS} more" if more > SHOWN_FOLDS else ""
    held = None
    if control["status"] == "found":
        held = ", ".join(f"{value:.4f}" for value in control["held"])
    return printed(
        *("probe", summary),
        headline=_unanswered(summary) if summary["undetermined"] else None,
        smaller=least is not None and least < summary["smallest_w2"] - 1e-9,
        folds=folds,
        held_strains=held,
    )


def _unanswered(summary: Summary) -> str:
    """Headline where directions have no answer, with what can be done."""
    count, of = summary["undetermined"], summary["directions"]
    if summary["ended"]:
        nearest = min(summary["ended"], key=lambda one: one["reached"])
        return (
            f"{count} of {of} directions ended before {summary['amplitude']:g}: shares are of the "
            f"others; the first is direction {nearest['direction']}, {nearest['status']} at "
            f"{nearest['reached']:.4g}: {nearest['message']}"
        )
    moves = any("the state moves" in note for note in summary["notes"])
    remedy = (
        "bring the state to rest first with --hold"
        if moves
        else "try another --yield-band, or take a snapshot farther from failure"
    )
    if summary["statuses"].get("none", 0) == count:
        return f"{count} of {of} directions have no solution, proved: shares are of the others"
    if count == of:
        return f"no solution found in any of {of} directions; {remedy}"
    return f"no solution found in {count} of {of} directions: shares are of the others; {remedy}"


def probe_command(
    path: Path,
    /,
    *,
    writing: Writing = Writing(),
    asked: Probing = Probing(),
    holding: Holding = Holding(),
    sharing: Sharing = Sharing(),
    reading: OneReading = OneReading(),
) -> Answer:
    """Probe a DEM snapshot in many directions: response envelope, cones, unstable loops.

    Status of a direction. unique: one solution, proved. one found: one solution, others are
    possible. several: at least two solutions. family: solutions in unbroken rows. none: no solution
    exists, proved. none found: no solution was found. not converged: a mechanism moves. Column
    proof says what each stands on.

    Parameters
    ----------
    path
        File of the snapshot, or of its grains.
    """
    return answered(
        *("probe", path, _probe_lines, writing, reading, asked, holding, sharing),
        progress=lambda done: f"{done} of {asked.directions} directions",
        unanswered=lambda summary: bool(summary["undetermined"] == summary["directions"]),
    )


def _sustain_lines(summary: Summary) -> list[str]:
    own, more = (summary[key] / summary["directions"] for key in ("seconds", "spread_seconds"))
    return printed("sustain", summary, own=own, more=more)


def sustain_command(
    path: Path,
    /,
    *,
    writing: Writing = Writing(),
    asked: Sustaining = Sustaining(),
    no_spread: Annotated[bool, Parameter(group=FURTHER, negative="")] = False,
    hold_stress: Annotated[bool, Parameter(group=FURTHER)] = False,
    sharing: Sharing = Sharing(),
    reading: OneReading = OneReading(),
) -> Answer:
    """Find the load of the first large motion of a DEM snapshot in each direction of stress.

    Parameters
    ----------
    path
        Snapshot with forces, periodic or between known walls.
    no_spread
        Skip the repeated loadings (other numbering, less damping) that estimate the spread.
    hold_stress
        Bring the sample to rest at fixed stress first. Default: at fixed cell.
    """
    kept = "finished directions are kept; the same command computes the others"
    own: Any = {"spread": not no_spread, "hold_stress": hold_stress, "kept": kept}
    return answered("sustain", path, _sustain_lines, writing, reading, asked, sharing, **own)
