"""Grains and walls of a snapshot's tables, the contacts between them, and their branches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from loops import InputError
from loops.arrays import Flags, Floats, Integers, in_threads, median
from loops.compiled import given
from loops.errors import check_choice, counted
from loops.graph import reduced_cell
from loops.validation import real
from patterns.snapshots.columns import AXIAL, VECTORS
from patterns.snapshots.findings import Finding, finding
from patterns.snapshots.tables import HUGE, Table, require_columns

WALL = 1
GIVE_CELL = (
    "Give --cell HXX,HXY,HYX,HYY or a table, --cells FILE; "
    "in Python cell=[[h_xx, h_xy], [h_yx, h_yy]]."
)
# Largest scatter of centres across their plane over the smallest radius. A distance in the plane is
# then shorter by 3e-4 of the radius at most.
PLANE_TOLERANCE = 0.05
# A scatter that is more than rounding is noted.
PLANE_NOTED = 1e-6
# Grains of these distances over the sum of their radii (median) touch: others have wrong ids.
TOUCHING = 1.3
# Rows by which ids and columns are judged.
SAMPLE_ROWS = 4096
# From this share of the bodies on type 1 is a kind of grains, not of walls.
MOST_WALLS = 0.5
# Ids below this many times their number are looked up in a table, others by bisection.
SPARSE = 8
# Branches or normals of the file may differ from the centres by this share of the branch: the
# precision of text with six digits; a wrong cell or image makes a far larger difference.
GEOMETRY_TOLERANCE = 1e-3
# Discs without overlap fill at most 0.91 of the area; a fuller cell belongs to other grains.
SOLID_LIMIT = 1.5
# Largest distance in cells; beyond it digits are lost.
MOST_CELLS = 1e9
# No contact law acts between grains further apart than this many times the sum of their radii.
TOUCHING_REACH = 2.0
FAR_IN_LISTS = 32.0  # mean spacings between successive grains, grains between successive contacts
BRANCH_BLOCK = 1 << 15  # contacts processed together, so that their arrays stay in the cache


class Bodies(NamedTuple):
    """Grains of a table."""

    ids: Integers
    x: Floats
    radii: Floats
    rotation: Floats | None = None
    mass: Floats | None = None
    motion: Floats | None = None  # (G, 3): velocity and spin


def in_plane(tables: Sequence[Table]) -> tuple[list[Table], list[str]]:
    """Tables in the plane that the centres lie in, grains first: x and z, or y and z, as x and y.

    Scatter across it is left out, and noted; `InputError` for a packing in three dimensions.
    """
    grains = tables[0]
    axes = [axis for axis in "xyz" if grains.has(axis)]
    if "z" not in axes:
        return list(tables), []
    own = np.ones(len(grains), dtype=bool)
    if grains.has("type") and not (own := grains.integers("type") != WALL).any():
        own = ~own
    radii = grains.column("radius")[own]
    place = {axis: grains.column(axis)[own] for axis in axes}
    left = "xyz"[axis_across(place, radii, f"column 'z' of {grains.path}")]
    notes, smallest = [], float(radii.min())
    if left in axes and (spread := float(np.ptp(place[left]))) > PLANE_NOTED * smallest:
        notes.append(
            f"centres scatter by {spread:.3g} along {left}, which is left out: distances are "
            f"shorter by {spread**2 / (4 * smallest):.2g} at most"
        )
    if left == "z":
        return list(tables), notes
    notes.append(plane_note(left))
    return [_turned_into_plane(table, left) for table in tables], notes


def plane_note(left: str) -> str:
    """Note on a packing in the plane across this axis."""
    return f"a packing in the plane of {' and '.join('xyz'.replace(left, ''))}: z was taken for y"


def axis_across(place: Mapping[str, Floats], radii: Floats, where: str) -> int:
    """Number of the axis along which centres don't differ, z first, or which is not there."""
    for k in (2, 1, 0):
        values = place.get("xyz"[k])
        if values is None or np.ptp(values) <= PLANE_TOLERANCE * np.abs(radii).min():
            return k
    z = place["z"]
    raise InputError(
        where,
        f"centres from z = {z.min():g} to {z.max():g}",
        "a packing in two dimensions, all centres in one plane",
        "Loops are faces of a plane network and have no counterpart in three dimensions: "
        "simulate in a plane; a slice or projection of a 3D packing has no loops of its own.",
    )


