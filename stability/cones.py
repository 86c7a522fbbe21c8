"""The instability cone in the plane, in closed form (Nicot et al. 2016, Fig. 12)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Floats, all_finite
from loops.shown import Shown
from stability.spectra import RTOL, as_operator, operator_norm

_SPLITTER = 2.0**27 + 1.0


@dataclass(frozen=True, eq=False, repr=False)
class PlaneCone(Shown):
    """The directions of the plane along which second-order work is negative: a double cone.

    Angles theta run from the first axis (E1) to the second (E2), tan theta = E2'/E1'; `alpha_e`
    turns them into the paper's alphaE = pi/2 - theta.

    Attributes
    ----------
    status : ndarray of str, shape (...)
        'empty': W2 > 0 everywhere; 'ray': the smallest eigenvalue of Ks is zero within the
        tolerance, a single direction is about to be lost; 'open'; 'all': W2 < 0 in every direction
        (in all but one when the largest eigenvalue is zero within the tolerance);
        'undetermined': the operator is not finite, or both eigenvalues are zero within it.
    opening : ndarray, shape (...)
        Full width of one nappe, radians, 0 to pi; its share of pi is the unstable fraction.
    axis : ndarray, shape (...)
        Direction of the smallest W2, in [0, pi); NaN where all directions are alike.
    edges : ndarray, shape (..., 2)
        `(theta_-, theta_+) = axis -+ opening/2`, where W2 = 0; not wrapped; NaN where there are
        none.
    """

    status: NDArray[np.str_]
    opening: Floats
    axis: Floats
    edges: Floats


def plane_cone(K: ArrayLike, rtol: float = RTOL) -> PlaneCone:
    """Instability cone of an operator in the plane.

    W2 along (cos theta, sin theta) is q = m + R cos 2(theta - theta0) (44), so
    the cone lies about theta0 + pi/2 with opening 2 atan sqrt(-lambda_min/lambda_max). The smaller
    eigenvalue comes from det Ks/lambda_max with an error-free determinant: the opening keeps full
    relative accuracy as the cone closes, axis and edges are right to 1e-15, however different the
    eigenvalues in size.

    Parameters
    ----------
    K : array_like, shape (..., 2, 2)
        Not symmetrised beforehand.
    rtol : float
        Uncertainty of the entries relative to the Frobenius norm. It decides on `status` alone; the
        angles are those of the entries as given. With 0 the entries are taken as exact.

    Returns
    -------
    PlaneCone

    Raises
    ------
    InputError
        If K is not (..., 2, 2).

    Examples
    --------
    A sliding contact has a cone of opening arctan mu, one edge of which is E1' = 0.

    >>> cone = plane_cone([[1.0, 0.0], [0.5, 0.0]])
    >>> cone.status.item(), round(float(np.tan(cone.opening)), 12)
    ('open', 0.5)
    >>> (cone.edges / np.pi).round(6).tolist()
    [0.5, 0.647584]
    """
    operator = as_operator(K, size=2)
    finite = all_finite(operator)
    known = np.where(finite[..., None, None], operator, 0.0)
    # Over the power of two next to the largest entry: exact, and squares cannot overflow.
    _, exponent = np.frexp(np.abs(known).max(axis=(-2, -1), keepdims=True))
    scaled = np.ldexp(known, -exponent)
    smallest, largest = _extreme_eigenvalues(scaled)
    band = rtol * operator_norm(scaled)
    neutral = (np.abs(smallest) <= band) & (np.abs(largest) <= band)
    cases = [neutral, smallest > band, smallest >= -band, largest > band]
    status = np.select(cases, ["undetermined", "empty", "ray", "open"], "all")
    opening = 2.0 * np.arctan2(
        np.sqrt(np.maximum(-smallest, 0.0)), np.sqrt(np.maximum(largest, 0.0))
    )
    # W2 is smallest a quarter turn from where it is largest.
    difference = scaled[..., 0, 0] - scaled[..., 1, 1]
    shear = scaled[..., 0, 1] + scaled[..., 1, 0]
    axis = np.mod(0.5 * np.arctan2(shear, difference) + 0.5 * np.pi, np.pi)
    axis = np.where((difference == 0.0) & (shear == 0.0), np.nan, axis)
    has_edges = np.asarray((smallest <= 0.0) & (largest >= 0.0))
    edges = axis[..., None] + 0.5 * opening[..., None] * np.array([-1.0, 1.0])
    edges = np.where(has_edges[..., None], edges, np.nan)
    return PlaneCone(
        status=np.where(finite, status, "undetermined"),
        opening=np.where(finite, opening, np.nan),
        axis=np.where(finite, axis, np.nan),
        edges=np.where(finite[..., None], edges, np.nan),
    )


def _extreme_eigenvalues(K: Floats) -> tuple[Floats, Floats]:
    """Both eigenvalues of Ks; the one smaller in size by the determinant, which spares digits."""
    mean = 0.5 * (K[..., 0, 0] + K[..., 1, 1])
    radius = 0.5 * np.hypot(K[..., 0, 0] - K[..., 1, 1], K[..., 0, 1] + K[..., 1, 0])
    outer = mean + np.copysign(radius, mean)
    # Determinant k11 k22 - ((k12 + k21)/2)^2, the rounding errors of the sum (Knuth) and of the
    # products added.
    a, b = K[..., 0, 1], K[..., 1, 0]
    total = a + b
    part = total - a
    lost = (a - (total - part)) + (b - part)
    product, product_error = _exact_product(K[..., 0, 0], K[..., 1, 1])
    square, square_error = _exact_product(0.5 * total, 0.5 * total)
    determinant = (product - square) + (product_error - square_error - 0.5 * total * lost)
    inner = np.divide(determinant, outer, out=np.zeros_like(outer), where=outer != 0.0)
    return np.minimum(inner, outer), np.maximum(inner, outer)


def _exact_product(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Rounded product and its rounding error (Dekker; entries are of order one or less)."""
    product = a * b
    a_high = _SPLITTER * a - (_SPLITTER * a - a)
    b_high = _SPLITTER * b - (_SPLITTER * b - b)
    a_low, b_low = a - a_high, b - b_high
    error = a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)
    return product, error
