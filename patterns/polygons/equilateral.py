"""Equilateral, irregular polygons of equal grains."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops import GrainGraph, InputError, polygon_area, polygon_centroid
from patterns.polygons.ring import Floats, compressed_ring, is_simple

# A gap left to the closing two branches below this many branches leaves their direction open.
OPEN_DIRECTION = 1e-9


def equilateral_polygon(
    angles: ArrayLike, *, strain: ArrayLike = 0.0, radius: float = 0.5, kn: ArrayLike = 1.0
) -> GrainGraph:
    """Equilateral loop of equal grains with given branch directions.

    Of the n branch directions n - 2 are free, those of contacts 0 to n - 3. Contacts n - 2 and
    n - 1 follow: they bridge the gap that the others leave, turned by the same angle to either
    side of it, and meet in a corner that turns left (every polygon has such corners: number the
    grains so that grain n - 1 sits in one). The reference barely touches; nothing is said of
    opposite grains, see `opposite_gap`.

    Parameters
    ----------
    angles : (..., n - 2) array
        Directions of the first branches, from grain c to grain c + 1, to axis 1 (radians,
        counter-clockwise positive). From turning angles: their cumulative sum.
    strain : (...) array
        Isotropic strain `E1 = E2`, compression positive, below 1.
    radius : float
        Radius of the grains (length); the branches are `2 r` long.
    kn : (...) array
        Normal stiffness (force per length).

    Returns
    -------
    GrainGraph
        Grains counter-clockwise, contacts (c, c+1), centroid at the origin, `T = 0`.

    Raises
    ------
    InputError
        If the closing two branches are too short for the gap, or there is no gap and their
        direction is open; if the polygon crosses or touches itself, or runs clockwise.

    Examples
    --------
    >>> import numpy as np
    >>> from patterns import equilateral_polygon
    >>> house = equilateral_polygon(np.radians([0, 90, 150]))
    >>> np.degrees(np.arctan2(*np.diff(house.x, axis=0).T[::-1])).round(9).tolist()
    [0.0, 90.0, 150.0, -136.254244388]
    """
    given = np.asarray(angles, dtype=float)
    if given.ndim == 0 or given.shape[-1] < 1 or not np.isfinite(given).all():
        raise InputError(
            "angles", str(angles), "n - 2 finite branch directions, n >= 3", "Give the directions."
        )
    directions = np.concatenate([given, _closing(given)], axis=-1)
    units = np.stack([np.cos(directions), np.sin(directions)], axis=-1)
    corners = 2.0 * radius * (np.cumsum(units, axis=-2) - units)
    _check_outline(corners)
    x0 = corners - polygon_centroid(corners)[..., None, :]
    return compressed_ring(x0, np.full(directions.shape[-1], radius), strain, kn)


def _closing(directions: Floats) -> Floats:
    """(..., 2) directions of two unit branches that lead back to the start."""
    gap = -np.stack([np.cos(directions).sum(axis=-1), np.sin(directions).sum(axis=-1)], axis=-1)
    size = np.hypot(gap[..., 0], gap[..., 1])
    # The closing two may be one straight line, up to rounding.
    if not (size <= 2.0 * (1.0 + 4.0 * np.finfo(float).eps)).all():
        raise InputError(
            "angles",
            f"branches that leave a gap of {float(size.max()):.6g} branches",
            "a gap that the two closing branches can bridge, at most 2",
            "Turn the branches more.",
        )
    if not (size > OPEN_DIRECTION).all():
        raise InputError(
            "angles",
            "branches that close by themselves",
            "a gap for the two closing branches",
            "Give the directions of all branches but the last two.",
        )
    half = np.arctan2(np.sqrt(np.maximum((2.0 - size) * (2.0 + size), 0.0)), size)
    middle = np.arctan2(gap[..., 1], gap[..., 0])
    return np.stack([middle - half, middle + half], axis=-1)


def _check_outline(corners: Floats) -> None:
    for ok, received in (
        (is_simple(corners), "a polygon that crosses or touches itself"),
        (polygon_area(corners) > 0, "a clockwise polygon"),
    ):
        if not ok.all():
            raise InputError(
                "angles", received, "a counter-clockwise outline", "Correct the directions."
            )