def _turned_into_plane(table: Table, left: str) -> Table:
    """The table with its vectors in the plane across the axis `left`, named as in x and y."""
    axes = list(zip("xyz", "xyz".replace(left, "") + left, strict=True))
    names = {v.replace("@", new): v.replace("@", old) for v in VECTORS + AXIAL for new, old in axes}
    table = table.renamed(names)
    # x, z and -y are right-handed.
    for name in [v.replace("@", "z") for v in AXIAL] if left == "y" else ():
        if table.has(name):
            table = table.with_column(name, -table.column(name))
    return table


def read_ids(table: Table) -> Integers:
    """Ids of the bodies; without such a column the row is the id, from 0."""
    if not table.has("id"):
        return np.arange(len(table))
    ids = table.integers("id")
    refuse_repeated(table, ids)
    return ids


def named_rows(
    grains: Table, contacts: Table, ids: Integers, cell: Floats | None
) -> tuple[Integers, int, list[str]]:
    """(C, 2) array: rows of the bodies of every contact, the shift of their ids, and notes.

    The row of a wall that `type1` or `type2` tells is the number of bodies.
    Ids of contacts may be one more or less than those of the grains: taken so where they touch
    then, and don't as they are. `InputError` for an unknown id.
    """
    named = np.column_stack([contacts.integers(name) for name in ("id1", "id2")])
    walls, notes = np.asarray(False), list[str]()
    if contacts.has("type1", "type2"):
        types = np.column_stack([contacts.integers(name) for name in ("type1", "type2")])
        rows = (types != WALL).any(axis=1)
        found = index_of(ids, named[rows])
        if rows.any() and not (found.min() >= 0 and _touch(grains, found, cell)):
            walls = types != WALL
            notes.append(f"columns 'type1', 'type2': {counted(rows.sum(), 'contact')} with walls")
    for shift in (0, -1, 1, 0):
        moved = index_of(ids, named + shift if shift else named)
        if walls.any():
            moved = np.where(walls, len(ids), moved)
        if moved.min() >= 0 and _touch(grains, moved, cell):
            break
    if shift:
        by = "more" if shift < 0 else "less"
        notes.append(f"ids of {contacts.path} are one {by} than those of {grains.path}")
    if moved.min() < 0:
        require_columns((grains, ("id",)))
        remedy = "Add the grain or drop the contact; check that both tables are of one snapshot."
        refuse_unknown(contacts, ("id1", "id2"), named, moved, remedy)
    return moved, shift, notes


def _touch(grains: Table, rows: Integers, cell: Floats | None) -> bool:
    """Whether most of the pairs touch, contacts with walls, as far as they are known, left out."""
    few = sample_rows(len(rows))
    one, two = rows[few][rows[few].max(axis=1) < len(grains)].T
    if grains.has("type"):
        wall = grains.integers("type") == WALL
        if (inner := ~(wall[one] | wall[two])).any():
            one, two = one[inner], two[inner]
    x, y, radii = (grains.column(name) for name in ("x", "y", "radius"))
    d = np.column_stack([x[two] - x[one], y[two] - y[one]])
    return bool(median(_reach(d, radii[one] + radii[two], cell)) < TOUCHING)


def _reach(d: Floats, reach: Floats, cell: Floats | None) -> Floats:
    """Distances to the nearest image over the sums of the radii."""
    if cell is not None:
        d = d - nearest_images(d, cell) @ cell.T
    return np.hypot(*d.T) / np.where(reach > 0, reach, 1.0)


