"""P-matrices: all principal minors are positive."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats
from stability.complementarity import positive_definite, scaled_definite

# Diagonal entries below this share of what they were before elimination are rounding.
ROUNDED_MINOR = 1e-11
# Matrices that the recursion looks at before it gives up; each takes 0.1 to 0.3 ms.
MOST_MATRICES = 300


def is_p_matrix(M: Floats, most: int = MOST_MATRICES) -> bool | None:
    """Return whether all principal minors of `M` (m, m) are positive; None if it is undecided.

    `w = q + M z` with `w >= 0`, `z >= 0`, `w.z = 0` has exactly one solution for every `q` if and
    only if `M` is a P-matrix (Samelson, Thrall and Wesler 1958). The recursion is that of
    Tsatsomeros and Li 2000: `M` is one if an entry `m_kk` of its diagonal is positive, and both the
    rest and its Schur complement `M / m_kk` are. Its `2^m` branches end where a matrix is known to
    be one: the symmetric part is positive definite once the diagonal is scaled to one, or it is
    diagonally dominant in a suitable norm (`D M + M^T D > 0` is tried for the whole alone). Where
    `most` matrices don't decide, or a minor vanishes to rounding, the answer is None.

    Raises
    ------
    ValueError
        If `M` is not square or not finite.

    Examples
    --------
    >>> import numpy as np
    >>> is_p_matrix(np.array([[1.0, 5.0], [-5.0, 1.0]])), is_p_matrix(np.array([[1.0, 2], [2, 1]]))
    (True, False)
    >>> is_p_matrix(np.ones((2, 2))) is None
    True
    """
    M = np.asarray(M, dtype=float)
    if M.ndim != 2 or M.shape[0] != M.shape[1] or not np.isfinite(M).all():
        raise ValueError(f"a square matrix of finite numbers is wanted, got shape {M.shape}")
    left, looked, certain = [(M, np.abs(np.diag(M)))], 0, True
    while left:
        A, size = left.pop()
        looked += 1
        diagonal = np.diag(A)
        if (diagonal < -ROUNDED_MINOR * size).any():
            return False
        if len(A) == 0:
            continue
        if (diagonal <= ROUNDED_MINOR * size).any():
            certain = False
            continue
        if looked > most:
            return None
        root = np.sqrt(diagonal)
        A = A / root / root[:, None]
        # The minor of two: negative ones are found before the recursion gets there.
        pairs = A * A.T
        np.fill_diagonal(pairs, 0.0)
        if pairs.max(initial=0.0) > 1.0 + ROUNDED_MINOR:
            return False
        # A singular matrix passes Cholesky's test or not, as its last pivot is rounded.
        definite = positive_definite(A - ROUNDED_MINOR * np.eye(len(A)))
        if definite or _dominant(A) or (looked == 1 and has_definite_scaling(A)):
            continue
        k = int(np.argmax(pairs.sum(axis=1)))
        rest = np.delete(np.arange(len(A)), k)
        block = A[np.ix_(rest, rest)]
        left.append((block, np.ones(len(rest))))
        left.append((block - np.outer(A[rest, k], A[k, rest]), np.ones(len(rest))))
    return True if certain else None


def has_definite_scaling(A: Floats) -> bool:
    """Return whether `D A + A^T D > 0` for a diagonal `D`; False where the search breaks down."""
    try:
        return scaled_definite(A)[0]
    except np.linalg.LinAlgError:
        return False


def _dominant(A: Floats) -> bool:
    """Return whether `|a_ij|` off the unit diagonal have a spectral radius below one (H-matrix)."""
    off = np.abs(A)
    np.fill_diagonal(off, 0.0)
    x = np.ones(len(A))
    for _ in range(8):
        y = off @ x
        if (y < x).all():
            return True
        x = np.maximum(y, 1e-3 * x)
        x /= x.max()
    return False
