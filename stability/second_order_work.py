"""Second-order work along directions, the cone in which it is negative, and its share of all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Floats, all_finite
from loops.errors import InputError, number, whole_number
from loops.shown import Shown
from loops.validation import finite, real
from stability.spectra import RTOL, as_operator, operator_norm

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
# Relative distance of the two means before the last step.
_AGM_CLOSE = 1e-14
OPERATORS_AT_ONCE = 1024  # operators at a time: a few MB for each temporary array


class PolarDiagram(NamedTuple):
    """Normalised second-order work in every direction of the plane (11, 22).

    Attributes
    ----------
    angle : ndarray, shape (n,)
        alphaE in radians, tan alphaE = E1'/E2': counted from the axis of E2 towards that of E1.
    direction : ndarray, shape (n, 2)
        (E1', E2') = (sin alphaE, cos alphaE).
    work : ndarray, shape (..., n)
        w2 of (45), in [-1, 1].
    points : ndarray, shape (..., n, 2)
        (r + w2) (cos alphaE, sin alphaE): the abscissa goes with E2', the ordinate with E1'.
    """

    angle: Floats
    direction: Floats
    work: Floats
    points: Floats


def second_order_work(K: ArrayLike, direction: ArrayLike) -> Floats:
    """Second-order work W2 = s1' E1' + s2' E2' = e . K e, equation (44) in any dimension.

    Parameters
    ----------
    K : array_like, shape (..., m, m)
    direction : array_like, shape (..., m)
        Strain rate e, of any length; its batch axes broadcast against those of K.

    Returns
    -------
    ndarray, shape (...)

    Raises
    ------
    InputError
        If a direction is zero or its length is not m.

    Examples
    --------
    >>> float(second_order_work([[1.0, 0.0], [0.5, 0.0]], [1.0, -4.0]))
    -1.0
    """
    operator, strain = _operator_and_direction(K, direction)
    stress = np.einsum("...ij,...j->...i", operator, strain)
    return np.asarray(np.einsum("...i,...i->...", stress, strain))


def normalised_second_order_work(K: ArrayLike, direction: ArrayLike) -> Floats:
    """Normalised second-order work `w2 = s'.E'/(|s'||E'|)`, equation (45).

    It is the cosine of the angle between the strain rate and the stress rate it causes. Where the
    stress rate is exactly zero (E' lies in the kernel of K) the cosine has no value; w2 is then 0,
    the value of W2 itself: a neutral direction.

    Parameters
    ----------
    K : array_like, shape (..., m, m)
    direction : array_like, shape (..., m)
        Strain rate, of any length.

    Returns
    -------
    ndarray, shape (...)
        In [-1, 1], negative in the instability cone.

    Raises
    ------
    InputError
        If a direction is zero or its length is not m.

    Examples
    --------
    >>> K = [[1.0, 1.0], [1.0, 1.0]]
    >>> normalised_second_order_work(K, [[2.0, 2.0], [1.0, -1.0]]).round(12).tolist()
    [1.0, 0.0]
    """
    operator, strain = _operator_and_direction(K, direction)
    stress = np.einsum("...ij,...j->...i", operator, strain)
    work = np.einsum("...i,...i->...", stress, strain)
    scale = np.linalg.norm(stress, axis=-1) * np.linalg.norm(strain, axis=-1)
    cosine = np.divide(work, scale, out=np.zeros_like(work), where=scale != 0.0)
    return np.asarray(np.clip(cosine, -1.0, 1.0))


def polar_diagram(K: ArrayLike, r: float = 2.0, directions: int = 360) -> PolarDiagram:
    """Data of the polar diagram of w2 (Nicot et al. 2016, Fig. 11).

    The paper plots the points (r + w2) (cos alphaE, sin alphaE) with tan alphaE = E1'/E2', r = 2.
    Taken as printed, alphaE starts at the axis of E2 and the figure has E2' across and E1' upwards,
    as in the Rendulic plane of the authors' earlier diagrams. Points inside the circle r are
    unstable directions. `alpha_e` turns an angle of a cone into alphaE.

    Parameters
    ----------
    K : array_like, shape (..., 2, 2)
        Operator in (11, 22).
    r : float
        Radius of the circle w2 = 0; above 1, so that no point crosses the centre.
    directions : int
        Number of equally spaced angles from 0, 2 pi left out.

    Returns
    -------
    PolarDiagram

    Raises
    ------
    InputError
        If K is not (..., 2, 2), r is not above 1, or there are no directions.

    Examples
    --------
    >>> diagram = polar_diagram([[2.0, 0.0], [0.0, -1.0]], directions=4)
    >>> diagram.work.round(12).tolist()
    [-1.0, 1.0, -1.0, 1.0]
    >>> diagram.points[:2].round(12).tolist()
    [[1.0, 0.0], [0.0, 3.0]]
    """
    operator = as_operator(K, size=2)
    number("r", r, 1.0, open_low=True)
    whole_number("directions", directions, 1)
    angle = 2.0 * np.pi * np.arange(directions) / directions
    c, s = np.cos(angle), np.sin(angle)
    direction = np.stack([s, c], axis=-1)
    work = normalised_second_order_work(operator[..., None, :, :], direction)
    points = (r + work)[..., None] * np.stack([c, s], axis=-1)
    return PolarDiagram(angle, direction, work, points)


def alpha_e(theta: ArrayLike) -> Floats:
    """The paper's angle alphaE of a direction given by theta, tan theta = E2'/E1'.

    Parameters
    ----------
    theta : array_like
        Angle from the axis of E1 towards that of E2, in radians, as the cones use it.

    Returns
    -------
    ndarray
        pi/2 - theta, not wrapped: tan alphaE = E1'/E2'.

    Examples
    --------
    >>> float(alpha_e(0.0)) == np.pi / 2
    True
    """
    return np.asarray(0.5 * np.pi - np.asarray(theta, dtype=np.float64))


def _operator_and_direction(K: ArrayLike, direction: ArrayLike) -> tuple[Floats, Floats]:
    operator = as_operator(K)
    strain = finite("direction", direction, ..., operator.shape[-1])
    zero = (strain == 0.0).all(axis=-1)
    if zero.any():
        where = f"direction {np.argwhere(zero)[0].tolist()}" if zero.ndim else "direction"
        raise InputError(where, "a zero vector", "a strain rate", "A direction needs a length.")
    return operator, strain


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


def _eigenvalues(eigenvalues: ArrayLike) -> Floats:
    values = real("eigenvalues", eigenvalues)
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
    inside, outside = _cut, lambda ratios: 1.0 - _cut(ratios)
    if rows.shape[1] == 3:
        inside, outside = _elliptic, _elliptic_rest
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
    y, z = 1.0 + 1.0 / a, 1.0 + 1.0 / b
    integral = _complete(np.sqrt(y / z), y, 0.0) / np.sqrt(z)
    return np.asarray(np.minimum(2.0 / np.pi * integral / np.sqrt(a) / np.sqrt(b), 1.0))


def _elliptic_rest(ratios: Floats) -> Floats:
    """1 - `_elliptic`: subtracted where half or more is left, else the mean of sqrt(g/(1 + g))."""
    rest = 1.0 - _elliptic(ratios)
    narrow = ratios[:, 0] < 1.0
    a, b = ratios[narrow].T
    A, B = a / (1.0 + a), b / (1.0 + b)
    # R_F + (a - b)/(1 + a) R_J/3 of 0, A, B, p
    p, modulus = b / (1.0 + a), np.sqrt(A / B)
    integral = _complete(modulus, A / p, 0.0) * (a - b) / (1.0 + a) / p
    integral = (_complete(modulus, 1.0, 1.0) + integral) / np.sqrt(B)
    rest[narrow] = 2.0 / np.pi * b * integral / np.sqrt((1.0 + a) * (1.0 + b))
    return rest


def _complete(modulus: Floats, p: Floats | float, b: float) -> Floats:
    """Bulirsch's complete elliptic integral `cel(kc, p, 1, b)` by its arithmetic-geometric mean.

    Int_0^(pi/2) (cos^2 + b sin^2) / ((cos^2 + p sin^2) sqrt(cos^2 + kc^2 sin^2)) dphi for b of 0 or
    1: all terms are positive. R_F(0, y, z) = cel(sqrt(y/z), 1, 1, 1)/sqrt(z), and
    R_J(0, y, z, p) = 3 cel(sqrt(y/z), y/p, 1, 0)/(p sqrt(z)). scipy takes long to load, and has
    errors of 1e-6 where p is many orders larger than y and z.
    """
    kc, e, a, m = modulus, modulus, np.ones_like(modulus), np.ones_like(modulus)
    q: Floats = np.sqrt(p * a)
    c = b / q
    while True:
        a, c, q = a + c / q, 2.0 * (c + a * e / q), q + e / q
        apart, m = np.abs(m - kc) > _AGM_CLOSE * m, m + kc
        if not apart.any():
            return np.asarray(0.5 * np.pi * (c + a * m) / (m * (m + q)))
        kc = 2.0 * np.sqrt(e)
        e = kc * m


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
    starts = range(0, len(rows), OPERATORS_AT_ONCE)
    pieces = [fraction(rows[start : start + OPERATORS_AT_ONCE]) for start in starts]
    return np.concatenate(pieces) if pieces else np.empty(0)


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
    number("rtol", rtol, 0.0)
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
