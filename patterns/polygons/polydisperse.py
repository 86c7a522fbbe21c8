"""Loops of unequal discs on a circle."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops import GrainGraph, InputError, polygon_centroid
from patterns.polygons.ring import Floats, compressed_ring

# Newton halves its distance at least, and ends quadratically: far more than it ever takes.
NEWTON_STEPS = 200


def polydisperse_polygon(
    radii: ArrayLike, *, strain: ArrayLike = 0.0, kn: ArrayLike = 1.0
) -> GrainGraph:
    """Barely touching loop of unequal discs whose centres lie on a circle.

    Branches are `r_i + r_(i+1)` long. A convex polygon on a circle with such sides always exists
    and is unique: the longest branch is shorter than its two neighbours together. The circle's
    centre lies outside the polygon where one branch is long against the others. Equal radii give
    `regular_polygon`. Nothing is said of opposite grains, which may overlap beside small grains:
    see `opposite_gap`.

    Parameters
    ----------
    radii : (..., n) array
        Radii of the grains in order (length, positive), n >= 3.
    strain : (...) array
        Isotropic strain `E1 = E2`, compression positive, below 1.
    kn : (...) array
        Normal stiffness (force per length).

    Returns
    -------
    GrainGraph
        Grains counter-clockwise, grain 0 in the direction of axis 1 from the circle's centre,
        contacts (c, c+1), centroid at the origin, `N = kn (r_i + r_j) strain`, `T = 0`.

    Raises
    ------
    InputError
        For fewer than three radii, or one that is not positive and finite.

    Examples
    --------
    >>> from patterns import polydisperse_polygon
    >>> from loops import contact_frame
    >>> contact_frame(polydisperse_polygon([1, 2, 1, 3]))[0].round(12).tolist()
    [3.0, 3.0, 4.0, 4.0]
    """
    size = np.asarray(radii, dtype=float)
    if size.ndim == 0 or size.shape[-1] < 3 or not (np.isfinite(size) & (size > 0)).all():
        raise InputError("radii", str(radii), "at least three positive lengths", "Correct them.")
    sides = size + np.roll(size, -1, axis=-1)
    directions = cyclic_directions(sides)
    edges = sides[..., None] * np.stack([np.cos(directions), np.sin(directions)], axis=-1)
    corners = np.cumsum(edges, axis=-2) - edges
    x0 = corners - polygon_centroid(corners)[..., None, :]
    return compressed_ring(x0, size, strain, kn)


def cyclic_directions(sides: Floats) -> Floats:
    """Directions of the sides of the polygon on a circle, the first corner towards axis 1.

    Half the angle `b` at the circle's centre over the longest side s solves
    `b + sum asin((s_i/s) sin b) = pi`, summed over the other sides. The left side is concave with
    the one root in (0, pi), beyond pi/2 where the centre is outside: Newton from the left stays on
    the left.

    Parameters
    ----------
    sides : (..., n) array
        Sides in order (length), each below the sum of the others.

    Returns
    -------
    (..., n) array
        Directions to axis 1 (radians).
    """
    longest = np.argmax(sides, axis=-1)[..., None]
    ratio = sides / np.take_along_axis(sides, longest, axis=-1)
    other = np.arange(sides.shape[-1]) != longest
    half = np.pi / np.where(other, ratio, 1.0).sum(axis=-1, keepdims=True)
    for _ in range(NEWTON_STEPS):
        step = _newton_step(half, ratio, other)
        half = half + step
        if (np.abs(step) <= 2.0 * np.finfo(float).eps * half).all():
            break
    halves = np.where(other, _half_angle(half, ratio)[0], half)
    return np.cumsum(2.0 * halves, axis=-1) - halves + 0.5 * np.pi


def _newton_step(half: Floats, ratio: Floats, other: Floats) -> Floats:
    angle, slope = _half_angle(half, ratio)
    value = np.where(other, angle, half).sum(axis=-1, keepdims=True) - np.pi
    slope = np.where(other, slope, 1.0).sum(axis=-1, keepdims=True)
    return -value / slope


def _half_angle(half: Floats, ratio: Floats) -> tuple[Floats, Floats]:
    """`asin(ratio sin b)` and its slope in b, without cancellation where the ratio is near 1."""
    sine, cosine = np.sin(half), np.cos(half)
    root = np.hypot(cosine, np.sqrt((1.0 - ratio) * (1.0 + ratio)) * sine)
    return np.arctan2(ratio * sine, root), ratio * cosine / root
