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
    shown,
    spread_words,
)
from studies.questions import FURTHER, Holding, Probing, Sustaining

if TYPE_CHECKING:
    from studies.output import Summary

STATUS_WORDS = {
    "unique": "one solution (proved)",
    "one found": "one solution found",
    "several": "several solutions",
    "family": "a line of solutions or more",
    "none": "no solution (proved)",
    "none found": "no solution found",
    "not converged": "not converged",
    "nearest": "nearest regimes (contacts that soften are kept from sliding)",
}
BY_WORDS = {"events": "followed from event to event", "increment": "each in one solve"}

# Folds that one line names at most.
SHOWN_FOLDS = 8


def _probe_lines(summary: Summary) -> list[str]:
    statuses = ", ".join(
        f"{STATUS_WORDS.get(name, name)}: {count}" for name, count in summary["statuses"].items()
    )
    driven = "H'" if summary["control"] == "strain" else "P'"
    how = (
        f"{BY_WORDS[summary['by']]} up to {summary['amplitude']:g}; numbers are increments over "
        f"it; boundary: {summary['boundary']}"
        if summary["amplitude"] is not None
        else f"{summary['candidates']} contacts are allowed to slide (yield band "
        f"{summary['yield_band']:g}), {summary['pieces']} different sets of sliding contacts; "
        f"boundary: {summary['boundary']}"
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
    least = summary["solutions_smallest_w2"]
    if least is not None and least < summary["smallest_w2"] - 1e-9:
        lines.append(
            f"of all {summary['solutions']} solutions the smallest w2 is {least:.4f} at "
            f"{summary['solutions_softest_theta_deg']:.1f} degrees; W2 < 0 in one at least of "
            f"{summary['solutions_unstable_directions']} directions"
        )
    if len(summary["folds_deg"]) and {"none", "none found"} & set(summary["statuses"]):
        folds = ", ".join(f"{angle:.2f}" for angle in summary["folds_deg"][:SHOWN_FOLDS])
        more = len(summary["folds_deg"]) - SHOWN_FOLDS
        lines.append(
            f"solutions turn back at {folds}"
            + (f" and {more} more" if more > 0 else "")
            + " degrees"
        )
    lines += [
        f"cone from {cone['begin_deg']:.2f} to {cone['end_deg']:.2f} degrees"
        + ("" if all(cone["refined"]) else " (one end is known only to the next direction)")
        for cone in summary["cones"]
    ]
    control = summary["destabilising"]
    if control["status"] == "found":
        held = ", ".join(f"{value:.4f}" for value in control["held"])
        lines.append(
            f"the sample loses its strength if this combination of strains is held constant: {held}"
        )
    if summary["orders"]:
        lines.append(
            "softest direction, by order of the loops: share of W2, share of its negative part"
        )
        lines += [
            f"  {order:>3}  {shown(row['W2_share']):>7}  {shown(row['negative_share']):>7}"
            for order, row in summary["orders"].items()
            if row["loops"]
        ]
    return lines


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
    writing: Writing | None = None,
    asked: Probing | None = None,
    holding: Holding | None = None,
    sharing: Sharing | None = None,
    reading: OneReading | None = None,
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
    asked = asked or Probing()
    groups = writing, reading or OneReading(), asked, holding, sharing
    return answered(
        *("probe", path, _probe_lines, *groups),
        progress=lambda done: f"{done} of {asked.directions} directions",
        unanswered=lambda summary: bool(summary["undetermined"] == summary["directions"]),
    )


def _sustain_lines(summary: Summary) -> list[str]:
    statuses = ", ".join(f"{count} {name}" for name, count in summary["statuses"].items())
    lines = [
        f"{summary['directions']} directions of the stress rate ({summary['subspace']}), load up "
        f"to {summary['largest']:.4g}: {statuses}"
    ]
    weakest = summary["weakest"]
    if weakest is None:
        lines.append("the equilibrium was lost in no direction")
    elif weakest["first_large_load"] is not None:
        lines.append(
            f"weakest direction {weakest['theta_deg']:.1f} degrees: first large motion by "
            f"{weakest['first_large_strain']:.2g} at an added load of "
            f"{weakest['first_large_load']:.4g}{spread_words(weakest['first_large_spread'])}"
        )
        lines.append(
            f"first loss of equilibrium in this direction: {weakest['limit']:.4g}"
            f"{spread_words(weakest['limit_spread'], weakest['limit_converged'])}"
        )
    else:
        lines.append(
            "no large motion; the smallest load at which the equilibrium was lost: "
            f"{weakest['limit']:.4g}, at {weakest['theta_deg']:.1f} degrees"
            f"{spread_words(weakest['limit_spread'], weakest['limit_converged'])}"
        )
    own, more = (summary[key] / summary["directions"] for key in ("seconds", "spread_seconds"))
    lines.append(f"processor time a direction: {own:.2g} s, {more:.2g} s more for its spreads")
    return lines


def sustain_command(
    path: Path,
    /,
    *,
    writing: Writing | None = None,
    asked: Sustaining | None = None,
    no_spread: Annotated[bool, Parameter(group=FURTHER, negative="")] = False,
    hold_stress: Annotated[bool, Parameter(group=FURTHER)] = False,
    sharing: Sharing | None = None,
    reading: OneReading | None = None,
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
    groups = writing, reading or OneReading(), asked, sharing
    own: Any = {"spread": not no_spread, "hold_stress": hold_stress}
    return answered("sustain", path, _sustain_lines, *groups, kept=kept, **own)
