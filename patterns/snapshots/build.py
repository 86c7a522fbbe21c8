"""A snapshot from its plain tables: bodies, contacts, forces, walls, law, checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loops import GrainGraph, InputError
from loops.arrays import Floats, Integers
from loops.compiled import load_ahead, use_compiled
from patterns.snapshots.checked import Checked
from patterns.snapshots.checks import check_state
from patterns.snapshots.findings import Finding, finding
from patterns.snapshots.forces import contacts_among, once, read_forces, redundant
from patterns.snapshots.frame import Frame
from patterns.snapshots.geometry import (
    GIVE_CELL,
    Bodies,
    as_cell,
    check_cell,
    high_cell,
    in_plane,
    named_rows,
    read_bodies,
    read_contacts,
    read_ids,
    require_fitting,
    rows_between_grains,
    some,
    told_walls,
)
from patterns.snapshots.laws import lacks_of, law_of, told_law
from patterns.snapshots.snapshot import Snapshot
from patterns.snapshots.source import COHESIVE, Source
from patterns.snapshots.tables import require_columns
from patterns.snapshots.walls import (
    ReadWalls,
    WallContacts,
    height_between,
    walls_of_rows,
    walls_of_table,
)


def build_snapshot(frame: Frame, source: Source) -> Snapshot:
    """Check the tables of one saved state and make the snapshot of them.

    Without forces, or with normal forces alone on frictional grains, only the geometry. Findings
    that leave no meaningful result are refused if strict; doubts become notes.
    """
    cell = as_cell(frame.cell if source.cell is None else source.cell)
    frame = replace(frame, cell=cell, periodic=source.periodic or frame.periodic)
    plane = () if frame.grains.has("z") else ("x", "y")
    require_columns((frame.grains, (*plane, "radius")), (frame.contacts, ("id1", "id2")))
    load_ahead(len(frame.contacts))
    tables = [frame.grains, frame.contacts, *([] if frame.walls is None else [frame.walls])]
    (own, table, *of_walls), notes = in_plane(tables)
    large, ids = use_compiled(None, len(table)), read_ids(own)
    named, shift, shifted = named_rows(own, table, ids, cell)
    of_type = {"given": frame.has_types, "others": bool(of_walls)}
    is_wall, kinds, findings = told_walls(own, named, cell, **of_type)
    beyond = bool(named.max() >= len(own))
    bodies, place = read_bodies(own, ids, is_wall, walls=beyond, along_space=large)
    every = named if place is None else place[named]
    rows = rows_between_grains(table, every, along_space=large)
    pairs, cell, periodic = some(every, rows), check_cell(cell, bodies.radii), frame.periodic
    if cell is None and not all(periodic):
        received, remedy = "no cell", f"{GIVE_CELL} Its height is that between the walls."
        raise InputError("--periodic", received, "the period as a vector of the cell", remedy)
    contacts = read_contacts(table.take(rows), pairs, bodies, cell, periodic)
    single = np.flatnonzero((every[:, 0] >= 0) != (every[:, 1] >= 0))
    at_walls, ends = table.take(single) if len(single) else None, every[single]
    table, forces = contacts.table, read_forces(contacts, at_walls, ends, source)
    kept, said = contacts_among(contacts, forces, measured=frame.measured)
    if kept is not None:
        return _of_fewer(frame, rows[~kept], said, (), source)
    require_fitting(contacts)
    notes = [*frame.notes, *notes, *shifted, *kinds, *forces.notes]
    normal, shear, known = forces.normal, forces.shear, forces.known
    if of_walls:
        found = walls_of_table(of_walls[0], contacts, forces, source.kn, shift)
    elif at_walls is not None and known:
        found = walls_of_rows(at_walls, named[single], ends, contacts, forces, source.kn)
    else:
        found = ReadWalls(None, len(every) - len(rows), [], [])
    walls = found.contacts
    findings += found.findings
    if cell is not None and not all(periodic):
        cell, said = _strip(cell, periodic, bodies, walls)
        notes.append(said)
    if source.law is None:
        source = replace(source, law=frame.law, shear_history=frame.shear_history)
    elif source.law in COHESIVE and source.adhesion is None and not table.has("adhesion"):
        expected = f"the largest pull of a contact under --law {source.law}"
        raise InputError("adhesion", "none", expected, "Give --adhesion, or such a column.")
    if source.law is None and known:
        told, words = told_law(contacts, normal)
        source = replace(source, law=told)
        notes += words
    lacks, law, regime = lacks_of(source, table), None, None
    sizes = ("force of contacts",) if table.has("force") and not known else ()
    if unused := (*frame.unused, *sizes):
        case = "ok" if known else "forces"
        findings.append(finding("columns", len(unused), case, names=", ".join(unused)))
    if not known:
        lacks = ["shear forces" if table.has("fn") else "forces", *lacks]
        lone = "normal forces without shear forces" if table.has("fn") else "no contact forces"
        notes.append(f"{lone}: the geometry of the loops alone, no stress and no stability")
    elif not lacks:
        law, regime = law_of(contacts, normal, shear, source, frame.shear_increment, notes)
    for array in (bodies.x, bodies.radii, pairs, normal, shear):
        array.flags.writeable = False  # not copied then
    try:
        graph = GrainGraph(
            x=bodies.x, radii=bodies.radii, cell=cell, contacts=pairs, images=contacts.images,
            normal_force=normal, shear_force=shear, regime=regime,
            rolling_moment=table.column("mz_on_2") if table.has("mz_on_2") else None,
        )  # fmt: skip
    except InputError:
        twice = once(contacts, forces)
        if twice is None:
            raise
        again, said, repeated = twice
        return _of_fewer(frame, rows[again], said, (repeated,), source)
    pushed = None if walls is None else (walls.grain, walls.force)
    state = Checked(
        *(graph, contacts.d, contacts.length, law, regime, contacts.given, pushed, bodies.ids),
        forces_known=known, periodic=periodic, rows=table.number(np.arange(len(table))),
    )  # fmt: skip
    of_columns = redundant(contacts, forces) if known else []
    every_one = (*frame.findings, *findings, *check_state(state), *of_columns)
    for one in every_one if source.strict else ():
        if one.severity == "error":
            raise InputError(table.path, one.says, "a packing of grains in contact", one.remedy)
    unbalanced = [one for one in every_one if one.check == "balance" and frame.measured and known]
    if any(one.severity != "ok" for one in unbalanced):
        law = regime = None
        graph, unbalanced = graph.replace(regime=None), []
        lacks.append("balance")
    notes += found.notes + [one.says for one in unbalanced] + _notes_of(every_one, lacks, known)
    # Codes that move no grain may write zeros.
    mass = None if bodies.mass is None or not (bodies.mass > 0).all() else bodies.mass
    velocity, spin = (None, None) if bodies.motion is None else (
        bodies.motion[:, :2], bodies.motion[:, 2])  # fmt: skip
    return Snapshot(
        *(graph, law, regime, bodies.ids, found.number, tuple(notes), walls, frame.step, every_one),
        *(bodies.rotation, tuple(lacks), mass, frame.time, velocity, spin, periodic),
    )


def _of_fewer(
    frame: Frame,
    left: Integers,
    words: str,
    findings: tuple[Finding, ...],
    source: Source,
) -> Snapshot:
    """The snapshot without some rows of the contacts."""
    kept = np.ones(len(frame.contacts), dtype=bool)
    kept[left] = False
    contacts, notes = frame.contacts.take(kept), (*frame.notes, words)
    findings = (*frame.findings, *findings)
    frame = replace(frame, contacts=contacts, notes=notes, findings=findings)
    return build_snapshot(frame, source)


def _strip(
    cell: Floats, periodic: tuple[bool, bool], bodies: Bodies, walls: WallContacts | None
) -> tuple[Floats, str]:
    """The cell of a sample that is periodic along one vector, its height that between the walls.

    Without walls on both sides that of the given cell, or of the grains if it is less.
    """
    free = periodic.index(False)
    along = "xy"[1 - free]
    height = height_between(bodies.x, walls, free)
    if height is not None:
        cell = cell * np.where(np.arange(2) == free, height / abs(cell[free, free]), 1.0)
        of = f"the height {height:.6g} between walls"
    else:
        cell = high_cell(cell, free, bodies.x, 2 * float(bodies.radii.max()))
        of = f"the cell {cell.tolist()}, which may hold more than the packing"
    return cell, f"periodic along {along} alone: stress refers to {of}"


def _notes_of(findings: Sequence[Finding], lacks: Sequence[str], forces_known: bool) -> list[str]:
    """Notes on the stiffness that known forces lack, and on all findings that are not as wanted."""
    notes = []
    if forces_known and {"kn", "kt", "young", "poisson"} & {*lacks}:
        needed = [one.says for one in findings if one.check == "stiffness"]
        stiffness = [name for name in lacks if name != "balance"]
        given = " and ".join(f"--{name}" for name in stiffness)
        lone = f"forces without {' and '.join(stiffness)}: no stability of the loops"
        notes.append("; ".join([lone, *needed, f"give {given}"]))
    return notes + [f"{one.severity}: {one}" for one in findings if one.severity != "ok"]