def told_walls(
    grains: Table, rows: Integers, cell: Floats | None, *, given: bool, others: bool
) -> tuple[Flags, list[str], list[Finding]]:
    """Bodies of type 1, walls unless they are discs that can't be any; notes and findings.

    `given` is whether the user names the column, `others` whether walls have a table of their own.
    """
    wall = grains.integers("type") == WALL if grains.has("type") else np.zeros(len(grains), bool)
    if given or not wall.any() or not (grains.column("radius")[wall] > 0).all():
        return wall, [], []
    own = rows[rows.max(axis=1) < len(grains)]
    of_walls = np.count_nonzero(wall[own], axis=1)
    reasons = (
        (bool((of_walls == 2).any()), "discs of type 1 touch one another"),
        (float(wall.mean()) >= MOST_WALLS, f"{100 * wall.mean():.3g} % of the discs are of type 1"),
        (cell is not None, "the sample is periodic"),
        (others, "walls have a table of their own"),
    )
    told = [words for holds, words in reasons if holds]
    if told:
        note = f"column 'type' of {grains.path} tells kinds of grains, not walls: {told[0]}"
        return np.zeros(len(wall), bool), [f"{note}; --columns type=type makes type 1 walls"], []
    one, two = own[of_walls == 1].T
    x, radii = grains.columns("x", "y"), grains.column("radius")
    if not len(one) or median(_reach(x[two] - x[one], radii[one] + radii[two], cell)) > TOUCHING:
        return wall, [], []
    return wall, [], [finding("type", float(wall.sum()), "discs")]


def read_bodies(
    table: Table, ids: Integers, is_wall: Flags, *, walls: bool = False, along_space: bool = False
) -> tuple[Bodies, Integers | None]:
    """Grains of a table, ascending by id, and the place of each row among them.

    The place of a wall is -1, also of `walls` beyond the table; no places if each row is its own.
    Grains whose ids jump across the
    sample are sorted along space instead if `along_space`: neighbouring grains are then close in
    memory in all that follows.
    """
    grains = np.flatnonzero(~is_wall)
    if len(grains) == 0:
        raise InputError(table.path, "walls alone", "grains", "Check the column 'type'.")
    if (ids[1:] < ids[:-1]).any():
        grains = grains[np.argsort(ids[grains])]
    if along_space:
        # Successive grains lie many mean spacings apart, as after a random insertion.
        x = some(table.columns("x", "y"), grains)
        spacing = np.sqrt(np.prod(np.ptp(x, axis=0)) / len(x))
        if median(np.abs(np.diff(x, axis=0)).sum(axis=1)) > FAR_IN_LISTS * spacing:
            from loops.compiled.network import spatial_order

            grains = grains[spatial_order(given(x, np.float64))]
    own, motion = table.take(grains), ("vx", "vy", "omega_z")
    bodies = Bodies(
        some(ids, grains),
        own.columns("x", "y"),
        own.column("radius"),
        own.column("theta_z") if own.has("theta_z") else None,
        own.column("mass") if own.has("mass") else None,
        own.columns(*motion) if own.has(*motion) else None,
    )
    refuse_radii(table, bodies.ids, bodies.radii, "Correct the row, or give walls type 1.")
    _refuse_coincident(table, bodies)
    place = None
    if walls or len(grains) < len(ids) or (grains[1:] < grains[:-1]).any():
        place = np.full(len(ids) + 1, -1)
        place[grains] = np.arange(len(grains))
    return bodies, place


