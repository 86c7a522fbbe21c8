"""Loops painted into pixels: for each pixel the loop that contains its centre (loads numba)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import Faces, GrainGraph
from loops.arrays import Floats, Integers
from loops.compiled import given, kernel
from studies.snapshot.table import loop_polygons


class Painting(NamedTuple):
    """Loops in pixels."""

    loop: NDArray[np.int32]
    extent: tuple[float, float, float, float]


def paint_loops(graph: GrainGraph, faces: Faces, longest: int) -> Painting:
    """Paint the loops of a packing: each pixel holds the loop that contains its centre, or -1."""
    offsets, corners, _ = loop_polygons(graph, faces)
    corners = given(corners, np.float64)
    low, high = corners.min(axis=0), corners.max(axis=0)
    side = float((high - low).max()) / longest
    columns, rows = (max(1, math.ceil(float(length) / side)) for length in high - low)
    loop = _paint((corners - low) / side, offsets, rows, columns)
    left, bottom = low.tolist()
    return Painting(loop, (left, left + columns * side, bottom, bottom + rows * side))


@kernel
def _paint(corners: Floats, offsets: Integers, rows: int, columns: int) -> NDArray[np.int32]:
    """Fill polygons row by row, between the odd and even crossings of the line of centres."""
    picture = np.full((rows, columns), -1, dtype=np.int32)
    crossed = np.empty(np.diff(offsets).max() if len(offsets) > 1 else 0)
    for loop in range(len(offsets) - 1):
        begin, end = offsets[loop], offsets[loop + 1]
        low, high = corners[begin, 1], corners[begin, 1]
        for k in range(begin, end):
            low, high = min(low, corners[k, 1]), max(high, corners[k, 1])
        for row in range(max(0, math.ceil(low - 0.5)), min(rows - 1, math.floor(high)) + 1):
            found = _crossings(corners, begin, end, row + 0.5, crossed)
            for k in range(0, found - 1, 2):
                first = max(0, math.ceil(crossed[k] - 0.5))
                last = min(columns - 1, math.ceil(crossed[k + 1] - 0.5) - 1)
                for column in range(first, last + 1):
                    picture[row, column] = loop
    return picture


@kernel
def _crossings(corners: Floats, begin: int, end: int, height: float, out: Floats) -> int:
    """Sorted crossings of a polygon's sides with a height; loops agree on a shared side."""
    found = 0
    for k in range(begin, end):
        a, b = k, k + 1 if k + 1 < end else begin
        if (corners[a, 1] <= height) == (corners[b, 1] <= height):
            continue
        if corners[a, 1] > corners[b, 1]:
            a, b = b, a
        share = (height - corners[a, 1]) / (corners[b, 1] - corners[a, 1])
        at = corners[a, 0] + share * (corners[b, 0] - corners[a, 0])
        place = found
        while place > 0 and out[place - 1] > at:
            out[place] = out[place - 1]
            place -= 1
        out[place] = at
        found += 1
    return found
