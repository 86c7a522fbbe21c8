"""The operator of every loop in its packing, and that of its surroundings.

An excess stress P on a loop's polygon, `F_i = -P B_i` on its grains with the packing around them,
strains it by `H = -(1/V_l) sum u_i (x) B_i`: `C_in = (1/V_l) B^T K^-1 B`, `A_in = C_in^-1`, with
contacts counted whole. The surroundings answer with `A_env = A_in - A_loop`, `A_loop` the traction
closure with free spins. Only the inverse's entries between grains of one loop are needed.
The whole packing is inverted, or square blocks of it with the grains around them held.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from loops.arrays import ROUNDING, Flags, Floats, Integers, available_cores, frobenius
from loops.errors import InputError
from loops.faces import Faces
from loops.gears import RegularMatrix, regular_matrix
from loops.geometry import boundary_vectors, polygon_area
from loops.graph import GrainGraph
from loops.loop_batches import loop_batches, tangents_of_loops
from loops.multifrontal import (
    FrontalLU,
    Rows,
    dissection,
    frontal_lu,
    slip_sketches,
    solve_sketches,
)
from loops.scene import Scene, of_scene
from loops.shown import Shown
from loops.system import REGULARISATION, System, packing_system, stiffness_matrix

# Factor by which such an estimate may be too small: chi-squared, one in a thousand is below half.
SKETCHED = 2.0
# Bound on the rounding of the sweep down, over its standard deviation (largest seen: 5.2).
SWEPT = 8.0
# Loops whose sweep errs by more than solves would are solved again, those that err most first, as
# long as right-hand sides times unknowns are fewer (one or two seconds).
AGAIN = 5e7
# Loops that are solved again at a time.
AT_ONCE = 16


class OfOrder(NamedTuple):
    """Loops of one order: grains (l, n), boundary vectors (l, n, 2), areas and rows of `centre`."""

    grains: Integers
    vectors: Floats
    area: Floats
    row: Integers


@dataclass(frozen=True, eq=False)
class Polygons:
    """Loops grouped by order, and the mean positions `centre` (L, 2) of their grains."""

    groups: list[OfOrder]
    centre: Floats

    def take(self, loops: Integers) -> Polygons:
        """Polygons of some rows, numbered in this order."""
        row = np.full(len(self.centre), -1)
        row[loops] = np.arange(len(loops))
        groups = []
        for group in self.groups:
            kept = row[group.row] >= 0
            shape = group.grains[kept], group.vectors[kept], group.area[kept]
            groups.append(OfOrder(*shape, row[group.row[kept]]))
        return Polygons(groups, self.centre[loops])


def polygons_of(graph: GrainGraph, faces: Faces) -> Polygons:
    """Polygons of all loops of a packing, in the order of `Faces.loops`."""
    out = Polygons([], np.empty((len(faces.loops), 2)))
    for batch in loop_batches(graph, faces):
        x = batch.graph.x
        out.groups.append(OfOrder(batch.grains, boundary_vectors(x), polygon_area(x), batch.row))
        out.centre[batch.row] = x.mean(axis=1) + batch.origin
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
    system: System, polygons: Polygons, side: float, buffer: float
) -> Iterator[Block]:
    """Cut the box into blocks of about `side`, each with its buffer."""
    graph, carries = system.graph, system.carrying.grains
    if graph.cell is not None:
        box, origin = graph.cell, np.zeros(2)
    else:
        origin = (graph.x - graph.radii[:, None]).min(axis=0)
        box = np.diag((graph.x + graph.radii[:, None]).max(axis=0) - origin)
    heights = abs(np.linalg.det(box)) / np.linalg.norm(box[:, ::-1], axis=0)
    extent = heights / (2.0 * float(graph.radii[carries].mean()))
    place, centre = (np.linalg.solve(box, (x - origin).T).T for x in (graph.x, polygons.centre))
    counts = np.maximum(1, np.round(extent / side)).astype(np.int64)
    home = np.floor(centre * counts).astype(np.int64) % counts
    number = home[:, 0] * counts[1] + home[:, 1]
    for k in range(int(counts.prod())):
        middle = (np.array(divmod(k, int(counts[1]))) + 0.5) / counts
        reach = 0.5 / counts + buffer / extent
        away, off = place - middle, centre - middle
        if graph.cell is not None:
            away, off = away - np.round(away), off - np.round(off)
        free = carries & (np.abs(away) <= reach).all(axis=1)
        whole = bool(free[carries].all())
        mine = np.flatnonzero(number == k)
        rho = ((reach - np.abs(off)) * extent).min(axis=1)
        for grains, _, _, row in polygons.groups:
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


@dataclass(frozen=True, eq=False)
class InvertedLoops:
    """`A_in` (L, 4, 4), its relative rounding error (L,) and distance to held grains `rho` (L,)."""

    matrix: Floats
    error: Floats
    rho: Floats


def inverted(
    system: System, polygons: Polygons, side: float, buffer: float, threads: int = 1
) -> InvertedLoops:
    """Invert in blocks of about `side`, or the whole packing if `side` is infinite."""
    count = len(polygons.centre)
    matrix, error, rho = np.empty((count, 4, 4)), np.empty(count), np.empty(count)
    for block in packing_blocks(system, polygons, side, buffer):
        rho[block.loops] = block.rho
        own = polygons.take(block.loops)
        matrix[block.loops], error[block.loops] = _operators(system, own, block, threads)
    return InvertedLoops(matrix, error, rho)


def _operators(
    system: System, polygons: Polygons, block: Block, threads: int
) -> tuple[Floats, Floats]:
    """`A_in` and relative error of the loops of a block; all grains but its free ones are held."""
    free, grains, count = block.free, np.flatnonzero(block.free), len(polygons.centre)
    number, edges = np.cumsum(free) - 1, _edges(system, polygons, free)
    compliance, terms = np.full((count, 4, 4), np.nan), np.zeros(count)
    variance = np.zeros((count, 4, 4))

    def use(group: int, rows: Integers, z: Floats, spread: Floats) -> None:
        own = polygons.groups[group]
        v, area, loops = own.vectors[rows], own.area[rows], own.row[rows]
        compliance[loops], terms[loops] = _compliances(z, v, area)
        variance[loops] = _compliances(spread, v * v, area * area)[0]

    regular = regular_matrix(system, free, block.whole)
    freedom = regular.freedom
    moves = free & (freedom[:, :2] >= 0).all(axis=1)
    if not (regular.known and moves.any()):
        unknown = np.nan if regular.known else np.inf
        return np.full((count, 4, 4), np.nan), np.full(count, unknown)
    fronts = dissection(block.x[grains], number[np.concatenate([edges, regular.coupled])])
    lu = frontal_lu(regular.matrix, fronts, freedom[grains], threads)
    groups = [
        Rows(number[g], freedom[g, :2], np.asarray(moves[g].all(axis=1)))
        for g, *_ in polygons.groups
    ]
    lu.entries(groups, use)
    found = solve_sketches(regular.matrix, lu)
    found += slip_sketches(lu, regular.amplitudes, regular.rounding)
    sketches = [_projected(polygons, freedom, one) for one in found]
    known = np.isfinite(compliance).all(axis=(1, 2))
    operator, error = np.full((count, 4, 4), np.nan), np.full(count, np.nan)

    def invert(loops: Flags) -> None:
        some = (one[loops] for one in (compliance, terms, *sketches))
        operator[loops], error[loops] = _inverses(*some)

    invert(known)
    swept = _swept_error(operator, variance)
    again = known & ~(swept <= error)
    most = np.argsort(np.where(again, -swept, np.inf), kind="stable")[int(AGAIN / (4 * lu.size)) :]
    again[most] = False
    _solve_again(compliance, again, regular, lu, polygons)
    invert(again)
    return operator, np.where(again, error, error + swept)


def _swept_error(A: Floats, variance: Floats) -> Floats:
    """(L,) relative error of `A = C^-1` by the rounding of `C` in the sweep, of given variance."""
    square = A * A
    with np.errstate(over="ignore", invalid="ignore"):
        terms = square.sum(axis=1)[:, :, None] * variance * square.sum(axis=2)[:, None, :]
        return SWEPT * np.sqrt(terms.sum(axis=(1, 2))) / frobenius(A)


def _solve_again(
    compliance: Floats, again: Flags, regular: RegularMatrix, lu: FrontalLU, polygons: Polygons
) -> None:
    """Replace the compliances of some loops by those of four solves each, refined once."""
    for grains, vectors, area, row in polygons.groups:
        some = np.flatnonzero(again[row])
        for part in np.split(some, np.arange(AT_ONCE, len(some), AT_ONCE)):
            moves, v = regular.freedom[grains[part], :2], vectors[part]
            loads, own = np.zeros((lu.size, len(part), 4)), np.arange(len(part))[:, None]
            loads[moves[:, :, 0], own, :2] = loads[moves[:, :, 1], own, 2:] = v
            u = lu.refined(regular.matrix, loads.reshape(lu.size, -1)).reshape(loads.shape)
            strain = np.einsum("lna,lnck->lcak", v, u[moves, own[:, :, None]])
            compliance[row[part]] = strain.reshape(-1, 4, 4) / area[part, None, None]


def inverse_at_contacts(system: System, threads: int = 1) -> Floats:
    """(E', 6, 6) entries of `K^-1` at the freedoms of each contact of grains, in their order.

    Translations that nothing resists are taken out: it is the inverse on motions without them, by
    component. Zero where a grain has no such freedom, or no contact resists it.
    """
    none = Polygons([], np.empty((0, 2)))
    (block,) = packing_blocks(system, none, np.inf, 0.0)
    grains, number = np.flatnonzero(block.free), np.cumsum(block.free) - 1
    edges = _edges(system, none, block.free)
    regular = regular_matrix(system, block.free, block.whole, slips=False)
    matrix, freedom = regular.matrix, regular.freedom
    fronts = dissection(block.x[grains], number[np.concatenate([edges, regular.coupled])])
    lu = frontal_lu(matrix, fronts, freedom[grains], threads)
    pairs = system.graph.contacts[system.contacts]
    ends = np.column_stack([freedom[pairs[:, 0], :2], freedom[pairs[:, 1], :2], freedom[pairs, 2]])
    found = np.zeros((len(pairs), 6, 6))

    def use(_: int, rows: Integers, z: Floats, spread: Floats) -> None:
        known = ends[rows] >= 0
        found[rows] = np.where(known[:, :, None] & known[:, None, :], z, 0.0)

    lu.entries([Rows(number[pairs], ends, np.ones(len(pairs), dtype=bool))], use)
    if not len(system.carrying.anchors):
        return found
    _, component = np.unique(system.carrying.component[grains], return_inverse=True)
    T = np.zeros((len(matrix.indptr), 2 * (component.max() + 1)))
    for axis in (0, 1):
        T[freedom[grains, axis], 2 * component + axis] = 1.0
    T = T[:-1] / np.sqrt(np.bincount(component, minlength=1).repeat(2))
    right, left = lu.solve(T), lu.solve(T, transposed=True)
    middle = T.T @ right
    T, right, left = (
        np.concatenate([a, np.zeros((1, a.shape[1]))])[ends] for a in (T, right, left)
    )
    return (
        found
        - T @ np.swapaxes(left, 1, 2)
        - right @ np.swapaxes(T, 1, 2)
        + T @ middle @ np.swapaxes(T, 1, 2)
    )


def _inverses(
    C: Floats,
    terms: Floats,
    left: Floats,
    right: Floats,
    residual: Floats,
    *slips: Floats,
) -> tuple[Floats, Floats]:
    """`A = C^-1` and a bound on its relative error; not numbers where the bound is not below 1.

    With the residual `R = 1 - K Z`, `dC = (1/V) B^T Z R B` and `dA = -A dC A`. Rounding of `K` adds
    to `R`; rounding of the products and of the inversion adds to `dC`. `left`, `right`, `residual`
    (L, 4, SKETCH) have the norms of `B^T Z`, `B^T Z^T`, `B^T R^T` over the root of V, two `slips`
    of rings that nearly close those of `B^T Z` and two those of `B^T Z^T`, in pairs.
    """
    u, s, vt = np.linalg.svd(C)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        A = np.swapaxes(vt, 1, 2) @ (np.swapaxes(u, 1, 2) / s[:, :, None])
        size, At = frobenius(A), np.swapaxes(A, 1, 2)
        remaining = frobenius(At @ residual) + ROUNDING * frobenius(At @ right)
        rounding = ROUNDING * size * (terms + s[:, 0])
        error, change = frobenius(A @ left) * remaining, frobenius(left) * remaining
        for one, other in zip(slips[:2], slips[2:], strict=True):
            norm = frobenius(At @ other)
            error, change = error + frobenius(A @ one) * norm, change + frobenius(one) * norm
        error = SKETCHED * error / size + rounding
        # Twice the first order is a bound where dC A is small.
        small = SKETCHED * change + rounding < 0.25
    error = np.where(small, 2.0 * error, np.inf)
    A[~(error < 1.0)] = np.nan
    return A, error


def _compliances(entries: Floats, v: Floats, area: Floats) -> tuple[Floats, Floats]:
    """`C_in = (1/V) B^T Z B` of loops from the entries (L, 2n, 2n) of `Z`; its terms."""
    count, n = v.shape[:2]
    loads = np.zeros((count, n, 2, 4))
    loads[:, :, 0, :2] = loads[:, :, 1, 2:] = v
    B = loads.reshape(count, 2 * n, 4)
    terms = np.abs(entries).max(axis=(1, 2)) * np.sum(np.hypot(v[..., 0], v[..., 1]), axis=1) ** 2
    return np.swapaxes(B, 1, 2) @ entries @ B / area[:, None, None], terms / area


def _projected(polygons: Polygons, freedom: Integers, sketch: Floats) -> Floats:
    """(L, 4, SKETCH) `B^T` times a sketch over the root of the area."""
    out = np.empty((len(polygons.centre), 4, sketch.shape[1]))
    for grains, v, area, row in polygons.groups:
        products = np.einsum("lna,lnck->lcak", v, sketch[freedom[grains, :2]], optimize=True)
        out[row] = products.reshape(len(row), *out.shape[1:]) / np.sqrt(area)[:, None, None]
    return out


def _edges(system: System, polygons: Polygons, free: Flags) -> Integers:
    """(E, 2) pairs of free grains with a contact or a loop in common, each once."""
    pairs = [system.graph.contacts[system.contacts]]
    for grains, *_ in polygons.groups:
        i, j = np.triu_indices(grains.shape[1], 1)
        pairs.append(np.stack([grains[:, i], grains[:, j]], axis=-1).reshape(-1, 2))
    every = np.concatenate(pairs)
    every = np.sort(every[free[every].all(axis=1) & (every[:, 0] != every[:, 1])], axis=1)
    code = np.unique(every[:, 0] * len(free) + every[:, 1])
    return np.column_stack([code // len(free), code % len(free)])


Method = Literal["auto", "whole", "blocks"]
METHODS = get_args(Method)
# Largest number of grains that `auto` inverts as a whole, for the sake of memory.
WHOLE = 400_000
# Default side of a block, in mean diameters.
BLOCK = 100.0
# Default width of the moving grains around it; `_truncation` states the error of what is held.
BUFFER = 8.0
# Held grains change a loop's operator in proportion to rho^-DECAY, rho the distance to the nearest.
DECAY = 1.9
# The factor depends on the packing: so many loops, evenly spread, are solved in the whole packing.
CHECKED = 300
# What is stated over the largest factor found there.
MARGIN = 1.5


@dataclass(frozen=True, eq=False, repr=False)
class LoopsInPlace(Shown):
    """Operators of the loops of a packing, in the order of `Faces.loops`.

    Attributes
    ----------
    matrix : (L, 4, 4) array
        `A_in` in the order (11, 12, 21, 22) (force per length). Not numbers where the loop carries
        nothing, where one of its grains is held, where nothing resists one of its strains, or where
        rounding alone decides whether a ring of gears in the packing closes.
    alone : (L, 4, 4) array
        `A_loop`: the loop cut out, uniform traction, spins free; not numbers where not trusted.
    error : (L,) array
        Stated error of `matrix` in its Frobenius norm, relative to that norm. Whole packing: a
        bound on rounding, amplified by soft modes of the packing and by the inversion of `C_in`.
        Blocks: more, from the distance to the nearest held grain; meant to hold for 99 in 100
        loops, infinite for a loop that reaches beyond its buffer or where held grains may change
        the whole packing's operator by its norm.
    alone_error : (L,) array
        Bound on the rounding error of `alone` (force per length).
    system : System
        The carrying part, with counts of what carries nothing.
    """

    matrix: Floats
    alone: Floats
    error: Floats
    alone_error: Floats
    system: System

    @property
    def surroundings(self) -> Floats:
        """(L, 4, 4) `A_env = A_in - A_loop`."""
        return self.matrix - self.alone

    @property
    def matrix_error(self) -> Floats:
        """(L,) error of `matrix` (force per length): no eigenvalue of Ks errs by more."""
        return self.error * frobenius(self.matrix)

    @property
    def surroundings_error(self) -> Floats:
        """(L,) error of `surroundings` (force per length)."""
        return self.matrix_error + self.alone_error


@of_scene
def loops_in_place(
    scene: Scene,
    faces: Faces | None = None,
    *,
    method: Method = "auto",
    block: float = BLOCK,
    buffer: float = BUFFER,
    threads: int | None = None,
) -> LoopsInPlace:
    """Operators of all loops of a snapshot in their packing: Theory, equation (11.5).

    Parameters
    ----------
    scene : Scene or Snapshot
        The packing, one state; the regimes of its contacts where they are known, else those that
        the law reads from the state.
    faces : Faces, optional
        Faces of the graph; those of the scene if left out.
    method : {'auto', 'whole', 'blocks'}
        Invert the whole packing, or square blocks with a buffer of moving grains around them and
        all others held: less memory. By default blocks beyond 400,000 grains.
    block, buffer : float
        Side of a block and width of its buffer, in mean diameters.
    threads : int, optional
        Threads of the inversion, all cores if left out; results are the same with any number.

    Returns
    -------
    LoopsInPlace

    Raises
    ------
    InputError
        If the packing floats, or the method is unknown.
    """
    faces = scene.faces if faces is None else faces
    # No stress is asked for.
    system = packing_system(replace(scene, boundary=replace(scene.boundary, volume=1.0)))
    matrix, error = operators_in_place(system, faces, method, block, buffer, threads)
    alone = tangents_of_loops(scene.graph, scene.law, faces, "traction", "free")
    return LoopsInPlace(matrix, alone.matrix, error, alone.rounding, system)


def operators_in_place(
    system: System,
    faces: Faces,
    method: Method = "auto",
    block: float = BLOCK,
    buffer: float = BUFFER,
    threads: int | None = None,
) -> tuple[Floats, Floats]:
    """Return `A_in` (L, 4, 4) of the loops of a system and its stated error over its norm (L,)."""
    if method not in METHODS:
        raise InputError("method", repr(method), "'" + "', '".join(METHODS) + "'", "Pick one.")
    polygons = polygons_of(system.graph, faces)
    if method == "auto":
        method = "whole" if system.graph.grain_count <= WHOLE else "blocks"
    side = np.inf if method == "whole" else block
    found = inverted(system, polygons, side, buffer, threads or available_cores())
    share = _truncation(system, polygons, found.matrix, found.rho)
    # A change within a share of the whole's norm is within s / (1 - s) of the blocks' own.
    error = np.full_like(share, np.inf)
    np.divide(share, 1.0 - share, out=error, where=share < 1.0)
    return found.matrix, error + found.error


def loop_loads(system: System, grains: Integers, vectors: Floats) -> Floats:
    """Return `B` (size, 4): forces on a loop's grains of a unit of each component of `P`."""
    B = np.zeros((system.size, 4))
    np.add.at(B[:, :2], system.freedom[grains, 0], vectors)
    np.add.at(B[:, 2:], system.freedom[grains, 1], vectors)
    return B


def _truncation(system: System, polygons: Polygons, matrix: Floats, rho: Floats) -> Floats:
    """(L,) error that held grains make, over the norm of the whole packing's operator.

    By loops that are solved in the whole packing.
    """
    with np.errstate(divide="ignore"):
        shape = rho**-DECAY
    some = np.flatnonzero(np.isfinite(matrix[:, 0, 0]) & (0 < shape) & (shape < np.inf))
    if not len(some):
        return np.where(shape > 0, shape, 0.0)
    some = np.unique(some[np.linspace(0, len(some) - 1, CHECKED).astype(np.int64)])
    springs, true = np.full(system.size, REGULARISATION * system.unit), []
    springs[system.freedom[system.carrying.anchors, :2].ravel()] += system.unit
    on_springs = (stiffness_matrix(system) + sparse.diags_array(springs)).tocsc()
    lu = splu(on_springs, "MMD_AT_PLUS_A", diag_pivot_thresh=0.001, options={"SymmetricMode": True})
    for grains, vectors, area, row in polygons.groups:
        for k in np.flatnonzero(np.isin(row, some)):
            B = loop_loads(system, grains[k], vectors[k])
            whole = np.linalg.inv(B.T @ lu.solve(B) / area[k])
            change = frobenius(matrix[row[k]] - whole) / frobenius(whole)
            true.append(change / shape[row[k]])
    return np.where(shape > 0, MARGIN * float(np.max(true)) * shape, 0.0)
