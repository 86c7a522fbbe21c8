"""Which columns of a dump of contacts hold what: told from the grains, or given by the user."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from loops import InputError
from loops.arrays import Floats, Integers
from patterns.snapshots.dumps.dump_files import Atoms
from patterns.snapshots.dumps.pairs import Pairs, Space, gaps, normals, pairs_of
from patterns.snapshots.frame import require_column
from patterns.snapshots.geometry import index_of, places_of
from patterns.snapshots.tables import WHOLE, Table
from patterns.snapshots.text import listed

Map = dict[str, str]

# Plain names of the contacts' columns of LAMMPS, and what they hold.
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
# Those of LIGGGHTS; forces act on atom 1, in all or in two parts.
LIGGGHTS_NAMES = ("id1", "id2", "fx", "fy", "fnx", "fny", "ftx", "fty", "delta")
PARTS = ("fnx", "fny", "ftx", "fty")
NONE = "none"  # what a map says of a column that the file lacks
# Positions, sizes and directions hold to this share: dumps have six digits or more.
TOLERANCE = 1e-3
PRECISE = 1e-6  # overlaps are small: they are told from other columns by more
KNOWN = 0.5  # share of a column that must be ids of grains
# Centres of a pair are at most this many times the sum of the radii apart: pair lists may hold
# neighbours beside contacts.
REACH = 1.5
AS_WRITTEN = "Give --columns as the dump was written, and both dumps of one step."
SAMPLE = 4096  # rows that are looked at to tell columns apart; all are checked at the end
MOST = 100  # columns among which vectors are looked for


def given_columns(table: Table, given: Mapping[str, str], names: Collection[str]) -> Map:
    """The columns that a map names for contacts; `InputError` for one that is not there."""
    columns = {name: column for name, column in given.items() if name in names}
    for name, column in columns.items():
        if column != NONE:
            require_column(name, column, table.names, table.path, ", or none")
    return columns


def are_ids(values: Floats, atoms: Atoms) -> bool:
    """Whether a column holds ids of grains.

    One unknown id is a fault to tell, a column without known ids holds something else.
    """
    if (np.rint(values) != values).any() or (np.abs(values) > WHOLE).any():
        return False
    return bool(np.mean(index_of(atoms.ids, values.astype(np.int64)) >= 0) > KNOWN)


def reach_of(atoms: Atoms, space: Space, one: Floats, two: Floats) -> float:
    """Largest distance of the centres over the sum of the radii, the worst 10 % left out."""
    i, j = (index_of(atoms.ids, values.astype(np.int64)) for values in (one, two))
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
    """Grains of the pairs: adds `id1` and `id2` to the map, of the choices those nearest."""
    rows = _sample_rows(table)
    known = {n: table.column(n)[rows] for pair in choices for n in pair}
    known = {n: values for n, values in known.items() if are_ids(values, atoms)}
    reach = [
        (reach_of(atoms, space, known[one], known[two]), (one, two))
        for one, two in choices
        if one in known and two in known
    ]
    best = min(reach, default=(np.inf, ("", "")), key=lambda item: item[0])
    if best[0] > REACH:
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
    return np.unique(np.linspace(0, len(table) - 1, SAMPLE).astype(np.int64))


def _named(columns: Map, names: Iterable[str]) -> str:
    return ", ".join(f"{name}={columns[name]}" for name in names)


def shares(vector: Floats, n: Floats) -> tuple[float, float]:
    """Parts of vectors (C, 2) along and across unit vectors, over their size; 0 for none."""
    size = np.sqrt(np.sum(vector**2)) or 1.0
    along = np.sqrt(np.sum(np.einsum("ck,ck->c", vector, n) ** 2))
    across = np.sqrt(np.sum((vector[:, 0] * n[:, 1] - vector[:, 1] * n[:, 0]) ** 2))
    return float(along / size), float(across / size)


class ColumnSearch:
    """Columns that nothing explains yet, and the search for two that form a vector."""

    def __init__(self, table: Table, data: dict[str, Floats], columns: Map, rows: Integers) -> None:
        self.table, self.columns, self.rows, self.data = table, columns, rows, data

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

        Of several the one whose size is a column comes first.
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
        sized = [pair for pair in found if size and self._size_of(pair, size)]
        found = sized or found
        if not found:
            return False
        if any(not self._same(found[0], other) for other in found[1:]):
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

    def _same(self, one: tuple[str, str], other: tuple[str, str]) -> bool:
        """Whether two vectors are one, up to its sign."""
        a, b = self._sample(one), self._sample(other)
        off = min(np.abs(a - b).max(), np.abs(a + b).max())
        return bool(off <= TOLERANCE * np.abs(a).max())

    def _sample(self, pair: tuple[str, str]) -> Floats:
        return np.column_stack([self.data[column][self.rows] for column in pair])

    def _check(self, names: tuple[str, str], error: float) -> None:
        if error > TOLERANCE:
            raise InputError(
                f"columns {_named(self.columns, names)} of {self.table.path}",
                f"vectors {error:.2g} off the branches of the grains",
                " and ".join(f"{name} ({CONTACT_NAMES[name]})" for name in names),
                AS_WRITTEN,
            )

    def _size(self, names: tuple[str, str], size: str) -> None:
        """Add the column of the vector's size, if there is one."""
        if size:
            self.find_size(size, np.hypot(*self.vector(names).T))

    def find_size(self, name: str, length: Floats) -> None:
        """Add the column whose sizes are `length` (C,) to the map, if there is one."""
        known = self.columns.get(name)
        found = self._equal(length[self.rows], [known] if known else self.free())
        if found is not None:
            self.columns[name] = found
        elif known and known != NONE:
            raise InputError(
                f"column {name}={known} of {self.table.path}",
                "other sizes than those of the vectors",
                CONTACT_NAMES[name],
                "Give --columns as the dump was written.",
            )

    def _size_of(self, pair: tuple[str, str], size: str) -> str | None:
        known = self.columns.get(size)
        free = [name for name in self.free() if name not in pair]
        return self._equal(np.hypot(*self._sample(pair).T), [known] if known else free)

    def _equal(self, length: Floats, names: list[str]) -> str | None:
        """The first column that holds these sizes, up to the sign."""
        limit = TOLERANCE * float(length.max(initial=0.0))
        for name in names:
            if name == NONE:
                continue
            if np.abs(np.abs(self.data[name][self.rows]) - length).max() <= limit:
                return name
        return None


