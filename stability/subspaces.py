"""Subspaces of the displacement gradient on which a tangent is judged."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.errors import InputError

COMPONENTS = ("11", "12", "21", "22")
_HALF = np.sqrt(0.5)
# Rows are orthonormal directions of H in the order of COMPONENTS.
_BASES: dict[str, Floats] = {
    "diagonal": np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]),
    "symmetric": np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, _HALF, _HALF, 0.0]]),
    "full": np.eye(4),
}


def as_operator(K: ArrayLike, size: int | None = None) -> Floats:
    """Read an operator or a batch of them: real, square in the last two axes."""
    array = np.asarray(K)
    square = array.ndim >= 2 and array.shape[-1] == array.shape[-2] > 0
    if array.dtype.kind not in "fiu" or not square or size not in (None, array.shape[-1]):
        m = "m" if size is None else str(size)
        received = f"shape {array.shape} of type {array.dtype}"
        remedy = "Pass the tangent or its restriction, batch axes first."
        raise InputError("operator", received, f"a real array of shape (..., {m}, {m})", remedy)
    return array.astype(np.float64, copy=False)


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
    if subspace not in _BASES:
        expected = f"one of {', '.join(_BASES)}"
        raise InputError("subspace", repr(subspace), expected, "Name the subspace to judge on.")
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
    c, s = np.cos(angle), np.sin(angle)
    to_frame = np.stack([np.stack([c, s], -1), np.stack([-s, c], -1)], -2)
    M = np.einsum("...ik,...jl->...ijkl", to_frame, to_frame)
    M = M.reshape(*M.shape[:-4], 4, 4)
    return np.asarray(M @ tangent @ np.swapaxes(M, -1, -2))
