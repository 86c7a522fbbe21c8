"""The diamond under isotropic strain, `E1 = E2 = E`, `T = 0`, `alpha = alpha0` (38) to (43)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from patterns.diamond.arguments import FloatArray, acute_angle, finite, nonnegative, strain
from patterns.diamond.force_tangents import matrix


def isotropic_stress(E: ArrayLike, alpha0: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Stresses on the path, `s1 = E/tan(alpha0)` and `s2 = E tan(alpha0)` (39).

    Equal only at 45 degrees: isotropic is the strain, not the stress (theory note section 9).

    Parameters
    ----------
    E : array_like (...)
        Isotropic strain below 1, compression positive.
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.

    Returns
    -------
    s1, s2 : ndarray (...)
        Dimensionless, compression positive.

    Raises
    ------
    InputError
        If `E` reaches 1 or `alpha0` leaves (0, pi/2).

    Examples
    --------
    >>> s1, s2 = isotropic_stress(0.2, np.arctan(0.5))
    >>> round(float(s1), 12), round(float(s2), 12)
    (0.4, 0.1)
    """
    E, t0 = strain("E", E), np.tan(acute_angle("alpha0", alpha0))
    return E / t0, E * t0


def isotropic_strain(s1: ArrayLike, alpha0: ArrayLike) -> FloatArray:
    """Strain that carries the axial stress `s1` on the path: the inverse of (39a).

    Parameters
    ----------
    s1 : array_like (...)
        Dimensionless axial stress, compression positive.
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.

    Returns
    -------
    E : ndarray (...)

    Raises
    ------
    InputError
        If `alpha0` leaves (0, pi/2), or no strain below 1 carries `s1`.

    Examples
    --------
    Table 2 of the paper:

    >>> round(float(isotropic_strain(0.35, np.radians(35.0))), 5)
    0.24507
    """
    t0 = np.tan(acute_angle("alpha0", alpha0))
    return strain("isotropic strain under s1", finite("s1", s1) * t0)


def isotropic_tangent(E: ArrayLike, alpha0: ArrayLike, kappa: ArrayLike) -> FloatArray:
    """Elastic tangent on the path (38), (40); at 45 degrees (43), at the critical strain (42).

    Parameters
    ----------
    E : array_like (...)
        Isotropic strain below 1.
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.
    kappa : array_like (...)
        Stiffness ratio `kt/kn`, zero or more.

    Returns
    -------
    K : ndarray (..., 2, 2)
        Symmetric. At 45 degrees its eigenvalues are 1 and `kappa - E/(1-E)`.

    Raises
    ------
    InputError
        If `E` reaches 1, `alpha0` leaves (0, pi/2) or `kappa` is negative.

    Examples
    --------
    At the critical strain and 45 degrees K is half the all-ones matrix:

    >>> isotropic_tangent(critical_strain(0.2), np.pi / 4, 0.2).round(12).tolist()
    [[0.5, 0.5], [0.5, 0.5]]
    """
    alpha0 = acute_angle("alpha0", alpha0)
    excess = isotropic_determinant(E, kappa)
    c, s, t0 = np.cos(alpha0), np.sin(alpha0), np.tan(alpha0)
    coupling = (1.0 - excess) * c * s
    return matrix(c**2 / t0 + excess * c * s, coupling, coupling, s**2 * t0 + excess * c * s)


def isotropic_determinant(E: ArrayLike, kappa: ArrayLike) -> FloatArray:
    """`det K = kappa - E/(1-E)` on the path, whatever the reference angle (below (43)).

    Parameters
    ----------
    E : array_like (...)
        Isotropic strain below 1.
    kappa : array_like (...)
        Stiffness ratio `kt/kn`, zero or more.

    Returns
    -------
    det_K : ndarray (...)

    Raises
    ------
    InputError
        If `E` reaches 1 or `kappa` is negative.

    Examples
    --------
    >>> float(isotropic_determinant(0.5, 0.25))
    -0.75
    """
    E = strain("E", E)
    return nonnegative("kappa", kappa) - E / (1.0 - E)


def critical_strain(kappa: ArrayLike) -> FloatArray:
    """Isotropic strain `E* = kappa/(1 + kappa)` at which `det K` vanishes (41).

    Parameters
    ----------
    kappa : array_like (...)
        Stiffness ratio `kt/kn`, zero or more.

    Returns
    -------
    E : ndarray (...)

    Raises
    ------
    InputError
        If `kappa` is negative.

    Examples
    --------
    >>> float(critical_strain(1.0))
    0.5
    """
    kappa = nonnegative("kappa", kappa)
    return kappa / (1.0 + kappa)
