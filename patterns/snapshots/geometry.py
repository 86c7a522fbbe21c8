"""Grains and walls of a snapshot's tables, the contacts between them, and their branches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from loops import InputError
from loops.arrays import Flags, Floats, Integers, in_threads, median
from loops.compiled import given, on_parts, use_passes
from patterns.snapshots.tables import HUGE, Table

WALL = 1
GIVE_CELL = (
    "Give --cell HXX,HXY,HYX,HYY or a table, --cells FILE; "
    "in Python cell=[[h_xx, h_xy], [h_yx, h_yy]]."
)
# Largest distance of centres from their plane over the smallest radius: the precision of text.
PLANE_TOLERANCE = 1e-3
# Ids below this many times their number are looked up in a table, others by bisection.
SPARSE = 8
# Branches or normals of the file may differ from the centres by this share of the branch: the
# precision of text with six digits; a wrong cell or image makes a far larger difference.
GEOMETRY_TOLERANCE = 1e-3
# Discs without overlap fill at most 0.91 of the area; a fuller cell belongs to other grains.
SOLID_LIMIT = 1.5
# No contact law acts between grains further apart than this many times the sum of their radii.
TOUCHING_REACH = 2.0
FAR_IN_LISTS = 32.0  # mean spacings between successive grains, grains between successive contacts
BRANCH_BLOCK = 1 << 15  # contacts processed together, so that their arrays stay in the cache


class Bodies(NamedTuple):
    """Grains and walls of a table: `ids`, `is_wall` of all bodies, the rest of the grains."""

    ids: Integers
    is_wall: Flags
    x: Floats
    radii: Floats
    rotation: Floats | None
    mass: Floats | None
    motion: Floats | None = None  # (G, 3): velocity and spin

    @property
    def grain_ids(self) -> Integers:
        """(G,) array: ids of the grains."""
        return self.ids[~self.is_wall] if self.is_wall.any() else self.ids


def read_bodies(table: Table, *, along_space: bool = False) -> Bodies:
    """Grains and walls of a table, ascending by id; refuses what can't be a packing in the plane.

    Grains whose ids jump across the sample are sorted along space instead if `along_space`:
    neighbouring grains are then close in memory in all that follows.
    """
    ids = table.integers("id")
    refuse_repeated(table, ids)
    is_wall = table.integers("type") == WALL if table.has("type") else np.zeros(len(ids), bool)
    x, radii = table.columns("x", "y"), table.column("radius")
    rotation, mass = (
        table.column(name) if table.has(name) else None for name in ("theta_z", "mass")
    )
    velocities = ("vx", "vy", "omega_z")
    motion = table.columns(*velocities) if table.has(*velocities) else None
    grains = np.flatnonzero(~is_wall)
    if (ids[1:] < ids[:-1]).any():
        order = np.argsort(ids)
        grains = order[~is_wall[order]]
        ids, is_wall = ids[order], is_wall[order]
    if len(grains) < len(x) or (grains[1:] < grains[:-1]).any():
        x, radii = x[grains], radii[grains]
        rotation, mass, motion = (
            None if values is None else values[grains] for values in (rotation, mass, motion)
        )
    if along_space:
        # Successive grains lie many mean spacings apart, as after a random insertion.
        spacing = np.sqrt(np.ptp(x[:, 0]) * np.ptp(x[:, 1]) / len(x))
        if median(np.abs(np.diff(x[:, 0])) + np.abs(np.diff(x[:, 1]))) > FAR_IN_LISTS * spacing:
            from loops.compiled.network import spatial_order

            order = spatial_order(given(x, np.float64))
            x, radii = some(x, order), some(radii, order)
            rotation, mass, motion = (
                None if values is None else some(values, order)
                for values in (rotation, mass, motion)
            )
            # Walls stand behind the grains.
            if is_wall.any():
                order = np.append(np.flatnonzero(~is_wall)[order], np.flatnonzero(is_wall))
            ids, is_wall = some(ids, order), is_wall[order]
    bodies = Bodies(ids, is_wall, x, radii, rotation, mass, motion)
    if len(radii) == 0:
        raise InputError(table.path, "walls alone", "grains", "Check the column 'type'.")
    refuse_radii(table, bodies.grain_ids, radii, "Correct the row, or give walls type 1.")
    _refuse_third_dimension(table, bodies)
    _refuse_coincident(table, bodies)
    return bodies


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


def read_pairs(table: Table, bodies: Bodies) -> Integers:
    """(C, 2) array: grains of every contact, -1 for walls; `InputError` for an unknown id."""
    expected = "an id of the table of grains"
    remedy = "Add the grain or drop the contact; check that both tables are of one snapshot."
    named = places_of(table, ("id1", "id2"), bodies.ids, expected, remedy)
    if not bodies.is_wall.any():
        return named
    return np.where(bodies.is_wall, -1, np.cumsum(~bodies.is_wall) - 1)[named]


def places_of(
    table: Table, names: tuple[str, str], ids: Integers, expected: str, remedy: str
) -> Integers:
    """(C, 2) array: places of the ids of two columns; `InputError` for an unknown id."""
    given = np.column_stack([table.integers(name) for name in names])
    found = index_of(ids, given)
    if found.min() < 0:
        row, side = np.argwhere(found < 0)[0]
        where = f"column {names[side]!r} of {table.path}, row {row}"
        raise InputError(where, f"grain {given[row, side]}", expected, remedy)
    return found


def index_of(ids: Integers, named: Integers) -> Integers:
    """Place of ids in a list of distinct ones, -1 for an unknown id."""
    low, high = int(ids.min()), int(ids.max())
    if high - low < SPARSE * len(ids):
        place = named - low
        every = bool(place.min(initial=0) >= 0 and place.max(initial=0) <= high - low)
        if not every:
            known = (place >= 0) & (place <= high - low)
            place = np.where(known, place, 0)
        # Consecutive ids are places themselves.
        if high - low >= len(ids) or (ids[1:] < ids[:-1]).any():
            at = np.full(high - low + 1, -1)
            at[ids - low] = np.arange(len(ids))
            place = at[place]
        return place if every else np.where(known, place, -1)
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
    ordered = np.sort(ids)
    same = np.flatnonzero(ordered[1:] == ordered[:-1])
    if len(same) == 0:
        return
    repeated = ordered[same[0]]
    received = f"id {repeated} {np.count_nonzero(ids == repeated)} times"
    remedy = "Keep one snapshot in the table and drop repeated rows."
    raise InputError(f"column 'id' of {table.path}", received, "each id once", remedy)


def _refuse_third_dimension(table: Table, bodies: Bodies) -> None:
    if not table.has("z"):
        return
    z = table.column("z")
    if table.has("type"):
        z = z[table.integers("type") != WALL]
    if np.ptp(z) <= PLANE_TOLERANCE * bodies.radii.min():
        return
    raise InputError(
        f"column 'z' of {table.path}",
        f"centres from z = {z.min():g} to {z.max():g}",
        "a packing in two dimensions, all centres in one plane",
        "Loops are faces of a plane network and have no counterpart in three dimensions: "
        "simulate in a plane; a slice or projection of a 3D packing has no loops of its own.",
    )


def _refuse_coincident(table: Table, bodies: Bodies) -> None:
    x = bodies.x
    level = np.sort(x[:, 0])
    if not (level[1:] == level[:-1]).any():
        return
    order = np.lexsort(x.T[::-1])
    same = np.flatnonzero((x[order[1:]] == x[order[:-1]]).all(axis=1))
    if len(same) == 0:
        return
    pair = sorted(bodies.grain_ids[order[same[0] : same[0] + 2]].tolist())
    received = f"grains {pair[0]} and {pair[1]} at the same place"
    raise InputError(table.path, received, "distinct centres", "Drop one of the two.")


def as_cell(cell: ArrayLike | None) -> Floats | None:
    """Return a periodic cell (2, 2), columns the cell vectors; `InputError` if it is no cell."""
    if cell is None:
        return None
    try:
        matrix = np.asarray(cell, dtype=float)
    except (ValueError, TypeError):
        matrix = np.full(0, np.nan)
    sound = matrix.shape == (2, 2) and bool((np.abs(matrix) <= HUGE).all())
    if not sound or not np.abs(np.linalg.det(matrix)) > 0:
        received = str(matrix.tolist())[:200]
        expected = "two independent cell vectors as the columns of HXX, HXY, HYX, HYY"
        raise InputError("cell", received, expected, "Give the cell of this snapshot.")
    return matrix


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


class ContactBranches(NamedTuple):
    """Branches of the contacts between grains: `images` (C, 2) or None, `d`, `length`, `n`.

    `given` (C, 2) are the normals of the file, else its branches, None if it has neither.
    """

    images: Integers | None
    d: Floats
    length: Floats
    n: Floats
    given: Floats | None


def read_branches(
    table: Table, rows: Integers, pairs: Integers, bodies: Bodies, cell: Floats | None
) -> ContactBranches:
    """Branches of the contacts in some rows of the table, compared with those of the file.

    Images come from the file, else from its branches, else they are the nearest.
    """
    normals, branches = table.optional("nx", "ny"), table.optional("branch_x", "branch_y")
    of_file = {
        name: some(values, rows)
        for name, values in (("branch", branches), ("normal", normals))
        if values is not None
    }
    images = _images_of_file(table, rows, cell)
    count = len(rows)
    made = np.zeros((count, 2), dtype=np.int64) if images is None and cell is not None else images
    d, n, length, reach = (np.empty(shape) for shape in ((count, 2), (count, 2), count, count))
    off = {name: np.zeros(count) for name in of_file}
    by_kernel = use_passes(count)
    if by_kernel:
        from loops.compiled.passes import fill_branches
    x, radii = given(bodies.x, np.float64), given(bodies.radii, np.float64)
    contacts = given(pairs, np.int64)

    def fill(at: int) -> None:
        part = slice(at, at + BRANCH_BLOCK)
        across = np.zeros((0, 2))
        if cell is not None and made is not None:
            if images is None:
                near = bodies.x[pairs[part, 0]] - bodies.x[pairs[part, 1]]
                near = of_file["branch"][part] + near if "branch" in of_file else near
                made[part] = np.rint(np.linalg.solve(cell, near.T).T)
            across = made[part] @ cell.T
        if by_kernel:
            filled = d[part], length[part], n[part], reach[part]
            fill_branches(x, radii, contacts[part], across, *filled)
        else:
            one, two = contacts[part].T
            d[part] = x[two] - x[one] + (across if cell is not None else 0.0)
            length[part] = np.hypot(d[part, 0], d[part, 1])
            # Coincident grains are refused by the graph.
            size = np.where(length[part] > 0, length[part], 1.0)
            n[part], reach[part] = d[part] / size[:, None], size / (radii[one] + radii[two])
        for name, values in of_file.items():
            own = (d if name == "branch" else n)[part]
            off[name][part] = np.hypot(*(values[part] - own).T)
        if "branch" in of_file:
            off["branch"][part] /= np.where(length[part] > 0, length[part], 1.0)

    in_threads(fill, range(0, count, BRANCH_BLOCK))
    made_branches = ContactBranches(
        *(made, d, length, n),
        # Normals come first: branches of many files are computed from the centres.
        of_file.get("normal", of_file.get("branch")),
    )
    _require_fitting(table, rows, pairs, bodies, made_branches, of_file, off, reach)
    return made_branches


def _require_fitting(
    table: Table,
    rows: Integers,
    pairs: Integers,
    bodies: Bodies,
    branches: ContactBranches,
    of_file: Mapping[str, Floats],
    off: Mapping[str, Floats],
    reach: Floats,
) -> None:
    """Raise `InputError` where branches of the file are not those of the centres, or too long.

    `off` is how far each of the file is off, `reach` each length over the sum of the radii.
    """

    def refuse(c: int, received: str, expected: str, remedy: str) -> NoReturn:
        one, two = bodies.grain_ids[pairs[c]].tolist()
        where = f"{table.path}, row {rows[c]} (grains {one} and {two})"
        raise InputError(where, received, expected, remedy)

    of_cell = "Give --cell if the sample is periodic; else take both tables of one snapshot."
    if branches.images is not None:
        of_cell = "Give the cell of this snapshot."
    for name, values in of_file.items():
        if off[name].max() <= GEOMETRY_TOLERANCE:
            continue
        c = int(np.argmax(off[name]))
        expected = branches.d if name == "branch" else branches.n
        turned = np.abs(values + expected).max() <= GEOMETRY_TOLERANCE * np.abs(expected).max()
        remedy = "All point from grain 2 to grain 1: exchange id1 and id2, or turn their signs."
        refuse(
            c,
            f"{name} {values[c].tolist()}",
            f"{expected[c].tolist()} from the centres, grain 1 to grain 2",
            remedy if turned else of_cell,
        )
    # If no grains overlap, the radii may be wrong: the checks explain it.
    if reach.max() > TOUCHING_REACH and median(reach) < TOUCHING_REACH:
        c = int(np.argmax(reach))
        received = f"centres {reach[c]:.3g} times the sum of the radii apart"
        refuse(c, received, "grains that touch", of_cell)


def some(values: Any, rows: Integers) -> Any:
    """Values of some rows; no copy if these are all rows in order."""
    if len(rows) == len(values) and bool((rows[1:] > rows[:-1]).all()):
        return values
    if not use_passes(len(rows)):
        return values[rows]
    # Rows in random order wait for the memory: on several cores at once.
    picked = np.empty((len(rows), *values.shape[1:]), dtype=values.dtype)

    def fill(part: slice) -> None:
        np.take(values, rows[part], axis=0, out=picked[part], mode="clip")

    on_parts(fill, len(rows))
    return picked


def _images_of_file(table: Table, rows: Integers, cell: Floats | None) -> Integers | None:
    if not table.has("cell_dx", "cell_dy"):
        return None
    images: Integers = np.column_stack([some(table.integers(f"cell_d{a}"), rows) for a in "xy"])
    if cell is None and images.any():
        c = int(np.argmax(images.any(axis=1)))
        where = f"{table.path}, row {rows[c]}"
        received = f"periodic image {images[c].tolist()} and no cell"
        raise InputError(where, received, "the periodic cell", GIVE_CELL)
    return None if cell is None else images
