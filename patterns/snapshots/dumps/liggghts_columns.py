"""Where the ids and forces of LIGGGHTS' `pair/gran/local` stand, its columns being unnamed.

The order is fixed whatever the order of the keywords: pos (6), vel (6), id (3: two ids and the
periodic flag), force (3), force_normal (3), force_tangential (3), torque (3), torque_normal (3),
torque_tangential (3), history (as the model), contactArea, delta, heatFlux, contactPoint (3),
ms_id (2); a group left out leaves no gap. So the ids come first, or after 6 or 12 columns, and the
forces follow them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.bodies import index_of
from patterns.snapshots.dumps.dump_files import Atoms
from patterns.snapshots.dumps.dump_geometry import (
    Pairs,
    Space,
    gaps,
    normals,
    pairs_of,
    require_ids,
)
from patterns.snapshots.tables import Table

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Map = dict[str, str]

# Plain names of the columns that a map may give; forces act on atom 1.
CONTACT_NAMES = ("id1", "id2", "fx", "fy", "fnx", "fny", "ftx", "fty", "delta")
NONE = "none"
# Positions, overlaps and directions hold to this share of the radii, or of the force.
TOLERANCE = 1e-3
PRECISE = 1e-6  # overlaps are small: they are told from other columns by more
KNOWN = 0.5  # share of a column that must be ids of grains
REACH = 1.5  # centres of a contact over the sum of the radii


class Contacts(NamedTuple):
    """Columns by plain names, pairs, total force on atom 1 (C, 2) and overlaps (C,) or None."""

    columns: Map
    pairs: Pairs
    force: Floats | None
    overlap: Floats | None


def read_contacts(table: Table, atoms: Atoms, space: Space, given: Map) -> Contacts:
    """Tell ids, forces and overlaps in the columns of `pair/gran/local`.

    Parameters
    ----------
    table : Table
        All columns of the dump in their order.
    atoms : Atoms
        Grains.
    space : Space
        Cell.
    given : dict of str to str
        Plain name to column, 'none' for what the dump lacks; taken instead.

    Returns
    -------
    Contacts
        What was found.

    Raises
    ------
    InputError
        If ids or forces are not where LIGGGHTS writes them, or the columns given don't hold what
        their names say; names the columns to give.
    """
    columns = {name: column for name, column in given.items() if name in CONTACT_NAMES}
    for name, column in columns.items():
        if column != NONE and column not in table.names:
            raise InputError(
                f"--columns {name}={column}",
                f"no such column in {table.path}",
                f"one of {' '.join(table.names)}, or none",
                "Correct the name.",
            )
    first = _find_ids(table, atoms, space, columns)
    pairs = _pairs(table, atoms, space, columns)
    if first >= 6:
        _check_positions(table, atoms, space, pairs, first)
    force = _force(table, pairs, columns, first + 3)
    return Contacts(columns, pairs, force, _overlap(table, atoms, pairs, columns, first + 3))


def _find_ids(table: Table, atoms: Atoms, space: Space, columns: Map) -> int:
    """Add `id1` and `id2` to the map; return how many columns stand before them."""
    if "id1" in columns and "id2" in columns:
        return table.names.index(columns["id1"])
    for first in (0, 6, 12):
        names = table.names[first : first + 3]
        if len(names) < 3 or not _are_ids(table, atoms, names):
            continue
        columns |= {"id1": names[0], "id2": names[1]}
        pairs = _pairs(table, atoms, space, columns)
        reach = atoms.radii[pairs.i] + atoms.radii[pairs.j]
        if np.quantile(np.hypot(*pairs.d.T) / reach, 0.9) <= REACH:
            return first
        del columns["id1"], columns["id2"]
    raise InputError(
        f"{len(table.names)} columns of {table.path}",
        "no ids of grains that touch in column 1, 7 or 13",
        "the order of pair/gran/local: pos, vel, id, force, ... with 'id' among them",
        "Name the columns: --columns id1=COLUMN,id2=COLUMN,fx=COLUMN,fy=COLUMN.",
    )


def _are_ids(table: Table, atoms: Atoms, names: list[str]) -> bool:
    """Whether these are two ids and the periodic flag."""
    one, two, flag = (table.column(name) for name in names)
    for values in (one, two):
        if (np.rint(values) != values).any() or (np.abs(values) > 2.0**53).any():
            return False
        # One unknown id is a fault to tell, a column without known ids holds something else.
        if np.mean(index_of(atoms.ids, values.astype(np.int64)) >= 0) <= KNOWN:
            return False
    return bool(np.isin(flag, (0, 1)).all() and (one != two).all())


def _pairs(table: Table, atoms: Atoms, space: Space, columns: Map) -> Pairs:
    names = (columns["id1"], columns["id2"])
    one, two = (table.integers(name) for name in names)
    return pairs_of(atoms, space, *require_ids(table.path, names, atoms.ids, one, two))


def _check_positions(table: Table, atoms: Atoms, space: Space, pairs: Pairs, first: int) -> None:
    """Compare the positions with the atoms'; six columns before the ids may be velocities."""
    names = table.names
    for x, index in ((table.columns(*names[:2]), pairs.i), (table.columns(*names[3:5]), pairs.j)):
        gap = x - atoms.x[index]
        gap -= space.shift(space.images(gap))
        off = np.hypot(*gap.T) / atoms.radii[index]
        near = np.quantile(off, 0.5) <= 1
        if off.max() > TOLERANCE and (first == 12 or near):
            row = int(np.argmax(off))
            raise InputError(
                f"{table.path}, row {row}",
                f"position {x[row].tolist()}",
                f"{atoms.x[index[row]].tolist()} of grain {atoms.ids[index[row]]} among the atoms",
                "Take both dumps from one step of one run.",
            )


