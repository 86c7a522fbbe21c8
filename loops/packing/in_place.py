"""The operator of every loop in its packing, and of what surrounds it.

An excess stress P on a loop's polygon, `F_i = -P B_i` on its grains with the packing around them,
strains it by `H = -(1/V_l) sum u_i (x) B_i`: `C_in = (1/V_l) B^T K^-1 B`, `A_in = C_in^-1`, with
contacts counted whole. The surroundings answer with `A_env = A_in - A_loop`, `A_loop` the traction
closure with free spins. Only the inverse's entries between grains of one loop are needed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, frobenius
from loops.closures import macroscopic_tangent
from loops.errors import InputError
from loops.faces import Faces
from loops.graph import GrainGraph
from loops.laws.protocol import ContactLaw, Regime
from loops.loop_batches import loop_batches
from loops.packing.inversion import Polygons, in_blocks, in_patches, of_some, polygons_of
from loops.packing.system import PackingSystem, packing_system
from loops.packing.walls import PlaneContacts

Method = Literal["auto", "whole", "blocks", "patches", "extrapolated"]
METHODS = get_args(Method)
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
    polygons, slides = polygons_of(graph, faces), bool((system.regime == Regime.SLIDING).any())
    if method == "auto":
        most = WHOLE_SLIDING if slides else WHOLE
        method = "whole" if graph.grain_count <= most else "blocks"
    if method in ("patches", "extrapolated"):
        find, width = partial(in_patches, system, polygons), radius
    else:
        whole = method == "whole"
        find = partial(in_blocks, system, polygons, np.inf if whole else block)
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
    exact = of_some(system, polygons, some)[some]
    true = frobenius(matrix[some] - exact) / frobenius(exact)
    return np.asarray(error * max(1.0, float(np.nanmax(true / error[some], initial=1.0))))


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
