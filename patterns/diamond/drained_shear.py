"""Shear force along the elastic drained path, by quadrature (theory note section 5).

Under constant `f = F2/(2 kn l0)` balance (12) gives `N = (T cos a + f)/sin a`, and
`T' = kappa l = kappa (1 - N)` becomes `(T sin^kappa a)' = kappa sin^(kappa - 1) a (sin a - f)`.
Over `v = ln tan(a/2)`, `da = sin a dv`, the integrand is analytic in a strip of half-width pi/2
whatever the angles: short Gauss-Legendre panels reach round-off also at `alpha0` near 0.
Lengths are over `l0`, forces over `kn l0`.
"""

from __future__ import annotations

import numpy as np

from patterns.diamond.arguments import FloatArray

# Eight nodes on a panel of 0.5: error 12.6^-16 = 3e-18 of the integrand; sin^kappa asks for
# panels below 2/kappa.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_NODES, _WEIGHTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
_PANEL = 0.5


def advance_shear(
    T: FloatArray, alpha: FloatArray, turn: FloatArray, f: FloatArray, kappa: FloatArray
) -> FloatArray:
    """Shear force after the branch has turned elastically from `alpha` to `alpha + turn`.

    Parameters
    ----------
    T : ndarray (n,)
        Shear force at `alpha` over `kn l0`, positive when alpha grows.
    alpha : ndarray (n,)
        Branch angle in (0, pi/2), radians.
    turn : ndarray (n,)
        Turn of the branch, radians; `alpha + turn` in (0, pi/2].
    f : ndarray (n,)
        Half the lateral force, `F2/(2 kn l0)`.
    kappa : ndarray (n,)
        Stiffness ratio `kt/kn`.

    Returns
    -------
    T : ndarray (n,)
        Relative error of a few rounding errors while `sin a > f` and the turn goes away from
        `T = 0`.

    Examples
    --------
    Without lateral force and at `kappa = 1` the integral is elementary:

    >>> one = np.ones(1)
    >>> T = advance_shear(0 * one, one, 0.5 * one, 0 * one, one)
    >>> round(float(T[0]), 12), round(float((np.cos(1.0) - np.cos(1.5)) / np.sin(1.5)), 12)
    (0.470744325041, 0.470744325041)
    """
    span, half_tan = log_tangent_step(alpha, turn), np.tan(0.5 * alpha)
    sin_end = np.sin(alpha + turn)
    panels = np.ceil(np.abs(span) / np.minimum(_PANEL, 2.0 / np.maximum(kappa, 1.0)))
    width = span / np.maximum(panels, 1.0)
    integral = np.zeros_like(T)
    for panel in range(int(panels.max(initial=0.0))):
        rows = np.flatnonzero(panels > panel)
        integral[rows] += _panel_integral(
            half_tan[rows], panel, width[rows], sin_end[rows], f[rows], kappa[rows]
        )
    return T * (np.sin(alpha) / sin_end) ** kappa + kappa * integral


def log_tangent_step(alpha: FloatArray, turn: FloatArray) -> FloatArray:
    """`ln tan((alpha + turn)/2) - ln tan(alpha/2)`, free of cancellation.

    Parameters
    ----------
    alpha, turn : ndarray (n,)
        Angle and turn, radians.

    Returns
    -------
    span : ndarray (n,)

    Examples
    --------
    >>> float(log_tangent_step(np.array(1.0), np.array(1e-18))) > 0
    True
    """
    return np.log1p(np.sin(0.5 * turn) / (np.cos(0.5 * (alpha + turn)) * np.sin(0.5 * alpha)))


def _panel_integral(
    half_tan: FloatArray,
    panel: int,
    width: FloatArray,
    sin_end: FloatArray,
    f: FloatArray,
    kappa: FloatArray,
) -> FloatArray:
    """Integral of `(sin b/sin a_end)^kappa (sin b - f) dv` over one panel, row by row."""
    half_tan = half_tan[:, None] * np.exp(width[:, None] * (panel + _NODES))
    sin_b = 2.0 * half_tan / (1.0 + half_tan**2)
    integrand = (sin_b / sin_end[:, None]) ** kappa[:, None] * (sin_b - f[:, None])
    # einsum, not a matrix product: a row must not depend on its neighbours, nor start threads.
    return width * np.einsum("ij,j->i", integrand, _WEIGHTS)
