"""The search for columns that form a vector, among columns without names."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.tables import Table

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Map = dict[str, str]

# Plain names of the contacts' columns, and what they hold.
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
NONE = "none"  # what a map says of a column that the file lacks
# A property holds to this share: dumps have six digits or more.
TOLERANCE = 1e-3
# A property holds to this share: dumps have six digits or more.
TOLERANCE = 1e-3


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
        found = [
            pair
            for pair in self._choices(known)
            if (vector := self._sample(pair)).any() and error(vector, self.rows) <= TOLERANCE
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

    def _choices(self, known: list[str | None]) -> Iterator[tuple[str, str]]:
        free = self.free()
        for one in [known[0]] if known[0] else free:
            for two in [known[1]] if known[1] else free:
                if one != two:
                    yield one, two

    def _check(self, names: tuple[str, str], error: float) -> None:
        if error > TOLERANCE:
            what = " and ".join(f"{name} ({CONTACT_NAMES[name]})" for name in names)
            raise InputError(
                f"columns {', '.join(f'{name}={self.columns[name]}' for name in names)} of "
                f"{self.table.path}",
                f"vectors {error:.2g} off the branches of the grains",
                what,
                "Give --columns as the dump was written, and both dumps of one step.",
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
