"""Where the second grain of each contact is: cell, images, and a check against the file."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import InputError
from patterns.snapshots.bodies import Bodies
from patterns.snapshots.tables import HUGE, Table

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Branches or normals of the file may differ from the centres by this share of the branch: text
# with six digits is that coarse, a wrong cell or image is far beyond.
GEOMETRY_TOLERANCE = 1e-3
# Discs pack to 0.91 of the area without overlap; beyond this the cell belongs to something else.
SOLID_LIMIT = 1.5
# Grains this many times the sum of their radii apart touch in no contact law.
REACH = 2.0


def as_cell(cell: ArrayLike | None) -> Floats | None:
    """Return a periodic cell (2, 2), columns the cell vectors; `InputError` for what is none."""
    if cell is None:
        return None
    try:
        matrix = np.asarray(cell, dtype=float)
    except (ValueError, TypeError):
        matrix = np.full(0, np.nan)
    sound = matrix.shape == (2, 2) and bool((np.abs(matrix) <= HUGE).all())
    if not sound or not np.abs(np.linalg.det(matrix)) > 0:
        raise InputError(
            "cell",
            str(matrix.tolist()),
            "two independent cell vectors as the columns of HXX, HXY, HYX, HYY",
            "Give the cell of this instant.",
        )
    return matrix


def check_cell(cell: ArrayLike | None, radii: Floats) -> Floats | None:
    """Return the periodic cell, or raise `InputError` if it can't be the one of these grains."""
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


def images_of(
    table: Table, rows: Integers, cell: Floats | None, x: Floats, pairs: Integers
) -> Integers | None:
    """Periodic image of the second grain of each contact.

    From the file; without them there, from the branches; else the nearest ones.

    Parameters
    ----------
    table : Table
        Contacts.
    rows : (C,) array of int
        Rows of the contacts between grains.
    cell : (2, 2) array or None
        Periodic cell.
    x : (G, 2) array
        Centres of the grains (length).
    pairs : (C, 2) array of int
        Grains of these contacts.

    Returns
    -------
    (C, 2) array of int or None
        Images; None without a cell.

    Raises
    ------
    InputError
        If the file has images and there is no cell.
    """
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
    gap = x[pairs[:, 0]] - x[pairs[:, 1]]
    branches = table.optional("branch_x", "branch_y")
    if branches is not None:
        gap += branches[rows]
    return np.rint(np.linalg.solve(cell, gap.T).T).astype(np.int64)


def check_geometry(
    table: Table, rows: Integers, bodies: Bodies, pairs: Integers, d: Floats, *, periodic: bool
) -> tuple[Floats, Floats]:
    """Lengths (C,) and unit normals (C, 2) of the branches `d` (C, 2), held against the file.

    `InputError` names the contact whose branch or normal in the file is furthest off, or whose
    grains are too far apart.
    """
    length = np.hypot(d[:, 0], d[:, 1])
    n = d / np.where(length > 0, length, 1.0)[:, None]
    expected, received, name = n, table.optional("nx", "ny"), "normal"
    branches = table.optional("branch_x", "branch_y")
    if branches is not None:
        expected, received, name = d, branches, "branch"
    if received is not None:
        received = received[rows]
        # Of a branch the share of its length; coincident grains are refused by the graph.
        scale = np.where(length > 0, length, 1.0) if name == "branch" else 1.0
        error = np.hypot(*(received - expected).T) / scale
        c = int(np.argmax(error))
        if error[c] > GEOMETRY_TOLERANCE:
            turned = (
                np.abs(received + expected).max() <= GEOMETRY_TOLERANCE * np.abs(expected).max()
            )
            raise InputError(
                _place(table, rows, bodies, pairs, c),
                f"{name} {received[c].tolist()}",
                f"{expected[c].tolist()} from the centres, grain 1 to grain 2",
                "All point from grain 2 to grain 1: exchange id1 and id2, or turn their signs."
                if turned
                else _remedy(periodic),
            )
    reach = length / bodies.radii[pairs].sum(axis=1)
    c = int(np.argmax(reach))
    # Where all are apart, the radii are in question: the checks tell why.
    if reach[c] > REACH and np.median(reach) < REACH:
        raise InputError(
            _place(table, rows, bodies, pairs, c),
            f"centres {reach[c]:.3g} times the sum of the radii apart",
            "grains that touch",
            _remedy(periodic),
        )
    return length, n


def _place(table: Table, rows: Integers, bodies: Bodies, pairs: Integers, c: int) -> str:
    one, two = bodies.grain_ids[pairs[c]].tolist()
    return f"{table.path}, row {rows[c]} (grains {one} and {two})"


def _remedy(periodic: bool) -> str:
    if periodic:
        return "Give the cell of this instant."
    return "Give --cell if the sample is periodic; else take both tables from one instant."
