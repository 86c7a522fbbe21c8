"""Types of the arrays that the platform hands around."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
Regimes = NDArray[np.int8]


def frobenius(a: Floats) -> Floats:
    """(...) norms of small matrices (..., i, j), several times faster than `numpy.linalg.norm`."""
    return np.asarray(np.sqrt(np.einsum("...ij,...ij->...", a, a)))


def all_finite(a: Floats) -> Flags:
    """(...) whether all entries of small matrices (..., i, j) are finite."""
    return np.asarray(np.isfinite(np.einsum("...ij->...", a)))
