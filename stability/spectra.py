"""Spectra of a tangent on a subspace of strains: eigenvalues, Bromwich's inequality, flutter."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Flags, Floats, all_finite, frobenius
from loops.errors import check_choice
from loops.validation import finite, real, require_shape

COMPONENTS = ("11", "12", "21", "22")
_HALF = np.sqrt(0.5)
# Rows are orthonormal directions of H in the order of COMPONENTS.
_BASES: dict[str, Floats] = {
    "diagonal": np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]),
    "symmetric": np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, _HALF, _HALF, 0.0]]),
    "full": np.eye(4),
}


RTOL = 1e-12
"""Default tolerance relative to the Frobenius norm of the operator.

Round-off leaves about m eps |K|, some 1e-15 |K|; a solve through the saddle system, more.
The weakest effect worth telling, the geometric stiffness of stiff grains, is about 1e-8 |K|.
"""


def as_operator(K: ArrayLike, size: int | None = None) -> Floats:
    """Read an operator or a batch of them: real, square in the last two axes."""
    remedy = "Pass gl.restrict(tangent, 'diagonal') of gl.traction_tangent(loop), batch axes first."
    array = real("operator", K, remedy=remedy)
    size = max(array.shape[-1:], default=0) if size is None else size
    require_shape("operator", array, ..., size or 1, size or 1)
    return array


def subspace_basis(subspace: str) -> Floats:
    """Orthonormal basis of a subspace of displacement gradients.

    `diagonal` holds (11, 22), the plane of Nicot et al. 2016. `symmetric` holds (11, 22,
    (12 + 21)/sqrt 2): no rotation, the right one for loops inside a packing. `full` holds all four;
    under compressive dead stress it contains an unstable rotation once spins turn with the loop.

    Parameters
    ----------
    subspace : {'diagonal', 'symmetric', 'full'}

    Returns
    -------
    ndarray, shape (m, 4)
        One direction a row, in the component order (11, 12, 21, 22); m = 2, 3 or 4.

    Raises
    ------
    InputError
        If the name is unknown.

    Examples
    --------
    >>> subspace_basis("diagonal").tolist()
    [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    """
    check_choice("subspace", subspace, _BASES)
    return _BASES[subspace].copy()


def restrict(A: ArrayLike, subspace: str) -> Floats:
    """Restriction of a macroscopic tangent to a subspace: K = B A B^T.

    The rows (nominal stress rates P') and the columns (displacement gradients H') are projected on
    the same orthonormal basis B, so that second-order work is kept: e.K e = P':H' for H' = B^T e.

    Parameters
    ----------
    A : array_like, shape (..., 4, 4)
        P' = A H' in the component order (11, 12, 21, 22), compression positive.
    subspace : {'diagonal', 'symmetric', 'full'}

    Returns
    -------
    ndarray, shape (..., m, m)
        In the unit of A, not symmetrised.

    Raises
    ------
    InputError
        If A is not (..., 4, 4) or the subspace is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> A = np.arange(16.0).reshape(4, 4)
    >>> restrict(A, "diagonal").tolist()
    [[0.0, 3.0], [12.0, 15.0]]
    >>> restrict(A, "symmetric").shape
    (3, 3)
    """
    basis = subspace_basis(subspace)
    return basis @ as_operator(A, size=4) @ basis.T


def rotate_tangent(A: ArrayLike, angle: ArrayLike) -> Floats:
    """Components of a macroscopic tangent in a frame turned by an angle.

    With the new axes as the columns of Q, a gradient reads Q^T H Q in the turned frame, and the
    operator M A M^T with M = Q^T (x) Q^T orthogonal: the spectra of `full` and `symmetric` stay.

    Parameters
    ----------
    A : array_like, shape (..., 4, 4)
        Component order (11, 12, 21, 22).
    angle : array_like
        Turn of the frame, counter-clockwise, in radians; broadcasts against the batch axes of A.

    Returns
    -------
    ndarray, shape (..., 4, 4)

    Raises
    ------
    InputError
        If A is not (..., 4, 4).

    Examples
    --------
    A quarter turn exchanges the two axes.

    >>> import numpy as np
    >>> turned = rotate_tangent(np.diag([1.0, 2.0, 3.0, 4.0]), np.pi / 2)
    >>> np.diag(turned).round(12).tolist()
    [4.0, 3.0, 2.0, 1.0]
    """
    tangent = as_operator(A, size=4)
    turn = finite("angle", angle)
    c, s = np.cos(turn), np.sin(turn)
    to_frame = np.stack([np.stack([c, s], -1), np.stack([-s, c], -1)], -2)
    M = np.einsum("...ik,...jl->...ijkl", to_frame, to_frame)
    M = M.reshape(*M.shape[:-4], 4, 4)
    return np.asarray(M @ tangent @ np.swapaxes(M, -1, -2))


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
    """Whether eigenvalues of K are complex beyond any perturbation of size `rtol |K|`.

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