def rows_between_grains(table: Table, pairs: Integers, *, along_space: bool) -> Integers:
    """Rows of the contacts between two grains, sorted by the first one if `along_space`.

    Contacts of a grain keep their order; `InputError` if there are none.
    """
    rows = np.arange(len(pairs))
    if along_space and not median(np.abs(np.diff(pairs[:, 0]))) < FAR_IN_LISTS:
        rows = np.sort((pairs[:, 0] << 32) | rows) & 0xFFFFFFFF
    if pairs.min() < 0:
        rows = rows[(pairs[rows] >= 0).all(axis=1)]
    if len(rows) == 0:
        raise InputError(table.path, "no contact between grains", "contacts", "Check the export.")
    return rows


def refuse_unknown(
    table: Table, names: Sequence[str], given: Integers, found: Integers, remedy: str,
    expected: str = "an id of the table of grains",
) -> None:  # fmt: skip
    """Raise `InputError` if the ids of some columns, (C, names), were not `found`."""
    if found.min() < 0:
        row, side = np.argwhere(found < 0)[0]
        where = f"column {names[side]!r} of {table.path}, row {table.number(row)}"
        raise InputError(where, f"grain {given[row, side]}", expected, remedy)


def sample_rows(count: int) -> Integers:
    """Rows by which columns and ids are recognised."""
    return np.unique(np.linspace(0, count - 1, SAMPLE_ROWS).astype(np.int64))


def index_of(ids: Integers, named: Integers) -> Integers:
    """Place of ids in a list of distinct ones, -1 for an unknown id."""
    low, high = int(ids.min()), int(ids.max())
    if high - low < SPARSE * len(ids):
        shift = np.where((named >= low) & (named <= high), named - low, -1)
        if high - low < len(ids) and (ids[1:] > ids[:-1]).all():
            return shift  # consecutive ids are places themselves
        # The last place is that of unknown ids.
        place = np.full(high - low + 2, -1)
        place[ids - low] = np.arange(len(ids))
        return place[shift]
    order = np.argsort(ids)
    found = order[np.minimum(np.searchsorted(ids, named, sorter=order), len(ids) - 1)]
    return np.where(ids[found] == named, found, -1)


def refuse_radii(table: Table, ids: Integers, radii: Floats, remedy: str) -> None:
    """Raise `InputError` for a radius that is not positive."""
    if len(radii) and radii.min() < 1 / HUGE:
        g = int(np.argmin(radii))
        where = f"radius of grain {ids[g]} in {table.path}"
        raise InputError(where, str(radii[g]), "a positive length", remedy)


def refuse_repeated(table: Table, ids: Integers) -> None:
    """Raise `InputError` if an id stands twice in the table."""
    if (ids[1:] > ids[:-1]).all():
        return
    values, count = np.unique(ids, return_counts=True)
    if len(values) == len(ids):
        return
    first = int(np.argmax(count > 1))
    received = f"id {values[first]} {count[first]} times"
    remedy = "Keep one snapshot in the table and drop repeated rows."
    raise InputError(f"column 'id' of {table.path}", received, "each id once", remedy)


def _refuse_coincident(table: Table, bodies: Bodies) -> None:
    x = bodies.x
    level = np.sort(x[:, 0])
    if not (level[1:] == level[:-1]).any():
        return
    order = np.lexsort(x.T[::-1])
    same = np.flatnonzero((x[order[1:]] == x[order[:-1]]).all(axis=1))
    if len(same) == 0:
        return
    pair = sorted(bodies.ids[order[same[0] : same[0] + 2]].tolist())
    received = f"grains {pair[0]} and {pair[1]} at the same place"
    raise InputError(table.path, received, "distinct centres", "Drop one of the two.")


def as_cell(cell: ArrayLike | None) -> Floats | None:
    """Return a periodic cell (2, 2), columns the cell vectors; `InputError` if it is no cell."""
    if cell is None:
        return None
    matrix = real("cell", cell, 2, 2, remedy="Give HXX, HXY, HYX, HYY: cell vectors as columns.")
    sound = bool((np.abs(matrix) <= HUGE).all())
    if not sound or not np.abs(np.linalg.det(matrix)) > 0:
        received = str(matrix.tolist())[:200]
        expected = "two independent cell vectors as the columns of HXX, HXY, HYX, HYY"
        raise InputError("cell", received, expected, "Give the cell of this snapshot.")
    return matrix


