"""The operator of every loop in its packing, and that of its surroundings.

An excess stress P on a loop's polygon, `F_i = -P B_i` on its grains with the packing around them,
strains it by `H = -(1/V_l) sum u_i (x) B_i`: `C_in = (1/V_l) B^T K^-1 B`, `A_in = C_in^-1`, with
contacts counted whole. The surroundings answer with `A_env = A_in - A_loop`, `A_loop` the traction
closure with free spins. Only the inverse's entries between grains of one loop are needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, available_cores, frobenius
from loops.closures import macroscopic_tangent
from loops.errors import InputError
from loops.faces import Faces
from loops.graph import GrainGraph
from loops.laws.protocol import ContactLaw
from loops.loop_batches import loop_batches
from loops.packing.boundary import PlaneContacts
from loops.packing.inversion import Polygons, inverted, polygons_of
from loops.packing.system import PackingSystem, factorised, packing_system
from loops.shown import Shown

Method = Literal["auto", "whole", "blocks"]
METHODS = get_args(Method)
# Largest number of grains that `auto` inverts as a whole, for the sake of memory.
WHOLE = 400_000
BLOCK, BUFFER = 100.0, 8.0
# Held grains change a loop's operator in proportion to rho^-DECAY, rho the distance to the nearest.
# The factor depends on the packing: CHECKED loops, evenly spread, are solved in the whole packing,
# and MARGIN times the largest factor found is stated.
DECAY, CHECKED, MARGIN = 1.9, 300, 1.5


@dataclass(frozen=True, eq=False, repr=False)
class LoopsInPlace(Shown):
    """Operators of the loops of a packing, in the order of `Faces.loops`.

    Attributes
    ----------
    matrix : (L, 4, 4) array
        `A_in` in the order (11, 12, 21, 22) (force per length). Not numbers where the loop carries
        nothing, where one of its grains is held, or where nothing resists one of its strains.
    alone : (L, 4, 4) array
        `A_loop`: the loop cut out, uniform traction, spins free; not numbers where not trusted.
    error : (L,) array
        Stated error of `matrix` in its Frobenius norm, relative to that norm. Whole packing: a
        bound on rounding, amplified by soft modes of the packing and by the inversion of `C_in`.
        Blocks: more, from the distance to the nearest held grain; meant to hold for 99 in 100
        loops, infinite for a loop that reaches beyond its buffer.
    alone_error : (L,) array
        Bound on the rounding error of `alone` (force per length).
    system : PackingSystem
        The carrying part, with counts of what carries nothing.
    """

    matrix: Floats
    alone: Floats
    error: Floats
    alone_error: Floats
    system: PackingSystem

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


def loops_in_place(
    graph: GrainGraph,
    law: ContactLaw,
    faces: Faces,
    *,
    regime: ArrayLike | None = None,
    method: Method = "auto",
    block: float = BLOCK,
    buffer: float = BUFFER,
    planes: PlaneContacts | None = None,
    held: ArrayLike | None = None,
    threads: int | None = None,
) -> LoopsInPlace:
    """Operators of all loops of a snapshot in their packing: Theory, equation (11.5).

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
    method : {'auto', 'whole', 'blocks'}
        Invert the whole packing, or square blocks with a buffer of moving grains around them and
        all others held: less memory. By default blocks beyond 400,000 grains.
    block, buffer : float
        Side of a block and width of its buffer, in mean diameters.
    threads : int, optional
        Threads of the inversion, all cores if left out; results are the same with any number. BLAS
        should use one thread each (`OPENBLAS_NUM_THREADS=1`).
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
    volume = None if graph.cell is not None else 1.0
    system = packing_system(graph, law, regime=regime, planes=planes, held=held, volume=volume)
    polygons = polygons_of(graph, faces)
    if method == "auto":
        method = "whole" if graph.grain_count <= WHOLE else "blocks"
    side = np.inf if method == "whole" else block
    found = inverted(system, polygons, side, buffer, threads or available_cores())
    error = found.error + _truncation(system, polygons, found.matrix, found.rho)
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(len(faces.loops))
    alone, alone_error = np.empty((len(faces.loops), 4, 4)), np.empty(len(faces.loops))
    given = None if regime is None else np.asarray(regime, dtype=np.int8)
    for batch in loop_batches(graph, faces):
        own = None if given is None else given[batch.contacts]
        tangent = macroscopic_tangent(
            batch.graph, law.take(batch.contacts), "traction", spins="free", regime=own
        )
        alone[row[batch.face]] = tangent.matrix
        alone_error[row[batch.face]] = tangent.rounding
    return LoopsInPlace(found.matrix, alone, error, alone_error, system)


def _truncation(system: PackingSystem, polygons: Polygons, matrix: Floats, rho: Floats) -> Floats:
    """(L,) relative error that held grains make, by loops that are solved in the whole packing."""
    with np.errstate(divide="ignore"):
        shape = rho**-DECAY
    some = np.flatnonzero(np.isfinite(matrix[:, 0, 0]) & (0 < shape) & (shape < np.inf))
    if not len(some):
        return np.where(shape > 0, shape, 0.0)
    some = np.unique(some[np.linspace(0, len(some) - 1, CHECKED).astype(np.int64)])
    factor, true = factorised(system), []
    for grains, vectors, area, row in zip(
        polygons.grains, polygons.vectors, polygons.area, polygons.row, strict=True
    ):
        for k in np.flatnonzero(np.isin(row, some)):
            B = np.zeros((system.size, 4))
            np.add.at(B[:, :2], system.freedom[grains[k], 0], vectors[k])
            np.add.at(B[:, 2:], system.freedom[grains[k], 1], vectors[k])
            whole = np.linalg.inv(B.T @ factor.solve(B, refinements=0) / area[k])
            change = frobenius(matrix[row[k]] - whole) / frobenius(whole)
            true.append(change / shape[row[k]])
    return np.where(shape > 0, MARGIN * float(np.max(true)) * shape, 0.0)
