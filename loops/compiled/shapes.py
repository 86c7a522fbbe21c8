"""Shapes and stresses of loops, one loop after the other."""

from __future__ import annotations

import math

import numpy as np

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.compiled import inlined, kernel

# Columns of `contact_rows`: those of `loops.closures.ring`, whose changes the cache would not see.
LENGTH, FN, FT = 0, 3, 4
# Columns of `loop_shapes`.
X, Y, AREA, PERIMETER, ELONGATION, ORIENTATION = range(6)
S11, S12, S21, S22, SLIDING = range(6, 11)
COLUMNS = 11


@kernel
def loop_shapes(
    rows: Floats, branches: Floats, x: Floats, regime: Regimes, offsets: Integers,
    grains: Integers, contacts: Integers, forward: Flags, loops: Integers,
) -> Floats:  # fmt: skip
    """(L, 11) of the given faces, each counter-clockwise; arrays as in `Rings`.

    Centroid, area, perimeter, elongation, orientation (radians), the stress 11, 12, 21, 22 over the
    polygon with contacts counted whole, number of sliding contacts.
    """
    out = np.empty((len(loops), COLUMNS))
    for loop in range(len(loops)):
        begin, end = offsets[loops[loop]], offsets[loops[loop] + 1]
        for column in range(COLUMNS):
            out[loop, column] = 0.0
        x0, y0, double = 0.0, 0.0, 0.0
        for h in range(begin, end):
            sign = 1.0 if forward[h] else -1.0
            x1, y1 = x0 + sign * branches[contacts[h], 0], y0 + sign * branches[contacts[h], 1]
            weight = x0 * y1 - y0 * x1
            double += weight
            out[loop, X] += weight * (x0 + x1)
            out[loop, Y] += weight * (y0 + y1)
            x0, y0 = x1, y1
            c = contacts[h]
            dx, dy, length = branches[c, 0], branches[c, 1], rows[c, LENGTH]
            fn, ft = rows[c, FN] / length, rows[c, FT] / length
            f0, f1 = fn * dx - ft * dy, fn * dy + ft * dx
            out[loop, S11] += f0 * dx
            out[loop, S12] += f0 * dy
            out[loop, S21] += f1 * dx
            out[loop, S22] += f1 * dy
            out[loop, PERIMETER] += length
            out[loop, SLIDING] += regime[contacts[h]] == 2
        out[loop, AREA] = 0.5 * double
        out[loop, X] /= 3.0 * double
        out[loop, Y] /= 3.0 * double
        for column in range(S11, S22 + 1):
            out[loop, column] /= out[loop, AREA]
        _add_moments(branches, contacts, forward, begin, end, loop, out)
        out[loop, X] += x[grains[begin], 0]
        out[loop, Y] += x[grains[begin], 1]
    return out


@inlined
def _add_moments(
    branches: Floats,
    contacts: Integers,
    forward: Flags,
    begin: int,
    end: int,
    loop: int,
    out: Floats,
) -> None:
    """Elongation and orientation from the second moment of the area about the centroid."""
    xx, xy, yy = 0.0, 0.0, 0.0
    x0, y0 = -out[loop, X], -out[loop, Y]
    for h in range(begin, end):
        sign = 1.0 if forward[h] else -1.0
        x1, y1 = x0 + sign * branches[contacts[h], 0], y0 + sign * branches[contacts[h], 1]
        weight = (x0 * y1 - y0 * x1) / 12.0
        xx += weight * (x0 * x0 + x1 * x1 + x0 * x1)
        yy += weight * (y0 * y0 + y1 * y1 + y0 * y1)
        xy += weight * (x0 * y0 + x1 * y1 + 0.5 * (x0 * y1 + y0 * x1))
        x0, y0 = x1, y1
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    radius = math.hypot(half, xy)
    gap = mean - radius
    out[loop, ELONGATION] = math.sqrt((mean + radius) / gap) if gap > 0.0 else np.inf
    out[loop, ORIENTATION] = 0.5 * math.atan2(xy, half)
