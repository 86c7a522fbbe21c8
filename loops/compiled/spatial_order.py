"""Grains numbered along space, so that neighbours lie close in memory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from loops.compiled.kernel import kernel

BITS = 11  # bins along each axis: 2^11, their codes sorted in two passes of 2^11 counters
BINS = 2**BITS


@kernel
def spatial_order(x: NDArray[np.float64]) -> NDArray[np.int32]:
    """Grains in the order of a Z-shaped curve through a grid of bins.

    Parameters
    ----------
    x : (G, 2) array
        Centres, finite.

    Returns
    -------
    (G,) array of int32
        Grains in order; those of one bin by their number.
    """
    grains = len(x)
    low0, low1, high0, high1 = x[0, 0], x[0, 1], x[0, 0], x[0, 1]
    for g in range(grains):
        low0, high0 = min(low0, x[g, 0]), max(high0, x[g, 0])
        low1, high1 = min(low1, x[g, 1]), max(high1, x[g, 1])
    scale0, scale1 = _bins_per_length(low0, high0), _bins_per_length(low1, high1)
    # The code of the bin above, the grain below.
    keys = np.empty(grains, dtype=np.int64)
    for g in range(grains):
        column, row = int((x[g, 0] - low0) * scale0), int((x[g, 1] - low1) * scale1)
        keys[g] = (_spread(column) | (_spread(row) << 1)) << 32 | g
    other = np.empty_like(keys)
    _sort_by_digit(keys, other, 32)
    _sort_by_digit(other, keys, 32 + BITS)
    order = np.empty(grains, dtype=np.int32)
    for g in range(grains):
        order[g] = keys[g] & 0x7FFFFFFF
    return order


@kernel
def _bins_per_length(low: float, high: float) -> float:
    # A hair less than all, so that the last grain falls into the last bin.
    return (BINS - 0.001) / (high - low) if high > low else 0.0


@kernel
def _spread(value: int) -> int:
    """The bits of a number on even places, zeros between them."""
    value = (value | (value << 8)) & 0x00FF00FF
    value = (value | (value << 4)) & 0x0F0F0F0F
    value = (value | (value << 2)) & 0x33333333
    return (value | (value << 1)) & 0x55555555


@kernel
def _sort_by_digit(keys: NDArray[np.int64], out: NDArray[np.int64], shift: int) -> None:
    """One pass of a radix sort, stable."""
    begin = np.zeros(BINS + 1, dtype=np.int64)
    for key in keys:
        begin[((key >> shift) & (BINS - 1)) + 1] += 1
    for digit in range(BINS):
        begin[digit + 1] += begin[digit]
    for key in keys:
        digit = (key >> shift) & (BINS - 1)
        out[begin[digit]] = key
        begin[digit] += 1
