"""Spectra of a tangent and of its symmetric part, Bromwich's inequality, flutter."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Flags, Floats, all_finite, frobenius
from stability.subspaces import as_operator

RTOL = 1e-12
"""Default tolerance relative to the Frobenius norm of the operator.

Round-off leaves about m eps |K|, some 1e-15 |K|; a solve through the saddle system, more.
The weakest effect worth telling, the geometric stiffness of stiff grains, is about 1e-8 |K|.
"""


def operator_norm(K: ArrayLike) -> Floats:
    """Frobenius norm, the yardstick of every tolerance.

    Parameters
    ----------
    K : array_like, shape (..., m, m)

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> float(operator_norm([[3.0, 0.0], [4.0, 0.0]]))
    5.0
    """
    operator = as_operator(K)
    largest = np.abs(operator).max(axis=(-2, -1))
    # Scaled by the largest entry, so that no unit makes the squares overflow or vanish.
    scale = np.where(np.isfinite(largest) & (largest > 0.0), largest, 1.0)
    return np.asarray(scale * frobenius(operator / scale[..., None, None]))


def symmetric_part(K: ArrayLike) -> Floats:
    """Symmetric part Ks = (K + K^T)/2, which alone carries second-order work.

    Parameters
    ----------
    K : array_like, shape (..., m, m)

    Returns
    -------
    ndarray, shape (..., m, m)

    Examples
    --------
    >>> symmetric_part([[1.0, 0.0], [0.5, 0.0]]).tolist()
    [[1.0, 0.25], [0.25, 0.0]]
    """
    operator = as_operator(K)
    return 0.5 * operator + 0.5 * np.swapaxes(operator, -1, -2)


def spectrum(K: ArrayLike) -> NDArray[np.complex128]:
    """Eigenvalues of K itself, never symmetrised.

    Parameters
    ----------
    K : array_like, shape (..., m, m)

    Returns
    -------
    ndarray of complex, shape (..., m)
        By ascending real part, then imaginary part. NaN for an operator that is not finite.

    Examples
    --------
    >>> spectrum([[1.0, 2.0], [-2.0, 1.0]]).round(12).tolist()
    [(1-2j), (1+2j)]
    """
    operator, finite = _finite(K)
    values = np.sort(np.linalg.eigvals(operator).astype(np.complex128), axis=-1)
    return np.where(finite[..., None], values, complex(np.nan, np.nan))


def symmetric_spectrum(K: ArrayLike) -> Floats:
    """Eigenvalues of the symmetric part Ks; the first one decides on second-order work.

    Parameters
    ----------
    K : array_like, shape (..., m, m)

    Returns
    -------
    ndarray, shape (..., m)
        Ascending. NaN for an operator that is not finite.

    Examples
    --------
    >>> symmetric_spectrum([[1.0, 4.0], [0.0, 1.0]]).round(12).tolist()
    [-1.0, 3.0]
    """
    operator, finite = _finite(K)
    values = np.linalg.eigvalsh(symmetric_part(operator))
    return np.where(finite[..., None], values, np.nan)


def symmetric_modes(K: ArrayLike) -> tuple[Floats, Floats]:
    """Eigenvalues of the symmetric part Ks with their unit directions.

    Parameters
    ----------
    K : array_like, shape (..., m, m)

    Returns
    -------
    values : ndarray, shape (..., m)
        Ascending. NaN for an operator that is not finite.
    vectors : ndarray, shape (..., m, m)
        Column k is the direction of value k; its first component of at least half the largest
        magnitude is positive.

    Examples
    --------
    >>> values, vectors = symmetric_modes([[1.0, 4.0], [0.0, 1.0]])
    >>> values.round(12).tolist(), vectors[:, 1].round(6).tolist()
    ([-1.0, 3.0], [0.707107, 0.707107])
    """
    operator, finite = _finite(K)
    values, vectors = np.linalg.eigh(symmetric_part(operator))
    size = np.abs(vectors)
    leading = np.argmax(size >= 0.5 * size.max(axis=-2, keepdims=True), axis=-2, keepdims=True)
    vectors = vectors * np.sign(np.take_along_axis(vectors, leading, axis=-2))
    values = np.where(finite[..., None], values, np.nan)
    return values, np.where(finite[..., None, None], vectors, np.nan)


def bromwich_margin(K: ArrayLike) -> Floats:
    """Bromwich's gap: min Re eig(K) - lambda_min(Ks), never negative.

    Hence det Ks vanishes no later than det K on a path (Theory, equation (6.3)).
    Computed eigenvalues are those of an operator within about `eps |K|`, so the computed gap may
    fall below zero by that much and no more, defective operators included.

    Parameters
    ----------
    K : array_like, shape (..., m, m)

    Returns
    -------
    ndarray, shape (...)
        In the unit of K; NaN for an operator that is not finite.

    Examples
    --------
    >>> round(float(bromwich_margin([[1.0, 4.0], [0.0, 1.0]])), 12)
    2.0
    """
    return np.asarray(spectrum(K).real.min(axis=-1) - symmetric_spectrum(K)[..., 0])


def flutter_pairs(K: ArrayLike, rtol: float = RTOL) -> Flags:
    """Which eigenvalues of K are complex beyond what a perturbation of `rtol |K|` can explain.

    A defective double root splits by sqrt(eps): perturbing the 0 of [[1, 1], [0, 1]] by -eps makes
    a pair 1 +- i sqrt(eps). In the real Schur form a pair is a block [[a, b], [c, a]] with
    Im^2 = -b c, and clearing the smaller of b, c makes it real: a change of
    `Im^2/max(|b|, |c|)`, and `max(|b|, |c|)` is at most `|dev K|`, dev K = K - (tr K/m) I. So a
    pair counts only if `Im^2 > rtol |K| |dev K|`, which guarantees that no change of that kind
    below `rtol |K|` undoes it. The least `|Im|` seen is then about `sqrt(rtol) |K|` at a defective
    root and `rtol |K|` at a plain one (K near a multiple of I). Roots of multiplicity m split by
    eps^(1/m): raise rtol for m > 2.

    Parameters
    ----------
    K : array_like, shape (..., m, m)
    rtol : float
        Relative uncertainty of the entries of K.

    Returns
    -------
    ndarray of bool, shape (..., m)
        In the order of `spectrum`; False for an operator that is not finite.

    Examples
    --------
    >>> flutter_pairs([[1.0, 1e-6], [-1e-6, 1.0]]).tolist()
    [True, True]
    >>> flutter_pairs([[1.0, 1.0], [-1e-15, 1.0]]).tolist()
    [False, False]
    """
    operator, _ = _finite(K)
    m = operator.shape[-1]
    mean = np.trace(operator, axis1=-2, axis2=-1)[..., None, None] / m
    threshold = rtol * operator_norm(operator) * operator_norm(operator - mean * np.eye(m))
    return np.asarray(spectrum(K).imag ** 2 > threshold[..., None])


def _finite(K: ArrayLike) -> tuple[Floats, Flags]:
    """Operators with the non-finite ones zeroed (LAPACK would raise for the whole batch)."""
    operator = as_operator(K)
    finite = all_finite(operator)
    return np.where(finite[..., None, None], operator, 0.0), finite