class Guess(NamedTuple):
    """Plain names and their columns, the pairs, and the forces on atom 1 as far as they are told.

    `columns` maps names of `CONTACT_NAMES`; `normal`, `shear` are (C, 2) or None (force).
    """

    columns: Map
    pairs: Pairs
    normal: Floats | None
    shear: Floats | None


def guess_columns(table: Table, atoms: Atoms, space: Space, given: Mapping[str, str]) -> Guess:
    """Tell the columns of a dump of contacts apart: ids of grains that touch, distances, forces.

    The normal force is a vector along the branch, the tangential one across it; sizes are others.
    """
    columns = given_columns(table, given, CONTACT_NAMES)
    columns |= {name: name for name in CONTACT_NAMES if table.has(name) and name not in given}
    if len(table.names) > MOST and not {"id1", "id2", "fx", "fy"} <= set(columns):
        raise InputError(
            table.path,
            f"{len(table.names)} columns",
            f"at most {MOST} to tell apart",
            "Name them: --columns id1=COLUMN,id2=COLUMN,fx=COLUMN,fy=COLUMN,p1=COLUMN,p2=COLUMN.",
        )
    data = {name: table.column(name) for name in table.names}
    free = [name for name in table.names if name != "index"]
    ones, twos = ([columns[name]] if name in columns else free for name in ("id1", "id2"))
    choices = [(one, two) for one in ones for two in twos if one != two]
    expected = "patom1 and patom2 of 'compute property/local'"
    ids = find_ids(table, atoms, space, columns, choices, expected, "")
    search = ColumnSearch(table, data, columns, _sample_rows(table))
    pairs = _branches(search, atoms, space, *ids)
    normal, shear = _lammps_forces(search, pairs)
    return Guess(columns, pairs, normal, shear)


