"""The groups of the bench by name, and the knee of each."""

from __future__ import annotations

from collections.abc import Callable

from loops import InputError
from studies.bench.batches import batch_sizes, compiled_modes, precisions
from studies.bench.closures import closure_methods
from studies.bench.directions import direction_methods
from studies.bench.eigenvalues import eigenvalue_methods
from studies.bench.faces import compiled_faces, face_methods
from studies.bench.fractions import fraction_methods
from studies.bench.measure import Row
from studies.bench.paths import path_methods

HARD, SMALLEST = "hard-cases", "smallest-model"
GROUPS: dict[str, tuple[Callable[[bool], list[Row]], ...]] = {
    "paths": (path_methods,),
    "closures": (closure_methods,),
    "eigenvalues": (eigenvalue_methods,),
    "fractions": (fraction_methods,),
    "directions": (direction_methods,),
    "faces": (face_methods,),
    "batches": (batch_sizes,),
    "precision": (precisions,),
    "compiled": (compiled_faces, compiled_modes),
}
# Below this an error is rounding: methods that reach it are told apart by their time alone.
ROUND_OFF = 1e-14
# Where none does, this many times the least error counts as reaching it.
NEAR = 10.0


def chosen_groups(only: str | None) -> tuple[str, ...]:
    """Names of the groups to run."""
    every = (*GROUPS, HARD, SMALLEST)
    names = every if only is None else tuple(name.strip() for name in only.split(","))
    for name in names:
        if name not in every:
            raise InputError("--only", repr(name), f"names from {', '.join(every)}", "Name these.")
    return names


def knee(rows: list[Row]) -> Row:
    """The cheapest row of a group that reaches round-off, or comes near the least error."""
    return min((row for row in rows if reaches(row, rows)), key=lambda row: row.seconds_per_item)


def reaches(row: Row, rows: list[Row]) -> bool:
    """Whether a row's error is rounding, or near the least of its group."""
    return row.error <= max(ROUND_OFF, NEAR * min(other.error for other in rows))
