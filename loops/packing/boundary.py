"""Boundary of a packing: walls, held outlines, and the grains that carry load between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.errors import InputError
from loops.faces import FaceKind, Faces
from loops.graph import GrainGraph
from loops.laws.protocol import Regime
from loops.pruning import component_labels, winding_ranks
from loops.shown import Shown


@dataclass(frozen=True, eq=False, repr=False)
class Carrying(Shown):
    """Grains and contacts that carry load, and counts of those that do not.

    `anchors`: one grain of each component that nothing holds, whose translations are fixed.
    `rattlers`: number of grains with fewer than two contacts, pruned recursively. `clusters`,
    `clustered`: number of components, and of their grains, that touch no wall and no held grain
    and do not wind around the cell.
    """

    grains: Flags
    contacts: Flags
    anchors: Integers
    rattlers: int
    clusters: int
    clustered: int


def carrying_grains(graph: GrainGraph, closed: Flags, supports: Integers) -> Carrying:
    """Prune rattlers and floating clusters; `supports` (G,): wall contacts, 2 for a held grain."""
    kept, contacts = _pruned(graph, closed, supports)
    count, label = component_labels(graph.grain_count, graph.contacts[contacts], kept)
    held = np.bincount(label[kept], weights=supports[kept], minlength=count) > 0
    winds = np.zeros(count, dtype=bool)
    if graph.images is not None:
        winds = winding_ranks(graph.contacts[contacts], graph.images[contacts], label, count) > 0
    good = held | winds
    if not good.any():
        raise InputError(
            "packing",
            f"{count} clusters that float" if count else "grains that all float",
            "contacts that span the periodic cell, walls, or grains that are held",
            "Give the cell or the walls, or hold the outline's grains.",
        )
    grains = kept & np.append(good, False)[label]
    free = np.flatnonzero(good & ~held)
    first = np.full(count, graph.grain_count)
    np.minimum.at(first, label[kept], np.flatnonzero(kept))
    return Carrying(
        grains=grains,
        contacts=contacts & grains[graph.contacts[:, 0]],
        anchors=first[free],
        rattlers=int(np.count_nonzero(~kept)),
        clusters=int(np.count_nonzero(~good)),
        clustered=int(np.count_nonzero(kept & ~grains)),
    )


def _pruned(graph: GrainGraph, closed: Flags, supports: Integers) -> tuple[Flags, Flags]:
    kept, contacts = np.ones(graph.grain_count, dtype=bool), closed.copy()
    while True:
        degree = supports + np.bincount(graph.contacts[contacts].ravel(), minlength=len(kept))
        loose = kept & (degree < 2)
        if not loose.any():
            return kept, contacts
        kept &= ~loose
        contacts &= kept[graph.contacts].all(axis=1)


@dataclass(frozen=True, eq=False, repr=False)
class PlaneContacts(Shown):
    """Contacts of grains with moving planes: branch from centre to foot, stiffness of each.

    `kt` is zero where the wall has no friction. A foot moves with the strain, a plane keeps its
    direction: there is no turning of the frame, and no geometric stiffness. `mu` is read by the
    equations of motion and by paths; without it a contact that has a shear stiffness never slides.
    """

    grain: Integers
    branch: Floats
    kn: Floats
    kt: Floats
    mu: Floats | None = None

    @property
    def regime(self) -> Regimes:
        """(W,) elastic with friction, else sliding."""
        return np.where(self.kt > 0, Regime.ELASTIC, Regime.SLIDING).astype(np.int8)

    def take(self, rows: Flags) -> PlaneContacts:
        """The picked contacts."""
        mu = None if self.mu is None else self.mu[rows]
        return PlaneContacts(self.grain[rows], self.branch[rows], self.kn[rows], self.kt[rows], mu)


def plane_contacts(
    graph: GrainGraph, grain: ArrayLike, force: ArrayLike, foot_to_centre: ArrayLike
) -> PlaneContacts:
    """Contacts with frictionless planes, `kn` from what each carries over its overlap.

    Parameters
    ----------
    graph : GrainGraph
        The packing.
    grain : (W,) array of int
        Grain of each contact.
    force : (W, 2) array
        Force of the wall on the grain (force).
    foot_to_centre : (W, 2) array
        From the foot on the wall to the centre of the grain (length).

    Returns
    -------
    PlaneContacts

    Raises
    ------
    InputError
        If a contact pulls, or carries a force without an overlap.
    """
    who, away = np.asarray(grain, dtype=np.int64), np.asarray(foot_to_centre, dtype=float)
    distance = np.linalg.norm(away, axis=1)
    normal = np.sum(np.asarray(force, dtype=float) * away, axis=1) / distance
    overlap = graph.radii[who] - distance
    closed = normal > 0
    if (normal < 0).any() or (overlap[closed] <= 0).any():
        wrong = int(np.flatnonzero((normal < 0) | (closed & (overlap <= 0)))[0])
        where, expected = f"wall contact {wrong}", "compression where the grain overlaps the wall"
        received = f"normal force {normal[wrong]:g} at an overlap of {overlap[wrong]:g}"
        raise InputError(where, received, expected, "Check the sign of forces and branches.")
    kn = normal[closed] / overlap[closed]
    return PlaneContacts(who[closed], -away[closed], kn, np.zeros(len(kn)))


def outline_grains(graph: GrainGraph, faces: Faces) -> Flags:
    """(G,) grains on the outer cycle of the largest cluster: to hold where walls aren't known."""
    outer = np.flatnonzero(faces.kind == FaceKind.OUTER)
    grains = np.zeros(graph.grain_count, dtype=bool)
    if len(outer):
        face = outer[np.argmax(np.abs(faces.area[outer]))]
        grains[faces.grains[faces.offsets[face] : faces.offsets[face + 1]]] = True
    return grains


def plane_stiffness(planes: PlaneContacts, radii: Floats) -> Floats:
    """(W, 4, 4) blocks `S`: `N' = -kn n.d'`, `T' = -kt (t.d' - r w)`, moment `-r T`."""
    n = planes.branch / np.linalg.norm(planes.branch, axis=1, keepdims=True)
    t = np.column_stack([-n[:, 1], n[:, 0]])
    zero = np.zeros((len(n), 1))
    normal = np.column_stack([n, zero, zero])
    shear = np.column_stack([t, -radii[planes.grain], zero])
    return (
        planes.kn[:, None, None] * normal[:, :, None] * normal[:, None, :]
        + planes.kt[:, None, None] * shear[:, :, None] * shear[:, None, :]
    )
