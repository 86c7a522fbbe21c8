"""What laws with Coulomb friction share: regimes, tangent, shear increment.

The law brings its current stiffnesses `kn` and `kt`; whether they are constant or grow with the
overlap is its own affair.
"""

from __future__ import annotations

from typing import Literal, cast, get_args

import numpy as np

from loops.contact_state import ContactState
from loops.errors import InputError
from loops.laws.protocol import Floats, Regime, Regimes

ShearIncrement = Literal["branch", "radii"]

# An unloaded gap below this fraction of `r_i + r_j` is touching: centres far from the origin carry
# the rounding of their coordinates.
TOUCHING = 1e-12
# Rounding of `|T|` against `mu N`.
AT_YIELD = 4 * np.finfo(float).eps


def coulomb_stiffness(
    state: ContactState, regime: Regimes, kn: Floats, kt: Floats, mu: Floats
) -> Floats:
    """Material stiffness `D` in the local frame, `(N', T') = -D (un', ut')`.

    Elastic `diag(kn, kt)`; sliding `[[kn, 0], [s mu kn, 0]]`, `s = sign(T)`; open zero.

    Parameters
    ----------
    state : ContactState
        Contacts.
    regime : (..., C) array of int8
        Their regime.
    kn, kt : (..., C) array
        Their current stiffnesses (force per length).
    mu : (..., C) array
        Their coefficient of friction.

    Returns
    -------
    (..., C, 2, 2) array
        `D` (force per length).
    """
    shape = np.broadcast_shapes(
        state.length.shape, state.shear_force.shape, regime.shape, kn.shape, kt.shape, mu.shape
    )
    sliding = regime == Regime.SLIDING
    stiffness = np.zeros((*shape, 2, 2))
    stiffness[..., 0, 0] = np.where(regime != Regime.OPEN, kn, 0.0)
    stiffness[..., 1, 1] = np.where(regime == Regime.ELASTIC, kt, 0.0)
    # A contact that never slides has infinite mu: keep it out of the product.
    stiffness[..., 1, 0] = np.sign(state.shear_force) * np.where(sliding, mu, 0.0) * kn
    return stiffness


def coulomb_regime(
    state: ContactState,
    rates: tuple[Floats, Floats] | None,
    kn: Floats,
    kt: Floats,
    mu: Floats,
) -> Regimes:
    """Regime of every contact.

    Without rates, a contact is open when its branch is longer than `r_i + r_j` and it carries no
    force, sliding when `|T| >= mu N` with `N > 0`, else elastic: just touching is elastic. With
    rates, a contact at yield slides only if the slip dissipates, and a touching contact opens if
    the branch lengthens.

    Parameters
    ----------
    state : ContactState
        Contacts.
    rates : pair of (..., C) arrays or None
        Displacement rates `(un', ut')`.
    kn, kt : (..., C) array
        Current stiffnesses (force per length).
    mu : (..., C) array
        Coefficient of friction.

    Returns
    -------
    (..., C) array of int8
        `Regime` of each contact.
    """
    n_force, t_force = state.normal_force, state.shear_force
    unloaded = (n_force <= 0) & (t_force == 0)
    gap = state.length - state.touching_length
    edge = TOUCHING * state.touching_length
    is_open = unloaded & (gap > edge)
    limit = np.where(n_force > 0, mu * np.where(n_force > 0, n_force, 1.0), np.inf)
    at_yield = np.abs(t_force) >= limit * (1 - AT_YIELD)
    if rates is not None:
        un_rate, ut_rate = rates
        is_open = is_open | (unloaded & (gap >= -edge) & (un_rate > 0))
        # -s (ut' + s mu N'/kt) >= 0, multiplied by kt; true where friction is zero.
        s, friction = np.sign(t_force), np.where(np.isfinite(mu), mu, 0.0)
        at_yield = at_yield & (-s * (kt * ut_rate - s * friction * kn * un_rate) >= 0)
    regime = np.where(is_open, Regime.OPEN, np.where(at_yield, Regime.SLIDING, Regime.ELASTIC))
    return regime.astype(np.int8)


def shear_kinematics(
    state: ContactState, increment: ShearIncrement
) -> tuple[Floats, Floats, Floats]:
    """Factors of `ut' = g t . d' - (b_i w_i + b_j w_j)`, see `ContactLaw`.

    Parameters
    ----------
    state : ContactState
        Contacts.
    increment : {'branch', 'radii'}
        `branch`: `g = 1` and the lever arms; `radii`: `g = (r_i + r_j)/l` and the radii.

    Returns
    -------
    g, b_i, b_j : (..., C) array
        Dimensionless, length, length; `g l = b_i + b_j`.
    """
    if increment == "radii":
        return state.touching_length / state.length, state.radii_i, state.radii_j
    return np.ones_like(state.length), state.arm_i, state.arm_j


def checked_increment(increment: str) -> ShearIncrement:
    """Return a known shear increment, or raise `InputError`."""
    if increment not in get_args(ShearIncrement):
        raise InputError(
            "shear_increment", repr(increment), "'branch' or 'radii'", "See the docstring."
        )
    return cast(ShearIncrement, increment)
