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


def frobenius(a: Floats) -> Floats:
    """(...) norms of small matrices (..., i, j), several times faster than `numpy.linalg.norm`."""
    return np.asarray(np.sqrt(np.einsum("...ij,...ij->...", a, a)))


def all_finite(a: Floats) -> Flags:
    """(...) whether all entries of small matrices (..., i, j) are finite."""
    return np.asarray(np.isfinite(np.einsum("...ij->...", a)))


def in_threads(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Results of `work` on every item, on all cores; numpy on large arrays runs side by side."""
    with ThreadPoolExecutor(available_cores()) as pool:
        return list(pool.map(work, items))


def available_cores() -> int:
    """Cores that this process may use, where the system tells; all of them elsewhere."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
