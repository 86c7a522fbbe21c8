"""What the anonymous columns of a LAMMPS `dump local` are, told from the grains."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.bodies import index_of
from patterns.snapshots.dumps.column_search import CONTACT_NAMES, NONE, TOLERANCE, ColumnSearch, Map
from patterns.snapshots.dumps.dump_files import Atoms
from patterns.snapshots.dumps.dump_geometry import Pairs, Space, normals, pairs_of, require_ids
from patterns.snapshots.tables import Table

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Centres of a pair are at most this many times the sum of the radii apart: pair lists may hold
# neighbours beside contacts.
REACH = 1.5
KNOWN = 0.5  # share of a column that must be ids of grains
SAMPLE = 4096  # rows that are looked at to tell columns apart; all are checked at the end


class Guess(NamedTuple):
    """Plain names and their columns, the pairs, and the forces on atom 1 as far as they are told.

    `columns` maps names of `CONTACT_NAMES`; `normal`, `shear` are (C, 2) or None (force).
    """

    columns: Map
    pairs: Pairs
    normal: Floats | None
    shear: Floats | None


def guess_columns(table: Table, atoms: Atoms, space: Space, given: Mapping[str, str]) -> Guess:
    """Tell the columns of a dump of contacts apart.

    Two columns of whole numbers are ids of grains that touch; two are the components of their
    distance; two form a vector along the branch, the normal force, whose size is another column;
    two form one across it, the tangential force, likewise.

    Parameters
    ----------
    table : Table
        All columns of the dump.
    atoms : Atoms
        Grains.
    space : Space
        Cell.
    given : mapping of str to str
        Plain name to column, 'none' for what the file lacks; taken instead of a guess.

    Returns
    -------
    Guess
        Columns and what they hold.

    Raises
    ------
    InputError
        If a column given does not hold what its name says, or a guess is not possible or not
        unique; names the columns to give.
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
    columns |= {name: name for name in CONTACT_NAMES if name in table.names and name not in given}
    data = {name: table.column(name) for name in table.names}
    rows = np.unique(np.linspace(0, len(table) - 1, SAMPLE).astype(np.int64))
    _Ids(table, data, atoms, space, rows).add(columns)
    i, j = require_ids(
        table.path,
        (columns["id1"], columns["id2"]),
        atoms.ids,
        table.integers(columns["id1"]),
        table.integers(columns["id2"]),
    )
    search = ColumnSearch(table, data, columns, rows)
    pairs = _branches(search, atoms, space, i, j)
    normal, shear = _forces(search, pairs)
    return Guess(columns, pairs, normal, shear)


class _Ids:
    """The search for the two columns of ids."""

    def __init__(
        self, table: Table, data: dict[str, Floats], atoms: Atoms, space: Space, rows: Integers
    ) -> None:
        self.table, self.atoms, self.space = table, atoms, space
        self.sample = {name: values[rows] for name, values in data.items()}

    def add(self, columns: Map) -> None:
        """Add `id1` and `id2` to the map, or check those that are there."""
        known = [columns.get(name) for name in ("id1", "id2")]
        free = [name for name in self.sample if name != "index" and self._are_ids(name)]
        choices = [
            (one, two)
            for one, two in permutations(self.sample, 2)
            if (one == known[0] if known[0] else one in free)
            and (two == known[1] if known[1] else two in free)
        ]
        reach = [(self._reach(*choice), choice) for choice in choices]
        best = min(reach, default=(np.inf, ("", "")), key=lambda item: item[0])
        if best[0] > REACH:
            names = ", ".join(f"{n}={columns[n]}" for n in ("id1", "id2") if n in columns)
            raise InputError(
                f"columns {' '.join(self.table.names)} of {self.table.path}",
                f"no ids of two grains that touch{' with ' + names if names else ''}",
                "patom1 and patom2 of 'compute property/local'",
                "Name them: --columns id1=COLUMN,id2=COLUMN.",
            )
        columns["id1"], columns["id2"] = best[1]

    def _are_ids(self, name: str) -> bool:
        values = self.sample[name]
        if (np.rint(values) != values).any() or (np.abs(values) > 2.0**53).any():
            return False
        # One unknown id is a fault to tell, a column without known ids holds something else.
        return bool(np.mean(index_of(self.atoms.ids, values.astype(np.int64)) >= 0) > KNOWN)

    def _reach(self, one: str, two: str) -> float:
        """Largest distance of the centres over the sum of the radii, the worst 10 % left out."""
        if not (self._are_ids(one) and self._are_ids(two)):
            return np.inf
        i, j = (index_of(self.atoms.ids, self.sample[name].astype(int)) for name in (one, two))
        known = (i >= 0) & (j >= 0)
        i, j = i[known], j[known]
        if len(i) == 0 or (i == j).any():
            return np.inf
        d = pairs_of(self.atoms, self.space, i, j).d
        ratio = np.hypot(d[:, 0], d[:, 1]) / (self.atoms.radii[i] + self.atoms.radii[j])
        return float(np.quantile(ratio, 0.9))


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


def _forces(search: ColumnSearch, pairs: Pairs) -> tuple[Floats | None, Floats | None]:
    """Normal and tangential force on atom 1, None for what the dump lacks."""
    n = normals(pairs.d)

    def share(part: Floats, vector: Floats) -> float:
        size = float(np.sum(vector**2))
        return float(np.sqrt(np.sum(part**2) / size)) if size > 0 else 0.0

    def across(vector: Floats, rows: Integers) -> float:
        return share(vector[:, 0] * n[rows, 1] - vector[:, 1] * n[rows, 0], vector)

    def along(vector: Floats, rows: Integers) -> float:
        return share(np.einsum("ck,ck->c", vector, n[rows]), vector)

    normal, shear = None, None
    if search.find(("fx", "fy"), across, "force"):
        normal = search.vector(("fx", "fy"))
    size = search.columns.get("force", NONE)
    push = None if size == NONE else search.data[size]
    if normal is None and push is not None:
        normal = -push[:, None] * n
    if search.find(("p1", "p2"), along, "p4"):
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
        f"columns {' '.join(rest)} of {search.table.path}",
        "none that form a force along the branch",
        "fx, fy and p1, p2 of 'compute pair/local'",
        "Name them: --columns fx=COLUMN,fy=COLUMN,p1=COLUMN,p2=COLUMN, or force=COLUMN; fx=none "
        "for the geometry alone; for a file of LIGGGHTS --format liggghts.",
    )
