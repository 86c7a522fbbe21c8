"""Where a packing ends: contacts with walls, or an outline whose grains are held."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.errors import InputError
from loops.faces import FaceKind, Faces
from loops.graph import GrainGraph
from loops.laws.protocol import Regime


@dataclass(frozen=True, eq=False)
class PlaneContacts:
    """Contacts of grains with moving planes: branch from centre to foot, stiffness of each.

    `kt` is zero where the wall has no friction. A foot moves with the strain, a plane keeps its
    direction: there is no turning of the frame, and no geometric stiffness.
    """

    grain: Integers
    branch: Floats
    kn: Floats
    kt: Floats

    @property
    def regime(self) -> Regimes:
        """(W,) elastic with friction, else sliding."""
        return np.where(self.kt > 0, Regime.ELASTIC, Regime.SLIDING).astype(np.int8)

    def take(self, rows: Flags) -> PlaneContacts:
        """The picked contacts."""
        return PlaneContacts(self.grain[rows], self.branch[rows], self.kn[rows], self.kt[rows])


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
