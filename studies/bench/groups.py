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

# Why a default is kept though it is not the knee.
REASONS = {
    "paths": "The scripts and the exact solver know the diamond and this one path; the path solver "
    "takes any graph, law and programme, and finds every event on the way. Its tolerance hardly "
    "changes its time here, so the default is the tightest.",
    "eigenvalues": "On large batches of 3 x 3 operators four sweeps of Jacobi's rotations in numpy "
    "are faster; on a single one LAPACK is, by ten times, and it takes any size. Large snapshots "
    "take compiled rotations (see compiled or plain).",
    "closure switch": "Lower limits cost more time and gain nothing; higher ones lose digits.",
}

# Groups whose settings are sizes of the input, not choices.
SIZES = {
    "batch or one by one": "One by one a loop costs 40 to 100 times more and is as accurate: "
    "functions take batches, and all loops of one order go together.",
    "precision": "Single precision gains little time and loses what `N/l` adds to the "
    "eigenvalues of stiff grains: of an overlap of 1e-7 a digit is left. Double is the default.",
    "compiled or plain": "The compiled way is taken from 200,000 contacts on (`compiled=None`); "
    "below, loading numba costs more than it saves. Both give the same.",
}


def chosen_groups(only: str | None) -> tuple[str, ...]:
    """Names of the groups to run.

    Parameters
    ----------
    only : str, optional
        Names separated by commas; all of them if None.

    Returns
    -------
    tuple of str

    Raises
    ------
    InputError
        For a name that there is not.

    Examples
    --------
    >>> from studies.bench.groups import chosen_groups
    >>> chosen_groups("faces, paths")
    ('faces', 'paths')
    """
    every = (*GROUPS, HARD, SMALLEST)
    names = every if only is None else tuple(name.strip() for name in only.split(","))
    for name in names:
        if name not in every:
            raise InputError("--only", repr(name), f"names from {', '.join(every)}", "Name these.")
    return names


def knee(rows: list[Row]) -> Row:
    """The cheapest row of a group that reaches round-off, or comes near the least error.

    Parameters
    ----------
    rows : list of Row
        Rows of one group.

    Returns
    -------
    Row

    Examples
    --------
    >>> from studies.bench.groups import knee
    >>> from studies.bench.measure import Row
    >>> rows = [Row("g", name, "", 1, time, error, 0.0, "") for name, time, error in
    ...         (("fast", 1.0, 1e-3), ("good", 2.0, 1e-15), ("slow", 9.0, 0.0))]
    >>> knee(rows).method
    'good'
    """
    return min((row for row in rows if reaches(row, rows)), key=lambda row: row.seconds_per_item)


def reaches(row: Row, rows: list[Row]) -> bool:
    """Whether a row's error is rounding, or near the least of its group.

    Parameters
    ----------
    row : Row
        One of them.
    rows : list of Row
        Rows of its group.

    Returns
    -------
    bool
    """
    return row.error <= max(ROUND_OFF, NEAR * min(other.error for other in rows))


def by_group(rows: list[Row]) -> dict[str, list[Row]]:
    """Rows sorted into their groups, in the order met."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.group, []).append(row)
    return found
