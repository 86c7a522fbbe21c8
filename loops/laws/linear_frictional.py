"""The linear-frictional contact law of Cundall and Strack, equations (1)-(8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.contact_state import ContactState
from loops.errors import InputError
from loops.laws.protocol import Floats, Regime, Regimes

ShearIncrement = Literal["branch", "radii"]

# An unloaded gap below this fraction of `r_i + r_j` is touching: centres far from the origin carry
# the rounding of their coordinates.
TOUCHING = 1e-12
# Rounding of `|T|` against `mu N`.
AT_YIELD = 4 * np.finfo(float).eps


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
        given = {"kn": kn, "kt": kt, "mu": mu}
        for name, ok, expected in (
            ("kn", _positive, "a positive finite stiffness"),
            ("kt", _not_negative, "a finite stiffness, zero or more"),
            ("mu", _friction, "a coefficient of friction, zero or more"),
        ):
            value = np.asarray(given[name], dtype=float)
            if not ok(value).all():
                bad = value[~ok(value)].flat[0]
                raise InputError(f"{name} of the contact law", str(bad), expected, "Correct it.")
            object.__setattr__(self, name, value)
        if shear_increment not in get_args(ShearIncrement):
            raise InputError(
                "shear_increment",
                repr(shear_increment),
                "'branch' or 'radii'",
                "See the docstring.",
            )
        object.__setattr__(self, "shear_increment", shear_increment)

    def shear_kinematics(self, state: ContactState) -> tuple[Floats, Floats, Floats]:
        """Factors of `ut' = g t . d' - (b_i w_i + b_j w_j)`, see `ContactLaw`.

        `branch`: `g = 1` and the lever arms; `radii`: `g = (r_i + r_j)/l` and the radii.
        """
        if self.shear_increment == "radii":
            return state.touching_length / state.length, state.radii_i, state.radii_j
        return np.ones_like(state.length), state.arm_i, state.arm_j

    def local_stiffness(self, state: ContactState, regime: Regimes) -> Floats:
        """Material stiffness `D` in the local frame, `(N', T') = -D (un', ut')`.

        Elastic `diag(kn, kt)`; sliding `[[kn, 0], [s mu kn, 0]]`, `s = sign(T)`; open zero.
        """
        shape = np.broadcast_shapes(state.length.shape, state.shear_force.shape, self.kn.shape)
        sliding = regime == Regime.SLIDING
        closed = regime != Regime.OPEN
        stiffness = np.zeros((*shape, 2, 2))
        stiffness[..., 0, 0] = np.where(closed, self.kn, 0.0)
        stiffness[..., 1, 1] = np.where(regime == Regime.ELASTIC, self.kt, 0.0)
        # A contact that never slides has infinite mu: keep it out of the product.
        mu = np.where(sliding, self.mu, 0.0)
        stiffness[..., 1, 0] = np.sign(state.shear_force) * mu * self.kn
        return stiffness

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
        n_force, t_force = state.normal_force, state.shear_force
        unloaded = (n_force <= 0) & (t_force == 0)
        gap = state.length - state.touching_length
        edge = TOUCHING * state.touching_length
        is_open = unloaded & (gap > edge)
        limit = np.where(n_force > 0, self.mu * np.where(n_force > 0, n_force, 1.0), np.inf)
        at_yield = np.abs(t_force) >= limit * (1 - AT_YIELD)
        if rates is not None:
            un_rate, ut_rate = rates
            is_open = is_open | (unloaded & (gap >= -edge) & (un_rate > 0))
            at_yield = at_yield & self._slip_dissipates(t_force, un_rate, ut_rate)
        regime = np.where(is_open, Regime.OPEN, np.where(at_yield, Regime.SLIDING, Regime.ELASTIC))
        return regime.astype(np.int8)

    def _slip_dissipates(
        self, t_force: Floats, un_rate: Floats, ut_rate: Floats
    ) -> NDArray[np.bool_]:
        """`-s (ut' + s mu N'/kt) >= 0`, multiplied by kt; true where friction is zero."""
        s = np.sign(t_force)
        mu = np.where(np.isfinite(self.mu), self.mu, 0.0)
        return -s * (self.kt * ut_rate - s * mu * self.kn * un_rate) >= 0

    def normal_force(self, state: ContactState) -> Floats:
        """`N = kn (r_i + r_j - l)`, zero for an open contact."""
        return self.kn * np.maximum(state.touching_length - state.length, 0.0)

    def take(self, contacts: NDArray[np.int64]) -> LinearFrictional:
        """Law of the picked contacts; scalar parameters stay scalar."""
        return LinearFrictional(
            kn=_take(self.kn, contacts),
            kt=_take(self.kt, contacts),
            mu=_take(self.mu, contacts),
            shear_increment=self.shear_increment,
        )


def _take(value: Floats, contacts: NDArray[np.int64]) -> Floats:
    return value if value.ndim == 0 else value[..., contacts]


def _positive(value: Floats) -> NDArray[np.bool_]:
    return np.isfinite(value) & (value > 0)


def _not_negative(value: Floats) -> NDArray[np.bool_]:
    return np.isfinite(value) & (value >= 0)


def _friction(value: Floats) -> NDArray[np.bool_]:
    return value >= 0
