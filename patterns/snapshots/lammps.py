"""Dumps of LAMMPS and of LIGGGHTS: atoms by `dump custom`, their contacts by `dump local`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from loops import InputError
from loops.arrays import Floats, Integers
from patterns.snapshots.dump_files import (
    ATOM_NAMES,
    NONE,
    PAIR_REACH,
    Atoms,
    DumpFrame,
    Forces,
    GrainPairs,
    Map,
    Space,
    Wall,
    contact_names,
    find_ids,
    first_frame,
    frame_of_pairs,
    frames_of_dumps,
    gaps,
    given_columns,
    is_dump,
    normals,
    pairs_of,
    read_atoms,
    sample_rows,
    space_of,
)
from patterns.snapshots.frame import Frame, Frames, Notes, Source, check_names
from patterns.snapshots.tables import Table, beside, head_of, listed

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
AS_WRITTEN = "Give --columns as the dump was written, and both dumps of one step."


def named(columns: Map, names: Iterable[str]) -> str:
    """Names of a map with their columns, for messages."""
    return ", ".join(f"{name}={columns[name]}" for name in names)


def shares(vector: Floats, n: Floats) -> tuple[float, float]:
    """Parts of vectors (C, 2) along and across unit vectors, over their size; 0 for none."""
    size = np.sqrt(np.sum(vector**2)) or 1.0
    along = np.sqrt(np.sum(np.einsum("ck,ck->c", vector, n) ** 2))
    across = np.sqrt(np.sum((vector[:, 0] * n[:, 1] - vector[:, 1] * n[:, 0]) ** 2))
    return float(along / size), float(across / size)


class ColumnSearch:
    """Columns not yet recognised, and the search for two of them that form a vector."""

    def __init__(self, table: Table, columns: Map) -> None:
        self.table, self.columns, self.rows = table, columns, sample_rows(table)
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
        if None not in known:
            self._check(names, error(self.vector(names), np.arange(len(self.table))))
            self._size(names, size)
            return True
        ones, twos = ([name] if name else self.free() for name in known)
        found = [
            pair
            for one in ones
            for two in twos
            if one != two
            and (vector := self._sample(pair := (one, two))).any()
            and error(vector, self.rows) <= TOLERANCE
        ]
        known_size = self.columns.get(size)
        sized = []
        for pair in found if size else []:
            others = [name for name in self.free() if name not in pair]
            length = np.hypot(*self._sample(pair).T)
            if self._equal(length, [known_size] if known_size else others):
                sized.append(pair)
        found = sized or found
        if not found:
            return False
        first = self._sample(found[0])
        for other in map(self._sample, found[1:]):
            # Further columns with the same vector, up to its sign, are accepted.
            off = min(np.abs(first - other).max(), np.abs(first + other).max())
            if off <= TOLERANCE * np.abs(first).max():
                continue
            raise InputError(
                f"columns of {self.table.path}",
                f"several that may be {names[0]}, {names[1]}: "
                + " or ".join(" ".join(pair) for pair in found),
                f"one choice ({CONTACT_NAMES[names[0]]}, {CONTACT_NAMES[names[1]]})",
                f"Name them: --columns {names[0]}=COLUMN,{names[1]}=COLUMN, or none.",
            )
        self.columns |= dict(zip(names, found[0], strict=True))
        self._check(names, error(self.vector(names), np.arange(len(self.table))))
        self._size(names, size)
        return True

    def _sample(self, pair: tuple[str, str]) -> Floats:
        return np.column_stack([self.data[column][self.rows] for column in pair])

    def _check(self, names: tuple[str, str], error: float) -> None:
        if error > TOLERANCE:
            raise InputError(
                f"columns {named(self.columns, names)} of {self.table.path}",
                f"vectors {error:.2g} off the branches of the grains",
                " and ".join(f"{name} ({CONTACT_NAMES[name]})" for name in names),
                AS_WRITTEN,
            )

    def _size(self, names: tuple[str, str], size: str) -> None:
        """Add the column of the vector's size, if there is one."""
        if size:
            self.find_size(size, np.hypot(*self.vector(names).T))

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
NO_WALLS = "contacts with walls are not in the dumps: their forces are missing from the stress"


def is_lammps(path: Path, head: bytes) -> bool:
    """Whether this is a text dump; ask LIGGGHTS first, whose dumps of atoms look alike."""
    return is_dump(head)


