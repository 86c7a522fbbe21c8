"""Determinants of the diamond's tangent in closed form, and its asymmetry (29) to (37).

All quantities are dimensionless, compression positive, radians; arguments broadcast. `alpha` is
the current branch angle, related to `E1`, `E2` and the reference angle by `angle_from_strains`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops.errors import InputError
from patterns.diamond.arguments import (
    FloatArray,
    acute_angle,
    finite,
    nonnegative,
    sliding_sign,
    strain,
)


def determinant(
    E1: ArrayLike,
    E2: ArrayLike,
    s1: ArrayLike,
    s2: ArrayLike,
    alpha: ArrayLike,
    lambda1: ArrayLike,
    lambda2: ArrayLike,
) -> FloatArray:
    """`det K` for any pair of moduli (34).

    Parameters
    ----------
    E1, E2 : array_like (...)
        Strains below 1.
    s1, s2 : array_like (...)
        Dimensionless stresses.
    alpha : array_like (...)
        Current branch angle in (0, pi/2), radians.
    lambda1, lambda2 : array_like (...)
        Moduli from `elastic_moduli` or `sliding_moduli`.

    Returns
    -------
    det_K : ndarray (...)

    Raises
    ------
    InputError
        If a strain reaches 1 or `alpha` leaves (0, pi/2).

    Examples
    --------
    >>> round(float(determinant(0.3, 0.3, 0.3, 0.3, np.pi / 4, 0.2, 0.2)), 12)
    -0.228571428571
    """
    alpha = acute_angle("alpha", alpha)
    lambda1, lambda2 = finite("lambda1", lambda1), finite("lambda2", lambda2)
    c, s = np.cos(alpha), np.sin(alpha)
    turning = geometric_asymmetry(E1, E2, s1, s2, alpha)
    return (
        s**2 * lambda1
        + c**2 * lambda2
        - geometric_softening(E1, E2, s1, s2, alpha)
        + (lambda1 - lambda2) * c * s * turning
    )


def determinant_elastic(
    E1: ArrayLike,
    E2: ArrayLike,
    s1: ArrayLike,
    s2: ArrayLike,
    alpha: ArrayLike,
    kappa: ArrayLike,
) -> FloatArray:
    """`det K = kappa - N/(kn l)` of elastic contacts (35).

    Parameters
    ----------
    E1, E2, s1, s2, alpha : array_like (...)
        As in `determinant`.
    kappa : array_like (...)
        Stiffness ratio `kt/kn`, zero or more.

    Returns
    -------
    det_K : ndarray (...)
        Vanishes where the geometric softening equals `kappa` (37).

    Raises
    ------
    InputError
        If a strain reaches 1, `alpha` leaves (0, pi/2) or `kappa` is negative.

    Examples
    --------
    >>> round(float(determinant_elastic(0.3, 0.3, 0.3, 0.3, np.pi / 4, 0.2)), 12)
    -0.228571428571
    """
    return nonnegative("kappa", kappa) - geometric_softening(E1, E2, s1, s2, alpha)


def determinant_sliding(
    E1: ArrayLike,
    E2: ArrayLike,
    s1: ArrayLike,
    s2: ArrayLike,
    alpha: ArrayLike,
    mu: ArrayLike,
    s: ArrayLike,
) -> FloatArray:
    """`det K` of sliding contacts (36), `s = sign(T)` in place of `zeta_n zeta_t`.

    Where `T = s mu N` it equals `-(1 + mu^2) N/(kn l)`: never positive.

    Parameters
    ----------
    E1, E2, s1, s2, alpha : array_like (...)
        As in `determinant`.
    mu : array_like (...)
        Friction coefficient, zero or more.
    s : array_like (...)
        Sign of T, +1 or -1.

    Returns
    -------
    det_K : ndarray (...)

    Raises
    ------
    InputError
        If a strain reaches 1, `alpha` leaves (0, pi/2), `mu` is negative or `s` is not a sign.

    Examples
    --------
    >>> round(float(determinant_sliding(0.3, 0.3, 0.3, 0.3, np.pi / 4, 0.1, 1)), 12)
    -0.428571428571
    """
    turning = geometric_asymmetry(E1, E2, s1, s2, alpha)
    return material_asymmetry(mu, s) * turning - geometric_softening(E1, E2, s1, s2, alpha)


def geometric_softening(
    E1: ArrayLike, E2: ArrayLike, s1: ArrayLike, s2: ArrayLike, alpha: ArrayLike
) -> FloatArray:
    """Left side of (37), `cos a sin a (s2/(1-E1) + s1/(1-E2))`; equal to `N/(kn l)`.

    Balance (12) cancels T from it: an elastic diamond loses `det K` at one branch length,
    `l/l0 = 1/(1 + kappa)`, whatever its angle and shear force.

    Parameters
    ----------
    E1, E2, s1, s2, alpha : array_like (...)
        As in `determinant`.

    Returns
    -------
    softening : ndarray (...)

    Raises
    ------
    InputError
        If a strain reaches 1 or `alpha` leaves (0, pi/2).

    Examples
    --------
    >>> round(float(geometric_softening(0.5, 0.5, 0.5, 0.5, np.pi / 4)), 12)
    1.0
    """
    alpha = acute_angle("alpha", alpha)
    p1, p2 = _current_stresses(E1, E2, s1, s2)
    return np.cos(alpha) * np.sin(alpha) * (p2 + p1)


def material_asymmetry(mu: ArrayLike, s: ArrayLike) -> FloatArray:
    """`Kmat12 - Kmat21 = s mu` of sliding contacts (29); elastic ones have none.

    Parameters
    ----------
    mu : array_like (...)
        Friction coefficient, zero or more.
    s : array_like (...)
        Sign of T, +1 or -1.

    Returns
    -------
    asymmetry : ndarray (...)

    Raises
    ------
    InputError
        If `mu` is negative or `s` is not a sign.

    Examples
    --------
    >>> float(material_asymmetry(0.25, -1))
    -0.25
    """
    return sliding_sign("s", s) * nonnegative("mu", mu)


def geometric_asymmetry(
    E1: ArrayLike, E2: ArrayLike, s1: ArrayLike, s2: ArrayLike, alpha: ArrayLike
) -> FloatArray:
    """`Kgeo12 - Kgeo21 = cos^2(a) s2/(1-E1) - sin^2(a) s1/(1-E2)`, equal to `-T/(kn l)`.

    It vanishes where (30) holds, that is where `T = 0` (31).

    Parameters
    ----------
    E1, E2, s1, s2, alpha : array_like (...)
        As in `determinant`.

    Returns
    -------
    asymmetry : ndarray (...)

    Raises
    ------
    InputError
        If a strain reaches 1 or `alpha` leaves (0, pi/2).

    Examples
    --------
    >>> round(float(geometric_asymmetry(0.5, 0.5, 0.3, 0.2, np.pi / 4)), 12)
    -0.1
    """
    alpha = acute_angle("alpha", alpha)
    p1, p2 = _current_stresses(E1, E2, s1, s2)
    return np.cos(alpha) ** 2 * p2 - np.sin(alpha) ** 2 * p1


def drained_slope(K: ArrayLike) -> FloatArray:
    """Slope `ds1/dE1 = det K / K22` under constant `s2` (33).

    Parameters
    ----------
    K : array_like (..., 2, 2)
        Tangent of `s' = K E'`.

    Returns
    -------
    slope : ndarray (...)
        Where `K22 = 0` the strain control has its limit: infinite with the sign of `det K`
        (the side `K22 > 0`), NaN if `det K` vanishes too.

    Raises
    ------
    InputError
        If `K` is not 2 by 2 or not finite.

    Examples
    --------
    >>> float(drained_slope([[2.0, 1.0], [1.0, 1.0]]))
    1.0
    """
    K = finite("K", K)
    if K.shape[-2:] != (2, 2):
        raise InputError("K", f"shape {K.shape}", "(..., 2, 2)", "Reshape it.")
    det_K = K[..., 0, 0] * K[..., 1, 1] - K[..., 0, 1] * K[..., 1, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return det_K / (K[..., 1, 1] + 0.0)


def _current_stresses(
    E1: ArrayLike, E2: ArrayLike, s1: ArrayLike, s2: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    E1, E2 = strain("E1", E1), strain("E2", E2)
    return finite("s1", s1) / (1.0 - E2), finite("s2", s2) / (1.0 - E1)
