"""The diamond's dimensionless tangent `s' = K E'` and its two origins (25) to (28).

`s_k = S_k/kn`. The operator equals the generic macroscopic tangent restricted to the components
(11, 22) with the bounding box `L10 L20` as reference volume. Compression positive, radians.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from patterns.diamond.arguments import FloatArray, finite
from patterns.diamond.force_tangents import matrix
from patterns.diamond.measures import angle_from_strains


def material_tangent(
    E1: ArrayLike, E2: ArrayLike, alpha0: ArrayLike, lambda1: ArrayLike, lambda2: ArrayLike
) -> FloatArray:
    """Material part `Kmat`, from the contact law alone (27).

    Parameters
    ----------
    E1, E2 : array_like (...)
        Strains below 1.
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.
    lambda1, lambda2 : array_like (...)
        Moduli from `elastic_moduli` or `sliding_moduli`.

    Returns
    -------
    K : ndarray (..., 2, 2)
        `Kmat12 - Kmat21` is 0 when elastic and `s mu` when sliding (29).

    Raises
    ------
    InputError
        If a strain reaches 1 or `alpha0` leaves (0, pi/2).

    Examples
    --------
    >>> material_tangent(0.0, 0.0, np.pi / 4, 0.2, 0.2).round(12).tolist()
    [[0.6, 0.4], [0.4, 0.6]]
    """
    alpha = angle_from_strains(E1, E2, alpha0)
    lambda1, lambda2 = finite("lambda1", lambda1), finite("lambda2", lambda2)
    t0, c, s = np.tan(np.asarray(alpha0)), np.cos(alpha), np.sin(alpha)
    return matrix(
        (c**2 + lambda1 * s**2) / t0,
        (1.0 - lambda2) * c * s,
        (1.0 - lambda1) * c * s,
        (s**2 + lambda2 * c**2) * t0,
    )


def geometric_tangent(
    E1: ArrayLike, E2: ArrayLike, s1: ArrayLike, s2: ArrayLike, alpha0: ArrayLike
) -> FloatArray:
    """Geometric part `Kgeo`, from the stresses carried while the branches turn (28).

    Parameters
    ----------
    E1, E2 : array_like (...)
        Strains below 1.
    s1, s2 : array_like (...)
        Dimensionless stresses, compression positive.
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.

    Returns
    -------
    K : ndarray (..., 2, 2)
        Symmetric if and only if `T = 0` (30), (31): `Kgeo12 - Kgeo21 = -T/(kn l)`.

    Raises
    ------
    InputError
        If a strain reaches 1 or `alpha0` leaves (0, pi/2).

    Examples
    --------
    >>> geometric_tangent(0.5, 0.5, 0.2, 0.1, np.pi / 4).round(12).tolist()
    [[-0.1, 0.1], [0.2, -0.2]]
    """
    alpha = angle_from_strains(E1, E2, alpha0)
    t0, c, s = np.tan(np.asarray(alpha0)), np.cos(alpha), np.sin(alpha)
    p1 = finite("s1", s1) / (1.0 - np.asarray(E2))
    p2 = finite("s2", s2) / (1.0 - np.asarray(E1))
    return matrix(-c * s * p2 / t0, c**2 * p2, s**2 * p1, -c * s * p1 * t0)


def tangent(
    E1: ArrayLike,
    E2: ArrayLike,
    s1: ArrayLike,
    s2: ArrayLike,
    alpha0: ArrayLike,
    lambda1: ArrayLike,
    lambda2: ArrayLike,
) -> FloatArray:
    """Dimensionless tangent `K = Kmat + Kgeo` of `s' = K E'` (25), (26).

    Parameters
    ----------
    E1, E2 : array_like (...)
        Strains below 1, compression positive.
    s1, s2 : array_like (...)
        Dimensionless stresses `S/kn`, compression positive.
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.
    lambda1, lambda2 : array_like (...)
        Moduli from `elastic_moduli` or `sliding_moduli`.

    Returns
    -------
    K : ndarray (..., 2, 2)
        `K = K^/kn`; the printed `K = kn K^` before (26) is a misprint.

    Raises
    ------
    InputError
        If a strain reaches 1 or `alpha0` leaves (0, pi/2).

    Examples
    --------
    At the end of the confinement of Table 1 the determinant is `0.2 - 0.3/0.7`:

    >>> K = tangent(0.3, 0.3, 0.3, 0.3, np.pi / 4, 0.2, 0.2)
    >>> round(float(np.linalg.det(K)), 12), round(0.2 - 0.3 / 0.7, 12)
    (-0.228571428571, -0.228571428571)
    """
    return material_tangent(E1, E2, alpha0, lambda1, lambda2) + geometric_tangent(
        E1, E2, s1, s2, alpha0
    )
