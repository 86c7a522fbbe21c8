"""Dumps of LIGGGHTS: atoms by `dump custom`, their contacts by `dump local`."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np

from loops import InputError
from loops.arrays import Flags, Floats
from loops.errors import counted
from patterns.snapshots.columns import NONE, check_names, components, names_beside
from patterns.snapshots.dump_files import (
    ATOM_NAMES,
    Atoms,
    DumpFrame,
    FoundContacts,
    Map,
    find_ids,
    frame_at,
    frames_of_dumps,
    given_columns,
    is_dump,
)
from patterns.snapshots.files import beside, head_of
from patterns.snapshots.frame import Frames
from patterns.snapshots.geometry import Contacts
from patterns.snapshots.lammps import TOLERANCE, shares
from patterns.snapshots.source import Source
from patterns.snapshots.tables import Table

# Headers of LIGGGHTS give this many digits: the cell is known to 1e-6 of its size.
COARSE = 9
CELL_STEPS = 5  # steps of Newton's method for the cell; two are enough
# Overlaps must fit the cell to this share of its size, better than the header.
FIT = 1e-7
PRECISE = 1e-6  # tolerance of overlaps, which are small: other columns may be nearly the same
# Columns of `pair/gran/local` have no names but a fixed order, whatever the order of the keywords:
# pos (6), vel (6), id (3: two ids and the periodic flag), force (3), force_normal (3),
# force_tangential (3), torque (3), torque_normal (3), torque_tangential (3), history (as the
# model), contactArea, delta, heatFlux, contactPoint (3), ms_id (2); a group left out leaves no gap.
# So the ids come first, or after 6 or 12 columns, and the forces follow them.
LIGGGHTS_NAMES = ("id1", "id2", "fx", "fy", "fnx", "fny", "ftx", "fty", "delta")
FORCE_PARTS = ("fnx", "fny", "ftx", "fty")  # parts of the force on atom 1; fx, fy is the total


def is_liggghts(path: Path, head: bytes) -> bool:
    """Whether the dump of contacts has the numbered columns of one compute, as LIGGGHTS writes."""
    if not is_dump(head):
        return False
    contacts = beside(path, *names_beside(path, "contacts"))
    if contacts is None:
        return False
    try:
        names = frame_at(contacts, head_of(contacts)).names
    except InputError:
        return False
    stem = "".join(names[:1]).rpartition("[")[0]
    return len(names) >= 3 and {*names} == {f"{stem}[{k + 1}]" for k in range(len(names))}


def liggghts_frames(source: Source) -> Frames:
    """Frames of a dump of atoms with all columns of `compute pair/gran/local` (docs/lammps.md).

    The columns of the forces are recognised by their directions, or given by a map of
    `LIGGGHTS_NAMES`. Headers have six digits: the cell is found from the overlaps of the contacts
    that cross its border.
    """
    check_names(source.columns, (*ATOM_NAMES, *LIGGGHTS_NAMES))

    def find(table: Table, atoms: Atoms, frame: DumpFrame, source: Source) -> FoundContacts:
        columns = given_columns(table, source.columns, LIGGGHTS_NAMES)
        contacts, first = recognised_pairs(table, atoms, columns)
        force = _force(table, atoms.axes, contacts.n, columns, first + 3)
        overlap = _overlap(table, contacts, columns, first + 3)
        shown = ", ".join(f"{name}={column}" for name, column in columns.items() if column != NONE)
        notes = [f"columns in the order of pair/gran/local: {shown}"]
        box = frame.box
        if box is not None and box.digits < COARSE and source.cell is None and any(atoms.periodic):
            atoms, contacts, note = finer_cell(atoms, contacts, overlap)
            notes.append(note)
        forces = {} if force is None else components("f@_on_2", -force)
        return FoundContacts(atoms, contacts, forces, tuple(notes))

    return frames_of_dumps(source, find)


def finer_cell(
    atoms: Atoms, contacts: Contacts, overlap: Floats | None
) -> tuple[Atoms, Contacts, str]:
    """Atoms and contacts with the edges of a rectangular cell from the overlaps across its border.

    Centres of a contact with images are `r1 + r2 - delta` apart: least squares for the lengths of
    the edges, by Newton's method from those of the header.
    """
    coarse = "cell from a header of six digits: branches across its border are as coarse"
    across, cell = np.flatnonzero(_crosses(contacts)), atoms.cell
    if cell is None or overlap is None or len(across) == 0 or cell[0, 1] or cell[1, 0]:
        return atoms, contacts, f"{coarse}; give --cell or dump delta"
    images = contacts.images[across]  # type: ignore[index]
    raw, edges = contacts.d[across] - images @ cell.T, np.diag(cell).copy()
    length = (contacts.length + contacts.overlap - overlap)[across]
    # An edge that no contact crosses stays as it is.
    crossed = images.any(axis=0)
    for _ in range(CELL_STEPS):
        d = raw + images * edges
        distance = np.hypot(*d.T)
        slope = (d / np.where(distance > 0, distance, 1.0)[:, None] * images)[:, crossed]
        edges[crossed] += np.linalg.lstsq(slope, length - distance, rcond=None)[0]
    misfit = np.abs(np.hypot(*(raw + images * edges).T) - length).max()
    change = np.abs(edges / np.diag(cell) - 1).max()
    if misfit > FIT * edges.max() or change > 1e-5:
        note = f"{coarse}; overlaps don't fit it better ({misfit:.2g}); give --cell"
        return atoms, contacts, note
    note = (
        f"cell {edges.tolist()} from the overlaps of {counted(len(across), 'contact')} across "
        f"its border, which it fits to {misfit:.1g}: the header has six digits"
    )
    atoms = atoms._replace(cell=np.diag(edges))
    return atoms, atoms.contacts(contacts.table.path, contacts.pairs, contacts.d), note


def _crosses(contacts: Contacts) -> Flags:
    """(C,) whether a contact crosses the border of the cell."""
    images = contacts.images
    return np.zeros(len(contacts.d), bool) if images is None else np.asarray(images.any(axis=1))


def recognised_pairs(table: Table, atoms: Atoms, columns: Map) -> tuple[Contacts, int]:
    """Contacts by their ids among the columns of `pair/gran/local`, and the place of these."""
    # The flag of the periodic border follows the ids.
    places = [names for at in (0, 6, 12) if len(names := table.names[at : at + 3]) == 3]
    choices = [(a, b) for a, b, flag in places if np.isin(table.column(flag), (0, 1)).all()]
    if "id1" in columns and "id2" in columns:
        choices = [(columns["id1"], columns["id2"])]
    expected = (
        "ids in column 1, 7 or 13, the order of pair/gran/local: pos, vel, id, force, ... with "
        "'id' among them"
    )
    pairs = find_ids(table, atoms, columns, choices, expected, ",fx=COLUMN,fy=COLUMN")
    first, bodies = table.names.index(columns["id1"]), atoms.bodies
    # Positions of both grains stand first, if velocities don't: these are the atoms' to rounding.
    ends = zip((0, 3), pairs.T, strict=True) if first >= 6 else ()
    for at, index in ends:
        x = table.columns(*(table.names[at + k] for k in atoms.axes))
        off = np.hypot(*atoms.nearest(x - bodies.x[index]).T) / bodies.radii[index]
        near = np.quantile(off, 0.5) <= 1
        if off.max() > TOLERANCE and (first == 12 or near):
            row = int(np.argmax(off))
            raise InputError(
                f"{table.path}, row {row}",
                f"position {x[row].tolist()}",
                f"{bodies.x[index[row]].tolist()} of grain {bodies.ids[index[row]]} among the "
                "atoms",
                "Take both dumps from one step of one run.",
            )
    return atoms.contacts(table.path, pairs), first


def _force(table: Table, axes: list[int], n: Floats, columns: Map, first: int) -> Floats | None:
    """Total force on atom 1, None if there is none."""
    if "fx" not in columns and "fnx" not in columns:
        _find_force(table, axes, n, columns, first)
    if NONE in (columns.get("fx"), columns.get("fnx")):
        return None
    names = FORCE_PARTS if "fnx" in columns else ("fx", "fy")
    if not {*names} <= {*columns}:
        received = ", ".join(name for name in names if name in columns)
        where, remedy = f"--columns for the force of {table.path}", "Give the others as well."
        raise InputError(where, received, ", ".join(names), remedy)
    vectors = table.columns(*(columns[name] for name in names))
    return np.asarray(vectors.reshape(len(table), -1, 2).sum(axis=1))


def _find_force(table: Table, axes: list[int], n: Floats, columns: Map, first: int) -> None:
    """Add the columns of the force to the map, recognised by their directions."""
    names, across = table.names, first + 3 - sum(axes)
    places = [at for at in (first, first + 3, first + 6) if at + 2 < len(names)]
    groups = [[names[at + k] for k in axes] for at in places]
    vectors = [table.columns(*group) for group in groups]
    if vectors and vectors[0].any() and not _small(table.column(names[across]), vectors[0]):
        raise InputError(
            f"column {names[across]} of {table.path}",
            "a force out of the plane",
            f"zero, after x and y of the force in {' '.join(groups[0])}",
            "The columns are in another order: name them, --columns fx=COLUMN,fy=COLUMN.",
        )
    kinds = [_kind(n, vector) for vector in vectors]
    if kinds == ["oblique", "along", "across"]:
        off = np.hypot(*(vectors[0] - vectors[1] - vectors[2]).T)
        if off.max() > TOLERANCE * float(np.abs(vectors[0]).max()) >= np.median(off):
            raise InputError(
                f"columns {' '.join(chain(*groups))} of {table.path}, row {np.argmax(off)}",
                "a force that is not the sum of its normal and tangential part",
                "the sum, as in the other rows",
                "Columns of the dump disagree: dump again.",
            )
    # Of frictionless grains the whole force is along the branch, as its normal part.
    whole = kinds[:2] == ["along", "along"] and _small(vectors[0] - vectors[1], vectors[0])
    if kinds[:1] == ["oblique"] or whole:
        columns |= {"fx": groups[0][0], "fy": groups[0][1]}
    elif sorted(kinds[:2]) == ["across", "along"]:
        normal, shear = groups[:2] if kinds[0] == "along" else groups[1::-1]
        columns |= dict(zip(FORCE_PARTS, normal + shear, strict=True))
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


def _kind(n: Floats, vector: Floats) -> str:
    """Direction of vectors against the branches: along, across, oblique or zero."""
    along, across = shares(vector, n)
    if along == across == 0:
        return "zero"
    return "along" if across <= TOLERANCE else "across" if along <= TOLERANCE else "oblique"


def _small(vector: Floats, scale: Floats) -> bool:
    return bool(np.abs(vector).max() <= TOLERANCE * np.abs(scale).max())


def _overlap(table: Table, contacts: Contacts, columns: Map, first: int) -> Floats | None:
    """Overlaps of the contacts; their column is recognised by contacts that cross no border."""
    if columns.get("delta") == NONE:
        return None
    inside = ~_crosses(contacts)
    expected, scale = contacts.overlap[inside], contacts.bodies.radii.min()
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
