"""The linear-frictional contact law of Cundall and Strack, equations (1)-(8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.contact_state import ContactState
from loops.laws import coulomb, parameters
from loops.laws.coulomb import ShearIncrement as ShearIncrement
from loops.laws.protocol import Floats, Regimes


@dataclass(frozen=True, eq=False, init=False)
class LinearFrictional:
    """Linear springs, Coulomb friction, no cohesion (Nicot et al. 2016, equations 5-8).

    - elastic: `N' = -kn un'`, `T' = -kt ut'`;
    - sliding (`|T| = mu N`): `T' = s mu N'`, `s = sign(T)`, while the slip dissipates,
      `-s (ut' + s mu N'/kt) >= 0`; the sign `s` keeps `|T| = mu N` when `N` falls, which the
      printed (8c) does not (theory note, section 9.1);
    - open: `N = T = 0` once the branch is longer than `r_i + r_j`.

    Parameters
    ----------
    kn : float or (..., C) array
        Normal stiffness (force per length, positive).
    kt : float or (..., C) array
        Tangential stiffness (force per length, not negative).
    mu : float or (..., C) array, default inf
        Coefficient of friction, tan of the contact friction angle (not negative; inf never
        slides).
    shear_increment : {'branch', 'radii'}
        What a turn of the branch by `d(alpha)` adds to `ut`: `l d(alpha)` (the paper) or
        `(r_i + r_j) d(alpha)` (Yade's default, `avoidGranularRatcheting`).

    Raises
    ------
    InputError
        If a parameter is not finite, has the wrong sign or `shear_increment` is unknown.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, contact_state
    >>> pair = GrainGraph(x=[[0, 0], [0.9, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> law, state = LinearFrictional(kn=1.0, kt=0.5), contact_state(pair)
    >>> law.normal_force(state).round(12).tolist()
    [0.1]
    >>> law.local_stiffness(state, law.regime(state)).tolist()
    [[[1.0, 0.0], [0.0, 0.5]]]
    """

    kn: Floats
    kt: Floats
    mu: Floats
    shear_increment: ShearIncrement

    def __init__(
        self,
        kn: ArrayLike,
        kt: ArrayLike,
        mu: ArrayLike = np.inf,
        shear_increment: ShearIncrement = "branch",
    ) -> None:
        object.__setattr__(self, "kn", parameters.positive("kn", kn))
        object.__setattr__(self, "kt", parameters.not_negative("kt", kt))
        object.__setattr__(self, "mu", parameters.friction("mu", mu))
        object.__setattr__(self, "shear_increment", coulomb.checked_increment(shear_increment))

    def shear_kinematics(self, state: ContactState) -> tuple[Floats, Floats, Floats]:
        """Factors of `ut'`, see `ContactLaw` and `shear_increment`."""
        return coulomb.shear_kinematics(state, self.shear_increment)

    def local_stiffness(self, state: ContactState, regime: Regimes) -> Floats:
        """Material stiffness `D` in the local frame, `(N', T') = -D (un', ut')`.

        Elastic `diag(kn, kt)`; sliding `[[kn, 0], [s mu kn, 0]]`, `s = sign(T)`; open zero.
        """
        return coulomb.coulomb_stiffness(state, regime, self.kn, self.kt, self.mu)

    def rolling_stiffness(self, state: ContactState, regime: Regimes) -> Floats:
        """No rolling resistance."""
        return np.zeros(())

    def regime(self, state: ContactState, rates: tuple[Floats, Floats] | None = None) -> Regimes:
        """Regime of every contact, `Regime`, as int8 (..., C).

        Without rates, a contact is open when its branch is longer than `r_i + r_j` and it
        carries no force, sliding when `|T| >= mu N` with `N > 0`, else elastic: just touching is
        elastic. With rates, a contact at yield slides only if the slip dissipates, and a
        touching contact opens if the branch lengthens.
        """
        return coulomb.coulomb_regime(state, rates, self.kn, self.kt, self.mu)

    def normal_force(self, state: ContactState) -> Floats:
        """`N = kn (r_i + r_j - l)`, zero for an open contact."""
        return self.kn * np.maximum(state.touching_length - state.length, 0.0)

    def take(self, contacts: NDArray[np.int64]) -> LinearFrictional:
        """Law of the picked contacts; scalar parameters stay scalar."""
        return LinearFrictional(
            kn=parameters.take(self.kn, contacts),
            kt=parameters.take(self.kt, contacts),
            mu=parameters.take(self.mu, contacts),
            shear_increment=self.shear_increment,
        )
