"""Tangents of the loops of a packing by the kernels, with the accuracy of the plain closures."""

from __future__ import annotations

import numpy as np

from loops.arrays import Integers
from loops.closures.macro_tangent import MacroTangent, solved
from loops.closures.traction import FORCE_METHOD_LIMIT, traction_tangent
from loops.compiled.kernel import given
from loops.compiled.loop_shapes import loop_areas
from loops.compiled.packing import CompiledPacking
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
    the plain closure decides.
    """
    shape = (packing.offsets, packing.contacts, packing.forward)
    loops = given(loops, np.int64)
    affine, traction, affine_condition, condition = ring_tangents(packing.rows, *shape, loops)
    volume = loop_areas(packing.rows, *shape, loops)
    residual = np.zeros(len(loops))
    poor = loops[~(condition <= FORCE_METHOD_LIMIT)]
    place = np.full(len(faces.kind), -1)
    place[loops] = np.arange(len(loops))
    for batch in loop_batches(graph, faces, loops=poor) if len(poor) else ():
        regime = packing.regime[batch.contacts]
        plain = traction_tangent(batch.graph, law.take(batch.contacts), regime=regime)
        at = place[batch.face]
        # What is not trusted is not a number already.
        traction[at], condition[at], residual[at] = plain.matrix, plain.condition, plain.residual
    return (
        solved(affine, "affine", "blocked", volume, affine_condition),
        solved(traction, "traction", "blocked", volume, condition, residual),
    )
