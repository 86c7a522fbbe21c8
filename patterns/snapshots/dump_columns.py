"""Columns of a dump of contacts: recognised from the grains, or given by the user."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping

import numpy as np

from loops import InputError
from loops.arrays import Floats, Integers
from patterns.snapshots.dump_files import Atoms, Space, pairs_of
from patterns.snapshots.frame import require_column
from patterns.snapshots.geometry import index_of, places_of
from patterns.snapshots.tables import Table
from patterns.snapshots.text import listed

Map = dict[str, str]
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
NONE = "none"  # entry of a column map for a column that the file lacks
# Relative tolerance of positions, sizes and directions: dumps have six digits or more.
TOLERANCE = 1e-3
KNOWN = 0.5  # share of a column that must be ids of grains
AGREEING = 0.5  # least share of rows that fit, by which a column is recognised
# Centres of a pair are at most this many times the sum of the radii apart: pair lists may hold
# neighbours beside contacts.
PAIR_REACH = 1.5
AS_WRITTEN = "Give --columns as the dump was written, and both dumps of one step."
SAMPLE_ROWS = 4096  # rows used to recognise columns; all rows are checked at the end


def given_columns(table: Table, given: Mapping[str, str], names: Collection[str]) -> Map:
    """Columns of contacts in the user's map; `InputError` for one that is not in the table."""
    columns = {name: column for name, column in given.items() if name in names}
    for name, column in columns.items():
        if column != NONE:
            require_column(name, column, table.names, table.path, ", or none")
    return columns


def ids_in(table: Table, name: str, rows: Integers, atoms: Atoms) -> Integers | None:
    """Some rows of a column if it holds ids of grains.

    Some unknown ids are reported as a fault later; a column of few known ids holds something else.
    """
    values = table.column(name)[rows]
    if (np.rint(values) != values).any():
        return None
    try:
        ids = table.integers(name)[rows]
    except InputError:
        return None
    return ids if np.mean(index_of(atoms.ids, ids) >= 0) > KNOWN else None


def reach_of(atoms: Atoms, space: Space, one: Integers, two: Integers) -> float:
    """Largest distance of the centres over the sum of the radii, the worst 10 % left out."""
    i, j = index_of(atoms.ids, one), index_of(atoms.ids, two)
    known = (i >= 0) & (j >= 0)
    i, j = i[known], j[known]
    if len(i) == 0 or (i == j).any():
        return np.inf
    d = pairs_of(atoms, space, i, j).d
    return float(np.quantile(np.hypot(*d.T) / (atoms.radii[i] + atoms.radii[j]), 0.9))


def find_ids(
    table: Table,
    atoms: Atoms,
    space: Space,
    columns: Map,
    choices: list[tuple[str, str]],
    expected: str,
    remedy: str,
) -> tuple[Integers, Integers]:
    """Grains of the pairs; `id1` and `id2` of the choice with the nearest grains join the map."""
    rows = _sample_rows(table)
    names = dict.fromkeys(n for pair in choices for n in pair)
    found = {n: ids_in(table, n, rows, atoms) for n in names}
    known = {n: ids for n, ids in found.items() if ids is not None}
    reach = [
        (reach_of(atoms, space, known[one], known[two]), (one, two))
        for one, two in choices
        if one in known and two in known
    ]
    best = min(reach, default=(np.inf, ("", "")), key=lambda item: item[0])
    if best[0] > PAIR_REACH:
        given = ", ".join(f"{n}={columns[n]}" for n in ("id1", "id2") if n in columns)
        raise InputError(
            f"columns {listed(table.names)} of {table.path}",
            f"no ids of two grains that touch{' with ' + given if given else ''}",
            expected,
            f"Name them: --columns id1=COLUMN,id2=COLUMN{remedy}.",
        )
    columns["id1"], columns["id2"] = best[1]
    other = "Take both dumps from one step of one run, with all the atoms."
    one, two = places_of(table, best[1], atoms.ids, "an id of the dump of atoms", other).T
    return one, two


def _sample_rows(table: Table) -> Integers:
    return np.unique(np.linspace(0, len(table) - 1, SAMPLE_ROWS).astype(np.int64))


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
        self.table, self.columns, self.rows = table, columns, _sample_rows(table)
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
