"""LAMMPS: `dump custom` of the atoms, perhaps with walls, and `dump local` of their contacts."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from loops import InputError
from loops.arrays import Floats, Integers
from patterns.snapshots.dump_columns import (
    CONTACT_NAMES,
    NONE,
    PAIR_REACH,
    TOLERANCE,
    ColumnSearch,
    Map,
    find_ids,
    given_columns,
    shares,
)
from patterns.snapshots.dump_files import (
    ATOM_NAMES,
    Atoms,
    DumpFrame,
    Forces,
    GrainPairs,
    Space,
    Wall,
    frame_of_pairs,
    frames_of_dumps,
    is_dump,
    normals,
    pairs_of,
    read_atoms,
    space_of,
)
from patterns.snapshots.frame import Frame, Frames, Notes, Source, check_names
from patterns.snapshots.tables import Table
from patterns.snapshots.text import listed

MOST_COLUMNS = 100  # largest number of columns among which vectors are searched
DAMPING = "forces of LAMMPS include damping: elastic and viscous parts can't be separated"


def recognises(path: Path, head: bytes) -> bool:
    """Whether this is a text dump; ask LIGGGHTS first, whose dumps of atoms look alike."""
    return is_dump(head)


def frames(source: Source) -> Frames:
    """Frames of a dump of atoms with the dump of their contacts, as docs/lammps.md has them.

    Columns of contacts are recognised from the grains, or given by a map of `CONTACT_NAMES`; walls
    are the per-atom columns of `fix wall/gran ... contacts`.
    """
    check_names(source, (*ATOM_NAMES, *WALL_NAMES, *CONTACT_NAMES))
    return frames_of_dumps(source, partial(_frame, source))


def _frame(source: Source, own: DumpFrame, local: DumpFrame, notes: Notes) -> Frame:
    atoms = read_atoms(own, source.columns)
    space, cell_notes = space_of(own.box, atoms, source.cell)
    columns, pairs, normal, shear = guess_columns(local.read(), atoms, space, source.columns)
    # On grain 2: the opposite of the forces on atom 1.
    forces = Forces(None)
    force_notes: Notes = ()
    if normal is not None and shear is not None:
        forces, force_notes = Forces(-(normal + shear)), (DAMPING,)
    elif normal is not None:
        missing = "no tangential force (p1, p2) among the columns; --mu 0 for frictionless grains"
        forces, force_notes = Forces(None, -normal), (DAMPING, missing)
    walls, wall_notes = read_walls(own, atoms, source.columns)
    if not walls and not all(space.periodic):
        wall_notes = ("no columns of walls: their forces are unknown",)
    found = [(name, columns[name]) for name in CONTACT_NAMES if name in columns]
    shown = ", ".join(f"{name}={column}" for name, column in found if column != NONE)
    given = all(name in source.columns or name == column for name, column in found)
    columns_note = f"columns{'' if given else ' guessed'}: {shown}"
    columns_note += "" if given else "; give --columns to overrule"
    said = (columns_note, *notes, *cell_notes, *force_notes, *wall_notes)
    return frame_of_pairs((own, local), atoms, space, pairs, forces, walls, said)


def guess_columns(
    table: Table, atoms: Atoms, space: Space, given: Mapping[str, str]
) -> tuple[Map, GrainPairs, Floats | None, Floats | None]:
    """Recognise the columns of a dump of contacts: ids of grains that touch, distances, forces.

    The normal force is a vector along the branch, the tangential one across it; sizes are others.
    """
    columns = given_columns(table, given, CONTACT_NAMES)
    columns |= {name: name for name in CONTACT_NAMES if table.has(name) and name not in given}
    if len(table.names) > MOST_COLUMNS and not {"id1", "id2", "fx", "fy"} <= set(columns):
        raise InputError(
            table.path,
            f"{len(table.names)} columns",
            f"at most {MOST_COLUMNS} to recognise columns in",
            "Name them: --columns id1=COLUMN,id2=COLUMN,fx=COLUMN,fy=COLUMN,p1=COLUMN,p2=COLUMN.",
        )
    free = [name for name in table.names if name != "index"]
    ones, twos = ([columns[name]] if name in columns else free for name in ("id1", "id2"))
    choices = [(one, two) for one in ones for two in twos if one != two]
    expected = "patom1 and patom2 of 'compute property/local'"
    ids = find_ids(table, atoms, space, columns, choices, expected, "")
    search = ColumnSearch(table, columns)
    pairs = _branches(search, atoms, space, *ids)
    return columns, pairs, *_find_forces(search, pairs)


def _branches(
    search: ColumnSearch, atoms: Atoms, space: Space, i: Integers, j: Integers
) -> GrainPairs:
    """Pairs with the images by the columns dx, dy, else with the nearest ones."""
    near = pairs_of(atoms, space, i, j)
    reach = atoms.radii[i] + atoms.radii[j]

    def error(vector: Floats, rows: Integers) -> float:
        # A difference of whole cells is another image; either sign is accepted.
        if (np.hypot(*vector.T) > 2 * PAIR_REACH * reach[rows]).any():
            return np.inf
        off = [vector - sign * near.d[rows] for sign in (1, -1)]
        off = [gap - space.shift(space.images(gap)) for gap in off]
        return float(min((np.hypot(*gap.T) / reach[rows]).max() for gap in off))

    if not search.find(("dx", "dy"), error, ""):
        search.find_size("dist", np.hypot(*near.d.T))
        return near
    vector = search.vector(("dx", "dy"))
    gap = vector - near.d
    same = np.hypot(*(gap - space.shift(space.images(gap))).T) / reach
    sign = 1.0 if same.max() <= TOLERANCE else -1.0
    pairs = pairs_of(atoms, space, i, j, sign * vector)
    search.find_size("dist", np.hypot(*pairs.d.T))
    return pairs


def _find_forces(search: ColumnSearch, pairs: GrainPairs) -> tuple[Floats | None, Floats | None]:
    """Normal and tangential force on atom 1, None for what the dump lacks."""
    n = normals(pairs.d)

    normal, shear = None, None
    if search.find(("fx", "fy"), lambda v, rows: shares(v, n[rows])[1], "force"):
        normal = search.vector(("fx", "fy"))
    size = search.columns.get("force", NONE)
    push = None if size == NONE else search.data[size]
    if normal is None and push is not None:
        normal = -push[:, None] * n
    if search.find(("p1", "p2"), lambda v, rows: shares(v, n[rows])[0], "p4"):
        shear = search.vector(("p1", "p2"))
    if normal is None:
        _require_nothing_left(search)
        return None, None
    # Without a size, whose sign tells repulsion, most contacts are taken to repel.
    if np.sum((1.0 if push is None else push) * np.einsum("ck,ck->c", normal, n)) > 0:
        normal, shear = -normal, None if shear is None else -shear
    return normal, shear


def _require_nothing_left(search: ColumnSearch) -> None:
    """Raise `InputError` if columns may be forces and the map does not exclude them."""
    rest = [
        name for name in search.free() if (np.rint(search.data[name]) != search.data[name]).any()
    ]
    if not rest or search.columns.get("fx") == NONE:
        return
    raise InputError(
        f"columns {listed(rest)} of {search.table.path}",
        "none that form a force along the branch",
        "fx, fy and p1, p2 of 'compute pair/local'",
        "Name them: --columns fx=COLUMN,fy=COLUMN,p1=COLUMN,p2=COLUMN, or force=COLUMN; fx=none "
        "for the geometry alone; for a file of LIGGGHTS --format liggghts.",
    )


# Columns of the fix: flag, force on the atom, contact point.
WALL_NAMES = ("wall_flag", "wall_fx", "wall_fy", "wall_x", "wall_y")
WALL_NUMBERS = ("1", "2", "3", "5", "6")
# Largest distance of the foot on a wall outside a grain over its radius: rounding of text.
FOOT_TOLERANCE = 1e-3


def read_walls(
    frame: DumpFrame, atoms: Atoms, columns: Mapping[str, str]
) -> tuple[tuple[Wall, ...], tuple[str, ...]]:
    """Contacts with walls from the dump of atoms.

    A fix f with the columns `f_f[1]` (in contact or not), `f_f[2], f_f[3]` (force on the atom),
    `f_f[5], f_f[6]` (contact point) is a wall if its points lie within the grains.
    """
    mapped = [columns[name] for name in WALL_NAMES if name in columns]
    found = [match for name in frame.names if (match := re.fullmatch(r"(f_\w+)\[\d+\]", name))]
    each = {match[1]: [f"{match[1]}[{k}]" for k in WALL_NUMBERS] for match in found}
    sets = {fix: names for fix, names in each.items() if set(names) <= set(frame.names)}
    if mapped:
        if len(mapped) < len(WALL_NAMES) or not set(mapped) <= set(frame.names):
            where = f"--columns for the wall of {frame.where}"
            expected = f"columns of the dump for {', '.join(WALL_NAMES)}"
            raise InputError(where, ", ".join(mapped), expected, "Give all five.")
        sets = {"wall": mapped}
    walls, notes = [], []
    for fix, names in sets.items():
        wall = _wall(frame, atoms, names)
        if wall is not None:
            walls.append(wall)
            notes.append(f"{fix} ({len(wall.grains)} contacts)")
        elif mapped:
            where, remedy = f"--columns for the wall of {frame.where}", "Correct the names."
            expected = "flag, force on the atom and contact point of 'fix wall/gran ... contacts'"
            raise InputError(where, "contact points beyond their grains", expected, remedy)
    if not notes:
        return (), ()
    return tuple(walls), (f"walls recognised: {', '.join(notes)}",)


def _wall(frame: DumpFrame, atoms: Atoms, names: list[str]) -> Wall | None:
    """The wall of these columns, None if they hold something else."""
    flag, fx, fy, x, y = frame.read(names).columns(*names).T
    grains = np.flatnonzero(flag > 0)
    force = np.column_stack([fx, fy])[grains]
    branch = atoms.x[grains] - np.column_stack([x, y])[grains]
    length = np.hypot(*branch.T)
    inside = (length > 0) & (length <= (1 + FOOT_TOLERANCE) * atoms.radii[grains])
    if (flag < 0).any() or not inside.all() or np.sum(force * branch) < 0:
        return None
    return Wall(grains, force, branch)
