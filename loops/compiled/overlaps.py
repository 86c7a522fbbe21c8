"""Kernel of grains that overlap."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats, Integers
from loops.compiled import kernel

MOST_BINS = 4  # a grain: of fewer, larger bins where a few grains are far from the others


@kernel
def overlapping(x: Floats, radii: Floats, least: float) -> Integers:
    """(P, 2) grains that overlap by more than `least`, found in bins as wide as the largest."""
    count = len(x)
    low0, low1, high0, high1 = x[:, 0].min(), x[:, 1].min(), x[:, 0].max(), x[:, 1].max()
    side = 2.0 * radii.max()
    while ((high0 - low0) / side + 1.0) * ((high1 - low1) / side + 1.0) > MOST_BINS * count + 100:
        side *= 2.0
    columns, rows = int((high0 - low0) / side) + 1, int((high1 - low1) / side) + 1
    home = np.empty(count, dtype=np.int64)
    begin = np.zeros(columns * rows + 1, dtype=np.int64)
    for g in range(count):
        home[g] = int((x[g, 0] - low0) / side) * rows + int((x[g, 1] - low1) / side)
        begin[home[g] + 1] += 1
    for b in range(columns * rows):
        begin[b + 1] += begin[b]
    place, member = begin[:-1].copy(), np.empty(count, dtype=np.int64)
    for g in range(count):
        member[place[home[g]]] = g
        place[home[g]] += 1
    pairs = np.empty((count + 16, 2), dtype=np.int64)
    found = 0
    for b in range(columns * rows):
        column, row = b // rows, b % rows
        for k in range(begin[b], begin[b + 1]):
            g = member[k]
            # Later grains of the own bin and of the bin above, then three bins of the next column.
            for part in range(2):
                if part == 0:
                    first, last = k + 1, begin[b + 1 + (row + 1 < rows)]
                elif column + 1 < columns:
                    first = begin[b + rows - (row > 0)]
                    last = begin[b + rows + 1 + (row + 1 < rows)]
                else:
                    first, last = 0, 0
                for m in range(first, last):
                    h = member[m]
                    across, up = x[g, 0] - x[h, 0], x[g, 1] - x[h, 1]
                    reach = radii[g] + radii[h] - least
                    if reach > 0.0 and across * across + up * up < reach * reach:
                        if found == len(pairs):
                            longer = np.empty((2 * found, 2), dtype=np.int64)
                            for p in range(found):
                                longer[p, 0], longer[p, 1] = pairs[p, 0], pairs[p, 1]
                            pairs = longer
                        pairs[found, 0], pairs[found, 1] = g, h
                        found += 1
    return pairs[:found]
