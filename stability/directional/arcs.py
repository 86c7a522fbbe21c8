"""Directions of the plane as angles, tan(theta) = e2/e1, and the arcs between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Arcs this short separate angles that are the same up to rounding.
NO_ARC = 1e-13


def plane_directions(angle: Floats) -> Floats:
    """Unit directions (..., 2) at angles (...)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def line_angles(lines: Floats) -> Floats:
    """Both angles in [0, 2 pi) at which each row of (..., L, 2) vanishes: (..., 2 L), ascending.

    Examples
    --------
    >>> (line_angles(np.array([[0.0, 1.0], [1.0, 0.0]])) / np.pi).tolist()
    [0.0, 0.5, 1.0, 1.5]
    """
    angle = np.arctan2(-lines[..., 0], lines[..., 1])
    both = np.concatenate([angle, angle + np.pi], axis=-1)
    return np.sort(np.mod(both, 2.0 * np.pi), axis=-1)


def middles(angle: Floats) -> Floats:
    """Middle of the arc from each of the ascending angles (..., A) to the next, around."""
    middle = 0.5 * (angle + np.roll(angle, -1, axis=-1))
    middle[..., -1] += np.pi
    return np.asarray(middle)


def widths(angle: Floats) -> Floats:
    """Length of the arc from each of the ascending angles (..., A) to the next; 2 pi in all."""
    width = np.roll(angle, -1, axis=-1) - angle
    width[..., -1] += 2.0 * np.pi
    return np.asarray(width)


def edges_of(angle: Floats, inside: NDArray[np.bool_]) -> Floats:
    """Angles at which the arcs change from inside to outside or back.

    Parameters
    ----------
    angle : (..., A) array
        Ascending, in [0, 2 pi).
    inside : (..., A) array of bool
        For the arc from each angle to the next.

    Returns
    -------
    (..., B) array
        Ascending, NaN behind the last.

    Examples
    --------
    >>> edges_of(np.array([0.0, 1.0, 2.0, 3.0]), np.array([True, True, False, False])).tolist()
    [0.0, 2.0]
    """
    count = angle.shape[-1]
    # An arc without length is like the last one with a length before it.
    order = np.where(widths(angle) > NO_ARC, np.arange(count), -1)
    twice = np.concatenate([order, np.where(order >= 0, order + count, -1)], axis=-1)
    before = np.maximum.accumulate(twice, axis=-1)[..., count - 1 :]
    known = np.take_along_axis(inside, before % count, axis=-1)
    changes = known[..., 1:] != known[..., :-1]
    edges = np.sort(np.where(changes, angle, np.nan), axis=-1)
    return edges[..., : int(changes.sum(axis=-1).max(initial=0))]