def _branches(search: ColumnSearch, atoms: Atoms, space: Space, i: Integers, j: Integers) -> Pairs:
    """Pairs with the images that dx, dy tell, else with the nearest ones."""
    near = pairs_of(atoms, space, i, j)
    reach = atoms.radii[i] + atoms.radii[j]

    def error(vector: Floats, rows: Integers) -> float:
        # Whole cells off are another image; the sign is the dump's own.
        if (np.hypot(*vector.T) > 2 * REACH * reach[rows]).any():
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


def _lammps_forces(search: ColumnSearch, pairs: Pairs) -> tuple[Floats | None, Floats | None]:
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
    # The size tells repulsion; else most contacts push. What pulls on atom 1 is that on atom 2.
    if np.sum((1.0 if push is None else push) * np.einsum("ck,ck->c", normal, n)) > 0:
        normal, shear = -normal, None if shear is None else -shear
    return normal, shear


def _require_nothing_left(search: ColumnSearch) -> None:
    """Raise `InputError` if columns that may be forces are left, and nobody said they aren't."""
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


# LIGGGHTS' `pair/gran/local`: columns have no names, but an order, whatever that of the keywords:
# pos (6), vel (6), id (3: two ids and the periodic flag), force (3), force_normal (3),
# force_tangential (3), torque (3), torque_normal (3), torque_tangential (3), history (as the
# model), contactArea, delta, heatFlux, contactPoint (3), ms_id (2); a group left out leaves no gap.
# So the ids come first, or after 6 or 12 columns, and the forces follow them.


class Contacts(NamedTuple):
    """Columns by plain names, pairs, total force on atom 1 (C, 2) and overlaps (C,) or None."""

    columns: Map
    pairs: Pairs
    force: Floats | None
    overlap: Floats | None


def read_contacts(table: Table, atoms: Atoms, space: Space, given: Map) -> Contacts:
    """Tell ids, forces and overlaps in the columns of `pair/gran/local`."""
    columns = given_columns(table, given, LIGGGHTS_NAMES)
    # Behind the ids stands the flag of the periodic border.
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
    if first >= 6:
        _check_positions(table, atoms, space, pairs, first)
    force = _force(table, pairs, columns, first + 3)
    return Contacts(columns, pairs, force, _overlap(table, atoms, pairs, columns, first + 3))


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
    for group in (("fx", "fy"), PARTS):
        found = [name for name in group if name in columns]
        if found and len(found) < len(group):
            where = f"--columns for the force of {table.path}"
            raise InputError(where, ", ".join(found), ", ".join(group), "Give the others as well.")
    if "fnx" in columns:
        normal, shear = (table.columns(columns[f"f{p}x"], columns[f"f{p}y"]) for p in "nt")
        for names, vector, wanted in ((PARTS[:2], normal, "along"), (PARTS[2:], shear, "across")):
            kind = _kind(pairs, vector)
            if kind not in (wanted, "zero"):
                raise InputError(
                    f"columns {_named(columns, names)} of {table.path}",
                    f"vectors {kind} to the branches of the grains",
                    f"vectors {wanted} them",
                    AS_WRITTEN,
                )
        force = normal + shear
    else:
        force = table.columns(columns["fx"], columns["fy"])
    if np.sum(force * pairs.d) > 0:
        raise InputError(
            f"columns {_named(columns, columns)} of {table.path}",
            "forces that pull the grains together",
            "forces on the first atom that push it away from the second",
            "Name the columns: --columns id1=COLUMN,id2=COLUMN,fx=COLUMN,fy=COLUMN.",
        )
    return force


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
            named = zip(PARTS, groups[1] + groups[2], strict=True)
            columns |= dict(named)
    elif sorted(kinds[:2]) == ["across", "along"]:
        groups = sorted(groups[:2], key=lambda group: kinds[groups.index(group)], reverse=True)
        columns |= dict(zip(PARTS, groups[0] + groups[1], strict=True))
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
    along, across = shares(vector, normals(pairs.d))
    if along == across == 0:
        return "zero"
    return "along" if across <= TOLERANCE else "across" if along <= TOLERANCE else "oblique"


def _small(vector: Floats, scale: Floats) -> bool:
    return bool(np.abs(vector).max() <= TOLERANCE * np.abs(scale).max())


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
