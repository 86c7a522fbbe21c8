"""All loops of a packing at once: those of one order are one graph with a batch axis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from loops.arrays import Floats, Integers
from loops.closures import Closure, MacroTangent, Spins, macroscopic_tangent
from loops.errors import InputError
from loops.faces import Faces, faces_by_order
from loops.graph import GrainGraph, branch_vectors
from loops.laws import ContactLaw


class LoopBatch(NamedTuple):
    """Loops of one order n, cut out of a packing.

    Attributes
    ----------
    graph : GrainGraph
        The loops, batch axis (L,): grains 0..n-1 counter-clockwise, contact c joins c and c+1;
        regimes go along.
    grains, contacts : (L, n) array of int
        Grains and contacts of each loop as numbered in the packing.
    face : (L,) array of int
        Face of each loop in `Faces`.
    origin : (L, 2) array
        Place of the graph's origin in the packing: zero, but the first grain for loops that cross
        a periodic border. These are unrolled from there, since sums with the cell vectors far from
        the origin would lose digits of the branches.
    """

    graph: GrainGraph
    grains: Integers
    contacts: Integers
    face: Integers
    origin: Floats


def loop_batches(
    graph: GrainGraph, faces: Faces, size: int = 2**16, loops: Integers | None = None
) -> Iterator[LoopBatch]:
    """Cut the loops out of a packing, order by order.

    Forces keep their values: `N` and `T` of a contact do not depend on its direction. The
    reference is the current configuration.

    Parameters
    ----------
    graph : GrainGraph
        The packing, one state.
    faces : Faces
        Its faces, from `find_faces`.
    size : int
        At most so many loops in a batch, to bound the memory of what is computed on it.
    loops : (L,) array of int, optional
        The loops to cut out, as faces; all of them if left out.

    Yields
    ------
    LoopBatch
        Loops of one order, in ascending order n.

    Examples
    --------
    >>> from loops import GrainGraph, find_faces, loop_batches
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
    >>> [batch.grains.tolist() for batch in loop_batches(square, find_faces(square))]
    [[[0, 1, 2], [0, 2, 3]]]
    """
    branches = branch_vectors(graph)
    crossing = None if graph.images is None else np.asarray(graph.images.any(axis=1))
    for order, group in faces_by_order(faces, loops).items():
        ring = np.column_stack([np.arange(order), np.roll(np.arange(order), -1)])
        for start in range(0, len(group.face), size):
            part = slice(start, start + size)
            grains, contacts = group.grains[part], group.contacts[part]
            x, origin = graph.x[grains], np.zeros((len(grains), 2))
            over = np.zeros(len(grains), dtype=bool)
            if crossing is not None:
                over = np.asarray(crossing[contacts].any(axis=1))
            if over.any():
                sign = np.where(group.forward[part][over][..., None], 1.0, -1.0)
                edges = sign * branches[contacts[over]]
                x[over] = np.cumsum(edges, axis=1) - edges
                origin[over] = graph.x[grains[over, 0]]
            batch = GrainGraph(
                x=x,
                radii=graph.radii[grains],
                contacts=ring,
                normal_force=graph.normal_force[contacts],
                shear_force=graph.shear_force[contacts],
                regime=None if graph.regime is None else graph.regime[contacts],
            )
            yield LoopBatch(batch, grains, contacts, group.face[part], origin)


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
    fields = ("matrix", "volume", "condition", "residual", "trusted", "sensitivity")
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(tangent, name) for tangent in tangents])[order]
        for name in fields
    }
    return replace(tangents[0], **arrays)
