"""The two tangential moduli of the diamond's contacts, elastic and sliding (below (20))."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from patterns.diamond.arguments import FloatArray, acute_angle, nonnegative, sliding_sign


def elastic_moduli(kappa: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Moduli of elastic contacts, `Lambda1 = Lambda2 = kappa`.

    Parameters
    ----------
    kappa : array_like (...)
        Stiffness ratio `kt/kn`, zero or more.

    Returns
    -------
    lambda1, lambda2 : ndarray (...)

    Raises
    ------
    InputError
        If `kappa` is negative or not finite.

    Examples
    --------
    >>> [float(x) for x in elastic_moduli(0.2)]
    [0.2, 0.2]
    """
    kappa = nonnegative("kappa", kappa)
    return kappa, kappa


def sliding_moduli(alpha: ArrayLike, mu: ArrayLike, s: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Moduli of sliding contacts, `Lambda1 = s mu / tan(alpha)`, `Lambda2 = -s mu tan(alpha)`.

    The paper's `zeta_n zeta_t` is read as `s = sign(T)`, which keeps `|T| = mu N` also when the
    contact unloads (theory note section 9).

    Parameters
    ----------
    alpha : array_like (...)
        Branch angle in (0, pi/2), radians.
    mu : array_like (...)
        Friction coefficient `tan(phi_g)`, zero or more.
    s : array_like (...)
        Sign of T, +1 or -1.

    Returns
    -------
    lambda1, lambda2 : ndarray (...)

    Raises
    ------
    InputError
        If `alpha` leaves (0, pi/2), `mu` is negative, or `s` is not a sign.

    Examples
    --------
    >>> [round(float(x), 12) for x in sliding_moduli(np.pi / 4, 0.1, 1)]
    [0.1, -0.1]
    """
    t = np.tan(acute_angle("alpha", alpha))
    friction = sliding_sign("s", s) * nonnegative("mu", mu)
    return friction / t, -friction * t
