"""Isotropic strain at which Ks of a regular loop first loses definiteness, as an exact root."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from loops import ContactLaw, contact_state, macroscopic_tangent
from loops.closures import Closure, Spins
from patterns import regular_polygon
from patterns.polygons.regular import Orientation
from stability import operator_norm, restrict, symmetric_spectrum

Floats = NDArray[np.float64]

# Strains that are looked at before a root is refined: none beyond the last.
FIRST, LAST, COUNT = 1e-6, 0.99, 397
# A smallest eigenvalue at the first load below this share of the operator's norm is a loss.
LOST = 1e-9


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
    [0.15, 0.0, -0.284]
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
    grid = np.concatenate([[FIRST], np.linspace(0.0, LAST, COUNT)[1:]])
    values = smallest(grid)
    lost = np.flatnonzero(~(values > 0.0))
    if not values[0] > -LOST * FIRST and values[0] <= 0.0:
        return 0.0
    if not values[0] > LOST * FIRST:
        return 0.0
    if len(lost) == 0:
        return None
    k = int(lost[0])
    if not np.isfinite(values[k]):
        return None
    return float(brentq(smallest, grid[k - 1], grid[k], xtol=1e-15, rtol=1e-14))
