"""Shape and stress of loops, one after the other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from loops.compiled.kernel import kernel

Floats = NDArray[np.float64]
Long = NDArray[np.int64]
Mask = NDArray[np.bool_]

X, Y, AREA, PERIMETER, ELONGATION, ORIENTATION = range(6)
S11, S12, S21, S22, SLIDING = range(6, 11)
COLUMNS = 11


@kernel
def loop_areas(rows: Floats, offsets: Long, contacts: Long, forward: Mask, loops: Long) -> Floats:
    """(L,) areas of loops; arguments as in `loop_shapes`."""
    area = np.empty(len(loops))
    for loop in range(len(loops)):
        x, y, double = 0.0, 0.0, 0.0
        for h in range(offsets[loops[loop]], offsets[loops[loop] + 1]):
            sign = 1.0 if forward[h] else -1.0
            dx, dy = sign * rows[contacts[h], 0], sign * rows[contacts[h], 1]
            double += x * dy - y * dx
            x += dx
            y += dy
        area[loop] = 0.5 * double
    return area


@kernel
def loop_shapes(
    rows: Floats,
    x: Floats,
    regime: NDArray[np.int8],
    offsets: Long,
    grains: Long,
    contacts: Long,
    forward: Mask,
    loops: Long,
) -> Floats:
    """Shape and Love-Weber stress of loops.

    Parameters
    ----------
    rows, x, regime, offsets, grains, contacts, forward : arrays
        As in `CompiledPacking`.
    loops : (L,) array of int
        Faces to take, each counter-clockwise.

    Returns
    -------
    (L, 11) array
        Centroid, area, perimeter, elongation, orientation (radians), the stress 11, 12, 21, 22
        over the polygon with contacts counted whole, number of sliding contacts.
    """
    out = np.empty((len(loops), COLUMNS))
    for loop in range(len(loops)):
        begin, end = offsets[loops[loop]], offsets[loops[loop] + 1]
        for column in range(COLUMNS):
            out[loop, column] = 0.0
        x0, y0, double = 0.0, 0.0, 0.0
        for h in range(begin, end):
            sign = 1.0 if forward[h] else -1.0
            x1, y1 = x0 + sign * rows[contacts[h], 0], y0 + sign * rows[contacts[h], 1]
            weight = x0 * y1 - y0 * x1
            double += weight
            out[loop, X] += weight * (x0 + x1)
            out[loop, Y] += weight * (y0 + y1)
            x0, y0 = x1, y1
            _add_stress(rows[contacts[h]], out[loop])
            out[loop, SLIDING] += regime[contacts[h]] == 2
        out[loop, AREA] = 0.5 * double
        out[loop, X] /= 3.0 * double
        out[loop, Y] /= 3.0 * double
        for column in range(S11, S22 + 1):
            out[loop, column] /= out[loop, AREA]
        _add_moments(rows, contacts, forward, begin, end, out[loop])
        out[loop, X] += x[grains[begin], 0]
        out[loop, Y] += x[grains[begin], 1]
    return out


@kernel
def _add_stress(row: Floats, out: Floats) -> None:
    """Add `f (x) d`, `f = N n + T t`, and the length of the branch."""
    length = math.hypot(row[0], row[1])
    f0 = (row[6] * row[0] - row[7] * row[1]) / length
    f1 = (row[6] * row[1] + row[7] * row[0]) / length
    out[S11] += f0 * row[0]
    out[S12] += f0 * row[1]
    out[S21] += f1 * row[0]
    out[S22] += f1 * row[1]
    out[PERIMETER] += length


@kernel
def _add_moments(
    rows: Floats, contacts: Long, forward: Mask, begin: int, end: int, out: Floats
) -> None:
    """Elongation and orientation from the second moment of the area about the centroid."""
    xx, xy, yy = 0.0, 0.0, 0.0
    x0, y0 = -out[X], -out[Y]
    for h in range(begin, end):
        sign = 1.0 if forward[h] else -1.0
        x1, y1 = x0 + sign * rows[contacts[h], 0], y0 + sign * rows[contacts[h], 1]
        weight = (x0 * y1 - y0 * x1) / 12.0
        xx += weight * (x0 * x0 + x1 * x1 + x0 * x1)
        yy += weight * (y0 * y0 + y1 * y1 + y0 * y1)
        xy += weight * (x0 * y0 + x1 * y1 + 0.5 * (x0 * y1 + y0 * x1))
        x0, y0 = x1, y1
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    radius = math.hypot(half, xy)
    gap = mean - radius
    out[ELONGATION] = math.sqrt((mean + radius) / gap) if gap > 0.0 else np.inf
    out[ORIENTATION] = 0.5 * math.atan2(xy, half)
