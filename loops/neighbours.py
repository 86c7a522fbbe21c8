"""Pairs of grains, or of a grain and a wall, that are near one another."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from loops.arrays import Floats, Integers
from loops.validation import ordered


def new_pairs(
    grains: Integers,
    images: Integers,
    x: Floats,
    radii: Floats,
    cell: Floats,
    walls: Floats,
    gap: float,
) -> tuple[Integers, Integers]:
    """Return pairs (Q, 2) and images (Q, 2) closer than `gap`, without those that are known.

    The last bodies are points of `walls` (W, 2), their normals into the sample.
    """
    count = len(x) - len(walls)
    near, at = near_pairs(x[:count], cell, radii[:count], gap)
    if len(walls):
        away = np.sum((x[:count, None] - x[count:]) * walls, axis=2)
        grain, wall = np.nonzero(away < radii[:count, None] + gap)
        near = np.vstack([near[~at.any(axis=1)], np.column_stack([grain, count + wall])])
        at = np.zeros_like(near)
    found, known = codes((near, at), ordered(grains, images))
    new = ~np.isin(found, known)
    return near[new], at[new]


def near_pairs(x: Floats, cell: Floats, radii: Floats, gap: float) -> tuple[Integers, Integers]:
    """Pairs (P, 2) whose surfaces are closer than `gap`, smaller grain first, and their images."""
    reach = 2.0 * float(radii.max()) + gap
    share = np.linalg.solve(cell, x.T).T
    home = np.floor(share).astype(np.int64)
    share = share - home
    # Images of grains are needed up to this distance from the cell, in shares of its sides.
    margin = reach * np.linalg.norm(np.linalg.inv(cell), axis=1)
    count = np.ceil(margin).astype(int)
    shifts = np.stack(
        np.meshgrid(*(np.arange(-m, m + 1) for m in count), indexing="ij"), axis=-1
    ).reshape(-1, 2)
    copies = share[None] + shifts[:, None]
    shift, j = np.nonzero(((copies > -margin) & (copies < 1 + margin)).all(axis=2))
    tree = cKDTree(copies[shift, j] @ cell.T)
    found = cKDTree(share @ cell.T).sparse_distance_matrix(tree, reach, output_type="coo_matrix")
    i, other = found.row.astype(np.int64), found.col
    second, image = j[other], shifts[shift[other]] + home[i] - home[j[other]]
    first = i < second
    own = (i == second) & ((image[:, 0] > 0) | ((image[:, 0] == 0) & (image[:, 1] > 0)))
    close = found.data < radii[i] + radii[second] + gap
    kept = (first | own) & close
    return np.column_stack([i, second])[kept], image[kept]


def codes(*lists: tuple[Integers, Integers]) -> list[Integers]:
    """One number for each pair and image, the same in all lists."""
    bodies = max(int(grains.max(initial=0)) for grains, _ in lists) + 1
    farthest = max(int(np.abs(images).max(initial=0)) for _, images in lists)
    sides = 2 * farthest + 1
    return [
        ((grains[:, 0] * bodies + grains[:, 1]) * sides + images[:, 0]) * sides + images[:, 1]
        for grains, images in lists
    ]
