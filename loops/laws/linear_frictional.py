"""The linear-frictional contact law of Cundall and Strack, equations (1)-(8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.graph import ContactState
from loops.laws.frictional import FrictionalLaw, friction_and_increment, parameter
from loops.laws.frictional import ShearIncrement as ShearIncrement


@dataclass(frozen=True, eq=False, init=False, repr=False)
class LinearFrictional(FrictionalLaw):
    """Linear springs, Coulomb friction, no cohesion (Nicot et al. 2016, equations 5-8).

    - elastic: `N' = -kn un'`, `T' = -kt ut'`;
    - sliding (`|T| = mu N`): `T' = s mu N'`, `s = sign(T)`, while the slip dissipates,
      `-s (ut' + s mu N'/kt) >= 0`; the sign `s` keeps `|T| = mu N` when `N` falls, which the
      printed (8c) does not (Theory, equation (9.1));
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
        kn = parameter("kn", kn, "a positive finite stiffness", 0.0, open_low=True)
        object.__setattr__(self, "kn", kn)
        kt = parameter("kt", kt, "a finite stiffness, zero or more", 0.0, open_low=False)
        object.__setattr__(self, "kt", kt)
        friction_and_increment(self, mu, shear_increment)

    def stiffnesses(self, state: ContactState) -> tuple[Floats, Floats]:
        """The constants `kn` and `kt`."""
        return self.kn, self.kt

    def closed_force(self, state: ContactState) -> Floats:
        """`N = kn (r_i + r_j - l)`."""
        return self.kn * state.overlap

    def normal_energy(self, state: ContactState) -> Floats:
        """`N^2/(2 kn)`."""
        return self.closed_force(state) ** 2 / (2.0 * self.kn)
