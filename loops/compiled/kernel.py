"""Compilation of kernels, and contiguous arrays for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function at its first call, without the interpreter's lock.

    The machine code is kept beside the module, in the user's cache folder if that cannot be
    written, or where NUMBA_CACHE_DIR says. Where nothing can be written it is compiled anew in
    every process.
    """
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:  # numba's word for: no place for the cache
        return numba.njit(nogil=True, error_model="numpy")(function)


def given(values: ArrayLike, dtype: Any) -> NDArray[Any]:
    """A contiguous read-only view, copied only if need be: one type of input, compiled once."""
    view = np.ascontiguousarray(values, dtype=dtype).view()
    view.flags.writeable = False
    return view
