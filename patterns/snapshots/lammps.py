"""Dumps of LAMMPS: atoms by `dump custom`, their contacts by `dump local`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from loops.arrays import Floats, Integers
from loops.shown import counted
from patterns.snapshots.columns import NONE, check_names, components
from patterns.snapshots.dump_files import (
    ATOM_NAMES,
    PAIR_REACH,
    Atoms,
    DumpFrame,
    GrainPairs,
    Map,
    Space,
    find_ids,
    frame_of_pairs,
    frames_of_dumps,
    given_columns,
    is_dump,
    normals,
    pairs_of,
    read_atoms,
    space_of,
)
from patterns.snapshots.frame import Frame, Frames, Notes
from patterns.snapshots.geometry import sample_rows
from patterns.snapshots.source import Source
from patterns.snapshots.tables import Table, listed

# Plain names of the columns of contacts of LAMMPS, and their contents.
CONTACT_NAMES = {
    "id1": "id of atom 1",
    "id2": "id of atom 2",
    "dx": "x of atom 1 less x of atom 2",
    "dy": "y of atom 1 less y of atom 2",
    "dist": "distance of the centres",
    "force": "size of the normal force, repulsion positive",
    "fx": "x of the normal force on atom 1",
    "fy": "y of the normal force on atom 1",
    "p1": "x of the tangential force on atom 1",
    "p2": "y of the tangential force on atom 1",
    "p4": "size of the tangential force",
}
# Relative tolerance of positions, sizes and directions: dumps have six digits or more.
TOLERANCE = 1e-3
AGREEING = 0.5  # least share of rows that fit, by which a column is recognised


def shares(vector: Floats, n: Floats) -> tuple[float, float]:
    """Parts of vectors (C, 2) along and across unit vectors, over their size; 0 for none."""
    size = np.sqrt(np.sum(vector**2)) or 1.0
    along = np.sqrt(np.sum(np.einsum("ck,ck->c", vector, n) ** 2))
    across = np.sqrt(np.sum((vector[:, 0] * n[:, 1] - vector[:, 1] * n[:, 0]) ** 2))
    return float(along / size), float(across / size)


class ColumnSearch:
    """Columns not yet recognised, and the search for two of them that form a vector."""

    def __init__(self, table: Table, columns: Map) -> None:
        self.table, self.columns, self.rows = table, columns, sample_rows(len(table))
        self.data = {name: table.column(name) for name in table.names}

    def free(self) -> list[str]:
        """Columns without a name that are not zero throughout."""
        taken = {*self.columns.values(), "index"}
        return [n for n, values in self.data.items() if n not in taken and values.any()]

    def vector(self, names: tuple[str, str]) -> Floats:
        """(C, 2) array of two columns by their plain names."""
        return np.column_stack([self.data[self.columns[name]] for name in names])

    def find(
        self, names: tuple[str, str], error: Callable[[Floats, Integers], float], size: str
    ) -> bool:
        """Add the two columns for which `error` is small to the map; check those given.

        Of several pairs, one whose size is a column comes first.
        """
        known = [self.columns.get(name) for name in names]
        if NONE in known:
            return False
        if None in known:
            ones, twos = ([name] if name else self.free() for name in known)
            found = [
                pair
                for one in ones
                for two in twos
                if one != two
                and (vector := self._sample(pair := (one, two))).any()
                and error(vector, self.rows) <= TOLERANCE
            ]
            sizes = [self.columns[size]] if size in self.columns else self.free() if size else []
            sized = [p for p in found if self._equal(np.hypot(*self._sample(p).T), sizes)]
            found = sized or found
            if not found:
                return False
            self._require_one(names, found)
            self.columns |= dict(zip(names, found[0], strict=True))
        if (off := error(self.vector(names), np.arange(len(self.table)))) > TOLERANCE:
            mapped = ", ".join(f"{name}={self.columns[name]}" for name in names)
            raise InputError(
                f"columns {mapped} of {self.table.path}",
                f"vectors {off:.2g} off the branches of the grains",
                " and ".join(f"{name} ({CONTACT_NAMES[name]})" for name in names),
                "Give --columns as the dump was written, and both dumps of one step.",
            )
        if size:
            self.find_size(size, np.hypot(*self.vector(names).T))
        return True

    def _require_one(self, names: tuple[str, str], found: list[tuple[str, str]]) -> None:
        """Raise `InputError` for several vectors; the same one up to its sign is accepted."""
        first = self._sample(found[0])
        for other in map(self._sample, found[1:]):
            off = min(np.abs(first - other).max(), np.abs(first + other).max())
            if off > TOLERANCE * np.abs(first).max():
                raise InputError(
                    f"columns of {self.table.path}",
                    f"several that may be {names[0]}, {names[1]}: "
                    + " or ".join(" ".join(pair) for pair in found),
                    f"one choice ({CONTACT_NAMES[names[0]]}, {CONTACT_NAMES[names[1]]})",
                    f"Name them: --columns {names[0]}=COLUMN,{names[1]}=COLUMN, or none.",
                )

    def _sample(self, pair: tuple[str, str]) -> Floats:
        return np.column_stack([self.data[column][self.rows] for column in pair])

    def find_size(self, name: str, length: Floats) -> None:
        """Add the column whose sizes are `length` (C,) to the map, if there is one.

        `InputError` for a column that has these sizes in most rows but not in all.
        """
        known = self.columns.get(name)
        found = self._equal(length[self.rows], [known] if known else self.free())
        if found is None and known and known != NONE:
            where = f"column {name}={known} of {self.table.path}"
            received, expected = "other sizes than those of the vectors", CONTACT_NAMES[name]
            raise InputError(where, received, expected, "Give --columns as the dump was written.")
        if found is None:
            return
        self.columns[name] = found
        off = np.abs(np.abs(self.data[found]) - length)
        if off.max() > TOLERANCE * length.max():
            row = int(np.argmax(off))
            raise InputError(
                f"column {name}={found} of {self.table.path}, row {row}",
                f"{self.data[found][row]:g}",
                f"{length[row]:g}, {CONTACT_NAMES[name]}, as its components and the other rows say",
                f"Two columns of the dump disagree: dump again, or say {name}=none by --columns.",
            )

    def _equal(self, length: Floats, names: list[str]) -> str | None:
        """The column that holds these sizes, up to the sign, in the most rows; at least half."""
        limit = TOLERANCE * length + 1e-3 * TOLERANCE * float(length.max(initial=0.0))
        shares = {
            name: float(np.mean(np.abs(np.abs(self.data[name][self.rows]) - length) <= limit))
            for name in names
            if name != NONE
        }
        best = max(shares, key=shares.__getitem__, default=None)
        return best if best is not None and shares[best] >= AGREEING else None


MOST_COLUMNS = 100  # largest number of columns among which vectors are searched
DAMPING = "forces of LAMMPS include damping: elastic and viscous parts can't be separated"


def is_lammps(path: Path, head: bytes) -> bool:
    """Whether this is a text dump; ask LIGGGHTS first, whose dumps of atoms look alike."""
    return is_dump(head)


def lammps_frames(source: Source) -> Frames:
    """Frames of a dump of atoms with the dump of their contacts, as docs/lammps.md has them.

    Columns of contacts are recognised from the grains, or given by a map of `CONTACT_NAMES`; walls
    are the per-atom columns of `fix wall/gran ... contacts`.
    """
    check_names(source.columns, (*ATOM_NAMES, *WALL_NAMES, *CONTACT_NAMES))

    def read(own: DumpFrame, local: DumpFrame, notes: Notes) -> Frame:
        atoms = read_atoms(own, source.columns)
        space = space_of(own.box, atoms, source)
        columns, pairs, normal, shear = guess_columns(local.read(), atoms, space, source.columns)
        # On grain 2: the opposite of the forces on atom 1.
        forces: dict[str, Floats] = {}
        force_notes: Notes = ()
        if normal is not None and shear is not None:
            forces, force_notes = components("f@_on_2", -(normal + shear)), (DAMPING,)
        elif normal is not None:
            missing = (
                "no tangential force (p1, p2) among the columns; --mu 0 for frictionless grains"
            )
            forces = {"fn": -np.einsum("ck,ck->c", normal, normals(pairs.d))}
            force_notes = (DAMPING, missing)
        walls, wall_notes = read_walls(own, atoms, source.columns)
        if walls is None and not all(space.periodic):
            wall_notes = ("no columns of walls: their forces are unknown",)
        found = [(name, columns[name]) for name in CONTACT_NAMES if name in columns]
        shown = ", ".join(f"{name}={column}" for name, column in found if column != NONE)
        given = all(name in source.columns or name == column for name, column in found)
        columns_note = f"columns{'' if given else ' guessed'}: {shown}"
        columns_note += "" if given else "; give --columns to overrule"
        said = (columns_note, *notes, *force_notes, *wall_notes)
        return frame_of_pairs((own, local), atoms, space, pairs, forces, walls, said)

    return frames_of_dumps(source, read)


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
        data = search.data
        rest = [name for name in search.free() if (np.rint(data[name]) != data[name]).any()]
        if rest and search.columns.get("fx") != NONE:
            # They may be forces, and the map does not exclude it.
            raise InputError(
                f"columns {listed(rest)} of {search.table.path}",
                "none that form a force along the branch",
                "fx, fy and p1, p2 of 'compute pair/local'",
                "Name them: --columns fx=COLUMN,fy=COLUMN,p1=COLUMN,p2=COLUMN, or force=COLUMN; "
                "fx=none for the geometry alone; for a file of LIGGGHTS --format liggghts.",
            )
        return None, None
    # Without a size, whose sign tells repulsion, most contacts are taken to repel.
    if np.sum((1.0 if push is None else push) * np.einsum("ck,ck->c", normal, n)) > 0:
        normal, shear = -normal, None if shear is None else -shear
    return normal, shear


# Columns of the fix: flag, force on the atom, contact point.
WALL_NAMES = ("wall_flag", "wall_fx", "wall_fy", "wall_x", "wall_y")
# Largest distance of the foot on a wall outside a grain over its radius: rounding of text.
FOOT_TOLERANCE = 1e-3


def read_walls(
    frame: DumpFrame, atoms: Atoms, columns: Mapping[str, str]
) -> tuple[dict[str, NDArray[Any]] | None, Notes]:
    """Columns of contacts with walls from the dump of atoms, and a note; None without any.

    A fix f with the columns `f_f[1]` (in contact or not), `f_f[2], f_f[3]` (force on the atom),
    `f_f[5], f_f[6]` (contact point) is a wall if its points lie within the grains.
    """
    mapped = [columns[name] for name in WALL_NAMES if name in columns]
    found = [match for name in frame.names if (match := re.fullmatch(r"(f_\w+)\[\d+\]", name))]
    places = (1, *(2 + axis for axis in atoms.axes), *(5 + axis for axis in atoms.axes))
    each = {match[1]: [f"{match[1]}[{k}]" for k in places] for match in found}
    sets = {fix: names for fix, names in each.items() if set(names) <= set(frame.names)}
    if mapped:
        if len(mapped) < len(WALL_NAMES) or not set(mapped) <= set(frame.names):
            where = f"--columns for the wall of {frame.where}"
            expected = f"columns of the dump for {', '.join(WALL_NAMES)}"
            raise InputError(where, ", ".join(mapped), expected, "Give all five.")
        sets = {"wall": mapped}
    walls, notes = [], []
    for fix, names in sets.items():
        flag, fx, fy, x, y = frame.read(names).columns(*names).T
        grains = np.flatnonzero(flag > 0)
        force = np.column_stack([fx, fy])[grains]
        branch = atoms.x[grains] - np.column_stack([x, y])[grains]
        length = np.hypot(*branch.T)
        inside = (length > 0) & (length <= (1 + FOOT_TOLERANCE) * atoms.radii[grains])
        if (flag >= 0).all() and inside.all() and np.sum(force * branch) >= 0:
            walls.append(np.column_stack([grains, force, branch]))
            notes.append(f"{fix} ({counted(len(grains), 'contact')})")
        elif mapped:
            where, remedy = f"--columns for the wall of {frame.where}", "Correct the names."
            expected = "flag, force on the atom and contact point of 'fix wall/gran ... contacts'"
            raise InputError(where, "contact points beyond their grains", expected, remedy)
    if not notes:
        return None, ()
    rows, said = np.concatenate(walls), (f"walls recognised: {', '.join(notes)}",)
    own = {"id": atoms.ids[rows[:, 0].astype(np.int64)], **components("f@", rows[:, 1:3])}
    return (own | components("branch_@", rows[:, 3:]) if len(rows) else None), said
