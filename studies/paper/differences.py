"""How far two arrays lie apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stability.spectra import operator_norm


def difference(found: ArrayLike, expected: ArrayLike) -> float:
    """Largest difference over the largest size of what is expected.

    Parameters
    ----------
    found, expected : array_like (...)
        What to compare.

    Returns
    -------
    float

    Examples
    --------
    >>> from studies.paper.differences import difference
    >>> difference([1.0, 2.5], [1.0, 2.0])
    0.25
    """
    expected = np.asarray(expected)
    return float(np.max(np.abs(np.asarray(found) - expected)) / np.max(np.abs(expected)))


def operator_difference(found: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Largest relative difference of operators, Frobenius norms.

    Parameters
    ----------
    found, expected : ndarray (n, 2, 2)
        What to compare.

    Returns
    -------
    float
    """
    return float(np.max(operator_norm(found - expected) / operator_norm(expected)))
