"""The diamond as a grain graph."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops import GrainGraph, InputError
from patterns.diamond.arguments import FloatArray, acute_angle, finite, positive, strain
from patterns.diamond.measures import overlap_ratio

CONTACTS = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])

# As alpha grows, branches (0, 1) and (2, 3) turn clockwise and the two others counter-clockwise;
# the graph counts T along the counter-clockwise tangent, the diamond along growing alpha.
SHEAR_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])

# Strains of a diamond that barely touches give an overlap of zero up to this rounding.
ROUNDING = 4.0 * np.finfo(np.float64).eps


def diamond(
    alpha0: ArrayLike,
    *,
    E1: ArrayLike = 0.0,
    E2: ArrayLike = 0.0,
    T: ArrayLike = 0.0,
    radius: ArrayLike = 0.5,
    kn: ArrayLike = 1.0,
) -> GrainGraph:
    """The diamond of four equal grains at strains `E1`, `E2`, centred on the origin.

    Grains run counter-clockwise: 0 right, 1 top, 2 left, 3 bottom. Contacts are (0, 1), (1, 2),
    (2, 3), (3, 0). In the reference the grains barely touch, `l0 = 2 radius`. The normal force
    follows from the positions, `N = kn (l0 - l)` (8a); the shear force is the caller's, because
    it depends on the path. Nothing is said of opposite grains: see `opposite_gaps`.

    Parameters
    ----------
    alpha0 : array_like (...)
        Reference angle between branch and axis 1 in (0, pi/2), radians.
    E1, E2 : array_like (...)
        Strains of the diagonals below 1, compression positive.
    T : array_like (...)
        Shear force in every contact, positive when alpha grows (unit of `kn * radius`).
    radius : array_like (...)
        Radius of the grains, positive.
    kn : array_like (...)
        Normal stiffness, positive. 1 gives dimensionless forces when `radius` is 0.5.

    Returns
    -------
    GrainGraph
        Batch axes are the broadcast shape of the arguments.

    Raises
    ------
    InputError
        If an argument leaves its range, or the strains open the contacts.

    Examples
    --------
    >>> graph = diamond(np.pi / 4, E1=0.3, E2=0.3)
    >>> graph.normal_force.round(12).tolist()
    [0.3, 0.3, 0.3, 0.3]
    >>> diamond(np.radians([35.0, 45.0, 55.0])).batch_shape
    (3,)
    """
    alpha0, radius = acute_angle("alpha0", alpha0), positive("radius", radius)
    E1, E2, T = strain("E1", E1), strain("E2", E2), finite("T", T)
    alpha0, E1, E2, T, radius, kn = np.broadcast_arrays(
        alpha0, E1, E2, T, radius, positive("kn", kn)
    )
    N = kn * 2.0 * radius * _closed_overlap(E1, E2, alpha0)
    cos, sin = np.cos(alpha0), np.sin(alpha0)
    return GrainGraph(
        x=_centres(2.0 * radius * (1.0 - E1) * cos, 2.0 * radius * (1.0 - E2) * sin),
        x0=_centres(2.0 * radius * cos, 2.0 * radius * sin),
        radii=radius[..., None] * np.ones(4),
        contacts=CONTACTS,
        normal_force=N[..., None] * np.ones(4),
        shear_force=T[..., None] * SHEAR_SIGNS,
    )


def _centres(half1: FloatArray, half2: FloatArray) -> FloatArray:
    """Centres (..., 4, 2) of a rhombus with half diagonals `half1`, `half2`."""
    zero = np.zeros_like(half1)
    x = np.stack([half1, zero, -half1, zero], axis=-1)
    y = np.stack([zero, half2, zero, -half2], axis=-1)
    return np.stack([x, y], axis=-1)


def _closed_overlap(E1: FloatArray, E2: FloatArray, alpha0: FloatArray) -> FloatArray:
    overlap = overlap_ratio(E1, E2, alpha0)
    if np.any(overlap < -ROUNDING):
        raise InputError(
            "E1, E2",
            f"strains that part the grains by {-float(np.min(overlap)):.3g} of the branch",
            "strains under which every contact still touches (l <= 2 radius)",
            "Compress the diamond, or leave the open contacts out.",
        )
    return np.maximum(overlap, 0.0)
