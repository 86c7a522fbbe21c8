"""Kernels that pass once over the contacts of a large packing: branches, forces on its grains.

Arrays are those of the contacts, (C, ...) with a row each, or of the grains, (G, ...). Each row of
a result belongs to one contact, so that parts of the contacts may be computed on several cores, or
is summed in the order of the contacts.
"""

from __future__ import annotations

import math

import numpy as np

from loops.arrays import Floats, Integers
from loops.compiled import kernel


@kernel
def fill_differences(x: Floats, contacts: Integers, d: Floats) -> None:
    """Fill in the centre of the second grain less that of the first, (C, 2)."""
    for c in range(len(contacts)):
        i, j = contacts[c, 0], contacts[c, 1]
        d[c, 0], d[c, 1] = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1]


@kernel
def fill_frames(d: Floats, length: Floats, n: Floats, t: Floats) -> None:
    """Fill in length, normal and tangent of branches."""
    for c in range(len(d)):
        size = math.hypot(d[c, 0], d[c, 1])
        length[c] = size
        n[c, 0], n[c, 1] = d[c, 0] / size, d[c, 1] / size
        t[c, 0], t[c, 1] = -n[c, 1], n[c, 0]


@kernel
def fill_edge_sums(
    d: Floats, contacts: Integers, offsets: Integers, loops: Integers, sums: Floats
) -> None:
    """Fill in the sums of x x, x y and y y over the branches around each of the loops, (L, 3)."""
    for k in range(len(loops)):
        xx, xy, yy = 0.0, 0.0, 0.0
        for h in range(offsets[loops[k]], offsets[loops[k] + 1]):
            x, y = d[contacts[h], 0], d[contacts[h], 1]
            xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
        sums[k, 0], sums[k, 1], sums[k, 2] = xx, xy, yy


@kernel
def stresses_at_end(
    contacts: Integers, side: int, d: Floats, normal: Floats, shear: Floats, radii: Floats
) -> Floats:
    """Sum force times arm, (G, 4), of the contacts whose `side` a grain is at."""
    total = np.zeros((len(radii), 4))
    for c in range(len(contacts)):
        length, g = math.hypot(d[c, 0], d[c, 1]), contacts[c, side]
        n0, n1 = d[c, 0] / length, d[c, 1] / length
        arm = 0.5 * (length + radii[g] - radii[contacts[c, 1 - side]])
        f0, f1 = normal[c] * n0 - shear[c] * n1, normal[c] * n1 + shear[c] * n0
        total[g, 0] += f0 * (arm * n0)
        total[g, 1] += f0 * (arm * n1)
        total[g, 2] += f1 * (arm * n0)
        total[g, 3] += f1 * (arm * n1)
    return total
