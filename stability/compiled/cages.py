"""Pairs of grains that carry nothing: normals and overlaps, shear, and how grains move them."""

from __future__ import annotations

import math

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.compiled import kernel


@kernel
def normals_and_overlaps(
    ends: Integers, offset: Floats, walls: Floats, x: Floats, touching: Floats
) -> tuple[Floats, Floats, Floats]:
    """Normals (R, 2), lengths and overlaps (R,) of pairs `ends` (2, R), zero where apart.

    Cell vectors `offset` (R, 2) are added with the rounding error of the difference, as in
    `loops.graph.across_border`. The last bodies are `walls`, whose contacts keep their normals.
    """
    count, first_wall = len(touching), len(x) - len(walls)
    n, length, overlap = np.empty((count, 2)), np.empty(count), np.empty(count)
    for p in range(count):
        i, j = ends[0, p], ends[1, p]
        for a in range(2):
            total = x[j, a] - x[i, a]
            kept = x[j, a] - total
            lost = (x[j, a] - (total + kept)) + (kept - x[i, a])
            n[p, a] = total + offset[p, a] + lost
        if j >= first_wall:
            normal = walls[j - first_wall]
            along = n[p, 0] * normal[0] + n[p, 1] * normal[1]
            n[p, 0], n[p, 1] = along * normal[0], along * normal[1]
        length[p] = math.sqrt(n[p, 0] ** 2 + n[p, 1] ** 2)
        overlap[p] = max(touching[p] - length[p], 0.0)
        n[p, 0] /= length[p]
        n[p, 1] /= length[p]
    return n, length, overlap


@kernel
def sheared(
    ends: Integers,
    c: Integers,
    n: Floats,
    moved: Floats,
    turned: Floats,
    kt: Floats,
    strength: Floats,
) -> tuple[Floats, Floats, Flags]:
    """Shear of pairs `c` (P,), its forces, and which slide, where grains have moved and turned.

    Displacements are `moved` (B, 2), turns times radii `turned` (B,).
    """
    slid, T, slides = np.empty(len(c)), np.empty(len(c)), np.empty(len(c), dtype=np.bool_)
    for k in range(len(c)):
        i, j = ends[0, c[k]], ends[1, c[k]]
        u0, u1 = moved[j, 0] - moved[i, 0], moved[j, 1] - moved[i, 1]
        slid[k] = n[k, 0] * u1 - n[k, 1] * u0 - turned[i] - turned[j]
        shear = kt[k] * slid[k]
        slides[k] = abs(shear) > strength[k]
        T[k] = -min(max(shear, -strength[k]), strength[k])
    return slid, T, slides


@kernel
def work_of_shear(c: Integers, kt: Floats, strength: Floats, slid: Floats) -> float:
    """Energy that shear of pairs `c` (P,) stores and takes at stiffnesses and strengths (R,)."""
    work = 0.0
    for k in range(len(c)):
        s, most, way = kt[c[k]], strength[c[k]], abs(slid[k])
        T = min(s * way, most)
        work += T * (way - (T / (2.0 * s) if s > 0.0 else 0.0))
    return work


@kernel
def parting_and_slip(
    ends: Integers, c: Integers, n: Floats, idle: Flags
) -> tuple[Floats, Integers]:
    """Parting and slip (2, P, 3 G) of pairs `c` (P,) by their idle grains, and these (G,).

    `n` (P, 2) are their normals. Unknowns of a grain: its displacement, and its spin times its
    radius.
    """
    met = np.zeros(len(idle), dtype=np.bool_)
    for p in c:
        for s in range(2):
            met[ends[s, p]] = idle[ends[s, p]]
    grains, place = np.flatnonzero(met), np.cumsum(met) - 1
    out = np.zeros((2, len(c), len(grains), 3))
    for k in range(len(c)):
        for s in range(2):
            grain, sense = ends[s, c[k]], 2.0 * s - 1.0
            if met[grain]:
                parts, shears = out[0, k, place[grain]], out[1, k, place[grain]]
                parts[0] += sense * n[k, 0]
                parts[1] += sense * n[k, 1]
                shears[0] -= sense * n[k, 1]
                shears[1] += sense * n[k, 0]
                shears[2] -= 1.0
    return out.reshape(2, len(c), 3 * len(grains)), grains
