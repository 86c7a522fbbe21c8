"""Isotropic strain at which Ks of a regular loop first loses definiteness, as an exact root."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from loops import ContactLaw, contact_state, macroscopic_tangent
from loops.closures import Closure, Spins
from patterns import regular_polygon
from patterns.polygons.shapes import Orientation
from stability import operator_norm, restrict, symmetric_spectrum

Floats = NDArray[np.float64]

# Strains that are looked at before a root is refined: none beyond the last.
FIRST, LAST, COUNT = 1e-6, 0.99, 100
# Strains looked at together.
CHUNKS = 9
# A smallest eigenvalue at the first load that is not above this share of the norm is a loss.
LOST = 1e-12


def smallest_eigenvalue(
    order: int,
    strain: Floats,
    law: ContactLaw,
    closure: Closure,
    spins: Spins = "blocked",
    subspace: str = "diagonal",
    orientation: Orientation = "vertex",
) -> Floats:
    """Smallest eigenvalue of Ks over the norm of K, under isotropic strains.

    Parameters
    ----------
    order : int
        Number of grains.
    strain : (...) array
        Isotropic strains `E1 = E2`, below 1.
    law : ContactLaw
        Any law; normal forces are the law's own, `T = 0`.
    closure, spins, subspace, orientation : str
        See `loops.macroscopic_tangent`, `stability.restrict`, `patterns.regular_polygon`.

    Returns
    -------
    (...) array
        NaN where the closure has no single answer.

    Examples
    --------
    >>> import numpy as np
    >>> from loops import LinearFrictional
    >>> law = LinearFrictional(kn=1.0, kt=0.25)
    >>> smallest_eigenvalue(6, np.array([0.1, 0.2, 0.3]), law, "traction").round(3).tolist()
    [0.237, 0.0, -0.399]
    """
    loop = regular_polygon(order, strain=strain, orientation=orientation)
    loop = loop.replace(normal_force=law.normal_force(contact_state(loop)))
    K = restrict(macroscopic_tangent(loop, law, closure, spins=spins).matrix, subspace)
    norm = operator_norm(K)
    return np.asarray(symmetric_spectrum(K)[..., 0] / np.where(norm > 0.0, norm, 1.0))


def critical_strain(
    order: int,
    law: ContactLaw,
    closure: Closure,
    spins: Spins = "blocked",
    subspace: str = "diagonal",
    orientation: Orientation = "vertex",
) -> float | None:
    """First isotropic strain at which Ks is no longer positive definite.

    Parameters
    ----------
    order : int
        Number of grains.
    law : ContactLaw
        Any law.
    closure, spins, subspace, orientation : str
        See `smallest_eigenvalue`.

    Returns
    -------
    float or None
        0.0 where Ks is not definite from the first load on, None where it stays definite up to
        `LAST`. A root is refined to 1e-15 where an eigenvalue changes sign between two of `COUNT`
        strains; one that is gained again between them is missed.

    Examples
    --------
    >>> from loops import LinearFrictional
    >>> law = LinearFrictional(kn=1.0, kt=0.25)
    >>> critical_strain(5, law, "traction", "free"), round(critical_strain(5, law, "traction"), 12)
    (0.0, 0.2)
    """

    def smallest(strain: Floats | float) -> Floats:
        strain = np.asarray(strain, dtype=float)
        return smallest_eigenvalue(order, strain, law, closure, spins, subspace, orientation)

    # The stiffness of spheres vanishes at touching: the first load, not none at all.
    if not float(smallest(FIRST)) > LOST:
        return 0.0
    below = FIRST
    for strains in np.array_split(np.linspace(0.0, LAST, COUNT)[1:], CHUNKS):
        values = smallest(strains)
        lost = np.flatnonzero(~(values > 0.0))
        if len(lost):
            k = int(lost[0])
            start = below if k == 0 else float(strains[k - 1])
            return _root(smallest, start, float(strains[k]))
        below = float(strains[-1])
    return None


def _root(smallest: Callable[[Floats | float], Floats], start: float, end: float) -> float | None:
    """Zero between two strains; none where an operator between them is not known."""
    if not np.isfinite(float(smallest(end))):
        return None
    return float(brentq(lambda E: float(smallest(E)), start, end, xtol=1e-15, rtol=1e-14))
