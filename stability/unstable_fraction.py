"""The fraction of directions along which second-order work is negative, in any dimension."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import elliprf, elliprj

from loops.arrays import Floats
from loops.errors import InputError

# Positive eigenvalues over the negative one are kept above the first figure, the negative one over
# the largest above the second: Carlson's integrals stay in range, no fraction moves by over 1e-20.
_SMALLEST_RATIO = 1e-40
_SMALLEST_NEGATIVE = 1e-200
# Nodes in v = ln u for Imhof's integrand, analytic in |Im v| < pi/2: the trapezoidal error is
# exp(-pi^2/h) = 7e-18. Ends: it decays as e^v to the left and at least as e^(-v/2) to the right.
_IMHOF_STEP = 0.25
_IMHOF_NODES = np.exp(np.arange(-40.0, 80.0 + _IMHOF_STEP, _IMHOF_STEP))
# Nodes in v = ln t for the branch-cut integrand, analytic in |Im v| < pi: exp(-2 pi^2/h) = 7e-18.
_CUT_STEP = 0.5
_CUT_NODES = np.exp(np.arange(-80.0, 80.0 + _CUT_STEP, _CUT_STEP))
_CHUNK = 1024  # operators at a time: a few MB for each temporary array


def unstable_fraction(eigenvalues: ArrayLike) -> Floats:
    """Fraction of directions in which a quadratic form is negative.

    The share of the unit sphere where sum lambda_i z_i^2 < 0, lambda the eigenvalues of
    Ks: Theory, equations (6.7) and (6.8). In the plane (2/pi) atan sqrt(-lambda_min/lambda_max); in
    space Carlson's integrals, accurate to a few units in the last place however small the fraction;
    beyond, Imhof's integral (absolute error 1e-15), or a positive integral with full relative
    accuracy when a single eigenvalue is negative. Eigenvalues are taken as exact: set to zero first
    those that are mere round-off, or a semi-definite form shows a fraction of order sqrt(eps).

    Parameters
    ----------
    eigenvalues : array_like, shape (..., m)
        In any order and unit.

    Returns
    -------
    ndarray, shape (...)
        Between 0 and 1; NaN where an eigenvalue is not finite. A form that is nowhere positive and
        not zero counts as 1, its neutral directions having no measure; the zero form as 0.

    Raises
    ------
    InputError
        If there is no last axis, or it is empty.

    Examples
    --------
    >>> round(float(unstable_fraction([1.0, 0.4, -0.2])), 5)
    0.1264
    >>> unstable_fraction([[1.0, -1.0], [1.0, 2.0], [-1.0, -3.0]]).tolist()
    [0.5, 0.0, 1.0]
    """
    values = _eigenvalues(eigenvalues)
    rows = values.reshape(-1, values.shape[-1])
    fraction = np.where(np.isfinite(rows).all(axis=1), (rows < 0.0).any(axis=1) * 1.0, np.nan)
    indefinite = np.isfinite(fraction) & (rows < 0.0).any(axis=1) & (rows > 0.0).any(axis=1)
    if indefinite.any():
        fraction[indefinite] = _indefinite_fraction(_unit_scale(rows[indefinite]))
    return fraction.reshape(values.shape[:-1])


def imhof_fraction(eigenvalues: ArrayLike) -> Floats:
    """Unstable fraction for any number of eigenvalues, by Imhof's integral.

    P(sum lambda_i z_i^2 < 0), z normal, is 1/2 - (1/pi) times the integral over u > 0 of
    sin(theta)/(u rho), theta = sum atan(lambda_i u)/2, rho = prod (1 + lambda_i^2 u^2)^(1/4).
    The trapezoidal rule in ln u converges geometrically; zero eigenvalues drop out by themselves.
    Work grows as m; arrays in flight stay within some tens of MB.

    Parameters
    ----------
    eigenvalues : array_like, shape (..., m)

    Returns
    -------
    ndarray, shape (...)
        Absolute error below 1e-15 for m up to 4, below 1e-14 for ten coinciding eigenvalues; NaN
        where an eigenvalue is not finite; 0 for the zero form.

    Raises
    ------
    InputError
        If there is no last axis, or it is empty.

    Examples
    --------
    >>> round(float(imhof_fraction([1.0, 0.4, -0.2, 0.0])), 12)
    0.126400021852
    """
    values = _eigenvalues(eigenvalues)
    rows = values.reshape(-1, values.shape[-1])
    fraction = np.where(np.isfinite(rows).all(axis=1), 0.0, np.nan)
    regular = np.isfinite(fraction) & (rows != 0.0).any(axis=1)
    fraction[regular] = _chunked(_imhof, _unit_scale(rows[regular]))
    return fraction.reshape(values.shape[:-1])


def _eigenvalues(eigenvalues: ArrayLike) -> Floats:
    values = np.asarray(eigenvalues, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] == 0:
        remedy = "Put them in the last axis."
        raise InputError("eigenvalues", f"shape {values.shape}", "(..., m) with m > 0", remedy)
    return values


def _unit_scale(rows: Floats) -> Floats:
    return rows / np.abs(rows).max(axis=1, keepdims=True)


def _indefinite_fraction(rows: Floats) -> Floats:
    """Rows with at least one eigenvalue of each sign."""
    if rows.shape[1] == 2:
        smallest, largest = rows.min(axis=1), rows.max(axis=1)
        return np.asarray(2.0 / np.pi * np.arctan2(np.sqrt(-smallest), np.sqrt(largest)))
    one_negative = (rows < 0.0).sum(axis=1) == 1
    one_positive = ((rows > 0.0).sum(axis=1) == 1) & ~one_negative
    several = ~(one_negative | one_positive)
    inside, outside = (_elliptic, _elliptic_rest) if rows.shape[1] == 3 else (_cut, _cut_rest)
    fraction = np.empty(len(rows))
    fraction[one_negative] = _chunked(inside, _ratios(rows[one_negative]))
    fraction[one_positive] = _chunked(outside, _ratios(-rows[one_positive]))
    fraction[several] = _chunked(_imhof, rows[several])
    return fraction


def _ratios(rows: Floats) -> Floats:
    """The other eigenvalues over the size of the one negative, largest first."""
    rows = np.sort(rows, axis=1)
    negative = np.maximum(-rows[:, :1], _SMALLEST_NEGATIVE)
    return np.maximum(rows[:, :0:-1] / negative, _SMALLEST_RATIO)


def _elliptic(ratios: Floats) -> Floats:
    """Solid angle of the cone a x^2 + b y^2 < z^2 over that of the sphere.

    With z^2 > g(phi) (x^2 + y^2), g = a cos^2 + b sin^2, it is the mean of 1 - sqrt(g/(1 + g)).
    That is a complete integral of the third kind; the exchange of its parameter (DLMF 19.21.12)
    absorbs the 1 and leaves one positive term, so nothing cancels.
    """
    a, b = ratios.T
    integral = elliprj(0.0, 1.0 + 1.0 / a, 1.0 + 1.0 / b, 1.0)
    return np.asarray(np.minimum(2.0 / (3.0 * np.pi) * integral / np.sqrt(a) / np.sqrt(b), 1.0))


def _elliptic_rest(ratios: Floats) -> Floats:
    """1 - `_elliptic`: subtracted where half or more is left, else the mean of sqrt(g/(1 + g))."""
    rest = 1.0 - _elliptic(ratios)
    narrow = ratios[:, 0] < 1.0
    a, b = ratios[narrow].T
    A, B = a / (1.0 + a), b / (1.0 + b)
    third = (a - b) / (1.0 + a) * elliprj(0.0, A, B, b / (1.0 + a)) / 3.0
    rest[narrow] = 2.0 / np.pi * b * (elliprf(0.0, A, B) + third) / np.sqrt((1.0 + a) * (1.0 + b))
    return rest


def _cut(ratios: Floats) -> Floats:
    """Fraction for one negative eigenvalue among m, ratios a_i of the others to its size.

    The inversion integral of the characteristic function folded onto its branch cut:
    (1/pi) Int_0^inf dt / (sqrt(t) (1 + t) prod sqrt(1 + a_i (1 + t))), positive throughout.
    """
    t = _CUT_NODES
    weight = _CUT_STEP / np.pi * np.sqrt(t) / (1.0 + t)
    integrand = np.tile(weight, (len(ratios), 1))
    for ratio in ratios.T:
        integrand /= np.sqrt(1.0 + np.multiply.outer(ratio, 1.0 + t))
    return np.asarray(np.minimum(integrand.sum(axis=1), 1.0))


def _cut_rest(ratios: Floats) -> Floats:
    return 1.0 - _cut(ratios)


def _imhof(rows: Floats) -> Floats:
    angle = np.zeros((len(rows), len(_IMHOF_NODES)))
    amplitude = np.ones_like(angle)
    for eigenvalue in rows.T:
        x = np.multiply.outer(eigenvalue, _IMHOF_NODES)
        angle += 0.5 * np.arctan(x)
        amplitude /= np.sqrt(np.sqrt(1.0 + x * x))
    integral = _IMHOF_STEP * (np.sin(angle) * amplitude).sum(axis=1)
    return np.asarray(np.clip(0.5 - integral / np.pi, 0.0, 1.0))


def _chunked(fraction: Callable[[Floats], Floats], rows: Floats) -> Floats:
    """Apply to a thousand rows at a time, for bounded memory."""
    pieces = [fraction(rows[i : i + _CHUNK]) for i in range(0, len(rows), _CHUNK)]
    return np.concatenate(pieces) if pieces else np.empty(0)
