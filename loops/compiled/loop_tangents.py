"""Tangents of the loops of a packing by the kernels, with the accuracy of the plain closures."""

from __future__ import annotations

import numpy as np

from loops.arrays import Floats, Integers
from loops.closures.macro_tangent import RESIDUAL_LIMIT, MacroTangent, solved
from loops.closures.traction import FORCE_METHOD_LIMIT, SADDLE_GAIN, traction_tangent
from loops.compiled.kernel import given
from loops.compiled.loop_shapes import loop_areas
from loops.compiled.packing import CompiledPacking
from loops.compiled.ring_saddle import ring_saddles
from loops.compiled.ring_tangents import ring_tangents
from loops.faces import Faces
from loops.graph import GrainGraph
from loops.laws.protocol import ContactLaw
from loops.loop_batches import loop_batches
from loops.null_space import NULL_TOLERANCE


def loop_tangents(
    packing: CompiledPacking, graph: GrainGraph, faces: Faces, law: ContactLaw, loops: Integers
) -> tuple[MacroTangent, MacroTangent]:
    """Affine and traction tangents of loops, spins blocked, as `macroscopic_tangent` has them.

    The force method comes first. Where it loses digits the saddle system is solved too, and the
    better answer kept; what has null vectors besides the rigid translations goes to the plain
    closure, which looks at the singular values.

    Parameters
    ----------
    packing : CompiledPacking
        From `compiled_packing`, with a law.
    graph, faces, law
        What it was made from.
    loops : (L,) array of int
        Faces to take, all of them loops.

    Returns
    -------
    affine, traction : MacroTangent
        Operators, (L, 4, 4).
    """
    shape = (packing.offsets, packing.contacts, packing.forward)
    loops = given(loops, np.int64)
    affine, traction, condition = ring_tangents(packing.rows, *shape, loops)
    volume = loop_areas(packing.rows, *shape, loops)
    none = np.zeros(len(loops))
    residual, ambiguity = none.copy(), none.copy()
    poor = np.flatnonzero(~(condition <= FORCE_METHOD_LIMIT))
    if len(poor):
        chosen = given(loops[poor], np.int64)
        matrix, other, other_residual = ring_saddles(packing.rows, *shape, chosen)
        better = (other_residual <= RESIDUAL_LIMIT) & (SADDLE_GAIN * other < condition[poor])
        better |= ~np.isfinite(condition[poor])
        at = poor[better]
        traction[at], condition[at] = matrix[better], other[better]
        residual[at] = other_residual[better]
        singular = poor[~(other * NULL_TOLERANCE < 1)]
        if len(singular):
            rest = _plain(packing, graph, faces, law, loops[singular])
            traction[singular], condition[singular], residual[singular], ambiguity[singular] = rest
    return (
        solved(affine, "affine", "blocked", volume, none + 1.0, none, none),
        solved(traction, "traction", "blocked", volume, condition, residual, ambiguity),
    )


def _plain(
    packing: CompiledPacking, graph: GrainGraph, faces: Faces, law: ContactLaw, loops: Integers
) -> tuple[Floats, Floats, Floats, Floats]:
    """Matrix, condition, residual and ambiguity by the plain closure."""
    place = np.full(len(faces.kind), -1)
    place[loops] = np.arange(len(loops))
    matrix = np.empty((len(loops), 4, 4))
    condition, residual = np.empty(len(loops)), np.empty(len(loops))
    for batch in loop_batches(graph, faces, loops=loops):
        regime = packing.regime[batch.contacts]
        tangent = traction_tangent(batch.graph, law.take(batch.contacts), regime=regime)
        at = place[batch.face]
        matrix[at], condition[at] = tangent.matrix, tangent.condition
        residual[at] = tangent.residual
    # An ambiguous answer is not a number already.
    return matrix, condition, residual, np.zeros(len(loops))
