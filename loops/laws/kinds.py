"""The contact laws: linear springs, springs that pull, spheres, and a rolling spring beside any."""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter
from typing import Self, TypeGuard, get_args

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Regimes
from loops.errors import InputError, check_choice
from loops.graph import ContactState
from loops.laws.frictional import (
    FrictionalLaw,
    Regime,
    ShearHistory,
    ShearIncrement,
    friction_and_increment,
    parameter,
    require_law,
)

# Share by which a shear cohesion may lie below `mu adhesion`: rounding of a product.
PRODUCT = 1e-12
# N over the overlap times the tangent `kn`.
HERTZ = 2.0 / 3.0
# Forces within this share of it are Hertz's, of linear springs with his tangents; in tables of his
# law it holds to 1e-9.
HERTZ_BAND = 0.01


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
    phi : float or (..., C) array, optional
        Angle of friction (radians) in place of `mu`.
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
    overlap_power = 1.0

    def __init__(
        self,
        kn: ArrayLike,
        kt: ArrayLike,
        mu: ArrayLike = np.inf,
        shear_increment: ShearIncrement = "branch",
        *,
        phi: ArrayLike | None = None,
    ) -> None:
        vars(self).update(
            kn=parameter("kn", kn, "a positive finite stiffness", above=True),
            kt=parameter("kt", kt, "a finite stiffness, zero or more"),
            **friction_and_increment(mu, phi, shear_increment),
        )

    table_words = property(lambda self: {})
    constant_springs = property(lambda self: (self.kn, self.kt))

    def stiffnesses(self, state: ContactState) -> tuple[Floats, Floats]:
        """The constants `kn` and `kt`."""
        return self.kn, self.kt

    def closed_force(self, state: ContactState) -> Floats:
        """`N = kn (r_i + r_j - l)`."""
        return self.kn * state.overlap

    def normal_energy(self, state: ContactState) -> Floats:
        """`N^2/(2 kn)`."""
        return self.closed_force(state) ** 2 / (2.0 * self.kn)


def linear_springs(law: object) -> TypeGuard[LinearFrictional]:
    """Return whether a law is linear springs with friction, and nothing else."""
    return type(law) is LinearFrictional


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
        adhesion = parameter("adhesion", adhesion, force)
        # Contacts that never slide have no limit that the pull could take away.
        least = np.where(np.isfinite(self.mu), self.mu, 0.0) * adhesion
        strength = parameter("cohesion", least if cohesion is None else cohesion, force)
        if np.any(strength < (1.0 - PRODUCT) * least):
            received, expected = f"{np.min(strength):g}", "at least mu times the adhesion"
            remedy = "Leave it out: then it is mu times the adhesion."
            raise InputError("cohesion of the contact law", received, expected, remedy)
        strength = np.maximum(strength, least)
        vars(self).update(adhesion=adhesion, cohesion=strength, bonded=bool(bonded))

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
            vars(law)[name] = np.where(opened, 0.0, getattr(self, name))
        return law


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
        check_choice("shear_history", shear_history, get_args(ShearHistory))
        between = "a ratio above -1, up to 0.5"
        vars(self).update(
            young=parameter("young", young, "a positive finite stiffness", above=True),
            poisson=parameter("poisson", poisson, between, -1.0, above=True, high=0.5),
            **friction_and_increment(mu, phi, shear_increment),
            shear_history=shear_history,
            ratio=None if ratio is None else parameter("ratio", ratio, "a ratio, zero or more"),
        )

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


@dataclass(frozen=True, eq=False, init=False, repr=False)
class RollingResistance(FrictionalLaw):
    """A contact law with a rolling spring, `M' = -k_r (w_j - w_i)` on grain j, `|M| <= mu_r R N`.

    Grain i receives the opposite moment; a closed contact, sticking or sliding, keeps its
    spring, an open one has none. Forces, regimes and overlaps are those of the other law. The
    relative spin `w_j - w_i` vanishes in a rigid rotation, so the law is objective for any radii.

    `R = r_i r_j/(r_i + r_j)`, as in model C of Ai, Chen, Rotter and Ooi (2011) without its viscous
    part. The limit holds in paths and replays of packings and where they are held, which keep `M`
    (`GrainGraph.rolling_moment`). A moment in the plane has no direction that a motion could turn,
    so the tangent of the elastic spring doesn't depend on it: tangents, rate problems and single
    loops take every spring as elastic, and paths of single loops refuse a law with a limit.

    It acts on the macroscopic tangent where spins are free; blocked or affine spins are equal
    spins. Under isotropic compression it gives regular loops of five and more grains with free
    spins back a threshold: that of blocked spins with `1/kt + l^2 cot^2(2 pi/n)/(4 k_r)` in place
    of `1/kt`.

    Parameters
    ----------
    law : FrictionalLaw
        The law of forces.
    k_r : float or (..., C) array
        Rolling stiffness (moment per angle, not negative).
    mu_r : float or (..., C) array
        Rolling strength: the largest `|M|/(R N)`, infinite if left out.

    Raises
    ------
    InputError
        If `k_r` is not finite or negative, or `mu_r` is negative.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, RollingResistance, assemble_tangent
    >>> pair = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> law = RollingResistance(LinearFrictional(kn=1.0, kt=0.4), k_r=0.03)
    >>> assemble_tangent(pair, law, spins=True)[4:, 4:].round(12).tolist()
    [[0.13, 0.07], [0.07, 0.13]]
    """

    law: FrictionalLaw
    k_r: Floats
    mu_r: Floats

    def __init__(self, law: FrictionalLaw, k_r: ArrayLike, mu_r: ArrayLike = np.inf) -> None:
        require_law(law)
        expected = "a coefficient of rolling friction, zero or more"
        vars(self).update(
            law=law,
            k_r=parameter("k_r", k_r, "a finite stiffness, zero or more"),
            mu_r=parameter("mu_r", mu_r, expected, high=np.inf),
        )

    def rolling_stiffness(self, state: ContactState, regime: Regimes) -> Floats:
        """`k_r` of closed contacts, beside that of the other law."""
        own = np.where(regime == Regime.OPEN, 0.0, self.k_r)
        return self.law.rolling_stiffness(state, regime) + own

    def parted(self, opened: Flags) -> RollingResistance:
        """Law whose law of forces has these contacts (C,) opened; springs come back at touch."""
        return RollingResistance(self.law.parted(opened), self.k_r, self.mu_r)


# The rest is the other law's, but that no columns of a table hold the spring.
for _name in {*vars(FrictionalLaw)} - {*vars(RollingResistance), "take", "table_words"}:
    if not _name.startswith("_"):
        setattr(RollingResistance, _name, property(attrgetter(f"law.{_name}")))
