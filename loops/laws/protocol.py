"""What every contact law offers to the rest of the platform."""

from __future__ import annotations

from enum import IntEnum
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from loops.contact_state import ContactState

Floats = NDArray[np.float64]
Regimes = NDArray[np.int8]


class Regime(IntEnum):
    """Regime of a contact."""

    OPEN = 0
    ELASTIC = 1
    SLIDING = 2


@runtime_checkable
class ContactLaw(Protocol):
    """A rate-type contact law, local components in the order (normal, tangential).

    The relative displacement rates are `un' = n . d'` and
    `ut' = g t . d' - (b_i w_i + b_j w_j)`, with `g`, `b_i`, `b_j` from `shear_kinematics`
    and `w` the grain spins (counter-clockwise positive). The force rates are
    `(N', T') = -D (un', ut')` with `D` from `local_stiffness`, and the rolling moment on grain j
    has the rate `-k_r (w_j - w_i)`. Forces are positive in compression.
    """

    def shear_kinematics(self, state: ContactState) -> tuple[Floats, Floats, Floats]:
        """Return `g`, `b_i`, `b_j`, each (..., C): how branch and spins make `ut'`.

        Objectivity asks for `g l = b_i + b_j`.
        """
        ...

    def local_stiffness(self, state: ContactState, regime: Regimes) -> Floats:
        """Return `D`, (..., C, 2, 2) (force per length), in the given regime."""
        ...

    def rolling_stiffness(self, state: ContactState, regime: Regimes) -> Floats:
        """Return `k_r`, broadcastable to (..., C) (moment per angle)."""
        ...

    def regime(self, state: ContactState, rates: tuple[Floats, Floats] | None = None) -> Regimes:
        """Return the regime, (..., C), along the displacement rates `(un', ut')` if given."""
        ...

    def normal_force(self, state: ContactState) -> Floats:
        """Return `N`, (..., C) (force), as the overlaps of the state give it."""
        ...

    def take(self, contacts: NDArray[np.int64]) -> ContactLaw:
        """Return the law of the picked contacts, parameters shaped like `contacts`."""
        ...
