"""Snapshots in the plain table form: one table of grains, one of contacts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import GrainGraph, InputError, contact_frame
from loops.validation import find_duplicate
from patterns.snapshots.contact_columns import forces_of, law_of
from patterns.snapshots.snapshot import Snapshot
from patterns.snapshots.tables import Table

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

WALL = 1
# Branches or normals of the file may differ from the centres by this share of the branch: text
# with six digits is that coarse, a wrong cell or image is far beyond.
GEOMETRY_TOLERANCE = 1e-3
# Discs pack to 0.91 of the area without overlap; beyond this the cell belongs to something else.
SOLID_LIMIT = 1.5


def read_snapshot(
    path: str | Path,
    contacts: str | Path | None = None,
    *,
    cell: ArrayLike | None = None,
    kn: float | None = None,
    kt: float | None = None,
    mu: float | None = None,
) -> Snapshot:
    """Read one instant from a table of grains and a table of contacts.

    CSV, CSV.gz or Parquet, columns by name. Grains: `id`, `x`, `y`, `radius` (length); rows
    with `type` 1 are walls. Contacts: `id1`, `id2`; the branch `branch_x, branch_y` or the normal
    `nx, ny`, from grain 1 to grain 2; `fn` (force, compression positive); the shear force
    `fsx, fsy` or the total force `fx_on_2, fy_on_2` on grain 2; `kn`, `ks` (force per length).
    Optional: `mu`; `sliding` (0 or 1); `cell_dx, cell_dy`, the image of grain 2.

    Parameters
    ----------
    path : str or Path
        The table of grains.
    contacts : str or Path, optional
        The table of contacts. Found beside `path` if left out, `grains` in its name replaced by
        `contacts`.
    cell : (2, 2) array, optional
        Periodic cell, its columns are the cell vectors (length).
    kn, kt, mu : float, optional
        Stiffness (force per length) and friction where the table lacks the column; a column of
        the table comes first.

    Returns
    -------
    Snapshot
        Grains, contacts between grains, law, regimes and ids.

    Raises
    ------
    InputError
        For a missing, empty or truncated file, a missing column, a value that is no finite
        number, coincident grains, an id that is unknown or stands there twice, a radius that is
        not positive, a contact that stands there twice, a cell that does not fit, no contacts.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> snapshot = read_snapshot(sample_path())
    >>> snapshot.graph.grain_count, snapshot.graph.contact_count, snapshot.wall_contacts
    (600, 819, 61)
    """
    grains_path = Path(path)
    contacts_path = Path(contacts) if contacts is not None else _beside(grains_path)
    grains, table = Table(grains_path), Table(contacts_path)
    ids, is_wall, x, radii = _grains(grains)
    rows, pairs, wall_contacts = _pairs(table, ids, is_wall)
    matrix = _cell(cell, radii)
    images = _images(table, rows, matrix, x, pairs)
    place = _Place(table, rows, ids[~is_wall])
    duplicate = find_duplicate(pairs, images, len(x))
    if duplicate is not None:
        raise InputError(
            place.of(duplicate[1], pairs),
            f"the same contact as row {rows[duplicate[0]]}",
            "each contact once",
            "Drop one of the two rows.",
        )
    graph = GrainGraph(x=x, radii=radii, contacts=pairs, images=images, cell=matrix)
    length, n, t = contact_frame(graph)
    _check_geometry(place, pairs, length, n, periodic=matrix is not None)
    normal, shear = forces_of(table, rows, n, t)
    graph = graph.replace(normal_force=normal, shear_force=shear)
    law, regime, notes = law_of(table, rows, normal, shear, kn=kn, kt=kt, mu=mu)
    if images is not None and not images.any():
        notes = (*notes, "no contact crosses the border of the periodic cell")
    return Snapshot(graph, law, regime, ids[~is_wall], wall_contacts, notes)


class _Place:
    """Where a contact stands in its file, for messages."""

    def __init__(self, table: Table, rows: Integers, ids: Integers) -> None:
        self.table, self.rows, self.ids = table, rows, ids

    def of(self, contact: int, pairs: Integers) -> str:
        one, two = self.ids[pairs[contact]].tolist()
        return f"{self.table.path}, row {self.rows[contact]} (grains {one} and {two})"


def _beside(path: Path) -> Path:
    if "grains" not in path.name:
        raise InputError(
            f"name of {path}",
            "no 'grains' in it",
            "grains_... with contacts_... beside it",
            "Name the table of contacts explicitly.",
        )
    return path.with_name(path.name.replace("grains", "contacts"))


def _grains(table: Table) -> tuple[Integers, NDArray[np.bool_], Floats, Floats]:
    """Ids and wall flags of all bodies; centres and radii of the grains."""
    ids = table.integers("id")
    values, counts = np.unique(ids, return_counts=True)
    if counts.max() > 1:
        repeated = values[np.argmax(counts > 1)]
        raise InputError(
            f"column 'id' of {table.path}",
            f"id {repeated} {counts.max()} times",
            "each id once",
            "Keep one instant in the table and drop repeated rows.",
        )
    is_wall = table.integers("type") == WALL if table.has("type") else np.zeros(len(ids), bool)
    x = np.column_stack([table.column("x"), table.column("y")])[~is_wall]
    radii, own = table.column("radius")[~is_wall], ids[~is_wall]
    if len(own) == 0:
        raise InputError(str(table.path), "walls alone", "grains", "Check the column 'type'.")
    if not (radii > 0).all():
        g = int(np.argmin(radii))
        raise InputError(
            f"radius of grain {own[g]} in {table.path}",
            str(radii[g]),
            "a positive length",
            "Correct the row, or give walls type 1.",
        )
    order = np.lexsort(x.T)
    same = np.flatnonzero((x[order[1:]] == x[order[:-1]]).all(axis=1))
    if len(same):
        pair = sorted(own[order[same[0] : same[0] + 2]].tolist())
        raise InputError(
            str(table.path),
            f"grains {pair[0]} and {pair[1]} at the same place",
            "distinct centres",
            "Drop one of the two.",
        )
    return ids, is_wall, x, radii


def _pairs(
    table: Table, ids: Integers, is_wall: NDArray[np.bool_]
) -> tuple[Integers, Integers, int]:
    """Rows of contacts between grains, their grains as indices, number of wall contacts."""
    named = np.column_stack([table.integers("id1"), table.integers("id2")])
    order = np.argsort(ids)
    found = order[np.minimum(np.searchsorted(ids, named, sorter=order), len(ids) - 1)]
    unknown = ids[found] != named
    if unknown.any():
        row, side = np.argwhere(unknown)[0]
        raise InputError(
            f"column 'id{side + 1}' of {table.path}, row {row}",
            f"grain {named[row, side]}",
            "an id of the table of grains",
            "Add the grain or drop the contact; check that both tables are of one instant.",
        )
    with_wall = is_wall[found].any(axis=1)
    rows = np.flatnonzero(~with_wall)
    if len(rows) == 0:
        raise InputError(
            str(table.path), "no contact between grains", "contacts", "Check the export."
        )
    number = np.cumsum(~is_wall) - 1
    return rows, number[found[rows]], int(np.count_nonzero(with_wall))


def _cell(cell: ArrayLike | None, radii: Floats) -> Floats | None:
    if cell is None:
        return None
    matrix = np.asarray(cell, dtype=float)
    if matrix.shape != (2, 2) or not np.isfinite(matrix).all() or np.linalg.det(matrix) == 0:
        raise InputError(
            "cell",
            str(matrix.tolist()),
            "two independent cell vectors as the columns of HXX, HXY, HYX, HYY",
            "Give the cell of this instant.",
        )
    solid = float(np.pi * np.sum(radii**2) / np.abs(np.linalg.det(matrix)))
    if solid > SOLID_LIMIT:
        raise InputError(
            "cell",
            f"{matrix.tolist()}, {solid:.3g} times filled by the grains",
            f"a cell that holds them (at most {SOLID_LIMIT} times filled)",
            "Check its unit and the order HXX, HXY, HYX, HYY.",
        )
    return matrix


def _images(
    table: Table, rows: Integers, cell: Floats | None, x: Floats, pairs: Integers
) -> Integers | None:
    """Images from the file; without them, from the branches, else the nearest ones."""
    if table.has("cell_dx", "cell_dy"):
        images = np.column_stack([table.integers("cell_dx"), table.integers("cell_dy")])[rows]
        if cell is None and images.any():
            c = int(np.argmax(images.any(axis=1)))
            raise InputError(
                f"{table.path}, row {rows[c]}",
                f"periodic image {images[c].tolist()} and no cell",
                "the periodic cell",
                "Give --cell HXX,HXY,HYX,HYY.",
            )
        return None if cell is None else images
    if cell is None:
        return None
    target = np.zeros((len(rows), 2))
    if table.has("branch_x", "branch_y"):
        target = np.column_stack([table.column("branch_x"), table.column("branch_y")])[rows]
    gap = target - (x[pairs[:, 1]] - x[pairs[:, 0]])
    return np.rint(np.linalg.solve(cell, gap.T).T).astype(np.int64)


def _check_geometry(
    place: _Place, pairs: Integers, length: Floats, n: Floats, *, periodic: bool
) -> None:
    """Compare branches or normals of the file with the centres."""
    table, rows = place.table, place.rows
    if table.has("branch_x", "branch_y"):
        given = np.column_stack([table.column("branch_x"), table.column("branch_y")])[rows]
        error = np.linalg.norm(given - length[:, None] * n, axis=1) / length
        what, received = "branch", given
    else:
        given = np.column_stack([table.column("nx"), table.column("ny")])[rows]
        error = np.linalg.norm(given - n, axis=1)
        what, received = "normal", given
    if error.max() <= GEOMETRY_TOLERANCE:
        return
    c = int(np.argmax(error))
    expected = n[c] if what == "normal" else length[c] * n[c]
    remedy = (
        "Give the cell of this instant."
        if periodic
        else "Give --cell if the sample is periodic; else take both tables from one instant."
    )
    raise InputError(
        place.of(c, pairs),
        f"{what} {received[c].tolist()}",
        f"{expected.tolist()} from the centres, grain 1 to grain 2",
        remedy,
    )
