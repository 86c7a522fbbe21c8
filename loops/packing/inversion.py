"""Loops in their packing: the system inverted whole, or in blocks with grains held around them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from loops.arrays import Flags, Floats, Integers, frobenius
from loops.faces import Faces
from loops.geometry import boundary_vectors, polygon_area
from loops.graph import GrainGraph
from loops.loop_batches import loop_batches
from loops.null_space import ROUNDING
from loops.packing.dissection import Front, dissection
from loops.packing.selected_inverse import EPS, SINGULAR, FrontalLU, eliminate
from loops.packing.spin_modes import spin_modes
from loops.packing.system import PackingSystem, assembled

# Random vectors from which the norms of Z^T B, Z B and R B of all loops are estimated together.
SKETCH = 16
# Beyond this norm of `R = 1 - K Z` the error is not of first order in it.
LEFT = 0.1


@dataclass(frozen=True, eq=False)
class Polygons:
    """Loops by order: grains (L, n), boundary vectors (L, n, 2), areas and rows of the results.

    Of all loops the `centre`.
    """

    grains: list[Integers]
    vectors: list[Floats]
    area: list[Floats]
    row: list[Integers]
    centre: Floats


def polygons_of(graph: GrainGraph, faces: Faces) -> Polygons:
    """The loops of a packing, see `Polygons`."""
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
class Inverted:
    """`A_in` (L, 4, 4), its relative rounding error and the distance to held grains, (L,) each."""

    matrix: Floats
    error: Floats
    rho: Floats


def inverted(
    system: PackingSystem, polygons: Polygons, side: float, buffer: float, threads: int = 1
) -> Inverted:
    """`A_in` of all loops, in blocks of about `side`; of the whole packing if it is infinite."""
    count = len(polygons.centre)
    rho = np.full(count, np.nan)
    found = _Sums(np.full((count, 4, 4), np.nan), np.zeros(count), *np.zeros((3, count, 4, SKETCH)))
    for block in _blocks(system, polygons, side, buffer):
        rho[block.loops] = block.rho
        _judge(system, polygons, block, found, threads)
    matrix, error = _inverses(found)
    return Inverted(matrix, error, rho)


@dataclass(frozen=True, eq=False)
class _Sums:
    """Per loop: `C_in`, size of the terms behind it, and sketches of `Z^T B`, `Z B`, `R B`."""

    compliance: Floats
    terms: Floats
    left: Floats
    right: Floats
    residual: Floats


def _inverses(found: _Sums) -> tuple[Floats, Floats]:
    """`A = C_in^-1` and a bound on its error relative to its norm.

    With `R = 1 - K Z` what is left over, `dC = (1/V) B^T Z R B` and `dA = -A dC A`. Rounding of `K`
    and of the products adds to `R`, the entries of `C` and their inversion err by rounding too.
    """
    known = np.isfinite(found.compliance).all(axis=(1, 2))
    matrix = np.full_like(found.compliance, np.nan)
    error = np.full(len(matrix), np.nan)
    u, s, vt = np.linalg.svd(found.compliance[known])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        A = np.swapaxes(vt, 1, 2) @ (np.swapaxes(u, 1, 2) / s[:, :, None])
        size, At = frobenius(A), np.swapaxes(A, 1, 2)
        left, right, residual = (one[known] for one in (found.left, found.right, found.residual))
        rest = frobenius(At @ residual) + ROUNDING * frobenius(At @ right)
        change = frobenius(A @ left) * rest / size
        rounding = ROUNDING * size * (found.terms[known] + s[:, 0])
        # Twice the first order holds where dC A is small.
        small = frobenius(left) * rest + rounding < 0.25
        bound = np.where(small, 2.0 * (change + rounding), np.inf)
    matrix[known], error[known] = A, bound
    matrix[~(error < 1.0)] = np.nan
    return matrix, error


@dataclass(frozen=True, eq=False)
class Block:
    """Free grains, where they lie, the loops judged with them and their distances to held grains.

    Distances `rho` are in mean diameters, infinite where no grain is held.
    """

    free: Flags
    x: Floats
    loops: Integers
    rho: Floats
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


def _judge(
    system: PackingSystem, polygons: Polygons, block: Block, found: _Sums, threads: int
) -> None:
    """Fill in `found` for the loops of a block, all grains but its free ones held."""
    free, grains = block.free, np.flatnonzero(block.free)
    number = np.cumsum(free) - 1
    wanted = np.zeros(len(polygons.centre), dtype=bool)
    wanted[block.loops] = True
    matrix, freedom, tied = _bordered(system, block)
    edges = np.concatenate([_edges(system, polygons, free, wanted), tied])
    fronts = dissection(block.x[grains], number[edges])
    lu = eliminate(matrix, fronts, freedom[grains], threads)
    sketches = _sketches(matrix, lu)
    moves = free & (freedom[:, :2] >= 0).all(axis=1)
    at = _fronts_of(fronts, polygons, number, moves, wanted)
    for group in range(len(polygons.row)):
        _project(
            polygons, group, np.flatnonzero(wanted[polygons.row[group]]), freedom, sketches, found
        )

    def use(k: int, freedoms: Integers, z: Floats) -> None:
        if not at[k]:
            return
        order = np.argsort(freedoms)
        for group, rows in at[k]:
            v, area = polygons.vectors[group][rows], polygons.area[group][rows]
            own = freedom[polygons.grains[group][rows], :2]
            at_rows = order[np.searchsorted(freedoms, own, sorter=order)]
            to = polygons.row[group][rows]
            found.compliance[to], found.terms[to] = _in_front(z, at_rows, v, area)

    lu.on_fronts(use)


def _in_front(z: Floats, place: Integers, v: Floats, area: Floats) -> tuple[Floats, Floats]:
    """`(1/V) B^T Z B` for loops whose freedoms (L, n, 2) stand at `place` in a front; its terms."""
    count, n = place.shape[:2]
    flat = place.reshape(count, 2 * n)
    block = z[flat[:, :, None], flat[:, None, :]]
    loads = np.zeros((count, n, 2, 4))
    loads[:, :, 0, :2] = loads[:, :, 1, 2:] = v
    B = loads.reshape(count, 2 * n, 4)
    terms = np.abs(block).max(axis=(1, 2)) * np.sum(np.hypot(v[..., 0], v[..., 1]), axis=1) ** 2
    return np.swapaxes(B, 1, 2) @ block @ B / area[:, None, None], terms / area


def _sketches(matrix: sparse.csr_array, lu: FrontalLU) -> tuple[Floats, ...]:
    """(size, SKETCH) `Z d g`, `Z^T c g` and `R^T g / d` for random signs g over sqrt(SKETCH).

    Columns of `K` have the size `c`, its rows over `c` the size `d`: rounding of `K` changes
    `a.Kb` by about `ROUNDING |d a| |c b|`, however much its entries differ in size. Where `R` isn't
    small there is a mode that is softer than what holds it here by up to `EPS / SINGULAR`.
    """
    sizes = abs(matrix)
    c = _positive(sizes.sum(axis=0))
    d = _positive((sizes @ sparse.diags_array(1.0 / c)).sum(axis=1))[:, None]
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (len(c), SKETCH)) / np.sqrt(SKETCH)
    left = lu.solve(d * signs)
    loads = np.hstack([c[:, None] * signs, matrix.T @ (signs / d)])
    both = lu.solve(loads, transposed=True)
    residual = signs / d - both[:, SKETCH:]
    if not np.linalg.norm(d * residual) < LEFT:
        residual *= EPS / SINGULAR
    return left, both[:, :SKETCH], residual


def _positive(sizes: Floats) -> Floats:
    return np.where(sizes > 0, sizes, 1.0)


def _project(
    polygons: Polygons,
    group: int,
    rows: Integers,
    freedom: Integers,
    sketches: tuple[Floats, ...],
    found: _Sums,
) -> None:
    """`B^T` of the sketches over the root of the area, for loops of one order."""
    v, area = polygons.vectors[group][rows], polygons.area[group][rows]
    own = freedom[polygons.grains[group][rows], :2]
    for sketch, out in zip(sketches, (found.left, found.right, found.residual), strict=True):
        products = np.einsum("lna,lnck->lcak", v, sketch[own], optimize=True)
        out[polygons.row[group][rows]] = (
            products.reshape(len(rows), 4, SKETCH) / np.sqrt(area)[:, None, None]
        )


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


def _bordered(system: PackingSystem, block: Block) -> tuple[sparse.csr_array, Integers, Integers]:
    """`K` of the free grains, made regular; (G, 4) freedoms in it; grains that modes tie, (E, 2).

    What the free grains lean on outside holds them. One grain of each component that nothing holds
    stands on springs that carry nothing. A spin that nothing resists is left out. A mode of several
    spins is balanced by moments in proportion to it: an unknown of its own, `G` and `G^T` at the
    border of `K`. This is the limit of `K + eps` for `eps` to zero.
    """
    G, size = system.graph.grain_count, system.size
    kept = np.zeros(size + 1, dtype=bool)
    kept[system.freedom[block.free]] = True
    kept[-1] = False
    ends = np.where(kept[system.ends], system.ends, -1)
    touched = (ends >= 0).any(axis=1)
    part = replace(system, ends=ends[touched], stiffness=system.stiffness[touched])
    diagonal = np.zeros(size)
    if block.whole:
        diagonal[system.freedom[system.carrying.anchors, :2].ravel()] = system.unit
    mode, motion = spin_modes(part.stiffness, part.ends, size)
    several = (mode >= 0) & (np.bincount(mode[mode >= 0], minlength=1)[mode] > 1)
    kept[:-1] &= (mode < 0) | several
    moved = np.flatnonzero(several)
    _, first, column = np.unique(mode[moved], return_index=True, return_inverse=True)
    border = sparse.csr_array((system.unit * motion[moved], (moved, column)), (size, len(first)))
    whole = (
        sparse.block_array(
            [[assembled(part) + sparse.diags_array(diagonal), border], [border.T, None]]
        ).tocsr()
        if len(first)
        else (assembled(part) + sparse.diags_array(diagonal)).tocsr()
    )
    own = np.concatenate([np.flatnonzero(kept[:-1]), size + np.arange(len(first))])
    number = np.full(size + len(first) + 1, -1)
    number[own] = np.arange(len(own))
    grain = np.empty(size, dtype=np.int64)
    grain[system.freedom[system.freedom[:, 2] >= 0, 2]] = np.flatnonzero(system.freedom[:, 2] >= 0)
    freedom = np.full((G, 4), -1)
    freedom[:, :3] = number[system.freedom]
    freedom[grain[moved[first]], 3] = number[size + np.arange(len(first))]
    tied = np.column_stack([grain[moved[first]][column], grain[moved]])
    return whole[own][:, own], freedom, tied[tied[:, 0] != tied[:, 1]]
