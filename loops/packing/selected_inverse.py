"""Entries of the inverse of a sparse matrix where its grains meet in a front (Takahashi).

With a front's own freedoms J and the rest S, and `K` reduced to them by the fronts below,

    Z_SJ = -Z_SS F_SJ F_JJ^-1,  Z_JS = -F_JJ^-1 F_JS Z_SS,
    Z_JJ = F_JJ^-1 + F_JJ^-1 F_JS Z_SS F_SJ F_JJ^-1

`Z_SS` is part of the parent's: one sweep up the tree factorises, one sweep down inverts. `K` need
not be symmetric; pivots are taken within a front's own block.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import sparse

from loops.arrays import Floats, Integers
from loops.packing.dissection import Front


class Eliminated(NamedTuple):
    """A front's own and remaining freedoms, `F_JJ^-1`, `F_JJ^-1 F_JS` and `F_SJ F_JJ^-1`."""

    own: Integers
    rest: Integers
    inverse: Floats
    right: Floats
    left: Floats


def eliminate(matrix: sparse.csr_array, fronts: list[Front], freedom: Integers) -> list[Eliminated]:
    """Factorise front by front; `freedom` (G, 3) has -1 where a grain has no freedom."""
    columns = matrix.tocsc()
    place = np.full(matrix.shape[0], -1)
    updates: dict[int, Floats] = {}
    done: list[Eliminated] = []
    for k, front in enumerate(fronts):
        own, rest = _free(freedom, front.own), _free(freedom, front.rest)
        j, size = len(own), len(own) + len(rest)
        place[own], place[rest] = np.arange(j), np.arange(j, size)
        dense = np.zeros((size, size))
        for child in front.children:
            at = place[done[child].rest]
            dense[at[:, None], at] += updates.pop(child)
        _add_lines(dense, matrix, own, place)
        _add_lines(dense.T, columns, own, place, after=j)
        inverse: Floats = np.linalg.inv(dense[:j, :j]).astype(np.float64, copy=False)
        right = inverse @ dense[:j, j:]
        updates[k] = dense[j:, j:] - dense[j:, :j] @ right
        done.append(Eliminated(own, rest, inverse, right, dense[j:, :j] @ inverse))
        place[own], place[rest] = -1, -1
    return done


def inverse_on_fronts(
    fronts: list[Front], done: list[Eliminated]
) -> Iterator[tuple[int, Integers, Floats]]:
    """Each front with its freedoms (own first) and the inverse on them, parents first."""
    stack: list[tuple[int, Floats]] = [(len(fronts) - 1, np.empty((0, 0)))] if fronts else []
    place = np.full(1 + max((int(part.own.max(initial=-1)) for part in done), default=-1), -1)
    while stack:
        k, outer = stack.pop()
        part = done[k]
        j, size = len(part.own), len(part.own) + len(part.rest)
        z = np.empty((size, size))
        z[j:, j:] = outer
        z[j:, :j] = -outer @ part.left
        z[:j, j:] = -part.right @ outer
        z[:j, :j] = part.inverse - part.right @ z[j:, :j]
        freedoms = np.concatenate([part.own, part.rest])
        yield k, freedoms, z
        place[freedoms] = np.arange(size)
        for child in fronts[k].children:
            at = place[done[child].rest]
            stack.append((child, z[at[:, None], at]))


def _free(freedom: Integers, grains: Integers) -> Integers:
    every = freedom[grains].ravel()
    return every[every >= 0]


def _add_lines(
    dense: Floats, lines: sparse.csr_array, own: Integers, place: Integers, after: int = 0
) -> None:
    """Add the matrix's entries of the own lines, from local place `after` on, to a front."""
    count = lines.indptr[own + 1] - lines.indptr[own]
    row = np.repeat(np.arange(len(own)), count)
    shift = np.repeat(lines.indptr[own] - np.concatenate([[0], np.cumsum(count)[:-1]]), count)
    at = np.arange(len(row)) + shift
    column = place[lines.indices[at]]
    inside = column >= after
    dense[row[inside], column[inside]] += lines.data[at][inside]
