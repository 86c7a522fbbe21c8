"""Contacts of grains with walls, as contacts with planes that the strain moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Flags, Floats, Integers, Regimes
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
        rough = np.where(self.kt > 0, Regime.ELASTIC, Regime.SLIDING)
        return rough.astype(np.int8)

    def take(self, rows: Flags) -> PlaneContacts:
        """The picked contacts."""
        return PlaneContacts(self.grain[rows], self.branch[rows], self.kn[rows], self.kt[rows])


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
