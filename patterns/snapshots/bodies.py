"""Grains and walls of a frame, and the contacts between them as indices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.tables import Table

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]

WALL = 1
# Centres leave their plane by less than this share of the smallest radius: text is that coarse.
PLANE_TOLERANCE = 1e-3
# Ids up to so many times their number are looked up in a table, others by bisection.
SPARSE = 8


class Bodies(NamedTuple):
    """Grains and walls of a table: `ids`, `is_wall` of all bodies, `x`, `radii` of the grains."""

    ids: Integers
    is_wall: Mask
    x: Floats
    radii: Floats

    @property
    def grain_ids(self) -> Integers:
        """(G,) array: ids of the grains."""
        return self.ids[~self.is_wall]


def read_bodies(table: Table) -> Bodies:
    """Grains and walls of a table.

    Parameters
    ----------
    table : Table
        `id, x, y, radius`, perhaps `type` and `z`.

    Returns
    -------
    Bodies
        By ascending id: the number of a loop must not depend on the order of a file.

    Raises
    ------
    InputError
        For ids that repeat, no grains, a radius that is not positive, coincident grains, and a
        packing in three dimensions.
    """
    ids = table.integers("id")
    refuse_repeated(table, ids)
    is_wall = table.integers("type") == WALL if table.has("type") else np.zeros(len(ids), bool)
    x, radii = table.columns("x", "y")[~is_wall], table.column("radius")[~is_wall]
    if (ids[1:] < ids[:-1]).any():
        order, grains = np.argsort(ids), np.argsort(ids[~is_wall])
        ids, is_wall, x, radii = ids[order], is_wall[order], x[grains], radii[grains]
    bodies = Bodies(ids, is_wall, x, radii)
    if len(radii) == 0:
        raise InputError(table.path, "walls alone", "grains", "Check the column 'type'.")
    if not (radii > 0).all():
        g = int(np.argmin(radii))
        raise InputError(
            f"radius of grain {bodies.grain_ids[g]} in {table.path}",
            str(radii[g]),
            "a positive length",
            "Correct the row, or give walls type 1.",
        )
    _refuse_third_dimension(table, bodies)
    _refuse_coincident(table, bodies)
    return bodies


def read_pairs(table: Table, bodies: Bodies) -> tuple[Integers, Integers]:
    """Bodies of every contact.

    Parameters
    ----------
    table : Table
        `id1, id2`.
    bodies : Bodies
        Whom they name.

    Returns
    -------
    named : (C, 2) array of int
        Indices among the bodies.
    grains : (C, 2) array of int
        Indices among the grains, -1 for walls.

    Raises
    ------
    InputError
        For an id that is unknown.
    """
    ids = bodies.ids
    given = np.column_stack([table.integers("id1"), table.integers("id2")])
    named = index_of(ids, given)
    unknown = named < 0
    if unknown.any():
        row, side = np.argwhere(unknown)[0]
        raise InputError(
            f"column 'id{side + 1}' of {table.path}, row {row}",
            f"grain {given[row, side]}",
            "an id of the table of grains",
            "Add the grain or drop the contact; check that both tables are of one instant.",
        )
    number = np.where(bodies.is_wall, -1, np.cumsum(~bodies.is_wall) - 1)
    return named, number[named]


def index_of(ids: Integers, named: Integers) -> Integers:
    """Place of ids in a list of distinct ones.

    Parameters
    ----------
    ids : (B,) array of int
        Distinct ids.
    named : (...) array of int
        Ids to look up.

    Returns
    -------
    (...) array of int
        Indices into `ids`, -1 for one that is not there.

    Examples
    --------
    >>> import numpy as np
    >>> from patterns.snapshots.bodies import index_of
    >>> index_of(np.array([7, 3]), np.array([3, 8])).tolist()
    [1, -1]
    """
    low, high = int(ids.min()), int(ids.max())
    if high - low < SPARSE * len(ids):
        place = np.full(high - low + 1, -1)
        place[ids - low] = np.arange(len(ids))
        inside = (named >= low) & (named <= high)
        return np.where(inside, place[np.where(inside, named - low, 0)], -1)
    order = np.argsort(ids)
    found = order[np.minimum(np.searchsorted(ids, named, sorter=order), len(ids) - 1)]
    return np.where(ids[found] == named, found, -1)


def refuse_repeated(table: Table, ids: Integers) -> None:
    """Raise `InputError` if an id stands twice in the table.

    Parameters
    ----------
    table : Table
        Where the ids come from, for the message.
    ids : (B,) array of int
        Its ids.

    Raises
    ------
    InputError
        Naming the id.
    """
    ordered = np.sort(ids)
    same = np.flatnonzero(ordered[1:] == ordered[:-1])
    if len(same) == 0:
        return
    repeated = ordered[same[0]]
    raise InputError(
        f"column 'id' of {table.path}",
        f"id {repeated} {np.count_nonzero(ids == repeated)} times",
        "each id once",
        "Keep one instant in the table and drop repeated rows.",
    )


def _refuse_third_dimension(table: Table, bodies: Bodies) -> None:
    if not table.has("z"):
        return
    z = table.column("z")[~bodies.is_wall]
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
    order = np.argsort(x[:, 0])
    level = x[order, 0]
    if not (level[1:] == level[:-1]).any():
        return
    order = np.lexsort(x.T[::-1])
    same = np.flatnonzero((x[order[1:]] == x[order[:-1]]).all(axis=1))
    if len(same) == 0:
        return
    pair = sorted(bodies.grain_ids[order[same[0] : same[0] + 2]].tolist())
    raise InputError(
        table.path,
        f"grains {pair[0]} and {pair[1]} at the same place",
        "distinct centres",
        "Drop one of the two.",
    )
