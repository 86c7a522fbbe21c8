"""Stresses and strains of the diamond and what strains say about the branch (after (20), (26)).

The stresses are nominal: forces over reference lengths, compression positive. They are the
diagonal components of the work-conjugate nominal stress over the bounding box `L10 L20`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from patterns.diamond.arguments import FloatArray, acute_angle, finite, positive, strain


def stresses(
    F1: ArrayLike, F2: ArrayLike, L10: ArrayLike, L20: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Nominal stresses `S1 = F1/L20` and `S2 = F2/L10`, conjugate to the strains (21).

    Parameters
    ----------
    F1, F2 : array_like (...)
        External forces, compression positive.
    L10, L20 : array_like (...)
        Reference diagonals, positive.

    Returns
    -------
    S1, S2 : ndarray (...)
        Force per length; divide by `kn` for the dimensionless `s1`, `s2`.

    Raises
    ------
    InputError
        If a reference diagonal is not positive.

    Examples
    --------
    >>> S1, S2 = stresses(2.0, 1.0, 4.0, 5.0)
    >>> float(S1), float(S2)
    (0.4, 0.25)
    """
    F1, F2 = finite("F1", F1), finite("F2", F2)
    return F1 / positive("L20", L20), F2 / positive("L10", L10)


def strains(
    L1: ArrayLike, L2: ArrayLike, L10: ArrayLike, L20: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Strains `E_k = 1 - L_k/L_k0`, positive when the diagonal shortens (21).

    Parameters
    ----------
    L1, L2 : array_like (...)
        Diagonals now, positive.
    L10, L20 : array_like (...)
        Reference diagonals, positive.

    Returns
    -------
    E1, E2 : ndarray (...)

    Raises
    ------
    InputError
        If a diagonal is not positive.

    Examples
    --------
    >>> E1, E2 = strains(3.0, 5.0, 4.0, 4.0)
    >>> float(E1), float(E2)
    (0.25, -0.25)
    """
    L10, L20 = positive("L10", L10), positive("L20", L20)
    return (L10 - positive("L1", L1)) / L10, (L20 - positive("L2", L2)) / L20


def angle_from_strains(E1: ArrayLike, E2: ArrayLike, alpha0: ArrayLike) -> FloatArray:
    """Branch angle, `tan(alpha) = tan(alpha0) (1 - E2)/(1 - E1)` (below (26)).

    Parameters
    ----------
    E1, E2 : array_like (...)
        Strains below 1, compression positive.
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.

    Returns
    -------
    alpha : ndarray (...)
        Radians.

    Raises
    ------
    InputError
        If a strain reaches 1 or `alpha0` leaves (0, pi/2).

    Examples
    --------
    >>> round(float(np.degrees(angle_from_strains(0.5, 0.0, np.arctan(0.5)))), 10)
    45.0
    """
    E1, E2 = strain("E1", E1), strain("E2", E2)
    alpha0 = acute_angle("alpha0", alpha0)
    return np.arctan2((1.0 - E2) * np.sin(alpha0), (1.0 - E1) * np.cos(alpha0))


def overlap_ratio(E1: ArrayLike, E2: ArrayLike, alpha0: ArrayLike) -> FloatArray:
    """Overlap of a contact over the reference branch, `1 - l/l0`; also `N/(kn l0)` by (8a).

    Written from `l0^2 - l^2`, so that it keeps its relative accuracy at stiff grains, where
    `l` and `l0` agree to many digits.

    Parameters
    ----------
    E1, E2 : array_like (...)
        Strains below 1, compression positive.
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.

    Returns
    -------
    overlap : ndarray (...)
        Positive in compression, negative where the contact has opened.

    Raises
    ------
    InputError
        If a strain reaches 1 or `alpha0` leaves (0, pi/2).

    Examples
    --------
    >>> round(float(overlap_ratio(0.3, 0.3, 0.6)), 12)
    0.3
    """
    E1, E2 = strain("E1", E1), strain("E2", E2)
    alpha0 = acute_angle("alpha0", alpha0)
    c, s = np.cos(alpha0), np.sin(alpha0)
    branch = np.hypot((1.0 - E1) * c, (1.0 - E2) * s)
    return (E1 * (2.0 - E1) * c**2 + E2 * (2.0 - E2) * s**2) / (1.0 + branch)


def opposite_gaps(E1: ArrayLike, E2: ArrayLike, alpha0: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Gaps between opposite grains over the reference branch, `(L_k - l0)/l0`.

    The paper lets opposite grains overlap; a negative gap says where it does (theory note
    section 9).

    Parameters
    ----------
    E1, E2 : array_like (...)
        Strains below 1, compression positive.
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.

    Returns
    -------
    gap1, gap2 : ndarray (...)
        Along axis 1 (right and left grains) and along axis 2 (top and bottom grains).

    Raises
    ------
    InputError
        If a strain reaches 1 or `alpha0` leaves (0, pi/2).

    Examples
    --------
    >>> gap1, gap2 = opposite_gaps(0.0, 0.0, np.pi / 6)
    >>> round(float(gap1), 12), round(float(gap2), 12)
    (0.732050807569, -0.0)
    """
    E1, E2 = strain("E1", E1), strain("E2", E2)
    alpha0 = acute_angle("alpha0", alpha0)
    return (
        2.0 * (1.0 - E1) * np.cos(alpha0) - 1.0,
        2.0 * (1.0 - E2) * np.sin(alpha0) - 1.0,
    )


def opposite_contact_strain(alpha0: ArrayLike) -> FloatArray:
    """Isotropic strain at which a pair of opposite grains first touches (theory note section 9).

    Parameters
    ----------
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.

    Returns
    -------
    strain : ndarray (...)
        `1 - 1/(2 sin(alpha0))` up to 45 degrees, `1 - 1/(2 cos(alpha0))` beyond. Negative below
        30 and above 60 degrees: the pair overlaps before any load.

    Raises
    ------
    InputError
        If `alpha0` leaves (0, pi/2).

    Examples
    --------
    >>> round(float(opposite_contact_strain(np.radians(35.0))), 4)
    0.1283
    """
    alpha0 = acute_angle("alpha0", alpha0)
    return 1.0 - 0.5 / np.minimum(np.sin(alpha0), np.cos(alpha0))
