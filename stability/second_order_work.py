"""Second-order work along directions, and the polar diagram of Nicot et al. 2016, Fig. 11."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.errors import InputError
from stability.arguments import number, whole_number
from stability.subspaces import as_operator


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

    It is the cosine of the angle between the strain rate and the stress rate it calls up. Where the
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
    strain = np.asarray(direction, dtype=np.float64)
    m = operator.shape[-1]
    if strain.ndim == 0 or strain.shape[-1] != m:
        remedy = "Give one component for each row of K."
        raise InputError("direction", f"shape {strain.shape}", f"(..., {m})", remedy)
    zero = (strain == 0.0).all(axis=-1)
    if zero.any():
        where = f"direction {np.argwhere(zero)[0].tolist()}" if zero.ndim else "direction"
        raise InputError(where, "a zero vector", "a strain rate", "A direction needs a length.")
    return operator, strain
