"""Tangents of a diamond at states of its path, added contacts between opposite grains included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from patterns.diamond import DiamondParameters as LoopParameters
from patterns.diamond import (
    determinant_elastic,
    determinant_sliding,
    elastic_moduli,
    geometric_tangent,
    material_tangent,
    sliding_moduli,
)
from patterns.diamond.tangents import geometric_asymmetry, material_asymmetry
from studies.diamond.states import States, chord_forces

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Operators:
    """Tangents at states; K is the sum of its parts (25)-(28), and of added contacts if any.

    Attributes
    ----------
    K, material, geometric : ndarray (n, 2, 2)
        Dimensionless, `s' = K E'`, not symmetrised. An added contact counts as material.
    det_K, det_Ks : ndarray (n,)
        Closed forms: (35) or (36), and `det Ks = det K - ((K12 - K21)/2)^2`.
    """

    K: Floats
    material: Floats
    geometric: Floats
    det_K: Floats
    det_Ks: Floats


def operators(loop: LoopParameters, states: States) -> Operators:
    """Tangents of a diamond at states of its path, by the paper's closed forms.

    An added contact lies along an axis and does not turn: it adds its stiffness over the lengths,
    `1/tan(alpha0)` to K11 or `tan(alpha0)` to K22.

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
    >>> from studies.diamond.operators import operators
    >>> from studies.diamond.states import isotropic_states
    >>> found = operators(TABLE_1, isotropic_states(TABLE_1, [0.0, 0.3]))
    >>> found.det_K.round(12).tolist()
    [0.2, -0.228571428571]
    """
    alpha0, t0 = loop.alpha0, np.tan(loop.alpha0)
    s1, s2 = _four_contact_stresses(loop, states)
    carried = states.E1, states.E2, s1, s2
    material = material_tangent(states.E1, states.E2, alpha0, *_moduli(loop, states))
    geometric = geometric_tangent(*carried, alpha0)
    bare = material + geometric
    added = np.stack([states.chords[:, 0] / t0, states.chords[:, 1] * t0], axis=-1)
    det_K = _determinant(loop, states, s1, s2) + added.prod(axis=-1)
    det_K += added[:, 0] * bare[:, 1, 1] + added[:, 1] * bare[:, 0, 0]
    material = material + added[:, :, None] * np.eye(2)
    asymmetry = geometric_asymmetry(*carried, states.alpha) + _slip_asymmetry(loop, states)
    return Operators(
        K=material + geometric,
        material=material,
        geometric=geometric,
        det_K=det_K,
        det_Ks=det_K - (0.5 * asymmetry) ** 2,
    )


def _four_contact_stresses(loop: LoopParameters, states: States) -> tuple[Floats, Floats]:
    """Stresses without the share of added contacts: what turns with the branches."""
    if not states.chords.any():
        return states.s1, states.s2
    force = chord_forces(loop, states)
    s1 = states.s1 - force[:, 0] / (2.0 * np.sin(loop.alpha0))
    return s1, states.s2 - force[:, 1] / (2.0 * np.cos(loop.alpha0))


def _moduli(loop: LoopParameters, states: States) -> tuple[Floats, Floats]:
    elastic = elastic_moduli(loop.kappa)
    if not states.slip.any():
        return elastic
    sliding = sliding_moduli(states.alpha, loop.mu, _sign(states))
    lambda1, lambda2 = (
        np.where(states.slip == 0.0, *pair) for pair in zip(elastic, sliding, strict=True)
    )
    return lambda1, lambda2


def _determinant(loop: LoopParameters, states: States, s1: Floats, s2: Floats) -> Floats:
    carried = states.E1, states.E2, s1, s2, states.alpha
    elastic = determinant_elastic(*carried, loop.kappa)
    if not states.slip.any():
        return elastic
    return np.where(
        states.slip == 0.0, elastic, determinant_sliding(*carried, loop.mu, _sign(states))
    )


def _slip_asymmetry(loop: LoopParameters, states: States) -> Floats:
    if not states.slip.any():
        return np.zeros_like(states.slip)
    return np.where(states.slip == 0.0, 0.0, material_asymmetry(loop.mu, _sign(states)))


def _sign(states: States) -> Floats:
    """Slip sign, +1 where contacts stick: there the sliding forms are computed in vain."""
    return np.where(states.slip == 0.0, 1.0, states.slip)
