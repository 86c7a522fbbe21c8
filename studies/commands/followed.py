"""`grainloops evolve` and `forecast`: a snapshot's packing followed through a programme."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
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
)
from studies.commands.printed import printed
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


def _lines(command: str, summary: Summary) -> list[str]:
    return printed(command, summary, driven_line=driven_line(summary))


def evolve_command(
    *paths: Annotated[Path, Parameter(required=True)],
    asked: Evolving,
    writing: Writing = Writing(),
    replaying: Replaying = Replaying(),
    holding: Holding = Holding(),
    cells: Cells = None,
    animation: Annotated[bool, Parameter(group=FURTHER)] = False,
    reading: PlaneReading = PlaneReading(),
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
        *("evolve", paths, partial(_lines, "evolve"), writing, reading),
        *(asked, replaying, holding),
        progress=_reached(asked),
        cells=cells,
        animation=animation,
    )


def _reached(asked: Driving) -> Callable[[float], str]:
    return lambda reached: f"{reached:.3g} of {asked.length:g}"


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
