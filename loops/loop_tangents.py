"""The tangents of all loops of a packing, in the order of its loops."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from loops.closures import Closure, MacroTangent, Spins, macroscopic_tangent
from loops.errors import InputError
from loops.faces import Faces
from loops.graph import GrainGraph
from loops.laws import ContactLaw
from loops.loop_batches import loop_batches

FIELDS = ("matrix", "volume", "condition", "residual", "trusted", "sensitivity")


def loop_tangents(
    graph: GrainGraph,
    law: ContactLaw,
    faces: Faces,
    closure: Closure = "traction",
    *,
    spins: Spins = "blocked",
) -> MacroTangent:
    """Macroscopic tangents of every loop of a packing, each over the area of its polygon.

    Parameters
    ----------
    graph : GrainGraph
        The packing, one state; contacts have the regimes that it tells.
    law : ContactLaw
        Law of its contacts.
    faces : Faces
        Its faces, from `find_faces`.
    closure : {'affine', 'traction'}
        How the surrounding medium drives the grains.
    spins : {'blocked', 'affine', 'free'}
        What the grains' spins do.

    Returns
    -------
    MacroTangent
        Batch axis (L,), one tangent a loop in the order of `faces.loops` (force per length,
        compression positive).

    Raises
    ------
    InputError
        If there are no loops.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, find_faces, loop_tangents
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
    >>> law = LinearFrictional(kn=1.0, kt=0.5)
    >>> loop_tangents(square, law, find_faces(square), "affine").matrix.shape
    (2, 4, 4)
    """
    faced, tangents = [], []
    for batch in loop_batches(graph, faces):
        faced.append(batch.face)
        own = law.take(batch.contacts)
        tangents.append(macroscopic_tangent(batch.graph, own, closure, spins=spins))
    if not tangents:
        raise InputError("faces", "no loops", "one at least", "Look at the contacts.")
    order = np.argsort(np.concatenate(faced))
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(tangent, name) for tangent in tangents])[order]
        for name in FIELDS
    }
    return replace(tangents[0], **arrays)
