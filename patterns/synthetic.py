"""Synthetic contact networks of any size, planar by construction."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Integers
from loops.errors import InputError, number, whole_number
from loops.graph import GrainGraph
from loops.validation import finite

ROW_HEIGHT = np.sqrt(3) / 2
# Three discs of this radius around a unit triangle's corners are still missed by every line.
LARGEST_JITTER = np.sqrt(3) / 4
MEAN_FORCE = 1e-3  # of kn times the mean branch, as in a stiff packing


def synthetic_network(
    grains: int,
    *,
    seed: int = 0,
    periodic: bool = False,
    cell: ArrayLike | None = None,
    coordination: float = 3.7,
    jitter: float = 0.2,
    friction: float = 0.5,
) -> GrainGraph:
    """A random planar contact network, in the plane or in a periodic cell.

    A triangular lattice of unit spacing loses grains at random until `grains` are left, each
    grain moves at random within a disc of radius `jitter`, and contacts between lattice
    neighbours are drawn at random until the mean coordination is reached. Within
    `jitter < sqrt(3)/4` no triangle of the lattice can turn over, so branches never cross; the
    affine map onto a given `cell` keeps that. Dangling grains, grains without contact, bridges and
    clusters inside loops occur, as in a packing.

    A radius is half the grain's longest branch and 0.1 % more, so every contact overlaps. Forces
    are assigned, not derived from the overlaps (a planar network has more contacts than radii):
    N is exponential with a mean of 1e-3 of the mean branch (`kn = 1`), T is uniform within
    1.25 times Coulomb's bounds and cut off at them, so one contact in five slides. There is no
    equilibrium.

    Parameters
    ----------
    grains : int
        Number of grains, at least 2.
    seed : int
        Seed; the same arguments give the same network.
    periodic : bool
        Whether the network continues across the borders of its cell.
    cell : (2, 2) array, optional
        Cell whose columns are the cell vectors (length); makes the network periodic. By default
        the rectangle of the lattice.
    coordination : float
        Mean number of contacts per grain `2 C / G`, all grains counted, from 0 to 6. Small
        networks in the plane have fewer where the lattice has no more.
    jitter : float
        Radius of the disc that a grain moves in, in lattice spacings, at least 0.
    friction : float
        Coefficient mu in `|T| <= mu N`, at least 0.

    Returns
    -------
    GrainGraph
        The network. Positions may lie outside the cell by the jitter.

    Raises
    ------
    InputError
        If an argument is out of its range or the cell is singular.

    Examples
    --------
    >>> from patterns.synthetic import synthetic_network
    >>> graph = synthetic_network(100, seed=1, periodic=True)
    >>> graph.grain_count, graph.contact_count
    (100, 185)
    """
    grains, seed = whole_number("grains", grains, 2), whole_number("seed", seed, 0)
    number("coordination", coordination, 0.0, 6.0)
    number("jitter", jitter, 0.0, LARGEST_JITTER, open_high=True)
    number("friction", friction, 0.0)
    rng = np.random.default_rng(seed)
    aspect = 1.0  # length of the first cell vector over the height of the cell above it
    if cell is not None:
        box = finite("cell", cell, 2, 2)
        if np.linalg.det(box) == 0:
            expected = "two independent cell vectors as columns"
            raise InputError("cell", str(cell), expected, "Correct the cell.")
        aspect, periodic = float(box[:, 0] @ box[:, 0] / abs(np.linalg.det(box))), True

    # The smallest lattice that holds the grains, with an even number of rows to close periodically.
    columns = max(1, round(np.sqrt(grains * aspect * ROW_HEIGHT)))
    rows = -(-grains // columns)
    rows += rows % 2
    columns = -(-grains // rows)
    kept = np.sort(rng.choice(rows * columns, grains, replace=False))
    row, column = np.divmod(kept, columns)
    r, angle = jitter * np.sqrt(rng.random(grains)), 2 * np.pi * rng.random(grains)
    moved = np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    x = np.column_stack([column + 0.5 * (row % 2), ROW_HEIGHT * row]) + moved

    contacts, images = _neighbours(rows, columns, periodic)
    grain = np.full(rows * columns, -1)
    grain[kept] = np.arange(grains)
    contacts = grain[contacts]
    present = (contacts >= 0).all(axis=1)
    contacts, images = contacts[present], images[present]
    wanted = min(round(coordination * grains / 2), len(contacts))
    drawn = np.sort(rng.choice(len(contacts), wanted, replace=False))
    contacts, images = contacts[drawn], images[drawn]

    lattice = np.diag([columns, rows * ROW_HEIGHT])
    stretch = np.eye(2) if cell is None else box @ np.linalg.inv(lattice)
    x = x @ stretch.T
    if cell is None:
        box = lattice @ stretch.T
    d = x[contacts[:, 1]] - x[contacts[:, 0]] + images @ box.T
    branch = np.hypot(d[:, 0], d[:, 1])
    mean = branch.mean() if len(branch) else 1.0
    radii = np.full(grains, 0.25 * mean)
    np.maximum.at(radii, contacts, 0.5 * branch[:, None])
    normal = rng.exponential(MEAN_FORCE * mean, len(branch))
    mobilised = np.clip(1.25 * rng.uniform(-1, 1, len(branch)), -1, 1)
    return GrainGraph(
        x=x,
        radii=1.001 * radii,
        contacts=contacts,
        normal_force=normal,
        shear_force=mobilised * (friction * normal),
        images=images if periodic else None,
        cell=box if periodic else None,
    )


def _neighbours(rows: int, columns: int, periodic: bool) -> tuple[Integers, Integers]:
    """Each site with its neighbours to the right, above right and above left."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    right = column + row % 2
    there = np.stack([[row, column + 1], [row + 1, right], [row + 1, right - 1]], axis=1)
    image_row, j_row = np.divmod(there[0].T, rows)
    image_column, j_column = np.divmod(there[1].T, columns)
    j = j_row * columns + j_column
    i = np.broadcast_to(np.arange(rows * columns)[:, None], j.shape)
    contacts = np.column_stack([i.ravel(), j.ravel()])
    images = np.column_stack([image_column.ravel(), image_row.ravel()])
    inside = slice(None) if periodic else ~images.any(axis=1)
    return contacts[inside], images[inside]
