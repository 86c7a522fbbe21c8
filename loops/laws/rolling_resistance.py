"""A rolling spring beside any other contact law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Integers, Regimes
from loops.graph import ContactState
from loops.laws.frictional import ContactLaw, Regime, parameter, require_law
from loops.shown import Shown

LawMethod = TypeVar("LawMethod", bound=Callable[..., Any])


def _of_the_other(method: LawMethod) -> LawMethod:
    """Method that calls the same method of the law beside the spring."""

    @wraps(method)
    def forward(self: Any, *args: Any, **options: Any) -> Any:
        return getattr(self.law, method.__name__)(*args, **options)

    return cast(LawMethod, forward)


@dataclass(frozen=True, eq=False, init=False, repr=False)
class RollingResistance(Shown):
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
    law : ContactLaw
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

    law: ContactLaw
    k_r: Floats
    mu_r: Floats

    def __init__(self, law: ContactLaw, k_r: ArrayLike, mu_r: ArrayLike = np.inf) -> None:
        require_law(law)
        expected = "a finite stiffness, zero or more"
        k_r = parameter("k_r", k_r, expected, 0.0, open_low=False)
        expected = "a coefficient of rolling friction, zero or more"
        mu_r = parameter("mu_r", mu_r, expected, 0.0, open_low=False, high=np.inf)
        for name, value in (("law", law), ("k_r", k_r), ("mu_r", mu_r)):
            object.__setattr__(self, name, value)

    mu = property(lambda self: self.law.mu)
    shear_increment = property(lambda self: self.law.shear_increment)
    shear_history = property(lambda self: self.law.shear_history)
    keeps_strength = property(lambda self: self.law.keeps_strength)
    shear_kinematics = _of_the_other(ContactLaw.shear_kinematics)
    local_stiffness = _of_the_other(ContactLaw.local_stiffness)
    regime = _of_the_other(ContactLaw.regime)
    normal_force = _of_the_other(ContactLaw.normal_force)
    closed_force = _of_the_other(ContactLaw.closed_force)
    gap = _of_the_other(ContactLaw.gap)
    strength = _of_the_other(ContactLaw.strength)
    normal_energy = _of_the_other(ContactLaw.normal_energy)

    def rolling_stiffness(self, state: ContactState, regime: Regimes) -> Floats:
        """`k_r` of closed contacts, beside that of the other law."""
        own = np.where(regime == Regime.OPEN, 0.0, self.k_r)
        return self.law.rolling_stiffness(state, regime) + own

    def take(self, contacts: Integers | slice) -> RollingResistance:
        """Law of the picked contacts; scalar parameters stay scalar."""
        picked = (k if k.ndim == 0 else k[..., contacts] for k in (self.k_r, self.mu_r))
        return RollingResistance(self.law.take(contacts), *picked)

    def parted(self, opened: Flags) -> RollingResistance:
        """Law whose law of forces has these contacts (C,) opened; springs come back at touch."""
        return RollingResistance(self.law.parted(opened), self.k_r, self.mu_r)