def as_periodic(word: str | None) -> tuple[bool, bool] | None:
    """Periodic directions of a word: `x`, `y` or `xy`."""
    if word is None:
        return None
    check_choice("periodic", word, ("x", "y", "xy"))
    return "x" in word, "y" in word


def check_cell(cell: ArrayLike | None, radii: Floats) -> Floats | None:
    """Return the periodic cell; `InputError` if the grains do not fit into it."""
    matrix = as_cell(cell)
    if matrix is None:
        return None
    solid = float(np.pi * np.sum(radii**2) / np.abs(np.linalg.det(matrix)))
    if solid > SOLID_LIMIT:
        raise InputError(
            "cell",
            f"{matrix.tolist()}, {solid:.3g} times filled by the grains",
            f"a cell that holds them (at most {SOLID_LIMIT} times filled)",
            "Check its unit and the order HXX, HXY, HYX, HYY.",
        )
    return matrix


def nearest_images(gap: Floats, cell: Floats, periodic: Sequence[bool] = (True, True)) -> Integers:
    """(C, 2) array: the whole cells nearest to the vectors `gap` (C, 2)."""
    # In a tilted cell the shares of the sides do not tell which image is near.
    sides = reduced_cell(cell) if all(periodic) else cell
    nearest = np.rint(np.linalg.solve(sides, gap.T).T) @ np.rint(np.linalg.solve(cell, sides)).T
    if (most := np.abs(nearest).max(initial=0.0)) > MOST_CELLS:
        received, expected = f"centres {most:.3g} periodic cells apart", f"at most {MOST_CELLS:.3g}"
        remedy = "Check the cell and the positions."
        raise InputError("positions of the grains", received, expected, remedy)
    return np.where(periodic, nearest, 0.0).astype(np.int64)


def high_cell(cell: Floats, free: int, x: Floats, margin: float) -> Floats:
    """The cell, in the direction `free` at least as high as the centres and a margin (length)."""
    inverse = np.linalg.inv(cell)[free]
    height = float(np.ptp(x @ inverse) + margin * np.linalg.norm(inverse))
    return np.asarray(cell * np.where(np.arange(2) == free, max(1.0, height), 1.0))


class Contacts(NamedTuple):
    """Contacts between grains: rows of a table, their `pairs` of grains, branches `d` and normals.

    `images` (C, 2) are None without a cell; `of_file` are the normals and branches of the file,
    `reach` (C,) the lengths over the sums of the radii.
    """

    table: Table
    bodies: Bodies
    pairs: Integers
    images: Integers | None
    d: Floats
    length: Floats
    n: Floats
    of_file: Mapping[str, Floats]
    reach: Floats

    @property
    def given(self) -> Floats | None:
        """(C, 2) normals of the file, else its branches, which many compute from the centres."""
        return self.of_file.get("normal", self.of_file.get("branch"))

    @property
    def overlap(self) -> Floats:
        """(C,) sums of the radii less the distances of the centres."""
        one, two = self.pairs.T
        return self.bodies.radii[one] + self.bodies.radii[two] - self.length


