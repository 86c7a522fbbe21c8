"""Loops in their packing: the system inverted whole, in blocks, or patch by patch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu
from scipy.spatial import cKDTree

from loops.arrays import Flags, Floats, Integers
from loops.faces import Faces
from loops.geometry import boundary_vectors, polygon_area
from loops.graph import GrainGraph
from loops.loop_batches import loop_batches
from loops.packing.dissection import Front, dissection
from loops.packing.factor import regularised
from loops.packing.selected_inverse import eliminate, inverse_on_fronts
from loops.packing.system import PackingSystem, assembled

# Added to the diagonal over the typical stiffness. C_in is off by about a thousand times that, by a
# million times in the softest modes of sliding contacts; rounding shows from 1e-13 on.
EPS = 1e-12
# A compliance so much smaller in one direction than in another is none: a mode that nothing but EPS
# holds is softer by EPS, a loop of one grain and its images has no strain at all.
SINGULAR = 1e-10


def _loads(moves: Integers, vectors: Floats, size: int) -> Floats:
    """(size, 4) forces `B` of a loop on its grains' freedoms `moves` (n, 2)."""
    B = np.zeros((size, 4))
    np.add.at(B[:, :2], moves[:, 0], vectors)
    np.add.at(B[:, 2:], moves[:, 1], vectors)
    return B


def _lu(matrix: sparse.sparray) -> SuperLU:
    return splu(
        matrix.tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.001,
        options={"SymmetricMode": True},
    )


def of_some(system: PackingSystem, polygons: Polygons, some: Integers) -> Floats:
    """(L, 4, 4) `A_in` of some loops solved one by one in the whole packing, else not numbers."""
    lu = _lu(regularised(system, assembled(system), EPS))
    compliance = np.full((len(polygons.centre), 4, 4), np.nan)
    for grains, vectors, area, row in zip(
        polygons.grains, polygons.vectors, polygons.area, polygons.row, strict=True
    ):
        for k in np.flatnonzero(np.isin(row, some)):
            B = _loads(system.freedom[grains[k], :2], vectors[k], system.size)
            compliance[row[k]] = B.T @ lu.solve(B) / area[k]
    return _inverted(compliance)


def in_blocks(
    system: PackingSystem, polygons: Polygons, side: float, buffer: float
) -> tuple[Floats, Floats]:
    """`A_in` of all loops and their distances to held grains."""
    compliance = np.full((len(polygons.centre), 4, 4), np.nan)
    rho = np.full(len(polygons.centre), np.nan)
    for part in _blocks(system, polygons, side, buffer):
        compliance[part.loops] = _compliances(system, polygons, part)
        rho[part.loops] = part.rho
    return _inverted(compliance), rho


def _inverted(compliance: Floats) -> Floats:
    """`C_in^-1`; not numbers where there is none, or where EPS alone would say what it is."""
    size = np.linalg.svd(np.nan_to_num(compliance), compute_uv=False)
    known = np.isfinite(compliance).all(axis=(1, 2)) & (size[:, 3] > SINGULAR * size[:, 0])
    out = np.full_like(compliance, np.nan)
    out[known] = np.linalg.inv(compliance[known])
    return out


@dataclass(frozen=True, eq=False)
class Polygons:
    """Loops by order: grains (L, n), boundary vectors (L, n, 2), areas and rows of the results.

    Of all loops the `centre`, and the `reach` from there to the farthest grain.
    """

    grains: list[Integers]
    vectors: list[Floats]
    area: list[Floats]
    row: list[Integers]
    centre: Floats
    reach: Floats


def polygons_of(graph: GrainGraph, faces: Faces) -> Polygons:
    """The loops of a packing, see `Polygons`."""
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(len(faces.loops))
    count = len(faces.loops)
    out = Polygons([], [], [], [], np.empty((count, 2)), np.empty(count))
    for batch in loop_batches(graph, faces):
        x = batch.graph.x
        out.grains.append(batch.grains)
        out.vectors.append(boundary_vectors(x))
        out.area.append(polygon_area(x))
        out.row.append(row[batch.face])
        centre = x.mean(axis=1)
        out.centre[row[batch.face]] = centre + batch.origin
        out.reach[row[batch.face]] = np.linalg.norm(x - centre[:, None], axis=2).max(axis=1)
    return out


