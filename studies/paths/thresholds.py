"""Isotropic strains at which a loop that keeps its shape loses stability."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from loops import ContactLaw, GrainGraph, contact_state, macroscopic_tangent
from loops.arrays import Floats
from loops.closures import Closure, Spins
from stability import operator_norm, restrict, symmetric_spectrum
from studies.paths.options import PolygonOptions

SUBSPACES = ("diagonal", "symmetric", "full")
# Strains between which the threshold is bracketed: the first, the last, and their count.
FIRST_STRAIN = 1e-6
LAST_STRAIN = 0.99
BRACKETS = 100
# Parts in which they are tried.
STRAIN_PARTS = 9
# Ks is not definite if its smallest eigenvalue at the first load is at most this share of the norm.
DEFINITE_RTOL = 1e-12


def thresholds(options: PolygonOptions) -> dict[str, float | None]:
    """Isotropic threshold by subspace, from the barely touching loop on.

    Also None where isotropic strain does not keep the loop's shape.
    """
    law, o = options.law(), options
    if not o.keeps_shape:
        return dict.fromkeys(SUBSPACES)
    return {
        subspace: isotropic_threshold(o.graph, law, o.closure, o.spins, subspace)
        for subspace in SUBSPACES
    }


def isotropic_threshold(
    strained: Callable[[Floats | float], GrainGraph],
    law: ContactLaw,
    closure: Closure,
    spins: Spins = "blocked",
    subspace: str = "diagonal",
) -> float | None:
    """First isotropic strain at which Ks of a loop that keeps its shape isn't positive definite.

    0 where Ks is not definite from the first load on, None where it stays so up to `LAST_STRAIN`.
    A root is refined to 1e-15 where an eigenvalue changes sign between two of `BRACKETS` strains;
    one that is gained again between them is missed.

    >>> from loops import boundary_of, LinearFrictional
    >>> law = LinearFrictional(kn=1.0, kt=0.25)
    >>> pentagon = PolygonOptions(5).graph
    >>> isotropic_threshold(pentagon, law, "traction", "free")
    0.0
    >>> round(isotropic_threshold(pentagon, law, "traction"), 12)
    0.2
    """

    def smallest(strain: Floats | float) -> Floats:
        """Smallest eigenvalue of Ks over the norm of K; NaN where there is no single answer."""
        loop = strained(strain)
        loop = loop.replace(normal_force=law.normal_force(contact_state(loop)))
        K = restrict(macroscopic_tangent(loop, law, closure, spins=spins).matrix, subspace)
        norm = operator_norm(K)
        return np.asarray(symmetric_spectrum(K)[..., 0] / np.where(norm > 0.0, norm, 1.0))

    # Spheres have no stiffness where they just touch: take the first load instead.
    if not float(smallest(FIRST_STRAIN)) > DEFINITE_RTOL:
        return 0.0
    below = FIRST_STRAIN
    for strains in np.array_split(np.linspace(0.0, LAST_STRAIN, BRACKETS)[1:], STRAIN_PARTS):
        lost = np.flatnonzero(~(smallest(strains) > 0.0))
        if len(lost):
            k = int(lost[0])
            bracket = below if k == 0 else float(strains[k - 1]), float(strains[k])
            if not np.isfinite(float(smallest(bracket[1]))):
                return None
            return float(brentq(lambda E: float(smallest(E)), *bracket, xtol=1e-15, rtol=1e-14))
        below = float(strains[-1])
    return None
