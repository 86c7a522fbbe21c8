"""`grainloops probe`, `sustain`, `evolve`, `forecast` and `material`: the packing of a snapshot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from loops.errors import InputError
from studies.clock import clock, of_parts
from studies.commands import (
    Answer,
    OneReading,
    PlaneReading,
    Sharing,
    Writing,
    answer,
    answered,
    driven_line,
    flags,
    numbers,
    out_or,
    printed,
)
from studies.questions import (
    FURTHER,
    Averaging,
    Cells,
    Damping,
    Driving,
    Evolving,
    Holding,
    Instabilities,
    Probing,
    Replaying,
    Sustaining,
    Whole,
)

if TYPE_CHECKING:
    from studies.output import Summary

# Folds that one line names at most.
SHOWN_FOLDS = 8
# Options of a loop that is made, and of a snapshot's.
OF_LOOP = ("order", "alpha0_deg", "orientations", "kappa", "phi_deg", "confine")
OF_SNAPSHOT = ("orders", "count")


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
    count, of = summary["undetermined"], summary["directions"]
    nearest = min(summary["ended"], key=lambda one: one["reached"], default=None)
    proved = summary["statuses"].get("none", 0) == count
    moves = any("the state moves" in note for note in summary["notes"])
    smaller = least is not None and least < summary["smallest_w2"] - 1e-9
    told = {"smaller": smaller, "folds": folds, "held_strains": held, "moves": moves}
    told |= {"nearest": nearest if count else None, "proved": count and proved and not nearest}
    told["sought"] = count and not proved and not nearest and {"all": count == of}
    return printed("probe", summary, **told)


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
        progress=lambda tell: lambda done: tell(f"{done} of {asked.directions} directions"),
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
    parts = partial(of_parts, what="directions")
    groups = writing, reading, asked, sharing
    return answered("sustain", path, _sustain_lines, *groups, progress=parts, **own)


def _lines(command: str, summary: Summary) -> list[str]:
    return printed(command, summary, driven_line=driven_line(summary))


def evolve_command(
    *paths: Annotated[Path, Parameter(required=True)],
    asked: Evolving,
    writing: Writing = Writing(),
    replaying: Replaying = Replaying(),
    holding: Holding = Holding(),
    cells: Cells = None,
    regions: Annotated[str | None, Parameter(group=FURTHER, metavar="COLUMN>VALUE")] = None,
    animation: Annotated[bool, Parameter(group=FURTHER)] = False,
    reading: PlaneReading = PlaneReading(),
) -> Answer:
    """Follow a DEM snapshot through a loading programme: stresses, events, loops.

    Parameters
    ----------
    paths
        Snapshot to start from; further snapshots are plotted for comparison.
    regions
        Compare loops inside with all others.
    animation
        Animate the loops' second-order work, as GIF.
    """
    return answered(
        *("evolve", paths, partial(_lines, "evolve"), writing, reading),
        *(asked, replaying, holding),
        progress=_reached(asked),
        cells=cells,
        regions=regions,
        animation=animation,
    )


def _reached(asked: Driving) -> Callable[[Any], Callable[[float], None]]:
    return lambda tell: lambda reached: tell(f"{reached:.3g} of {asked.length:g}")


def forecast_command(
    path: Path,
    /,
    *,
    asked: Driving,
    writing: Writing = Writing(),
    rows: Annotated[Whole, Parameter(group=FURTHER)] = 40,
    instabilities: Instabilities = 1000,
    no_spread: Annotated[bool, Parameter(group=FURTHER, negative="")] = False,
    inertial_number: Annotated[float, Parameter(group=FURTHER)] = 2e-6,
    damping: Damping = 0.3,
    holding: Holding = Holding(),
    reading: OneReading = OneReading(),
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
        *("forecast", path, partial(_lines, "forecast"), writing, reading, asked, holding),
        progress=_reached(asked),
        unanswered=lambda summary: not summary["answered"],
        instabilities=instabilities,
        rows=rows,
        spread=not no_spread,
        inertial_number=inertial_number,
        damping=damping,
    )


def material_command(
    snapshot: Path | None = None,
    *,
    asked: Averaging = Averaging(),
    writing: Writing = Writing(),
    reading: OneReading = OneReading(),
) -> Answer:
    """Average loops as a material, and march the mean through a programme.

    Copies of one loop (--order) in all directions, or the loops of a snapshot; beside them one of
    the loops alone.

    Parameters
    ----------
    snapshot
        Snapshot whose loops are averaged, with its law and forces.
    """
    given = {name: value for name, value in asdict(asked).items() if value is not None}
    of_loop, of_snapshot = ([n for n in names if n in given] for names in (OF_LOOP, OF_SNAPSHOT))
    if snapshot is not None and of_loop:
        expected = "none of these: loops of a snapshot have their own law and state"
        raise InputError(flags(of_loop), "given with a snapshot", expected, "Leave them out.")
    if snapshot is None and (read := flags([*reading.given(), *of_snapshot])):
        raise InputError(read, "given without a snapshot", "a snapshot", "Name its file.")
    listed = numbers("--orders", given.pop("orders", None))
    if listed is not None:
        given["orders"] = tuple(int(n) if n == int(n) else n for n in listed)
    given.setdefault("end", 1e-1 if snapshot is None else 1e-3)
    out = out_or(writing.out, "material", snapshot)
    with clock("grainloops material"):
        from studies.material import MaterialOptions, run_material

        how = {} if snapshot is None else reading.how_of(snapshot)
        options = MaterialOptions(**given)
        summary = run_material(options, out, snapshot=snapshot, **writing.files(), **how)
    sets = {"mean of the loops": summary["mean"]}
    sets[f"loop {summary['loop']} alone"] = summary["single"]
    driven = None if snapshot is None else driven_line(summary)
    lines = printed("material", summary, driven_line=driven, sets=sets)
    return answer(writing.json, out, lines, summary["notes"])
