"""The diamond's tangent of forces over shortenings, `F' = K~ Delta'` (17)-(24), (53)-(57).

`F = (F1, F2)` and `Delta_k = L_k0 - L_k` are positive in compression. `lagrangian_tangent` turns
any operator of this module into stress over strain, so that (24), (56) and (57) are the images of
(20), (53) and (54).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops.errors import InputError
from patterns.diamond.arguments import FloatArray, acute_angle, finite, nonnegative, positive


def force_material_tangent(
    L1: ArrayLike, L2: ArrayLike, lambda1: ArrayLike, lambda2: ArrayLike, kn: ArrayLike = 1.0
) -> FloatArray:
    """Material part of `K~`, from the contact law alone (53).

    Parameters
    ----------
    L1, L2 : array_like (...)
        Diagonals now, positive.
    lambda1, lambda2 : array_like (...)
        Moduli from `elastic_moduli` or `sliding_moduli`.
    kn : array_like (...)
        Normal stiffness, zero or more.

    Returns
    -------
    K : ndarray (..., 2, 2)
        In the unit of `kn`. Symmetric when elastic.

    Raises
    ------
    InputError
        If a diagonal is not positive or `kn` is negative.

    Examples
    --------
    >>> force_material_tangent(1.0, 1.0, 0.5, 0.5).round(12).tolist()
    [[0.75, 0.25], [0.25, 0.75]]
    """
    c, s, _ = _branch_direction(L1, L2)
    lambda1, lambda2 = finite("lambda1", lambda1), finite("lambda2", lambda2)
    K = matrix(
        c**2 + lambda1 * s**2,
        (1.0 - lambda2) * c * s,
        (1.0 - lambda1) * c * s,
        s**2 + lambda2 * c**2,
    )
    return nonnegative("kn", kn)[..., None, None] * K


def force_geometric_tangent(
    L1: ArrayLike, L2: ArrayLike, F1: ArrayLike, F2: ArrayLike
) -> FloatArray:
    """Geometric part of `K~`, from the forces carried while the branch turns (54).

    Parameters
    ----------
    L1, L2 : array_like (...)
        Diagonals now, positive.
    F1, F2 : array_like (...)
        External forces now, compression positive.

    Returns
    -------
    K : ndarray (..., 2, 2)
        Force per length. Symmetric if and only if `T = 0` (31).

    Raises
    ------
    InputError
        If a diagonal is not positive.

    Examples
    --------
    >>> force_geometric_tangent(3.0, 4.0, 5.0, 10.0).round(12).tolist()
    [[-1.6, 1.2], [0.8, -0.6]]
    """
    c, s, diameter = _branch_direction(L1, L2)
    p1, p2 = finite("F1", F1) / diameter, finite("F2", F2) / diameter
    return matrix(-s * p2, c * p2, s * p1, -c * p1)


def force_tangent(
    L1: ArrayLike,
    L2: ArrayLike,
    F1: ArrayLike,
    F2: ArrayLike,
    lambda1: ArrayLike,
    lambda2: ArrayLike,
    kn: ArrayLike = 1.0,
) -> FloatArray:
    """Tangent `K~` of `F' = K~ Delta'` (20): (17) when elastic, (19) when sliding.

    Parameters
    ----------
    L1, L2 : array_like (...)
        Diagonals now, positive.
    F1, F2 : array_like (...)
        External forces now, compression positive.
    lambda1, lambda2 : array_like (...)
        Moduli from `elastic_moduli` or `sliding_moduli`.
    kn : array_like (...)
        Normal stiffness, zero or more.

    Returns
    -------
    K : ndarray (..., 2, 2)
        In the unit of `kn`; rows are forces, columns shortenings.

    Raises
    ------
    InputError
        If a diagonal is not positive or `kn` is negative.

    Examples
    --------
    >>> force_tangent(3.0, 4.0, 0.0, 0.0, 1.0, 1.0, kn=2.0).round(12).tolist()
    [[2.0, 0.0], [0.0, 2.0]]
    """
    return force_material_tangent(L1, L2, lambda1, lambda2, kn) + force_geometric_tangent(
        L1, L2, F1, F2
    )


def lagrangian_tangent(force_tangent: ArrayLike, alpha0: ArrayLike) -> FloatArray:
    """Tangent of `S' = K^ E'` from one of `F' = K~ Delta'`, `K^ = A K~ B` (22), (23).

    `A = diag(1/tan(alpha0), 1)` and `B = diag(1, tan(alpha0))`. Applied to (20), (53), (54) it
    gives (24), (56), (57), where the printed `Lambda kt` stands for `Lambda` and the printed
    `S2` of (57) for `S2/kn`. `K^ = kn K` with the dimensionless `K` of (26).

    Parameters
    ----------
    force_tangent : array_like (..., 2, 2)
        Operator between forces and shortenings.
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.

    Returns
    -------
    K : ndarray (..., 2, 2)
        In the unit of `force_tangent`; rows are stresses, columns strains.

    Raises
    ------
    InputError
        If `alpha0` leaves (0, pi/2) or the operator is not 2 by 2.

    Examples
    --------
    >>> lagrangian_tangent([[1.0, 2.0], [3.0, 4.0]], np.arctan(2.0)).round(12).tolist()
    [[0.5, 2.0], [3.0, 8.0]]
    """
    operator = finite("force_tangent", force_tangent)
    if operator.shape[-2:] != (2, 2):
        raise InputError("force_tangent", f"shape {operator.shape}", "(..., 2, 2)", "Reshape it.")
    t0 = np.tan(acute_angle("alpha0", alpha0))
    one = np.ones_like(t0)
    return operator * matrix(1.0 / t0, one, one, t0)


def congruence(alpha0: ArrayLike) -> FloatArray:
    """The factor `D = diag(t0^-1/2, t0^1/2)` of `K^ = D K~ D`, `t0 = tan(alpha0)` (Appendix I).

    A congruence, not a similarity: determinants agree and so do the signs of the symmetric
    parts' eigenvalues; the eigenvalues themselves agree only at 45 degrees. The appendix claims
    more (theory note section 9).

    Parameters
    ----------
    alpha0 : array_like (...)
        Reference angle in (0, pi/2), radians.

    Returns
    -------
    D : ndarray (..., 2, 2)
        Diagonal, determinant 1.

    Raises
    ------
    InputError
        If `alpha0` leaves (0, pi/2).

    Examples
    --------
    >>> congruence(np.arctan(4.0)).round(12).tolist()
    [[0.5, 0.0], [0.0, 2.0]]
    """
    root = np.sqrt(np.tan(acute_angle("alpha0", alpha0)))
    zero = np.zeros_like(root)
    return matrix(1.0 / root, zero, zero, root)


def matrix(k11: FloatArray, k12: FloatArray, k21: FloatArray, k22: FloatArray) -> FloatArray:
    """Stack four broadcasting components (...) into operators (..., 2, 2).

    Examples
    --------
    >>> matrix(np.array(1.0), np.array(2.0), np.array(3.0), np.array(4.0)).tolist()
    [[1.0, 2.0], [3.0, 4.0]]
    """
    components = np.stack(np.broadcast_arrays(k11, k12, k21, k22), axis=-1)
    return components.reshape((*components.shape[:-1], 2, 2))


def _branch_direction(L1: ArrayLike, L2: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    L1, L2 = positive("L1", L1), positive("L2", L2)
    diameter = np.hypot(L1, L2)
    return L1 / diameter, L2 / diameter, diameter
