"""Tangents of the loops of a packing by the kernels, with the accuracy of the plain closures."""

from __future__ import annotations

import numpy as np

from loops.arrays import Integers
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


def loop_tangents(
    packing: CompiledPacking, graph: GrainGraph, faces: Faces, law: ContactLaw, loops: Integers
) -> tuple[MacroTangent, MacroTangent]:
    """Affine and traction tangents of faces `loops`, spins blocked, as `macroscopic_tangent`.

    `packing` is `compiled_packing` of the rest, with the law. Where the force method loses digits
    the saddle system is solved too and the better answer kept; what has null vectors besides the
    rigid translations goes to the plain closure, which looks at the singular values.
    """
    shape = (packing.offsets, packing.contacts, packing.forward)
    loops = given(loops, np.int64)
    affine, traction, affine_condition, condition = ring_tangents(packing.rows, *shape, loops)
    volume = loop_areas(packing.rows, *shape, loops)
    residual = np.zeros(len(loops))
    poor = np.flatnonzero(~(condition <= FORCE_METHOD_LIMIT))
    singular = loops[:0]
    if len(poor):
        chosen = given(loops[poor], np.int64)
        matrix, other, rest = ring_saddles(packing.rows, *shape, chosen)
        better = (rest <= RESIDUAL_LIMIT) & (SADDLE_GAIN * other < condition[poor])
        at = poor[better]
        traction[at], condition[at], residual[at] = matrix[better], other[better], rest[better]
        singular = loops[poor[~np.isfinite(other)]]
    place = np.full(len(faces.kind), -1)
    place[loops] = np.arange(len(loops))
    for batch in loop_batches(graph, faces, loops=singular) if len(singular) else ():
        regime = packing.regime[batch.contacts]
        plain = traction_tangent(batch.graph, law.take(batch.contacts), regime=regime)
        at = place[batch.face]
        # What is not trusted is not a number already.
        traction[at], condition[at], residual[at] = plain.matrix, plain.condition, plain.residual
    return (
        solved(affine, "affine", "blocked", volume, affine_condition),
        solved(traction, "traction", "blocked", volume, condition, residual),
    )