def lammps_frames(source: Source) -> Frames:
    """Frames of a dump of atoms with the dump of their contacts, as docs/lammps.md has them.

    Columns of contacts are recognised from the grains, or given by a map of `CONTACT_NAMES`; walls
    are the per-atom columns of `fix wall/gran ... contacts`.
    """
    check_names(source, (*ATOM_NAMES, *WALL_NAMES, *CONTACT_NAMES))

    def read(own: DumpFrame, local: DumpFrame, notes: Notes) -> Frame:
        atoms = read_atoms(own, source.columns)
        space, cell_notes = space_of(own.box, atoms, source.cell)
        columns, pairs, normal, shear = guess_columns(local.read(), atoms, space, source.columns)
        # On grain 2: the opposite of the forces on atom 1.
        forces = Forces(None)
        force_notes: Notes = ()
        if normal is not None and shear is not None:
            forces, force_notes = Forces(-(normal + shear)), (DAMPING,)
        elif normal is not None:
            missing = (
                "no tangential force (p1, p2) among the columns; --mu 0 for frictionless grains"
            )
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
        flag, fx, fy, x, y = frame.read(names).columns(*names).T
        grains = np.flatnonzero(flag > 0)
        force = np.column_stack([fx, fy])[grains]
        branch = atoms.x[grains] - np.column_stack([x, y])[grains]
        length = np.hypot(*branch.T)
        inside = (length > 0) & (length <= (1 + FOOT_TOLERANCE) * atoms.radii[grains])
        if (flag >= 0).all() and inside.all() and np.sum(force * branch) >= 0:
            walls.append(Wall(grains, force, branch))
            notes.append(f"{fix} ({len(grains)} contacts)")
        elif mapped:
            where, remedy = f"--columns for the wall of {frame.where}", "Correct the names."
            expected = "flag, force on the atom and contact point of 'fix wall/gran ... contacts'"
            raise InputError(where, "contact points beyond their grains", expected, remedy)
    if not notes:
        return (), ()
    return tuple(walls), (f"walls recognised: {', '.join(notes)}",)


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
    contacts = beside(path, *contact_names(path))
    if contacts is None:
        return False
    try:
        names = first_frame(contacts, head_of(contacts)).names
    except InputError:
        return False
    numbered = {f"[{k + 1}]" for k in range(len(names))}
    stems = {name.rpartition("[")[0] for name in names}
    return len(names) >= 3 and len(stems) == 1 and {n[n.rfind("[") :] for n in names} == numbered


def liggghts_frames(source: Source) -> Frames:
    """Frames of a dump of atoms with all columns of `compute pair/gran/local` (docs/lammps.md).

    The columns of the forces are recognised by their directions, or given by a map of
    `LIGGGHTS_NAMES`. Headers have six digits: the cell is found from the overlaps of the contacts
    that cross its border.
    """
    check_names(source, (*ATOM_NAMES, *LIGGGHTS_NAMES))

    def read(own: DumpFrame, local: DumpFrame, notes: Notes) -> Frame:
        atoms = read_atoms(own, source.columns)
        space, said = space_of(own.box, atoms, source.cell)
        contacts = read_contacts(local.read(), atoms, space, dict(source.columns))
        found = ", ".join(f"{name}={c}" for name, c in contacts.columns.items() if c != NONE)
        said = (f"columns in the order of pair/gran/local: {found}", *notes, *said)
        box = own.box
        if box is not None and box.digits < COARSE and source.cell is None and any(space.periodic):
            space, note = finer_cell(atoms, space, contacts)
            said = (*said, note)
        pairs = pairs_of(atoms, space, contacts.pairs.i, contacts.pairs.j, contacts.pairs.d)
        if not all(space.periodic):
            said = (*said, NO_WALLS)
        forces = Forces(None if contacts.force is None else -contacts.force)
        return frame_of_pairs((own, local), atoms, space, pairs, forces, notes=said)

    return frames_of_dumps(source, read)


def finer_cell(atoms: Atoms, space: Space, contacts: Contacts) -> tuple[Space, str]:
    """The edges of a rectangular cell from the overlaps across its border.

    Centres of a contact with images are `r1 + r2 - delta` apart: least squares for the lengths of
    the edges, by Newton's method from those of the header.
    """
    coarse = "cell from a header of six digits: branches across its border are as coarse"
    across = np.flatnonzero(contacts.pairs.images.any(axis=1))
    cell = space.cell
    if cell is None or contacts.overlap is None or len(across) == 0 or cell[0, 1] or cell[1, 0]:
        return space, f"{coarse}; give --cell or dump delta"
    pairs: GrainPairs = contacts.pairs.take(across)
    length = (atoms.radii[pairs.i] + atoms.radii[pairs.j]) - contacts.overlap[across]
    raw = atoms.x[pairs.j] - atoms.x[pairs.i]
    edges = np.diag(cell).copy()
    # An edge that no contact crosses stays as it is.
    crossed = pairs.images.any(axis=0)
    for _ in range(CELL_STEPS):
        d = raw + pairs.images * edges
        distance = np.hypot(*d.T)
        slope = (normals(d) * pairs.images)[:, crossed]
        edges[crossed] += np.linalg.lstsq(slope, length - distance, rcond=None)[0]
    misfit = np.abs(np.hypot(*(raw + pairs.images * edges).T) - length).max()
    change = np.abs(edges / np.diag(cell) - 1).max()
    if misfit > FIT * edges.max() or change > 1e-5:
        return space, f"{coarse}; overlaps don't fit it better ({misfit:.2g}); give --cell"
    return Space(np.diag(edges), space.periodic), (
        f"cell {edges.tolist()} from the overlaps of {len(across)} contacts across its border, "
        f"which it fits to {misfit:.1g}: the header has six digits"
    )


