"""States of the drained biaxial path: strains, forces and stresses from the branch's turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from patterns.diamond.arguments import FloatArray


@dataclass(frozen=True, eq=False)
class DrainedState:
    """States of a diamond under constant `s2`; arrays (...), dimensionless (`kn = l0 = 1`).

    Attributes
    ----------
    E1, E2 : ndarray (...)
        Strains, compression positive.
    length, alpha : ndarray (...)
        Branch length over `l0` and branch angle, radians.
    turn : ndarray (...)
        `alpha - alpha0`, which keeps its digits at stiff grains.
    N, T : ndarray (...)
        Contact forces over `kn l0`; N compression positive, T positive when alpha grows.
    s1, s2 : ndarray (...)
        Stresses `S/kn`, compression positive.
    """

    E1: FloatArray
    E2: FloatArray
    length: FloatArray
    alpha: FloatArray
    turn: FloatArray
    N: FloatArray
    T: FloatArray
    s1: FloatArray
    s2: FloatArray


def drained_state(
    alpha0: FloatArray, confinement: FloatArray, turn: FloatArray, T: FloatArray
) -> DrainedState:
    """State at the turn `alpha - alpha0` with shear force `T`, in terms that don't cancel.

    Parameters
    ----------
    alpha0 : ndarray (...)
        Reference angle in (0, pi/2), radians.
    confinement : ndarray (...)
        Isotropic strain at A; `F2 = 2 kn l0 confinement sin(alpha0)` from there on.
    turn : ndarray (...)
        Turn of the branch since A, radians.
    T : ndarray (...)
        Shear force over `kn l0`.

    Returns
    -------
    DrainedState

    Examples
    --------
    >>> zero = np.array(0.0)
    >>> state = drained_state(np.array(0.6), np.array(0.3), zero, zero)
    >>> round(float(state.E1), 12), round(float(state.E2), 12)
    (0.3, 0.3)
    """
    cos0, sin0, f = np.cos(alpha0), np.sin(alpha0), confinement * np.sin(alpha0)
    fall = 2.0 * np.sin(alpha0 + 0.5 * turn) * np.sin(0.5 * turn) / cos0
    rise = 2.0 * np.cos(alpha0 + 0.5 * turn) * np.sin(0.5 * turn) / sin0
    cos, sin = cos0 * (1.0 - fall), sin0 * (1.0 + rise)
    N = (T * cos + f) / sin
    return DrainedState(
        E1=N + fall * (1.0 - N),
        E2=N - rise * (1.0 - N),
        length=1.0 - N,
        alpha=alpha0 + turn,
        turn=turn,
        N=N,
        T=T,
        s1=(T + f * cos) / (sin * sin0),
        s2=confinement * np.tan(alpha0) + 0.0 * N,
    )


def normal_force(alpha: FloatArray, f: FloatArray, T: FloatArray) -> FloatArray:
    """`N = (T cos a + f)/sin a`, balance (12b) under `f = F2/(2 kn l0)`.

    Parameters
    ----------
    alpha, f, T : ndarray (...)
        Branch angle (radians), half the lateral force, shear force; forces over `kn l0`.

    Returns
    -------
    N : ndarray (...)

    Examples
    --------
    >>> float(normal_force(np.array(np.pi / 2), np.array(0.25), np.array(0.5))).__round__(12)
    0.25
    """
    return (T * np.cos(alpha) + f) / np.sin(alpha)


def turning_stiffness(
    alpha: FloatArray, f: FloatArray, T: FloatArray, lambda2: FloatArray
) -> FloatArray:
    """`K22/tan(alpha0)`: positive where, under constant `s2`, `E1` grows with the angle.

    Parameters
    ----------
    alpha, f, T : ndarray (...)
        Branch angle (radians), half the lateral force, shear force; forces over `kn l0`.
    lambda2 : ndarray (...)
        Second modulus, `kappa` when elastic and `-s mu tan(alpha)` when sliding.

    Returns
    -------
    K22 : ndarray (...)
        Over `tan(alpha0)`. Infinite at `l = 0`.

    Examples
    --------
    >>> zero = np.array(0.0)
    >>> round(float(turning_stiffness(np.array(np.pi / 4), zero, zero, np.array(0.2))), 12)
    0.6
    """
    cos, sin = np.cos(alpha), np.sin(alpha)
    axial = (T + f * cos) / sin
    return sin**2 + lambda2 * cos**2 - cos * axial / (1.0 - normal_force(alpha, f, T))
