"""From the plain tables of one instant to a snapshot."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import GrainGraph, InputError, LinearFrictional
from loops.laws.frictional import ShearIncrement
from loops.validation import find_duplicate
from patterns.snapshots.bodies import Bodies, read_bodies, read_pairs
from patterns.snapshots.checks import Finding, State, check_state, same_normal_force
from patterns.snapshots.contact_columns import force_on_second, law_of
from patterns.snapshots.contact_geometry import check_cell, check_geometry, images_of
from patterns.snapshots.frame import Frame
from patterns.snapshots.snapshot import Snapshot, WallContacts
from patterns.snapshots.tables import Table

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Parameters(NamedTuple):
    """What the user says of the law: `kn`, `kt`, `mu` for columns that a file lacks."""

    kn: float | None = None
    kt: float | None = None
    mu: float | None = None
    shear_increment: ShearIncrement | None = None


def build_snapshot(frame: Frame, parameters: Parameters, *, strict: bool = True) -> Snapshot:
    """Check the tables of one instant and make the snapshot of them.

    Without forces, or with normal forces alone on frictional grains, only the geometry. Findings
    after which nothing meaningful can follow are refused if `strict`; doubts become notes.
    """
    bodies, table = read_bodies(frame.grains), frame.contacts
    pairs = read_pairs(table, bodies)[1]
    rows = np.flatnonzero((pairs >= 0).all(axis=1))
    if len(rows) == 0:
        raise InputError(table.path, "no contact between grains", "contacts", "Check the export.")
    cell = check_cell(frame.cell, bodies.radii)
    images = images_of(table, rows, cell, bodies.x, pairs[rows])
    d = bodies.x[pairs[rows, 1]] - bodies.x[pairs[rows, 0]]
    if images is not None and cell is not None:
        d += images @ cell.T
    length, n = check_geometry(table, rows, bodies, pairs[rows], d, periodic=cell is not None)
    notes = list(frame.notes)
    normals = _normals(table, rows, n)
    force = force_on_second(table, normals, frictionless=_frictionless(table, parameters))
    normal, shear = _components(force, rows, n)
    walls = _walls(table, bodies, pairs, force)
    law: LinearFrictional | None = None
    regime: NDArray[np.int8] | None = None
    if force is None:
        lone = "normal forces without shear forces" if table.has("fn") else "no contact forces"
        notes.append(f"{lone}: the geometry of the loops alone, no stress and no stability")
    else:
        increment = parameters.shear_increment or frame.shear_increment or "branch"
        law, regime, assumed = law_of(
            table, rows, normal, shear, **parameters._asdict() | {"shear_increment": increment}
        )
        notes += assumed
        if increment == "radii" or frame.shear_increment == "radii":
            notes.append(_increment_note(parameters.shear_increment, frame.shear_increment))
    graph = _graph(frame, bodies, rows, pairs[rows], images, cell, normal, shear, regime)
    if images is not None and not images.any():
        notes.append("no contact crosses the border of the periodic cell")
    given = table.optional("nx", "ny")
    given = table.optional("branch_x", "branch_y") if given is None else given
    findings = check_state(
        State(graph, d, length, law, regime, None if given is None else given[rows], walls)
    )
    if force is not None and table.has("fn", "fx_on_2"):
        findings = (*findings, same_normal_force(table.column("fn")[rows], normal))
    if strict:
        _refuse_errors(table, findings)
    notes += [f"{one}" for one in findings if one.severity != "ok"]
    return Snapshot(
        graph,
        law,
        regime,
        bodies.grain_ids,
        len(pairs) - len(rows),
        tuple(notes),
        walls,
        frame.step,
        findings,
    )


def _refuse_errors(table: Table, findings: tuple[Finding, ...]) -> None:
    for found in findings:
        if found.severity == "error":
            raise InputError(table.path, found.says, "a packing of grains in contact", found.remedy)


def _increment_note(given: ShearIncrement | None, told: ShearIncrement | None) -> str:
    if given is None:
        return (
            "shear increment 'radii', Yade's default: --shear-increment branch if the simulation "
            "had avoidGranularRatcheting=False"
        )
    return f"shear increment {given!r} as given" + (
        "" if told in (None, given) else f", not {told!r}"
    )


def _frictionless(table: Table, parameters: Parameters) -> bool:
    if table.has("mu"):
        return not table.column("mu").any()
    return parameters.mu == 0


def _normals(table: Table, rows: Integers, n: Floats) -> Floats:
    """Normals of all contacts: from the centres between grains, from the file with walls."""
    if len(rows) == len(table):
        return n
    given = table.optional("nx", "ny")
    if given is None:
        branches = table.optional("branch_x", "branch_y")
        given = np.zeros((len(table), 2)) if branches is None else branches
        length = np.hypot(*given.T)
        given = given / np.where(length > 0, length, 1.0)[:, None]
    given[rows] = n
    return given


def _components(force: Floats | None, rows: Integers, n: Floats) -> tuple[Floats, Floats]:
    """`N` and `T` of the contacts between grains."""
    if force is None:
        return np.zeros(len(rows)), np.zeros(len(rows))
    f = force[rows]
    return np.einsum("ck,ck->c", f, n), n[:, 0] * f[:, 1] - n[:, 1] * f[:, 0]


def _graph(
    frame: Frame,
    bodies: Bodies,
    rows: Integers,
    pairs: Integers,
    images: Integers | None,
    cell: Floats | None,
    normal: Floats,
    shear: Floats,
    regime: NDArray[np.int8] | None,
) -> GrainGraph:
    try:
        return GrainGraph(
            x=bodies.x,
            radii=bodies.radii,
            contacts=pairs,
            normal_force=normal,
            shear_force=shear,
            images=images,
            cell=cell,
            regime=regime,
        )
    except InputError:
        # The graph knows indices only: name the rows and the ids.
        found = find_duplicate(pairs, images, len(bodies.x))
        if found is None:
            raise
        one, two = bodies.grain_ids[pairs[found[1]]].tolist()
        raise InputError(
            f"{frame.contacts.path}, row {rows[found[1]]} (grains {one} and {two})",
            f"the same contact as row {rows[found[0]]}",
            "each contact once",
            "Drop one of the two rows.",
        ) from None


def _walls(
    table: Table, bodies: Bodies, pairs: Integers, force: Floats | None
) -> WallContacts | None:
    """Contacts of a grain with a wall; None where the file lacks the force or the branch."""
    single = np.flatnonzero((pairs >= 0).sum(axis=1) == 1)
    if force is None or not len(single):
        return None
    wall_first = pairs[single, 0] < 0
    grain = np.where(wall_first, pairs[single, 1], pairs[single, 0])
    sign = np.where(wall_first, 1.0, -1.0)[:, None]
    branches, points = table.optional("branch_x", "branch_y"), table.optional("cx", "cy")
    if branches is not None:
        branch = sign * branches[single]
    elif points is not None:
        branch = bodies.x[grain] - points[single]
    else:
        return None
    return WallContacts(grain, sign * force[single], branch)