class Contacts(NamedTuple):
    """Columns by plain names, pairs, total force on atom 1 (C, 2) and overlaps (C,) or None."""

    columns: Map
    pairs: GrainPairs
    force: Floats | None
    overlap: Floats | None


def read_contacts(table: Table, atoms: Atoms, space: Space, given: Map) -> Contacts:
    """Recognise ids, forces and overlaps among the columns of `pair/gran/local`."""
    columns = given_columns(table, given, LIGGGHTS_NAMES)
    # The flag of the periodic border follows the ids.
    places = [names for at in (0, 6, 12) if len(names := table.names[at : at + 3]) == 3]
    choices = [(a, b) for a, b, flag in places if np.isin(table.column(flag), (0, 1)).all()]
    if "id1" in columns and "id2" in columns:
        choices = [(columns["id1"], columns["id2"])]
    expected = (
        "ids in column 1, 7 or 13, the order of pair/gran/local: pos, vel, id, force, ... with "
        "'id' among them"
    )
    ids = find_ids(table, atoms, space, columns, choices, expected, ",fx=COLUMN,fy=COLUMN")
    pairs = pairs_of(atoms, space, *ids)
    first = table.names.index(columns["id1"])
    # Positions of both grains stand first, if velocities don't: these are the atoms' to rounding.
    ends = ((0, pairs.i), (3, pairs.j)) if first >= 6 else ()
    for at, index in ends:
        x = table.columns(*table.names[at : at + 2])
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
    force = _force(table, pairs, columns, first + 3)
    return Contacts(columns, pairs, force, _overlap(table, atoms, pairs, columns, first + 3))


def _force(table: Table, pairs: GrainPairs, columns: Map, first: int) -> Floats | None:
    """Total force on atom 1, None if there is none."""
    if "fx" not in columns and "fnx" not in columns:
        _find_force(table, pairs, columns, first)
    if NONE in (columns.get("fx"), columns.get("fnx")):
        return None
    for group in (("fx", "fy"), FORCE_PARTS):
        found = [name for name in group if name in columns]
        if found and len(found) < len(group):
            where = f"--columns for the force of {table.path}"
            raise InputError(where, ", ".join(found), ", ".join(group), "Give the others as well.")
    if "fnx" in columns:
        normal, shear = (table.columns(columns[f"f{p}x"], columns[f"f{p}y"]) for p in "nt")
        for names, vector, wanted in (
            (FORCE_PARTS[:2], normal, "along"),
            (FORCE_PARTS[2:], shear, "across"),
        ):
            kind = _kind(pairs, vector)
            if kind not in (wanted, "zero"):
                raise InputError(
                    f"columns {named(columns, names)} of {table.path}",
                    f"vectors {kind} to the branches of the grains",
                    f"vectors {wanted} them",
                    AS_WRITTEN,
                )
        force = normal + shear
    else:
        force = table.columns(columns["fx"], columns["fy"])
    if np.sum(force * pairs.d) > 0:
        raise InputError(
            f"columns {named(columns, columns)} of {table.path}",
            "forces that pull the grains together",
            "forces on the first atom that push it away from the second",
            "Name the columns: --columns id1=COLUMN,id2=COLUMN,fx=COLUMN,fy=COLUMN.",
        )
    return force


def _find_force(table: Table, pairs: GrainPairs, columns: Map, first: int) -> None:
    """Add the columns of the force to the map, recognised by their directions."""
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
        if kinds[1:] == ["along", "across"]:
            off = np.hypot(*(vectors[0] - vectors[1] - vectors[2]).T)
            limit = TOLERANCE * float(np.abs(vectors[0]).max())
            if off.max() > limit >= np.median(off):
                every = " ".join(" ".join(group) for group in groups)
                raise InputError(
                    f"columns {every} of {table.path}, row {np.argmax(off)}",
                    "a force that is not the sum of its normal and tangential part",
                    "the sum, as in the other rows",
                    "Columns of the dump disagree: dump again.",
                )
            if off.max() <= limit:
                columns |= dict(zip(FORCE_PARTS, groups[1] + groups[2], strict=True))
    elif sorted(kinds[:2]) == ["across", "along"]:
        groups = sorted(groups[:2], key=lambda group: kinds[groups.index(group)], reverse=True)
        columns |= dict(zip(FORCE_PARTS, groups[0] + groups[1], strict=True))
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


def _kind(pairs: GrainPairs, vector: Floats) -> str:
    """Direction of vectors against the branches: along, across, oblique or zero."""
    along, across = shares(vector, normals(pairs.d))
    if along == across == 0:
        return "zero"
    return "along" if across <= TOLERANCE else "across" if along <= TOLERANCE else "oblique"


def _small(vector: Floats, scale: Floats) -> bool:
    return bool(np.abs(vector).max() <= TOLERANCE * np.abs(scale).max())


def _overlap(
    table: Table, atoms: Atoms, pairs: GrainPairs, columns: Map, first: int
) -> Floats | None:
    """Overlaps of the contacts; their column is recognised by contacts that cross no border."""
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
