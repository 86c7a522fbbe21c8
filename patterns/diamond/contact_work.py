"""Work spent on one contact along the two routes of the paper's Fig. 4 (9), (10).

The contact law is hypoelastic: both routes join the same two positions, and the work differs by
`kt alpha^2 (l^2 - (l - compression)^2)/2` although nothing dissipates.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from patterns.diamond.arguments import FloatArray, finite, nonnegative, positive


def work_shear_then_compress(
    length: ArrayLike, alpha: ArrayLike, compression: ArrayLike, kn: ArrayLike, kt: ArrayLike
) -> FloatArray:
    """Work of turning the branch at its full length, then shortening it (9).

    Parameters
    ----------
    length : array_like (...)
        Branch length at first touch, positive.
    alpha : array_like (...)
        Turning of the branch, radians.
    compression : array_like (...)
        Shortening of the branch.
    kn, kt : array_like (...)
        Normal and tangential stiffness, zero or more.

    Returns
    -------
    work : ndarray (...)
        `(kt l^2 alpha^2 + kn D^2)/2`.

    Raises
    ------
    InputError
        If `length` is not positive or a stiffness is negative.

    Examples
    --------
    >>> float(work_shear_then_compress(2.0, 0.5, 1.0, 3.0, 4.0))
    3.5
    """
    arc = positive("length", length) * finite("alpha", alpha)
    compression = finite("compression", compression)
    return 0.5 * (nonnegative("kt", kt) * arc**2 + nonnegative("kn", kn) * compression**2)


def work_compress_then_shear(
    length: ArrayLike, alpha: ArrayLike, compression: ArrayLike, kn: ArrayLike, kt: ArrayLike
) -> FloatArray:
    """Work of shortening the branch, then turning it at the shorter length (10).

    Parameters
    ----------
    length, alpha, compression, kn, kt : array_like (...)
        As in `work_shear_then_compress`.

    Returns
    -------
    work : ndarray (...)
        `(kn D^2 + kt (l - D)^2 alpha^2)/2`.

    Raises
    ------
    InputError
        If `length` is not positive or a stiffness is negative.

    Examples
    --------
    >>> float(work_compress_then_shear(2.0, 0.5, 1.0, 3.0, 4.0))
    2.0
    """
    length, compression = positive("length", length), finite("compression", compression)
    arc = (length - compression) * finite("alpha", alpha)
    return 0.5 * (nonnegative("kn", kn) * compression**2 + nonnegative("kt", kt) * arc**2)
