"""Spheres in a plane: Hertz's normal force, Mindlin's tangential stiffness, Coulomb friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats
from loops.errors import check_choice
from loops.graph import ContactState
from loops.laws.frictional import (
    FrictionalLaw,
    ShearHistory,
    ShearIncrement,
    friction_and_increment,
    parameter,
)

# N over the overlap times the tangent `kn`.
HERTZ = 2.0 / 3.0
# Forces within this share of it are Hertz's, of linear springs with his tangents; in tables of his
# law it holds to 1e-9.
HERTZ_BAND = 0.01


@dataclass(frozen=True, eq=False, init=False, repr=False)
class HertzMindlin(FrictionalLaw):
    """Incremental Hertz-Mindlin law, no slip within the contact area, no cohesion.

    The grains are spheres of one material with their centres in the plane. With the overlap
    `delta = r_i + r_j - l`, `R* = r_i r_j/(r_i + r_j)`, `E* = E/(2 (1 - nu^2))` and
    `G* = E/(4 (1 + nu)(2 - nu))`:

    - `N = (4/3) E* sqrt(R*) delta^(3/2)` (Hertz), so `N' = -kn un'`, `kn = 2 E* sqrt(R* delta)`;
    - elastic: `T' = -kt ut'`, `kt = 8 G* sqrt(R* delta)` (Mindlin, no slip), with the `kt` of the
      current overlap: hypoelastic, like the linear law; or `T = -kt(delta) xi`, `xi' = ut'`, so
      `T' = -kt ut' - T/(2 delta) un'`;
    - sliding: `T' = s mu N'` and its condition, as in `LinearFrictional`;
    - open: `N = T = 0` once the branch is longer than `r_i + r_j`.

    The ratio `kt/kn = 2 (1 - nu)/(2 - nu)` is that of the material, 2/3 to 1 for `nu` from 0.5
    to 0; both stiffnesses vanish at touching. `T` keeps its value while `kt` falls with the
    overlap (`shear_history="force"`), or goes with it (`"displacement"`). There is no rescaling on
    unloading alone (LAMMPS's `mindlin_rescale`) and no partial slip (Mindlin and Deresiewicz); a
    closed cycle of shear and compression may therefore gain energy (Elata and Berryman 1996).

    The stiffnesses of a state follow from its `N`, `kn = (6 E*^2 R* N)^(1/3)`: the same as from
    the overlap where `N` is Hertz's force, and exact where positions are rounded, as in the tables
    of a simulation of stiff grains. Give a graph its `normal_force(state)` first.

    Under isotropic compression `N/(kn l) = (2/3) E/(1 - E)`: a regular loop of four and more
    grains loses stability at `E = kappa/(kappa + 2/3)` under the traction closure with spins
    blocked, `kappa = kt/kn`, where the linear law does at `kappa/(kappa + 1)`.

    Parameters
    ----------
    young : float or (..., C) array
        Young's modulus E of the grains (force per length squared, positive).
    poisson : float or (..., C) array
        Their Poisson's ratio nu, above -1 and up to 0.5.
    mu : float or (..., C) array, default inf
        Coefficient of friction (not negative; inf never slides).
    phi : float or (..., C) array, optional
        Angle of friction (radians) in place of `mu`.
    shear_increment : {'branch', 'radii'}
        What a turn of the branch adds to `ut`, see `LinearFrictional`.
    shear_history : {'force', 'displacement'}
        What a contact keeps while its `kt` changes: `T`, to which increments are added (Yade's
        `Law2_ScGeom_MindlinPhys_Mindlin`, LAMMPS's `mindlin/force`), or the displacement that
        `kt` is multiplied with (LIGGGHTS's `tangential history`, LAMMPS's `mindlin` and
        `gran/hertz/history`).
    ratio : float or (..., C) array, optional
        `kt/kn` (not negative) in place of the material's, as LAMMPS's `gran/hertz/history` has it.

    Raises
    ------
    InputError
        If a parameter leaves its range, or `shear_increment` or `shear_history` is unknown.

    Examples
    --------
    >>> from loops import GrainGraph, HertzMindlin, contact_state
    >>> pair = GrainGraph(x=[[0, 0], [0.96, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> law = HertzMindlin(young=1.0, poisson=0.0)
    >>> pair = pair.replace(normal_force=law.normal_force(contact_state(pair)))
    >>> pair.normal_force.round(12).tolist()
    [0.002666666667]
    >>> state = contact_state(pair)
    >>> law.local_stiffness(state, law.regime(state)).round(12).tolist()
    [[[0.1, 0.0], [0.0, 0.1]]]
    """

    young: Floats
    poisson: Floats
    mu: Floats
    shear_increment: ShearIncrement
    shear_history: ShearHistory
    ratio: Floats | None
    overlap_power = 1.5

    def __init__(
        self,
        young: ArrayLike,
        poisson: ArrayLike,
        mu: ArrayLike = np.inf,
        shear_increment: ShearIncrement = "branch",
        shear_history: ShearHistory = "force",
        ratio: ArrayLike | None = None,
        *,
        phi: ArrayLike | None = None,
    ) -> None:
        young = parameter("young", young, "a positive finite stiffness", 0.0, open_low=True)
        object.__setattr__(self, "young", young)
        expected = "a ratio above -1, up to 0.5"
        poisson = parameter("poisson", poisson, expected, -1.0, open_low=True, high=0.5)
        object.__setattr__(self, "poisson", poisson)
        friction_and_increment(self, mu, shear_increment, phi)
        check_choice("shear_history", shear_history, get_args(ShearHistory))
        object.__setattr__(self, "shear_history", shear_history)
        if ratio is not None:
            ratio = parameter("ratio", ratio, "a ratio, zero or more", 0.0, open_low=False)
        object.__setattr__(self, "ratio", ratio)

    table_words = property(lambda self: {"law": "hertz", "shear_history": self.shear_history})
    of_moduli = property(lambda self: np.ndim(self.young) == 0)

    @property
    def stiffness_ratio(self) -> Floats:
        """`kappa = kt/kn`, whatever the overlap: as given, or `2 (1 - nu)/(2 - nu)`."""
        if self.ratio is not None:
            return self.ratio
        return 2.0 * (1.0 - self.poisson) / (2.0 - self.poisson)

    def normal_stiffness(self, state: ContactState) -> Floats:
        """(..., C) `kn = (6 E*^2 R* N)^(1/3) = 2 E* sqrt(R* delta)` (force per length)."""
        force = np.maximum(state.normal_force, 0.0)
        radius = effective_radius(state.radii_i, state.radii_j)
        return np.cbrt(6.0 * self._effective_young() ** 2 * radius * force)

    def stiffnesses(self, state: ContactState) -> tuple[Floats, Floats]:
        """`kn` and `kt = kappa kn` of the current `N`."""
        kn = self.normal_stiffness(state)
        return kn, self.stiffness_ratio * kn

    def coupling(self, state: ContactState) -> Floats:
        """`T/(2 delta) = T kn/(3 N)` of a shear force by displacement, else zero."""
        if self.shear_history == "force":
            return np.zeros(())
        loaded = state.normal_force > 0
        share = state.shear_force / (3.0 * np.where(loaded, state.normal_force, 1.0))
        return np.asarray(np.where(loaded, share, 0.0) * self.normal_stiffness(state))

    def elastic_slip(self, T: Floats, kt: Floats) -> Floats:
        """Return `ut` between two states; `T/kt` is kept where `T` goes with the overlap."""
        if self.shear_history == "force":
            return super().elastic_slip(T, kt)
        return np.asarray(T[0] / kt[0] - T[1] / kt[1])

    def closed_force(self, state: ContactState) -> Floats:
        """`N = (4/3) E* sqrt(R*) delta^(3/2)`, odd in the overlap."""
        root = np.sqrt(effective_radius(state.radii_i, state.radii_j))
        factor = (4.0 / 3.0) * self._effective_young() * root
        return factor * np.sign(state.overlap) * np.abs(state.overlap) ** 1.5

    def normal_energy(self, state: ContactState) -> Floats:
        """`(2/5) N delta`."""
        return 0.4 * self.closed_force(state) * state.overlap

    def _effective_young(self) -> Floats:
        return self.young / (2.0 * (1.0 - self.poisson**2))


def effective_radius(radii_i: Floats, radii_j: Floats) -> Floats:
    """Return `R* = r_i r_j/(r_i + r_j)`."""
    return radii_i * radii_j / (radii_i + radii_j)
