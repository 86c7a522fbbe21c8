"""Geometry, balance and measures of the diamond (Nicot et al. 2016, equations 11 to 21).

Four equal discs form a rhombus of side `l`; `alpha` is the angle between a branch and axis 1.
Forces and strains are positive in compression. `T` is positive when `alpha` grows
(`T' = kt l alpha'`). Angles are radians. All arguments broadcast.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from patterns.diamond.arguments import FloatArray, finite, positive


def side_lengths(length: ArrayLike, alpha: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Diagonals of the rhombus, `L1 = 2 l cos(alpha)` and `L2 = 2 l sin(alpha)` (11).

    Parameters
    ----------
    length : array_like (...)
        Branch length.
    alpha : array_like (...)
        Branch angle to axis 1, radians.

    Returns
    -------
    L1, L2 : ndarray (...)
        In the unit of `length`.

    Raises
    ------
    InputError
        If `length` is not positive or `alpha` is not finite.

    Examples
    --------
    >>> L1, L2 = side_lengths(1.0, np.pi / 6)
    >>> round(float(L1), 12), round(float(L2), 12)
    (1.732050807569, 1.0)
    """
    length, alpha = positive("length", length), finite("alpha", alpha)
    return 2.0 * length * np.cos(alpha), 2.0 * length * np.sin(alpha)


def side_rates(
    length: ArrayLike,
    alpha: ArrayLike,
    length_rate: ArrayLike,
    alpha_rate: ArrayLike,
) -> tuple[FloatArray, FloatArray]:
    """Rates of the diagonals (15).

    Parameters
    ----------
    length, alpha : array_like (...)
        Branch length and angle (radians).
    length_rate, alpha_rate : array_like (...)
        Their rates.

    Returns
    -------
    L1_rate, L2_rate : ndarray (...)

    Examples
    --------
    >>> rate1, rate2 = side_rates(1.0, 0.0, -0.1, 0.2)
    >>> float(rate1), float(rate2)
    (-0.2, 0.4)
    """
    length, alpha = positive("length", length), finite("alpha", alpha)
    length_rate = finite("length_rate", length_rate)
    turn = length * finite("alpha_rate", alpha_rate)
    c, s = np.cos(alpha), np.sin(alpha)
    return 2.0 * (length_rate * c - turn * s), 2.0 * (length_rate * s + turn * c)


def branch_from_sides(L1: ArrayLike, L2: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Branch length and angle of a rhombus with diagonals `L1`, `L2`: the inverse of (11).

    Parameters
    ----------
    L1, L2 : array_like (...)
        Diagonals, positive.

    Returns
    -------
    length, alpha : ndarray (...)
        Branch length in the unit of `L1`; angle in radians.

    Raises
    ------
    InputError
        If a diagonal is not positive.

    Examples
    --------
    >>> length, alpha = branch_from_sides(6.0, 8.0)
    >>> float(length), round(float(np.tan(alpha)), 12)
    (5.0, 1.333333333333)
    """
    L1, L2 = positive("L1", L1), positive("L2", L2)
    return 0.5 * np.hypot(L1, L2), np.arctan2(L2, L1)


def external_forces(N: ArrayLike, T: ArrayLike, alpha: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """External forces that balance the contacts, compression positive (12).

    Parameters
    ----------
    N, T : array_like (...)
        Normal (compression positive) and tangential force (positive when alpha grows) of a contact.
    alpha : array_like (...)
        Branch angle, radians.

    Returns
    -------
    F1, F2 : ndarray (...)
        `2 (N cos(alpha) + T sin(alpha))` and `2 (N sin(alpha) - T cos(alpha))`.

    Examples
    --------
    >>> F1, F2 = external_forces(1.0, 0.5, 0.0)
    >>> float(F1), float(F2)
    (2.0, -1.0)
    """
    N, T, alpha = finite("N", N), finite("T", T), finite("alpha", alpha)
    c, s = np.cos(alpha), np.sin(alpha)
    return 2.0 * (N * c + T * s), 2.0 * (N * s - T * c)


def contact_forces(F1: ArrayLike, F2: ArrayLike, alpha: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Contact forces under external forces `F1`, `F2`: the inverse of (12).

    Parameters
    ----------
    F1, F2 : array_like (...)
        External forces along axes 1 and 2, compression positive.
    alpha : array_like (...)
        Branch angle, radians.

    Returns
    -------
    N, T : ndarray (...)

    Examples
    --------
    >>> N, T = contact_forces(2.0, -1.0, 0.0)
    >>> float(N), float(T)
    (1.0, 0.5)
    """
    F1, F2, alpha = finite("F1", F1), finite("F2", F2), finite("alpha", alpha)
    c, s = np.cos(alpha), np.sin(alpha)
    return 0.5 * (F1 * c + F2 * s), 0.5 * (F1 * s - F2 * c)


def force_rates(
    N_rate: ArrayLike,
    T_rate: ArrayLike,
    alpha_rate: ArrayLike,
    F1: ArrayLike,
    F2: ArrayLike,
    alpha: ArrayLike,
) -> tuple[FloatArray, FloatArray]:
    """Rates of the external forces (13): the contact law's part and the turning of the branch.

    Parameters
    ----------
    N_rate, T_rate, alpha_rate : array_like (...)
        Rates of the contact forces and of the branch angle.
    F1, F2 : array_like (...)
        External forces now.
    alpha : array_like (...)
        Branch angle now, radians.

    Returns
    -------
    F1_rate, F2_rate : ndarray (...)

    Examples
    --------
    >>> rate1, rate2 = force_rates(0.0, 0.0, 0.1, 3.0, 2.0, np.pi / 4)
    >>> round(float(rate1), 12), round(float(rate2), 12)
    (-0.2, 0.3)
    """
    material1, material2 = external_forces(N_rate, T_rate, alpha)
    alpha_rate = finite("alpha_rate", alpha_rate)
    return material1 - finite("F2", F2) * alpha_rate, material2 + finite("F1", F1) * alpha_rate


def contact_displacement_rates(
    shortening1_rate: ArrayLike, shortening2_rate: ArrayLike, alpha: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Relative displacement rates at a contact from the shortening rates of the diagonals (16).

    Parameters
    ----------
    shortening1_rate, shortening2_rate : array_like (...)
        Rates of `Delta_k = L_k0 - L_k`, positive in compression.
    alpha : array_like (...)
        Branch angle, radians.

    Returns
    -------
    un_rate, ut_rate : ndarray (...)
        `un' = l'` (positive when the grains part) and `ut' = -l alpha'`.

    Examples
    --------
    >>> un, ut = contact_displacement_rates(2.0, 4.0, 0.0)
    >>> float(un), float(ut)
    (-1.0, 2.0)
    """
    D1 = finite("shortening1_rate", shortening1_rate)
    D2 = finite("shortening2_rate", shortening2_rate)
    alpha = finite("alpha", alpha)
    c, s = np.cos(alpha), np.sin(alpha)
    return -0.5 * (c * D1 + s * D2), -0.5 * (s * D1 - c * D2)
