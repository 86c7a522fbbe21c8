"""Linear springs that pull: an attraction while grains touch, or bonds that break for good."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats
from loops.errors import InputError
from loops.graph import ContactState
from loops.laws.frictional import LinearFrictional, ShearIncrement, parameter

# Share by which a shear cohesion may lie below `mu adhesion`: rounding of a product.
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False, init=False, repr=False)
class CohesiveFrictional(LinearFrictional):
    """Linear springs, Coulomb friction, and cohesion: attraction, or bonds that break.

    - attraction (`bonded=False`): `N = kn delta - a` with the overlap `delta = r_i + r_j - l`; the
      contact opens where the grains part, under the pull-off force `a`, and attracts again when
      they touch again;
    - bond (`bonded=True`): `N = kn delta` holds beyond touch, until it reaches `-a` at a gap of
      `a/kn`; then the bond is gone for good and the contact goes on as `LinearFrictional`;
    - elastic: `N' = -kn un'`, `T' = -kt ut'`;
    - sliding (`|T| = c + mu N`): `T' = s mu N'`, as in `LinearFrictional`;
    - open: `N = T = 0`. At the opening `N` and `T` drop at once: the packing moves to another
      equilibrium.

    The bond is that of Yade's `Law2_ScGeom6D_CohFrictPhys_CohesionMoment` without moments, with
    `fragile=False` and `unpMax=0` (`a` its `normalAdhesion`, `c` its `shearAdhesion`), but that
    Yade sets `N` to zero where a bond slides in tension.

    Parameters
    ----------
    kn : float or (..., C) array
        Normal stiffness (force per length, positive).
    kt : float or (..., C) array
        Tangential stiffness (force per length, not negative).
    mu : float or (..., C) array, default inf
        Coefficient of friction (not negative; inf never slides).
    phi : float or (..., C) array, optional
        Angle of friction (radians) in place of `mu`.
    adhesion : float or (..., C) array
        Largest pull `a` (force, not negative); zero of contacts that do not pull.
    cohesion : float or (..., C) array, optional
        Strength `c` against shear at `N = 0` (force), at least `mu a`; `mu a` if left out: then
        friction knows `N + a`, and vanishes where the contact opens.
    bonded : bool
        Whether contacts are bonds, that break for good.
    shear_increment : {'branch', 'radii'}
        What a turn of the branch adds to `ut`, see `LinearFrictional`.

    Raises
    ------
    InputError
        If a parameter leaves its range, or `cohesion` is below `mu a`.

    Examples
    --------
    >>> from loops import CohesiveFrictional, GrainGraph, contact_state
    >>> pair = GrainGraph(x=[[0, 0], [1.01, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> law = CohesiveFrictional(kn=1.0, kt=0.5, mu=0.3, adhesion=0.02, bonded=True)
    >>> law.normal_force(contact_state(pair)).round(12).tolist()
    [-0.01]
    >>> law.parted([True]).normal_force(contact_state(pair)).tolist()
    [0.0]
    """

    adhesion: Floats
    cohesion: Floats
    bonded: bool
    cohesive = True

    def __init__(
        self,
        kn: ArrayLike,
        kt: ArrayLike,
        mu: ArrayLike = np.inf,
        adhesion: ArrayLike = 0.0,
        cohesion: ArrayLike | None = None,
        bonded: bool = False,
        shear_increment: ShearIncrement = "branch",
        *,
        phi: ArrayLike | None = None,
    ) -> None:
        super().__init__(kn, kt, mu, shear_increment, phi=phi)
        force = "a finite force, zero or more"
        adhesion = parameter("adhesion", adhesion, force, 0.0, open_low=False)
        object.__setattr__(self, "adhesion", adhesion)
        # Contacts that never slide have no limit that the pull could take away.
        least = np.where(np.isfinite(self.mu), self.mu, 0.0) * adhesion
        given = least if cohesion is None else cohesion
        strength = parameter("cohesion", given, force, 0.0, open_low=False)
        if np.any(strength < (1.0 - ROUNDING) * least):
            received, expected = f"{np.min(strength):g}", "at least mu times the adhesion"
            remedy = "Leave it out: then it is mu times the adhesion."
            raise InputError("cohesion of the contact law", received, expected, remedy)
        object.__setattr__(self, "cohesion", np.maximum(strength, least))
        object.__setattr__(self, "bonded", bool(bonded))

    table_words = property(lambda self: {"law": "bonded" if self.bonded else "cohesive"})
    # Bonds pull by their springs.
    attraction = property(lambda self: 0.0 if self.bonded else self.adhesion)

    def closed_force(self, state: ContactState) -> Floats:
        """`N = kn delta`, less the adhesion of contacts that attract."""
        return self.kn * state.overlap - self.attraction

    def gap(self, state: ContactState) -> Floats:
        """`-delta`, of a bond less the gap `a/kn` at which it breaks."""
        return -state.overlap - (self.adhesion / self.kn if self.bonded else 0.0)

    def strength(self, state: ContactState) -> Floats:
        """`c + mu N`; infinite where nothing slides."""
        return np.maximum(super().strength(state) + self.cohesion, 0.0)

    def normal_energy(self, state: ContactState) -> Floats:
        """`kn delta^2/2`, less `a delta` of contacts that attract."""
        spring = 0.5 * self.kn * state.overlap**2
        return spring - self.attraction * state.overlap

    def parted(self, opened: Flags) -> Self:
        """Law once these contacts (C,) have opened: bonds have no adhesion and cohesion left."""
        if not self.bonded:
            return self
        law = self.take(np.arange(np.shape(opened)[-1]))
        for name in ("adhesion", "cohesion"):
            object.__setattr__(law, name, np.where(opened, 0.0, getattr(self, name)))
        return law
