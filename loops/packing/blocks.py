"""Polygons of the loops of a packing, and square blocks of it with grains held around them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.faces import Faces
from loops.geometry import boundary_vectors, polygon_area
from loops.graph import GrainGraph
from loops.loop_batches import loop_batches
from loops.packing.system import PackingSystem


@dataclass(frozen=True, eq=False)
class Polygons:
    """Loops grouped by order: grains (l, n), boundary vectors (l, n, 2), areas and row of each.

    A row is the place of the loop in `centre` (L, 2), the mean position of its grains.
    """

    grains: list[Integers]
    vectors: list[Floats]
    area: list[Floats]
    row: list[Integers]
    centre: Floats

    def take(self, loops: Integers) -> Polygons:
        """Polygons of some rows, numbered in this order."""
        row = np.full(len(self.centre), -1)
        row[loops] = np.arange(len(loops))
        kept = [row[own] >= 0 for own in self.row]
        return Polygons(
            grains=[a[k] for a, k in zip(self.grains, kept, strict=True)],
            vectors=[a[k] for a, k in zip(self.vectors, kept, strict=True)],
            area=[a[k] for a, k in zip(self.area, kept, strict=True)],
            row=[row[a[k]] for a, k in zip(self.row, kept, strict=True)],
            centre=self.centre[loops],
        )


def polygons_of(graph: GrainGraph, faces: Faces) -> Polygons:
    """Polygons of all loops of a packing, in the order of `Faces.loops`."""
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(len(faces.loops))
    out = Polygons([], [], [], [], np.empty((len(faces.loops), 2)))
    for batch in loop_batches(graph, faces):
        x = batch.graph.x
        out.grains.append(batch.grains)
        out.vectors.append(boundary_vectors(x))
        out.area.append(polygon_area(x))
        out.row.append(row[batch.face])
        out.centre[row[batch.face]] = x.mean(axis=1) + batch.origin
    return out


@dataclass(frozen=True, eq=False)
class Block:
    """Free grains (G,), positions `x` (G, 2) around the block's centre, and the block's loops.

    `rho` is the distance of each loop to the nearest held grain in mean diameters, infinite where
    none is held.
    """

    free: Flags
    x: Floats
    loops: Integers
    rho: Floats
    whole: bool


def packing_blocks(
    system: PackingSystem, polygons: Polygons, side: float, buffer: float
) -> Iterator[Block]:
    """Cut the box into blocks of about `side`, each with its buffer."""
    graph, carries = system.graph, system.carrying.grains
    box, origin = _box(graph)
    heights = abs(np.linalg.det(box)) / np.linalg.norm(box[:, ::-1], axis=0)
    extent = heights / (2.0 * float(graph.radii[carries].mean()))
    place, centre = (np.linalg.solve(box, (x - origin).T).T for x in (graph.x, polygons.centre))
    counts = np.maximum(1, np.round(extent / side)).astype(np.int64)
    home = np.floor((centre - np.floor(centre)) * counts).astype(np.int64).clip(0, counts - 1)
    number = home[:, 0] * counts[1] + home[:, 1]
    for k in range(int(counts.prod())):
        middle = (np.array(divmod(k, int(counts[1]))) + 0.5) / counts
        reach = 0.5 / counts + buffer / extent
        away, off = (_nearest(f - middle, graph) for f in (place, centre))
        free = carries & (np.abs(away) <= reach).all(axis=1)
        whole = bool(free[carries].all())
        mine = np.flatnonzero(number == k)
        rho = ((reach - np.abs(off)) * extent).min(axis=1)
        for grains, row in zip(polygons.grains, polygons.row, strict=True):
            # Grains of a loop that reaches beyond the buffer are freed; its error is unknown.
            beyond = (number[row] == k) & ~free[grains].all(axis=1)
            rho[row[beyond]] = 0.0
            free[grains[beyond]] = True
        yield Block(
            free=free & carries,
            x=away @ box.T,
            loops=mine,
            rho=np.full(len(mine), np.inf) if whole else rho[mine],
            whole=whole,
        )


def _box(graph: GrainGraph) -> tuple[Floats, Floats]:
    if graph.cell is not None:
        return graph.cell, np.zeros(2)
    low, high = graph.x.min(axis=0), graph.x.max(axis=0)
    return np.diag(np.maximum(high - low, 1e-9 * np.abs(graph.radii).max())), low


def _nearest(offset: Floats, graph: GrainGraph) -> Floats:
    return offset if graph.cell is None else offset - np.round(offset)
