"""States along the path of a diamond, and the operators there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops import GrainGraph
from patterns import diamond
from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import (
    determinant_elastic,
    elastic_moduli,
    geometric_asymmetry,
    geometric_tangent,
    isotropic_stress,
    material_tangent,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class States:
    """States of a diamond in the order of its path; arrays (n,), dimensionless (`kn = l0 = 1`).

    Attributes
    ----------
    stage : ndarray of str
        Stage of the programme, 'isotropic'.
    regime : ndarray of str
        Regime of the contacts, 'elastic'.
    E1, E2 : ndarray
        Strains, compression positive.
    length, alpha : ndarray
        Branch length over `l0` and branch angle, radians.
    N, T : ndarray
        Contact forces over `kn l0`; N compression positive, T positive when alpha grows.
    s1, s2 : ndarray
        Stresses `S/kn`, compression positive.
    """

    stage: NDArray[np.str_]
    regime: NDArray[np.str_]
    E1: Floats
    E2: Floats
    length: Floats
    alpha: Floats
    N: Floats
    T: Floats
    s1: Floats
    s2: Floats


@dataclass(frozen=True, eq=False)
class Operators:
    """Tangents at states; K is the sum of its material and geometric parts (25)-(28).

    Attributes
    ----------
    K, material, geometric : ndarray (n, 2, 2)
        Dimensionless, `s' = K E'`, not symmetrised.
    det_K, det_Ks : ndarray (n,)
        Closed forms: (35), and `det Ks = det K - ((K12 - K21)/2)^2`.
    """

    K: Floats
    material: Floats
    geometric: Floats
    det_K: Floats
    det_Ks: Floats


def isotropic_states(loop: LoopParameters, E: ArrayLike) -> States:
    """States under isotropic strain: `alpha = alpha0`, `T = 0`, stresses (39).

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    E : array_like (n,)
        Isotropic strains in [0, 1).

    Returns
    -------
    States

    Examples
    --------
    >>> from patterns.diamond import TABLE_1
    >>> from studies.diamond.states import isotropic_states
    >>> isotropic_states(TABLE_1, [0.0, 0.25]).length.tolist()
    [1.0, 0.75]
    """
    E = np.atleast_1d(np.asarray(E, dtype=np.float64))
    s1, s2 = isotropic_stress(E, loop.alpha0)
    return States(
        stage=np.full(E.shape, "isotropic"),
        regime=np.full(E.shape, "elastic"),
        E1=E,
        E2=E,
        length=1.0 - E,
        alpha=np.full(E.shape, loop.alpha0),
        N=E,
        T=np.zeros_like(E),
        s1=s1,
        s2=s2,
    )


def operators(loop: LoopParameters, states: States) -> Operators:
    """Tangents of a diamond at states of its path, by the paper's closed forms.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    states : States
        Where.

    Returns
    -------
    Operators

    Examples
    --------
    >>> from patterns.diamond import TABLE_1
    >>> from studies.diamond.states import isotropic_states, operators
    >>> found = operators(TABLE_1, isotropic_states(TABLE_1, [0.0, 0.3]))
    >>> found.det_K.round(12).tolist()
    [0.2, -0.228571428571]
    """
    carried = states.E1, states.E2, states.s1, states.s2
    lambda1, lambda2 = elastic_moduli(loop.kappa)
    material = material_tangent(states.E1, states.E2, loop.alpha0, lambda1, lambda2)
    geometric = geometric_tangent(*carried, loop.alpha0)
    det_K = determinant_elastic(*carried, states.alpha, loop.kappa)
    asymmetry = geometric_asymmetry(*carried, states.alpha)
    return Operators(
        K=material + geometric,
        material=material,
        geometric=geometric,
        det_K=det_K,
        det_Ks=det_K - (0.5 * asymmetry) ** 2,
    )


def loop_graph(loop: LoopParameters, states: States) -> GrainGraph:
    """The grain graph of a diamond at states of its path.

    Parameters
    ----------
    loop : patterns.diamond.DiamondParameters
        The diamond.
    states : States
        Where.

    Returns
    -------
    GrainGraph
        Batch axis (n,).
    """
    return diamond(loop.alpha0, E1=states.E1, E2=states.E2, T=states.T)
