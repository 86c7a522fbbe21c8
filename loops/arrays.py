"""Types of arrays, and small operations on many of them at once."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Item = TypeVar("Item")
Result = TypeVar("Result")

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]
Regimes = NDArray[np.int8]
# Unit of rounding times its growth by a few operations.
ROUNDING = 8 * float(np.finfo(np.float64).eps)


def frobenius(a: Floats) -> Floats:
    """(...) norms of small matrices (..., i, j), several times faster than `numpy.linalg.norm`."""
    return np.asarray(np.sqrt(np.einsum("...ij,...ij->...", a, a)))


def all_finite(a: Floats) -> Flags:
    """(...) whether all entries of small matrices (..., i, j) are finite."""
    return np.asarray(np.isfinite(np.einsum("...ij->...", a)))


def in_threads(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Results of `work` on every item, by as many threads as cores."""
    with ThreadPoolExecutor(available_cores()) as pool:
        return list(pool.map(work, items))


def available_cores() -> int:
    """Cores that this process may use; all of the machine where the system does not say."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