def read_contacts(
    table: Table,
    pairs: Integers,
    bodies: Bodies,
    cell: Floats | None,
    periodic: tuple[bool, bool] = (True, True),
) -> Contacts:
    """Contacts of the rows of a table.

    Images come from the file, else from its branches, else they are the nearest.
    """
    normals, branches = table.optional("nx", "ny"), table.optional("branch_x", "branch_y")
    of_file = {
        name: values
        for name, values in (("branch", branches), ("normal", normals))
        if values is not None
    }
    images = _images_of_file(table, cell)
    count, x, radii = len(pairs), bodies.x, bodies.radii
    made = np.zeros((count, 2), dtype=np.int64) if images is None and cell is not None else images
    d, n, length, reach = (np.empty(shape) for shape in ((count, 2), (count, 2), count, count))

    def fill(at: int) -> None:
        part = slice(at, at + BRANCH_BLOCK)
        one, two = pairs[part].T
        d[part] = x[two] - x[one]
        if cell is not None and made is not None:
            if images is None:
                near = (of_file["branch"][part] if "branch" in of_file else 0.0) - d[part]
                made[part] = nearest_images(near, cell, periodic)
            d[part] += made[part] @ cell.T
        length[part] = np.hypot(d[part, 0], d[part, 1])
        # Coincident grains are refused by the graph.
        size = np.where(length[part] > 0, length[part], 1.0)
        n[part], reach[part] = d[part] / size[:, None], size / (radii[one] + radii[two])

    in_threads(fill, range(0, count, BRANCH_BLOCK))
    return Contacts(table, bodies, pairs, made, d, length, n, of_file, reach)


def require_fitting(contacts: Contacts) -> None:
    """Raise `InputError` where branches of the file are not those of the centres, or too long."""

    def refuse(c: int, received: str, expected: str, remedy: str) -> NoReturn:
        one, two = contacts.bodies.ids[contacts.pairs[c]].tolist()
        table = contacts.table
        where = f"{table.path}, row {table.number(c)} (grains {one} and {two})"
        raise InputError(where, received, expected, remedy)

    of_cell = "Give --cell if the sample is periodic; else take both tables of one snapshot."
    if contacts.images is not None:
        of_cell = "Give the cell of this snapshot."
    for name, values in contacts.of_file.items():
        expected = contacts.d if name == "branch" else contacts.n
        off = np.hypot(*(values - expected).T)
        if name == "branch":
            off /= np.where(contacts.length > 0, contacts.length, 1.0)
        if off.max() <= GEOMETRY_TOLERANCE:
            continue
        c = int(np.argmax(off))
        turned = np.abs(values + expected).max() <= GEOMETRY_TOLERANCE * np.abs(expected).max()
        remedy = "All point from grain 2 to grain 1: exchange id1 and id2, or turn their signs."
        refuse(
            c,
            f"{name} {values[c].tolist()}",
            f"{expected[c].tolist()} from the centres, grain 1 to grain 2",
            remedy if turned else of_cell,
        )
    # If no grains overlap, the radii may be wrong: the checks explain it.
    reach = contacts.reach
    if reach.max() > TOUCHING_REACH and median(reach) < TOUCHING_REACH:
        c = int(np.argmax(reach))
        received = f"centres {reach[c]:.3g} times the sum of the radii apart"
        refuse(c, received, "grains that touch", of_cell)


def sums_on_grains(pairs: Integers, force: Floats, count: int) -> Floats:
    """(G, 2) sums of forces on the second grains of pairs, (2, C), with their reactions."""
    one, two = pairs.T
    return np.stack(
        [np.bincount(two, f, count) - np.bincount(one, f, count) for f in force], axis=1
    )


def some(values: Any, rows: Integers) -> Any:
    """Values of some rows; no copy if these are all rows in order."""
    if len(rows) == len(values) and bool((rows[1:] > rows[:-1]).all()):
        return values
    return values[rows]


def _images_of_file(table: Table, cell: Floats | None) -> Integers | None:
    if not table.has("cell_dx", "cell_dy"):
        return None
    images: Integers = np.column_stack([table.integers(f"cell_d{axis}") for axis in "xy"])
    if cell is None and images.any():
        c = int(np.argmax(images.any(axis=1)))
        where = f"{table.path}, row {table.number(c)}"
        received = f"periodic image {images[c].tolist()} and no cell"
        raise InputError(where, received, "the periodic cell", GIVE_CELL)
    return None if cell is None else images
