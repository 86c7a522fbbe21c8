"""Dumps of LAMMPS: atoms by `dump custom`, their contacts by `dump local`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from loops import InputError
from loops.arrays import Floats, Integers
from loops.errors import counted
from patterns.snapshots.columns import NONE, TABLE, check_names, components
from patterns.snapshots.dump_files import (
    ATOM_NAMES,
    PAIR_REACH,
    WALL_NAMES,
    Atoms,
    DumpFrame,
    FoundContacts,
    Map,
    find_ids,
    frames_of_dumps,
    given_columns,
    is_dump,
)
from patterns.snapshots.frame import Frames, Notes
from patterns.snapshots.geometry import Contacts, sample_rows
from patterns.snapshots.source import Source
from patterns.snapshots.tables import Table, listed

CONTACT_NAMES: dict[str, str] = TABLE["lammps"]
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

    def find(
        self, names: tuple[str, str], error: Callable[[Floats, Integers], float], size: str
    ) -> Floats | None:
        """(C, 2) vectors for which `error` is small, or those given, checked; None without any.

        Their columns join the map; of several pairs, one whose size is a column comes first.
        """
        known = [self.columns.get(name) for name in names]
        if NONE in known:
            return None
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
                return None
            self._require_one(names, found)
            self.columns |= dict(zip(names, found[0], strict=True))
        vectors = self.table.columns(*(self.columns[name] for name in names))
        if (off := error(vectors, np.arange(len(vectors)))) > TOLERANCE:
            mapped = ", ".join(f"{name}={self.columns[name]}" for name in names)
            raise InputError(
                f"columns {mapped} of {self.table.path}",
                f"vectors {off:.2g} off the branches of the grains",
                " and ".join(f"{name} ({CONTACT_NAMES[name]})" for name in names),
                "Give --columns as the dump was written, and both dumps of one step.",
            )
        if size:
            self.find_size(size, np.hypot(*vectors.T))
        return vectors

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
NO_SHEAR = "no tangential force (p1, p2) among the columns; --mu 0 for frictionless grains"


def is_lammps(path: Path, head: bytes) -> bool:
    """Whether this is a text dump; ask LIGGGHTS first, whose dumps of atoms look alike."""
    return is_dump(head)


def lammps_frames(source: Source) -> Frames:
    """Frames of a dump of atoms with the dump of their contacts, as docs/lammps.md has them.

    Columns of contacts are recognised from the grains, or given by a map of `CONTACT_NAMES`; walls
    are the per-atom columns of `fix wall/gran ... contacts`.
    """
    check_names(source.columns, (*ATOM_NAMES, *WALL_NAMES, *CONTACT_NAMES))

    def find(table: Table, atoms: Atoms, frame: DumpFrame, source: Source) -> FoundContacts:
        columns, contacts, normal, shear = guess_columns(table, atoms, source.columns)
        found = [(name, columns[name]) for name in CONTACT_NAMES if name in columns]
        shown = ", ".join(f"{name}={column}" for name, column in found if column != NONE)
        given = all(name in source.columns or name == column for name, column in found)
        overrule = "" if given else "; give --columns to overrule"
        notes: Notes = (f"columns{'' if given else ' guessed'}: {shown}{overrule}",)
        # On grain 2: the opposite of the forces on atom 1.
        forces: dict[str, Floats] = {}
        if normal is not None and shear is not None:
            forces, notes = components("f@_on_2", -(normal + shear)), (*notes, DAMPING)
        elif normal is not None:
            forces = {"fn": -np.einsum("ck,ck->c", normal, contacts.n)}
            notes = (*notes, DAMPING, NO_SHEAR)
        return FoundContacts(atoms, contacts, forces, notes)

    return frames_of_dumps(source, find)


def guess_columns(
    table: Table, atoms: Atoms, given: Mapping[str, str]
) -> tuple[Map, Contacts, Floats | None, Floats | None]:
    """Recognise the columns of a dump of contacts: ids of grains that touch, distances, forces.

    The normal force is a vector along the branch, the tangential one across it; sizes are others.
    """
    columns = given_columns(table, given, CONTACT_NAMES)
    columns |= {name: name for name in CONTACT_NAMES if table.has(name) and name not in given}
    if len(table.names) > MOST_COLUMNS and not {"id1", "id2", "fx", "fy"} <= set(columns):
        raise InputError(
            table.path,
            counted(len(table.names), "column"),
            f"at most {MOST_COLUMNS} to recognise columns in",
            "Name them: --columns id1=COLUMN,id2=COLUMN,fx=COLUMN,fy=COLUMN,p1=COLUMN,p2=COLUMN.",
        )
    free = [name for name in table.names if name != "index"]
    ones, twos = ([columns[name]] if name in columns else free for name in ("id1", "id2"))
    choices = [(one, two) for one in ones for two in twos if one != two]
    expected = "patom1 and patom2 of 'compute property/local'"
    pairs = find_ids(table, atoms, columns, choices, expected, "")
    search = ColumnSearch(table, columns)
    contacts = _branches(search, atoms, pairs)
    return columns, contacts, *_find_forces(search, contacts.n)


def _branches(search: ColumnSearch, atoms: Atoms, pairs: Integers) -> Contacts:
    """Contacts with the images by the columns dx, dy, else with the nearest ones."""
    contacts = atoms.contacts(search.table.path, pairs)
    d, reach = contacts.d, contacts.length + contacts.overlap

    def off(vector: Floats, sign: int, rows: Integers) -> Floats:
        # A difference of whole cells is another image.
        return np.hypot(*atoms.nearest(vector - sign * d[rows]).T) / reach[rows]

    def error(vector: Floats, rows: Integers) -> float:
        if (np.hypot(*vector.T) > 2 * PAIR_REACH * reach[rows]).any():
            return np.inf
        return float(min(off(vector, sign, rows).max() for sign in (1, -1)))

    vector = search.find(("dx", "dy"), error, "")
    if vector is not None:
        sign = 1 if off(vector, 1, np.arange(len(d))).max() <= TOLERANCE else -1
        contacts = atoms.contacts(search.table.path, pairs, sign * vector)
    search.find_size("dist", contacts.length)
    return contacts


def _find_forces(search: ColumnSearch, n: Floats) -> tuple[Floats | None, Floats | None]:
    """Normal and tangential force on atom 1, None for what the dump lacks; `n` are the normals."""
    normal = search.find(("fx", "fy"), lambda v, rows: shares(v, n[rows])[1], "force")
    size = search.columns.get("force", NONE)
    push = None if size == NONE else search.data[size]
    if normal is None and push is not None:
        normal = -push[:, None] * n
    shear = search.find(("p1", "p2"), lambda v, rows: shares(v, n[rows])[0], "p4")
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
