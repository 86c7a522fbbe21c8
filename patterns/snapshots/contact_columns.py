"""Forces and contact law from the columns of a table of contacts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from loops import InputError, LinearFrictional, Regime
from loops.laws.frictional import ShearIncrement
from patterns.snapshots.tables import Table

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# A contact without a flag counts as sliding from this share of mu N on, as Yade's own tables do.
SLIDING_SHARE = 0.999


def force_on_second(table: Table, n: Floats, *, frictionless: bool) -> Floats | None:
    """Total force on the second body of every contact, as far as the table tells it.

    A code's shear vector may lean out of the tangent by its own rounding (1e-9 of the force in
    Yade's): the total force keeps that share in `N`.

    Parameters
    ----------
    table : Table
        Contacts.
    n : (C, 2) array
        Their normals, from 1 to 2.
    frictionless : bool
        Whether a normal force alone is the whole force.

    Returns
    -------
    (C, 2) array or None
        Forces, in the table's unit; None if there are none, or normal forces alone.

    Raises
    ------
    InputError
        If a column is missing or holds no finite numbers.
    """
    total = table.optional("fx_on_2", "fy_on_2")
    if total is not None:
        return total
    shear = table.optional("fsx", "fsy")
    if shear is not None:
        return shear + table.column("fn")[:, None] * n
    if table.has("fn") and frictionless:
        return table.column("fn")[:, None] * n
    return None


def law_of(
    table: Table,
    rows: Integers,
    normal: Floats,
    shear: Floats,
    *,
    kn: float | None,
    kt: float | None,
    mu: float | None,
    shear_increment: ShearIncrement,
) -> tuple[LinearFrictional, NDArray[np.int8], tuple[str, ...]]:
    """Law and regime of every contact, and what had to be assumed for them.

    Parameters
    ----------
    table : Table
        Contacts: `kn`, `ks`, `mu`, `sliding`, as far as they are there.
    rows : (C,) array of int
        Rows of the contacts between grains.
    normal, shear : (C,) array
        Their forces.
    kn, kt, mu : float or None
        For the columns that the table lacks.
    shear_increment : {'branch', 'radii'}
        What shear turns by.

    Returns
    -------
    law : LinearFrictional
        Parameters of each contact.
    regime : (C,) array of int8
        `Regime`, sliding where the table flags it, else from the forces.
    notes : tuple of str
        What was assumed.

    Raises
    ------
    InputError
        If a stiffness is neither in the table nor given.
    """
    notes: list[str] = []
    stiffness = [
        _parameter(table, rows, column, value, option, notes)
        for column, value, option in (("kn", kn, "--kn"), ("ks", kt, "--kt"))
    ]
    friction: Floats | None = None
    if table.has("mu") or mu is not None:
        friction = _parameter(table, rows, "mu", mu, "--mu", notes)
    if table.has("sliding"):
        sliding = (table.column("sliding")[rows] != 0) & (normal > 0)
    elif friction is not None:
        sliding = (np.abs(shear) >= SLIDING_SHARE * friction * normal) & (normal > 0)
        notes.append(f"no column 'sliding': sliding where |T| >= {SLIDING_SHARE} mu N")
    else:
        sliding = np.zeros(len(rows), dtype=bool)
        notes.append("neither 'sliding' nor 'mu': every contact is taken as elastic")
    if friction is None:
        # Only the sliding blocks need the friction: |T|/N where the file flags sliding.
        loaded = np.where(normal > 0, normal, 1.0)
        friction = np.where(sliding, np.abs(shear) / loaded, np.inf)
        if sliding.any():
            notes.append("no column 'mu': friction of sliding contacts taken as |T|/N")
    regime = np.where(sliding, Regime.SLIDING, Regime.ELASTIC).astype(np.int8)
    law = LinearFrictional(
        kn=stiffness[0], kt=stiffness[1], mu=friction, shear_increment=shear_increment
    )
    return law, regime, tuple(notes)


def _parameter(
    table: Table, rows: Integers, column: str, value: float | None, option: str, notes: list[str]
) -> Floats:
    if table.has(column):
        if value is not None:
            notes.append(f"{option} {value} not used: the table has the column {column!r}")
        return table.column(column)[rows]
    if value is None:
        raise InputError(
            f"column {column!r} of {table.path}",
            "no such column",
            "the stiffness of each contact",
            f"Add the column, or give {option}.",
        )
    notes.append(f"{column} = {value} for every contact, from {option}")
    return np.full(len(rows), float(value))
