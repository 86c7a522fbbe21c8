"""Types of arrays, and small operations on many of them at once."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

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


def as_complex(vectors: Floats) -> NDArray[np.complex128]:
    """Vectors of the plane (..., 2) as complex numbers (...): numpy gathers these faster."""
    return np.ascontiguousarray(vectors, dtype=np.float64).view(np.complex128)[..., 0]


def true_runs(where: Flags) -> list[slice]:
    """Slices of consecutive True values (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(np.int64), [0]])))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def median(values: ArrayLike) -> float:
    """Return the median of all values; nan of none."""
    return float(np.median(np.asarray(values))) if np.size(values) else float("nan")


def quantiles(values: ArrayLike, shares: Sequence[float]) -> list[float]:
    """Return the quantiles of all values, linear between them; nan of none."""
    known = np.asarray(values if np.size(values) else np.nan)
    return [float(one) for one in np.quantile(known, shares)]


def in_threads(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Results of `work` on every item, by as many threads as cores."""
    with ThreadPoolExecutor(available_cores()) as pool:
        return list(pool.map(work, items))


@cache
def _blas(of_scipy: bool) -> ThreadpoolController:
    """The libraries of linear algebra: numpy has one, scipy another."""
    if of_scipy:
        import scipy.linalg  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def _release(blas: ThreadpoolController) -> None:
    """Let any thread set the number, as the last block may end in another one than the first."""
    for library in blas.lib_controllers:
        if hasattr(library, "clear_controlling_thread"):
            library.clear_controlling_thread(force=True)


# Limits of the blocks that run in one thread now: the first knows what was before.
_LOCK, _LIMITS = Lock(), list[Any]()


@contextmanager
def one_blas_thread(*, of_scipy: bool = True) -> Iterator[None]:
    """Run the linear algebra of numpy and scipy in one thread: a context, or a decorator.

    Without `of_scipy`, which the block must not use then, scipy is not loaded.

    The number of threads of OpenBLAS changes the last digit of a decomposition, from some 40
    unknowns on: one process, several, and a cluster of other machines must give the same bits.
    Threads that wait for each other cost more than they save in matrices of a few hundred rows: a
    direction of `sustain` took 35 s in place of 4.8 s (2,000 grains, two cores). Blocks may lie in
    one another, and beside one another in threads of the caller: the last to end sets it back.
    """
    blas = _blas(of_scipy or "scipy" in sys.modules)
    with _LOCK:
        if not _LIMITS:
            _release(blas)
        _LIMITS.append(None if _LIMITS else blas.limit(limits=1, user_api="blas"))
    try:
        yield
    finally:
        with _LOCK:
            if (limit := _LIMITS.pop()) is not None:
                _release(blas)
                limit.restore_original_limits()
                _release(blas)


def available_cores() -> int:
    """Cores that this process may use; all of the machine where the system does not say."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
