"""Quadrons: the quadrilaterals that a grain and a loop have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from loops.arrays import Floats, Integers
from loops.errors import check_choice
from loops.faces import Faces, find_faces
from loops.graph import GrainGraph, require_one_state
from loops.loop_batches import loop_batches
from loops.shown import Shown

About = Literal["centres", "contacts"]


@dataclass(frozen=True, eq=False, repr=False)
class Quadrons(Shown):
    """Quadrons of the loops of a packing, in the order of the loops, then around each.

    Attributes
    ----------
    face : (Q,) array of int
        Face of the loop, as `Faces` numbers them.
    order : (Q,) array of int
        Order of the loop.
    grain : (Q,) array of int
        Grain.
    chord : (Q, 2) array
        From the contact by which the loop, counter-clockwise, comes to the grain to the one by
        which it leaves (length).
    reach : (Q, 2) array
        From the grain's point to that of the loop (length).
    """

    face: Integers
    order: Integers
    grain: Integers
    chord: Floats
    reach: Floats

    def facts(self) -> dict[str, object]:
        """Facts shown at the prompt and in a notebook."""
        return {"quadrons": len(self.face), "mean area": float(self.area.mean())}

    @property
    def area(self) -> Floats:
        """(Q,) signed area `reach x chord / 2`; negative where the quadron is turned over."""
        a, b = self.chord, self.reach
        return np.asarray(0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))

    @property
    def elongation(self) -> Floats:
        """(Q,) length of the diagonal to the loop over the one between contacts."""
        lengths = (np.linalg.norm(v, axis=1) for v in (self.reach, self.chord))
        return np.asarray(np.divide(*lengths))

    @property
    def skew(self) -> Floats:
        """(Q,) cosine of the angle between the diagonals: 0 for a kite."""
        size = np.linalg.norm(self.reach, axis=1) * np.linalg.norm(self.chord, axis=1)
        return np.asarray(np.sum(self.reach * self.chord, axis=1) / size)


def quadrons(
    graph: GrainGraph, faces: Faces | None = None, *, about: About = "centres"
) -> Quadrons:
    """Return the quadrons of all loops of a packing.

    Of a grain and a loop that it belongs to, the quadron is the quadrilateral of the grain's point,
    the two contacts of the grain in the loop, and the loop's point, the mean of its contacts
    (Matsushima and Blumenfeld, arXiv 1207.2988, after Blumenfeld and Edwards 2003). Its diagonals
    `chord`, between the contacts, and `reach`, from the grain's point to the loop's, give the area
    `1/2 |reach x chord|`. A contact's point is in the middle of its overlap.

    Parameters
    ----------
    graph : GrainGraph
        The packing, one state.
    faces : Faces, optional
        Its faces; found if left out.
    about : {'centres', 'contacts'}
        The grain's point: its centre, so that the quadrons of a loop fill the polygon through the
        centres exactly; or the mean of its contacts, as published for grains of any shape. Then
        those of all faces fill the sample, and each loop's area is its own no longer.

    Returns
    -------
    Quadrons

    Raises
    ------
    InputError
        If the graph has several states, or the word is another one.

    Examples
    --------
    Four discs in a square: each quadron is a quarter of it.

    >>> from loops import GrainGraph, quadrons
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> found = quadrons(square)
    >>> found.order.tolist(), found.area.tolist()
    ([4, 4, 4, 4], [0.25, 0.25, 0.25, 0.25])
    """
    require_one_state(graph)
    check_choice("about", about, ("centres", "contacts"))
    faces = find_faces(graph) if faces is None else faces
    aside = np.zeros((graph.grain_count, 2))
    if about == "contacts":
        aside = _to_contacts(graph, faces)
    parts = []
    for batch in loop_batches(graph, faces):
        x, radii = batch.graph.x, batch.graph.radii
        d = np.roll(x, -1, axis=1) - x
        length = np.linalg.norm(d, axis=2)
        share = 0.5 * (1.0 + (radii - np.roll(radii, -1, axis=1)) / length)
        leaving = x + share[..., None] * d
        chord = leaving - np.roll(leaving, 1, axis=1)
        reach = leaving.mean(axis=1, keepdims=True) - (x + aside[batch.grains])
        order = np.full(batch.grains.shape, batch.grains.shape[1])
        face = np.broadcast_to(batch.face[:, None], order.shape)
        parts.append((face, order, batch.grains, chord, reach))
    flat = [
        np.concatenate([part.reshape(-1, *part.shape[2:]) for part in column])
        for column in zip(*parts, strict=True)
    ] or [np.zeros(0, int)] * 3 + [np.zeros((0, 2))] * 2
    rows = np.argsort(flat[0], kind="stable")
    return Quadrons(*(column[rows] for column in flat))


def _to_contacts(graph: GrainGraph, faces: Faces) -> Floats:
    """Return (G, 2) from each centre to the mean of the grain's contacts in the faces."""
    d = graph.branches[faces.contacts] * np.where(faces.forward, 1.0, -1.0)[:, None]
    i, j = graph.contacts[faces.contacts].T
    start, end = np.where(faces.forward, i, j), np.where(faces.forward, j, i)
    length = np.linalg.norm(d, axis=1)
    share = 0.5 * (1.0 + (graph.radii[start] - graph.radii[end]) / length)
    # Every contact of a grain is one half-edge that starts there.
    total = np.zeros((graph.grain_count, 2))
    np.add.at(total, start, share[:, None] * d)
    count = np.bincount(start, minlength=graph.grain_count)
    return total / np.maximum(count, 1)[:, None]