def _force(table: Table, pairs: Pairs, columns: Map, first: int) -> Floats | None:
    """Total force on atom 1, None if there is none."""
    if "fx" not in columns and "fnx" not in columns:
        _find_force(table, pairs, columns, first)
    if NONE in (columns.get("fx"), columns.get("fnx")):
        return None
    _require_all(table, columns)
    if "fx" in columns:
        force = table.columns(columns["fx"], columns["fy"])
        if "fnx" not in columns and "ftx" not in columns:
            return _checked(table, pairs, columns, force)
    normal, shear = (table.columns(columns[f"f{p}x"], columns[f"f{p}y"]) for p in "nt")
    _require_kind(table, pairs, columns, normal, shear)
    return _checked(table, pairs, columns, normal + shear)


def _require_all(table: Table, columns: Map) -> None:
    """Raise `InputError` for half a vector, or half of the force."""
    for group in (("fx", "fy"), ("fnx", "fny", "ftx", "fty")):
        found = [name for name in group if name in columns]
        if found and len(found) < len(group):
            raise InputError(
                f"--columns for the force of {table.path}",
                ", ".join(found),
                f"{', '.join(group)}",
                "Give the others as well.",
            )


def _find_force(table: Table, pairs: Pairs, columns: Map, first: int) -> None:
    """Add the columns of the force to the map, told by their directions."""
    names = table.names
    groups = [names[at : at + 2] for at in (first, first + 3, first + 6) if at + 2 < len(names)]
    vectors = [table.columns(*group) for group in groups]
    if vectors and vectors[0].any() and not _small(table.column(names[first + 2]), vectors[0]):
        raise InputError(
            f"column {names[first + 2]} of {table.path}",
            "a force out of the plane",
            f"zero, after x and y of the force in {' '.join(groups[0])}",
            "The columns are in another order: name them, --columns fx=COLUMN,fy=COLUMN.",
        )
    kinds = [_kind(pairs, vector) for vector in vectors]
    if kinds[:1] == ["oblique"]:
        columns |= {"fx": groups[0][0], "fy": groups[0][1]}
        total = [vectors[0] - vectors[1] - vectors[2]] if len(vectors) == 3 else []
        if total and kinds[1:] == ["along", "across"] and _small(total[0], vectors[0]):
            named = zip(("fnx", "fny", "ftx", "fty"), groups[1] + groups[2], strict=True)
            columns |= dict(named)
    elif sorted(kinds[:2]) == ["across", "along"]:
        groups = sorted(groups[:2], key=lambda group: kinds[groups.index(group)], reverse=True)
        columns |= dict(zip(("fnx", "fny", "ftx", "fty"), groups[0] + groups[1], strict=True))
    elif kinds[:2] == ["along", "along"] and _small(vectors[0] - vectors[1], vectors[0]):
        columns |= {"fx": groups[0][0], "fy": groups[0][1]}
    elif kinds[:1] == ["along"]:
        raise InputError(
            f"columns {' '.join(groups[0])} of {table.path}",
            "vectors along the branches: the whole force between frictionless grains, or its "
            "normal part",
            "the total force",
            f"Say which: --columns fx={groups[0][0]},fy={groups[0][1]}, or fx=none.",
        )
    else:
        columns["fx"] = NONE


