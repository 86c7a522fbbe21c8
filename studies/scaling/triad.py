"""The loop that measures memory bandwidth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from loops.compiled.kernel import kernel

Floats = NDArray[np.float64]


@kernel
def triad(a: Floats, b: Floats, c: Floats, s: float) -> None:
    """`a = b + s c`, each number read or written once."""
    for k in range(len(a)):
        a[k] = b[k] + s * c[k]
