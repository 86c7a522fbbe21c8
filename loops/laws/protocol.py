"""The protocol that every contact law fulfils: kinematics, tangent, regimes, forces, energy."""

from __future__ import annotations

from enum import IntEnum
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, Integers, Regimes
from loops.errors import InputError
from loops.graph import ContactState


class Regime(IntEnum):
    """Regime of a contact.

    Attributes
    ----------
    OPEN, ELASTIC, SLIDING
        0: no force; 1: elastic, sticking; 2: slides at the strength of its law.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> regime = read_snapshot(sample_path()).regime
    >>> int((regime == Regime.SLIDING).sum()), Regime(int(regime[0])).name
    (51, 'ELASTIC')
    """

    OPEN = 0
    ELASTIC = 1
    SLIDING = 2

    # Arrays ask for it at every comparison; an enum that lacks it takes 8 microseconds to say so.
    __array_ufunc__ = np.ndarray.__array_ufunc__


@runtime_checkable
class ContactLaw(Protocol):
    """A rate-type contact law, local components in the order (normal, tangential).

    The relative displacement rates are `un' = n . d'` and `ut' = g t . d' - (b_i w_i + b_j w_j)`,
    with `g`, `b_i`, `b_j` from `shear_kinematics` and `w` the grain spins (counter-clockwise
    positive). The force rates are `(N', T') = -D (un', ut')` with `D` from `local_stiffness`, and
    the rolling moment on grain j has the rate `-k_r (w_j - w_i)`. Forces are positive in
    compression. The normal force of a closed contact is a function of the geometry.

    The edge of the law says which regimes are open to a contact: it opens where `gap` grows
    positive, closes where the grains touch, slides while `|T|` is at its `strength` and the slip
    dissipates. Derive a law of your own from `loops.FrictionalLaw`.
    """

    @property
    def mu(self) -> ArrayLike:
        """Friction, broadcastable to (..., C): 0 slides freely, inf never slides."""
        ...

    @property
    def keeps_strength(self) -> bool:
        """Whether `|T|` of a sliding contact is its strength; otherwise `T` is integrated."""
        ...

    def shear_kinematics(self, state: ContactState) -> tuple[Floats, Floats, Floats]:
        """Return `g`, `b_i`, `b_j`, each (..., C); objectivity asks for `g l = b_i + b_j`."""
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

    def closed_force(self, state: ContactState) -> Floats:
        """Return `N`, (..., C), as if every contact were closed: smooth beyond the opening."""
        ...

    def gap(self, state: ContactState) -> Floats:
        """Return (..., C) a length, positive where a closed contact has opened."""
        ...

    def strength(self, state: ContactState) -> Floats:
        """Return the shear force, (..., C), that a contact can carry under its `N`."""
        ...

    def normal_energy(self, state: ContactState) -> Floats:
        """Return the energy, (..., C), that closed contacts store in their normal direction."""
        ...

    def take(self, contacts: Integers) -> ContactLaw:
        """Return the law of the picked contacts, parameters shaped like `contacts`."""
        ...


def require_law(law: object) -> None:
    """Raise `InputError` unless the law has everything that `ContactLaw` asks for."""
    names = [name for name in dir(ContactLaw) if not name.startswith("_")]
    missing = [name for name in names if not hasattr(law, name)]
    if missing:
        received = f"{type(law).__name__} without {', '.join(missing)}"
        expected = "a law with its tangent and its edge"
        raise InputError("contact law", received, expected, "Derive it from gl.FrictionalLaw.")
