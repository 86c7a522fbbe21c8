"""The operator of every loop in its packing, and of what surrounds it.

An excess stress P on a loop's polygon, `F_i = -P B_i` on its grains with the packing around them,
strains it by `H = -(1/V_l) sum u_i (x) B_i`: `C_in = (1/V_l) B^T K^-1 B`, `A_in = C_in^-1`, with
contacts counted whole. The surroundings answer with `A_env = A_in - A_loop`, `A_loop` the traction
closure with free spins. Only the inverse's entries between grains of one loop are needed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu
from scipy.spatial import cKDTree

from loops.arrays import Flags, Floats, Integers, frobenius
from loops.closures import macroscopic_tangent
from loops.errors import InputError
from loops.faces import Faces
from loops.geometry import boundary_vectors, polygon_area
from loops.graph import GrainGraph
from loops.laws.protocol import ContactLaw, Regime
from loops.loop_batches import loop_batches
from loops.packing.dissection import Front, dissection
from loops.packing.factor import regularised
from loops.packing.selected_inverse import eliminate, inverse_on_fronts
from loops.packing.system import PackingSystem, assembled, packing_system
from loops.packing.walls import PlaneContacts

Method = Literal["auto", "whole", "blocks", "patches", "extrapolated"]
METHODS = get_args(Method)

# Added to the diagonal over the typical stiffness. C_in is off by about a thousand times that, by a
# million times in the softest modes of sliding contacts; rounding shows from 1e-13 on.
EPS = 1e-12
# A compliance so much smaller in one direction than in another is none: a mode that nothing but EPS
# holds is softer by EPS, a loop of one grain and its images has no strain at all.
SINGULAR = 1e-10
# Up to so many grains the whole packing is inverted; beyond, squares of BLOCK mean diameters with
# grains held BUFFER outside them: on 128,000 grains half the time and a quarter of the memory. With
# sliding contacts blocks are done twice, and soft modes are longer than they: later there.
WHOLE, WHOLE_SLIDING = 30_000, 130_000
BLOCK, BUFFER = 100.0, 8.0
# Elastic contacts: the error of a loop `rho` mean diameters from held grains is below
# ERROR rho^-1.9 for 99 in 100 loops. With sliding contacts soft modes reach further: there it is
# below the larger of SLIDING / rho and SHRINK times the change from half the buffer.
ERROR, DECAY, SLIDING, SHRINK = 5.0, 1.9, 2.0, 4.0
# So many loops, evenly spread, are then solved in the whole packing, and all errors are widened
# until theirs hold; packings of more grains are too large for it, and their error is not known.
CHECKED, CHECKABLE = 100, 300_000
# A patch around every loop, in mean diameters. Extrapolated from R/2 and R in 1/R^2 the error is
# below their difference, with sliding contacts below SHRINK times that, from the least radius on.
RADIUS, LEAST_RADIUS = 8.0, 4.0


@dataclass(frozen=True, eq=False)
class LoopsInPlace:
    """Operators of the loops of a packing, in the order of `Faces.loops`.

    Attributes
    ----------
    matrix : (L, 4, 4) array
        `A_in` in the order (11, 12, 21, 22) (force per length). Not numbers where the loop carries
        nothing, where one of its grains is held, or where nothing resists one of its strains.
    alone : (L, 4, 4) array
        `A_loop`: the loop cut out, uniform traction, spins free; not numbers where not trusted.
    error : (L,) array
        Stated error of `matrix` relative to its norm, meant to hold for 99 in 100 loops; 0 for the
        whole packing. Of blocks from the distance to the nearest held grain, with sliding contacts
        from half the buffer too, infinite for a loop that reaches beyond its buffer; of patches
        from their radius, and half of it. With sliding contacts soft modes may be longer than any
        block: errors are then widened until those of a hundred loops hold against the whole
        packing, and infinite beyond 300,000 grains.
    system : PackingSystem
        The carrying part, with counts of what carries nothing.
    """

    matrix: Floats
    alone: Floats
    error: Floats
    system: PackingSystem

    @property
    def surroundings(self) -> Floats:
        """(L, 4, 4) `A_env = A_in - A_loop`."""
        return self.matrix - self.alone


def loops_in_place(
    graph: GrainGraph,
    law: ContactLaw,
    faces: Faces,
    *,
    regime: ArrayLike | None = None,
    method: Method = "auto",
    block: float = BLOCK,
    buffer: float = BUFFER,
    radius: float = RADIUS,
    planes: PlaneContacts | None = None,
    held: ArrayLike | None = None,
) -> LoopsInPlace:
    """Operators of all loops of a snapshot in their packing.

    Parameters
    ----------
    graph : GrainGraph
        The packing, one state.
    law : ContactLaw
        Contact law.
    faces : Faces
        Its faces.
    regime : (C,) array of Regime, optional
        Regime of each contact; the graph's own, else read from the state by the law if left out.
    method : {'auto', 'whole', 'blocks', 'patches', 'extrapolated'}
        Invert the whole packing (exact), or square blocks with a buffer around them; by size. Or
        a patch a loop, also extrapolated from half of it: slower than blocks of the same error.
    block, buffer, radius : float
        Side of a block, width of its buffer and of a patch around its loop, in mean diameters.
    planes, held
        As in `packing_response`.

    Returns
    -------
    LoopsInPlace

    Raises
    ------
    InputError
        If the packing floats, or the method is unknown.
    """
    if method not in METHODS:
        raise InputError("method", repr(method), "'" + "', '".join(METHODS) + "'", "Pick one.")
    if not LEAST_RADIUS <= radius < np.inf:
        raise InputError(
            "radius", f"{radius:g}", f"{LEAST_RADIUS:g} mean diameters and more", "Widen the patch."
        )
    volume = None if graph.cell is not None else 1.0
    system = packing_system(graph, law, regime=regime, planes=planes, held=held, volume=volume)
    polygons, slides = _polygons(graph, faces), bool((system.regime == Regime.SLIDING).any())
    if method == "auto":
        most = WHOLE_SLIDING if slides else WHOLE
        method = "whole" if graph.grain_count <= most else "blocks"
    if method in ("patches", "extrapolated"):
        find, width = partial(_in_patches, system, polygons), radius
    else:
        whole = method == "whole"
        find = partial(_in_blocks, system, polygons, np.inf if whole else block)
        width = np.inf if whole else buffer
    matrix, error = _with_error(find, width, method, slides)
    if slides:
        error = _held_to_the_whole(system, polygons, matrix, error)
    return LoopsInPlace(matrix, _alone(graph, law, faces, regime), error, system)


def _with_error(
    find: Callable[[float], tuple[Floats, Floats]], width: float, method: Method, slides: bool
) -> tuple[Floats, Floats]:
    """`A_in` with so much left to move around the loops, and its stated error."""
    matrix, rho = find(width)
    with np.errstate(divide="ignore"):
        error = ERROR * rho**-DECAY
        if np.isinf(rho).all() or not (slides or method == "extrapolated"):
            return matrix, error
        nearer, _ = find(0.5 * width)
        change = matrix - nearer
        if method == "extrapolated":
            matrix = matrix + change / 3.0
        size = np.linalg.norm(change, axis=(1, 2)) / np.linalg.norm(matrix, axis=(1, 2))
        if method == "extrapolated":
            return matrix, (SHRINK if slides else 1.0) * size
        return matrix, np.where(rho < np.inf, np.maximum(SLIDING / rho, SHRINK * size), 0.0)


def _held_to_the_whole(
    system: PackingSystem, polygons: Polygons, matrix: Floats, error: Floats
) -> Floats:
    """Stated errors, widened until those of `CHECKED` loops hold against the whole packing."""
    stated = np.flatnonzero(np.isfinite(matrix[:, 0, 0]) & (error > 0) & (error < np.inf))
    if not len(stated):
        return error
    if system.graph.grain_count > CHECKABLE:
        return np.where(error > 0, np.inf, error)
    some = np.unique(stated[np.linspace(0, len(stated) - 1, CHECKED).astype(np.int64)])
    lu = _lu(regularised(system, assembled(system), EPS))
    compliance = np.full((len(error), 4, 4), np.nan)
    for grains, vectors, area, row in zip(
        polygons.grains, polygons.vectors, polygons.area, polygons.row, strict=True
    ):
        for k in np.flatnonzero(np.isin(row, some)):
            B = _loads(system.freedom[grains[k], :2], vectors[k], system.size)
            compliance[row[k]] = B.T @ lu.solve(B) / area[k]
    exact = _inverted(compliance)[some]
    true = frobenius(matrix[some] - exact) / frobenius(exact)
    return np.asarray(error * max(1.0, float(np.nanmax(true / error[some], initial=1.0))))


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


def _in_blocks(
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


def _polygons(graph: GrainGraph, faces: Faces) -> Polygons:
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


def _alone(graph: GrainGraph, law: ContactLaw, faces: Faces, regime: ArrayLike | None) -> Floats:
    """(L, 4, 4) `A_loop`."""
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(len(faces.loops))
    out = np.empty((len(faces.loops), 4, 4))
    given = None if regime is None else np.asarray(regime, dtype=np.int8)
    for batch in loop_batches(graph, faces):
        own = None if given is None else given[batch.contacts]
        tangent = macroscopic_tangent(
            batch.graph, law.take(batch.contacts), "traction", spins="free", regime=own
        )
        out[row[batch.face]] = tangent.matrix
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


def _in_patches(system: PackingSystem, polygons: Polygons, radius: float) -> tuple[Floats, Floats]:
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