@dataclass(frozen=True, eq=False)
class Block:
    """Free grains, where they lie, the loops judged with them and their distances to held grains.

    Distances `rho` are in mean diameters, infinite where no grain is held.
    """

    free: Flags
    x: Floats
    loops: Integers
    rho: Floats
    freedom_kept: Flags
    whole: bool


def _blocks(
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
            # A loop that reaches beyond the buffer is freed, and nothing is said of its error.
            beyond = (number[row] == k) & ~free[grains].all(axis=1)
            rho[row[beyond]] = 0.0
            free[grains[beyond]] = True
        free &= carries
        kept = np.zeros(system.size + 1, dtype=bool)
        kept[system.freedom[free]] = True
        yield Block(
            free=free,
            x=away @ box.T,
            loops=mine,
            rho=np.full(len(mine), np.inf) if whole else rho[mine],
            freedom_kept=kept[:-1],
            whole=whole,
        )


def in_patches(system: PackingSystem, polygons: Polygons, radius: float) -> tuple[Floats, Floats]:
    """`A_in` of every loop, grains further than `radius` mean diameters around it held."""
    graph, carries = system.graph, system.carrying.grains
    box, origin = _box(graph)
    place, centre = (np.linalg.solve(box, (x - origin).T).T for x in (graph.x, polygons.centre))
    # In the box stretched to its heights a circle lies within the square of its radius.
    heights = abs(np.linalg.det(box)) / np.linalg.norm(box[:, ::-1], axis=0)
    reach = radius * 2.0 * float(graph.radii[carries].mean())
    wrap = np.floor if graph.cell is not None else np.zeros_like
    who = np.flatnonzero(carries)
    around = np.nextafter(heights, np.inf) if graph.cell is not None else None
    tree = cKDTree((place - wrap(place))[who] * heights, boxsize=around)
    matrix = (assembled(system) + EPS * system.unit * sparse.eye_array(system.size)).tocsr()
    out = np.full((len(centre), 4, 4), np.nan)
    local = np.full(system.size, -1)
    for group, row in enumerate(polygons.row):
        middle = centre[row]
        size = reach + polygons.reach[row]
        near = tree.query_ball_point((middle - wrap(middle)) * heights, size, p=np.inf)
        for k, grains in enumerate(polygons.grains[group]):
            moves = system.freedom[grains, :2]
            if (moves < 0).any():
                continue
            square = who[near[k]]
            off = _nearest(place[square] - middle[k], graph) @ box.T
            inside = np.append(square[np.hypot(*off.T) <= size[k]], grains)
            own = np.unique(system.freedom[inside])
            own = own[own >= 0]
            local[own] = np.arange(len(own))
            B = _loads(local[moves], polygons.vectors[group][k], len(own))
            lu = _lu(matrix[own][:, own])
            out[row[k]] = B.T @ lu.solve(B) / polygons.area[group][k]
    return _inverted(out), np.full(len(out), radius)


def _box(graph: GrainGraph) -> tuple[Floats, Floats]:
    if graph.cell is not None:
        return graph.cell, np.zeros(2)
    low, high = graph.x.min(axis=0), graph.x.max(axis=0)
    return np.diag(np.maximum(high - low, 1e-9 * np.abs(graph.radii).max())), low


def _nearest(offset: Floats, graph: GrainGraph) -> Floats:
    return offset if graph.cell is None else offset - np.round(offset)


def _compliances(system: PackingSystem, polygons: Polygons, block: Block) -> Floats:
    """(len(block.loops), 4, 4) `C_in` with all grains but the free ones held."""
    free, grains = block.free, np.flatnonzero(block.free)
    number = np.cumsum(free) - 1
    wanted = np.zeros(len(polygons.centre), dtype=bool)
    wanted[block.loops] = True
    fronts = dissection(block.x[grains], number[_edges(system, polygons, free, wanted)])
    renumbered = np.append(np.cumsum(block.freedom_kept) - 1, -1)
    freedom = renumbered[system.freedom[grains]]
    done = eliminate(_matrix(system, block), fronts, freedom)
    out = np.full((len(polygons.centre), 4, 4), np.nan)
    moves = free & (system.freedom[:, :2] >= 0).all(axis=1)
    at = _fronts_of(fronts, polygons, number, moves, wanted)
    place = np.full(int(np.count_nonzero(block.freedom_kept)) + 1, -1)
    for k, freedoms, z in inverse_on_fronts(fronts, done):
        place[freedoms] = np.arange(len(freedoms))
        for group, rows in at[k]:
            v, area = polygons.vectors[group][rows], polygons.area[group][rows]
            at_rows = place[freedom[number[polygons.grains[group][rows]], :2]]
            out[polygons.row[group][rows]] = _in_front(z, at_rows, v, area)
        place[freedoms] = -1
    return out[block.loops]


def _in_front(z: Floats, place: Integers, v: Floats, area: Floats) -> Floats:
    """`(1/V) B^T Z B` for loops whose freedoms (L, n, 2) stand at `place` in a front."""
    count, n = place.shape[:2]
    flat = place.reshape(count, 2 * n)
    block = z[flat[:, :, None], flat[:, None, :]]
    loads = np.zeros((count, n, 2, 4))
    loads[:, :, 0, :2] = loads[:, :, 1, 2:] = v
    B = loads.reshape(count, 2 * n, 4)
    return np.swapaxes(B, 1, 2) @ block @ B / area[:, None, None]


def _edges(system: PackingSystem, polygons: Polygons, free: Flags, wanted: Flags) -> Integers:
    """Pairs of free grains that a contact or a wanted loop joins, each once."""
    pairs = [system.graph.contacts[system.contacts]]
    for grains, row in zip(polygons.grains, polygons.row, strict=True):
        i, j = np.triu_indices(grains.shape[1], 1)
        some = grains[wanted[row]]
        pairs.append(np.stack([some[:, i], some[:, j]], axis=-1).reshape(-1, 2))
    every = np.concatenate(pairs)
    every = np.sort(every[free[every].all(axis=1) & (every[:, 0] != every[:, 1])], axis=1)
    code = np.unique(every[:, 0] * len(free) + every[:, 1])
    return np.column_stack([code // len(free), code % len(free)])


def _fronts_of(
    fronts: list[Front], polygons: Polygons, number: Integers, moves: Flags, wanted: Flags
) -> list[list[tuple[int, Integers]]]:
    """Loops, by order, that each front holds: the front of their first eliminated grain."""
    turn = np.empty(len(number), dtype=np.int64)
    for k, front in enumerate(fronts):
        turn[front.own] = k
    at: list[list[tuple[int, Integers]]] = [[] for _ in fronts]
    for group, (grains, row) in enumerate(zip(polygons.grains, polygons.row, strict=True)):
        rows = np.flatnonzero(wanted[row] & moves[grains].all(axis=1))
        first = turn[number[grains[rows]]].min(axis=1)
        order = np.argsort(first, kind="stable")
        where, start = np.unique(first[order], return_index=True)
        ends = np.append(start[1:], len(rows))
        for k, low, high in zip(where.tolist(), start, ends, strict=False):
            at[k].append((group, rows[order[low:high]]))
    return at


def _matrix(system: PackingSystem, block: Block) -> sparse.csr_array:
    """The regularised system of the free grains; what they lean on outside holds them."""
    if block.whole:
        return regularised(system, assembled(system), EPS).tocsr()
    ends = np.where(np.append(block.freedom_kept, False)[system.ends], system.ends, -1)
    touched = (ends >= 0).any(axis=1)
    part = replace(system, ends=ends[touched], stiffness=system.stiffness[touched])
    kept = np.flatnonzero(block.freedom_kept)
    matrix = assembled(part).tocsr()[kept][:, kept]
    return (matrix + EPS * system.unit * sparse.eye_array(len(kept))).tocsr()