def _kind(pairs: Pairs, vector: Floats) -> str:
    """Direction of vectors against the branches: along, across, oblique or zero."""
    n = normals(pairs.d)
    size = np.sqrt(np.sum(vector**2))
    if size == 0:
        return "zero"
    along = np.sqrt(np.sum(np.einsum("ck,ck->c", vector, n) ** 2)) / size
    across = np.sqrt(np.sum((vector[:, 0] * n[:, 1] - vector[:, 1] * n[:, 0]) ** 2)) / size
    return "along" if across <= TOLERANCE else "across" if along <= TOLERANCE else "oblique"


def _small(vector: Floats, scale: Floats) -> bool:
    return bool(np.abs(vector).max() <= TOLERANCE * np.abs(scale).max())


def _require_kind(table: Table, pairs: Pairs, columns: Map, normal: Floats, shear: Floats) -> None:
    for names, vector, expected in (
        (("fnx", "fny"), normal, "along"),
        (("ftx", "fty"), shear, "across"),
    ):
        kind = _kind(pairs, vector)
        if kind not in (expected, "zero"):
            raise InputError(
                f"columns {', '.join(f'{name}={columns[name]}' for name in names)} of {table.path}",
                f"vectors {kind} to the branches of the grains",
                f"vectors {expected} them",
                "Give --columns as the dump was written, and both dumps of one step.",
            )


def _checked(table: Table, pairs: Pairs, columns: Map, force: Floats) -> Floats:
    """Return the force on atom 1, which pushes it away from atom 2 on the whole."""
    if np.sum(force * pairs.d) <= 0:
        return force
    raise InputError(
        f"columns {', '.join(f'{name}={columns[name]}' for name in columns)} of {table.path}",
        "forces that pull the grains together",
        "forces on the first atom that push it away from the second",
        "Name the columns: --columns id1=COLUMN,id2=COLUMN,fx=COLUMN,fy=COLUMN.",
    )


def _overlap(table: Table, atoms: Atoms, pairs: Pairs, columns: Map, first: int) -> Floats | None:
    """Overlaps of the contacts, told by those that cross no border."""
    if columns.get("delta") == NONE:
        return None
    inside = ~pairs.images.any(axis=1)
    expected = -gaps(atoms, pairs)[inside]
    scale = atoms.radii.min()
    for name in [columns["delta"]] if "delta" in columns else table.names[first:]:
        values = table.column(name)
        if len(expected) and np.abs(values[inside] - expected).max() <= PRECISE * scale:
            columns["delta"] = name
            return values
    if "delta" in columns:
        raise InputError(
            f"column delta={columns['delta']} of {table.path}",
            "other values than the overlaps of the grains",
            "the sums of the radii less the distances",
            "Correct the name, or delta=none.",
        )
    return None
