"""Geometry and balance of the diamond (11) to (21), and the diamond as a grain graph.

Four equal discs form a rhombus of side `l`; `alpha` is the angle between a branch and axis 1.
Forces and strains are positive in compression. `T` is positive when `alpha` grows
(`T' = kt l alpha'`). Angles are radians. All arguments broadcast.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops import GrainGraph, InputError
from loops.arrays import Floats
from loops.validation import acute_angle, finite, nonnegative, positive, strain

DIAMOND_SIDES = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
# As alpha grows, branches (0, 1) and (2, 3) turn clockwise and the two others counter-clockwise;
# the graph counts T along the counter-clockwise tangent, the diamond along growing alpha.
DIAMOND_SHEAR_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])
# Strains of a diamond that barely touches give an overlap of zero up to this rounding.
TOUCHING_ATOL = 4.0 * np.finfo(np.float64).eps


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
    it depends on the path. Overlaps of opposite grains are not checked: see `opposite_gaps`.

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
        contacts=DIAMOND_SIDES,
        normal_force=N[..., None] * np.ones(4),
        shear_force=T[..., None] * DIAMOND_SHEAR_SIGNS,
    )


def _centres(half1: Floats, half2: Floats) -> Floats:
    """Centres (..., 4, 2) of a rhombus with half diagonals `half1`, `half2`."""
    zero = np.zeros_like(half1)
    x = np.stack([half1, zero, -half1, zero], axis=-1)
    y = np.stack([zero, half2, zero, -half2], axis=-1)
    return np.stack([x, y], axis=-1)


def _closed_overlap(E1: Floats, E2: Floats, alpha0: Floats) -> Floats:
    overlap = overlap_ratio(E1, E2, alpha0)
    if np.any(overlap < -TOUCHING_ATOL):
        raise InputError(
            "E1, E2",
            f"strains that part the grains by {-float(np.min(overlap)):.3g} of the branch",
            "strains under which every contact still touches (l <= 2 radius)",
            "Compress the diamond, or leave the open contacts out.",
        )
    return np.maximum(overlap, 0.0)


def external_forces(N: ArrayLike, T: ArrayLike, alpha: ArrayLike) -> tuple[Floats, Floats]:
    """External forces `F1, F2` that balance the contacts, compression positive (12).

    `2 (N cos(alpha) + T sin(alpha))` and `2 (N sin(alpha) - T cos(alpha))`.
    """
    N, T, alpha = finite("N", N), finite("T", T), finite("alpha", alpha)
    c, s = np.cos(alpha), np.sin(alpha)
    return 2.0 * (N * c + T * s), 2.0 * (N * s - T * c)


def contact_displacement_rates(
    shortening1_rate: ArrayLike, shortening2_rate: ArrayLike, alpha: ArrayLike
) -> tuple[Floats, Floats]:
    """Relative displacement rates at a contact from the shortening rates of the diagonals (16)."""
    D1 = finite("shortening1_rate", shortening1_rate)
    D2 = finite("shortening2_rate", shortening2_rate)
    alpha = finite("alpha", alpha)
    c, s = np.cos(alpha), np.sin(alpha)
    return -0.5 * (c * D1 + s * D2), -0.5 * (s * D1 - c * D2)


def angle_from_strains(E1: ArrayLike, E2: ArrayLike, alpha0: ArrayLike) -> Floats:
    """Branch angle, `tan(alpha) = tan(alpha0) (1 - E2)/(1 - E1)` (below (26))."""
    E1, E2 = strain("E1", E1), strain("E2", E2)
    alpha0 = acute_angle("alpha0", alpha0)
    return np.arctan2((1.0 - E2) * np.sin(alpha0), (1.0 - E1) * np.cos(alpha0))


def overlap_ratio(E1: ArrayLike, E2: ArrayLike, alpha0: ArrayLike) -> Floats:
    """Overlap of a contact over the reference branch, `1 - l/l0`; also `N/(kn l0)` by (8a).

    Written from `l0^2 - l^2`, so that it keeps its relative accuracy at stiff grains, where `l` and
    `l0` agree to many digits. Negative where the contact has opened.
    """
    E1, E2 = strain("E1", E1), strain("E2", E2)
    alpha0 = acute_angle("alpha0", alpha0)
    c, s = np.cos(alpha0), np.sin(alpha0)
    branch = np.hypot((1.0 - E1) * c, (1.0 - E2) * s)
    return (E1 * (2.0 - E1) * c**2 + E2 * (2.0 - E2) * s**2) / (1.0 + branch)


def opposite_gaps(E1: ArrayLike, E2: ArrayLike, alpha0: ArrayLike) -> tuple[Floats, Floats]:
    """Gaps between opposite grains along axes 1 and 2 over the reference branch, `(L_k - l0)/l0`.

    The paper lets them overlap: the gap is then negative (docs/paper.md, departures).
    """
    E1, E2 = strain("E1", E1), strain("E2", E2)
    alpha0 = acute_angle("alpha0", alpha0)
    return (
        2.0 * (1.0 - E1) * np.cos(alpha0) - 1.0,
        2.0 * (1.0 - E2) * np.sin(alpha0) - 1.0,
    )


def opposite_contact_strain(alpha0: ArrayLike) -> Floats:
    """Isotropic strain at which a pair of opposite grains first touches (docs/paper.md)."""
    alpha0 = acute_angle("alpha0", alpha0)
    return 1.0 - 0.5 / np.minimum(np.sin(alpha0), np.cos(alpha0))


def work_shear_then_compress(
    length: ArrayLike, alpha: ArrayLike, compression: ArrayLike, kn: ArrayLike, kt: ArrayLike
) -> Floats:
    """Work of turning the branch at its full length, then shortening it (9)."""
    arc = positive("length", length) * finite("alpha", alpha)
    compression = finite("compression", compression)
    return 0.5 * (nonnegative("kt", kt) * arc**2 + nonnegative("kn", kn) * compression**2)


def work_compress_then_shear(
    length: ArrayLike, alpha: ArrayLike, compression: ArrayLike, kn: ArrayLike, kt: ArrayLike
) -> Floats:
    """Work of shortening the branch, then turning it at the shorter length (10)."""
    length, compression = positive("length", length), finite("compression", compression)
    arc = (length - compression) * finite("alpha", alpha)
    return 0.5 * (nonnegative("kn", kn) * compression**2 + nonnegative("kt", kt) * arc**2)
