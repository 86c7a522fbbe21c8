"""States and tangents of the diamond by the paper's closed forms, added contacts included.

An added contact between opposite grains lies along an axis, so that it neither turns nor shears:
its force is the overlap, and it adds `1/tan(alpha0)` to K11 or `tan(alpha0)` to K22.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Flags, Floats
from patterns.diamond import (
    DiamondParameters,
    angle_from_strains,
    determinant_elastic,
    determinant_sliding,
    elastic_moduli,
    external_forces,
    geometric_tangent,
    material_tangent,
    opposite_gaps,
    overlap_ratio,
    sliding_moduli,
)
from patterns.diamond.tangents import geometric_asymmetry, material_asymmetry

NONE = (False, False)


@dataclass(frozen=True, eq=False)
class DiamondStates:
    """States of a diamond; arrays (n,), forces over `kn l0`, stresses over `kn`, radians.

    `slip` multiplies `mu` in the moduli of (20): 0 where the contacts stick, `sign(T)` where they
    slide by Coulomb's law, `zeta_n zeta_t` by (8c) as printed. `added (n, 2)` tells whether the
    opposite grains on axis 1, and on axis 2, share a contact. T is positive when alpha grows.
    """

    stage: NDArray[np.str_]
    slip: Floats
    added: Flags
    E1: Floats
    E2: Floats
    alpha: Floats
    N: Floats
    T: Floats
    s1: Floats
    s2: Floats

    @property
    def length(self) -> Floats:
        """Branch length over `l0`."""
        return 1.0 - self.N

    @property
    def regime(self) -> NDArray[np.str_]:
        """Regime of the four contacts, 'elastic' or 'sliding'."""
        return np.where(self.slip == 0.0, "elastic", "sliding")

    def take(self, rows: NDArray[np.intp] | Sequence[int] | slice) -> DiamondStates:
        """The picked rows."""
        return DiamondStates(*(getattr(self, field.name)[rows] for field in fields(self)))


def states_at(
    loop: DiamondParameters,
    E1: ArrayLike,
    E2: ArrayLike,
    T: ArrayLike = 0.0,
    *,
    stage: ArrayLike = "isotropic",
    slip: ArrayLike = 0.0,
    added: ArrayLike = NONE,
) -> DiamondStates:
    """States (n,) of known strains and shear force: branch, forces and stresses follow."""
    rows = [np.atleast_1d(np.asarray(value, dtype=float)) for value in (E1, E2, T, slip)]
    E1, E2, T, slip = np.broadcast_arrays(*rows)
    added = np.broadcast_to(np.asarray(added, dtype=bool), (E1.size, 2))
    N, alpha = overlap_ratio(E1, E2, loop.alpha0), angle_from_strains(E1, E2, loop.alpha0)
    F1, F2 = external_forces(N, T, alpha)
    gap1, gap2 = opposite_gaps(E1, E2, loop.alpha0)
    return DiamondStates(
        stage=np.broadcast_to(stage, E1.shape),
        slip=slip,
        added=added,
        E1=E1,
        E2=E2,
        alpha=alpha,
        N=N,
        T=T,
        s1=(F1 - gap1 * added[:, 0]) / (2.0 * np.sin(loop.alpha0)),
        s2=(F2 - gap2 * added[:, 1]) / (2.0 * np.cos(loop.alpha0)),
    )


@dataclass(frozen=True, eq=False)
class Operators:
    """Tangents `K (n, 2, 2)` of `s' = K E'`, their parts (25) to (28), determinants (35), (36).

    An added contact counts as material. `det Ks = det K - ((K12 - K21)/2)^2`.
    """

    K: Floats
    material: Floats
    geometric: Floats
    det_K: Floats
    det_Ks: Floats


def operators(loop: DiamondParameters, states: DiamondStates) -> Operators:
    """Tangents of a diamond at its states."""
    alpha0, t0, slides = loop.alpha0, np.tan(loop.alpha0), states.slip != 0.0
    overlap = -np.stack(opposite_gaps(states.E1, states.E2, alpha0), axis=-1) * states.added
    # What turns with the branches: stresses without the share of added contacts.
    s1 = states.s1 - overlap[:, 0] / (2.0 * np.sin(alpha0))
    s2 = states.s2 - overlap[:, 1] / (2.0 * np.cos(alpha0))
    turning = states.E1, states.E2, s1, s2
    # Where the contacts stick the forms of sliding ones are computed in vain.
    sign, mu = np.where(slides, states.slip, 1.0), loop.mu if slides.any() else 0.0
    moduli = zip(elastic_moduli(loop.kappa), sliding_moduli(states.alpha, mu, sign), strict=True)
    lambda1, lambda2 = (np.where(slides, sliding, elastic) for elastic, sliding in moduli)
    material = material_tangent(states.E1, states.E2, alpha0, lambda1, lambda2)
    geometric = geometric_tangent(*turning, alpha0)
    bare = material + geometric
    added = np.stack([states.added[:, 0] / t0, states.added[:, 1] * t0], axis=-1)
    det_K = np.where(
        slides,
        determinant_sliding(*turning, states.alpha, mu, sign),
        determinant_elastic(*turning, states.alpha, loop.kappa),
    )
    det_K = det_K + added.prod(axis=-1) + added[:, 0] * bare[:, 1, 1] + added[:, 1] * bare[:, 0, 0]
    material = material + added[:, :, None] * np.eye(2)
    asymmetry = geometric_asymmetry(*turning, states.alpha)
    asymmetry = asymmetry + np.where(slides, material_asymmetry(mu, sign), 0.0)
    det_Ks = det_K - (0.5 * asymmetry) ** 2
    return Operators(material + geometric, material, geometric, det_K, det_Ks)
