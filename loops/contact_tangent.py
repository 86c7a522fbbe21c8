"""The tangent of one contact: force rates from the motion of its two grains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, Regimes
from loops.contact_state import ContactState
from loops.laws.protocol import ContactLaw


@dataclass(frozen=True, eq=False)
class ContactTangent:
    """Rates of force and moment of every contact, batch axes `...` first.

    With `d'` the branch rate and `w` the spins (counter-clockwise positive), the force of grain
    i on grain j and the moments that the contact exerts on its grains have the rates

        f'   = -k d' + q_i w_i + q_j w_j
        m_i' = -(p_i . d' + c_ii w_i + c_ij w_j)
        m_j' = -(p_j . d' + c_ji w_i + c_jj w_j)

    Attributes
    ----------
    k : (..., C, 2, 2) array
        Translational block (force per length).
    q_i, q_j : (..., C, 2) array
        Force per spin of either grain (force).
    p_i, p_j : (..., C, 2) array
        Moment per branch rate (force).
    c : (..., C, 2, 2) array
        Moment per spin, rows and columns (i, j) (force times length).
    """

    k: Floats
    q_i: Floats
    q_j: Floats
    p_i: Floats
    p_j: Floats
    c: Floats


def contact_regime(
    state: ContactState, law: ContactLaw, regime: ArrayLike | None = None
) -> Regimes:
    """Regime of the contacts: the given one, else what the law reads from the state.

    Parameters
    ----------
    state : ContactState
        Contacts.
    law : ContactLaw
        Their law.
    regime : (..., C) array of Regime, optional
        Regime to use instead, as flagged by a DEM code for instance.

    Returns
    -------
    (..., C) array of int8
        `Regime` of each contact.
    """
    return law.regime(state) if regime is None else np.asarray(regime, dtype=np.int8)


def translational_blocks(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """Tangent blocks `k` of the contacts with spins blocked, `f' = -k d'`.

    With the linear-frictional law and the shear increment `branch` these are

        elastic   k = kn n(x)n + (kt - N/l) t(x)t + (T/l) n(x)t
        sliding   k = kn n(x)n + s mu kn t(x)n - (N/l) t(x)t + (T/l) n(x)t

    (Nicot et al. 2016, equations 13-19, for one branch; theory note, section 2). The terms
    with `N/l` and `T/l` arise because the frame turns with the branch.

    Parameters
    ----------
    state : ContactState
        Contacts.
    law : ContactLaw
        Their law.
    regime : (..., C) array of int8
        Their regime.

    Returns
    -------
    (..., C, 2, 2) array
        Blocks in the global frame (force per length).

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, contact_state, translational_blocks
    >>> pair = GrainGraph(x=[[0, 0], [0.8, 0]], radii=[0.5, 0.5], contacts=[[0, 1]],
    ...                   normal_force=[0.2])
    >>> law, state = LinearFrictional(kn=1.0, kt=0.5), contact_state(pair)
    >>> translational_blocks(state, law, law.regime(state)).round(12).tolist()
    [[[1.0, 0.0], [0.0, 0.25]]]
    """
    return _to_global(state, local_blocks(state, law, regime))


def translational_compliances(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """Inverse blocks `k^-1`, inverted in the local frame where no digits are lost.

    In the global frame the determinant of a stiff sliding contact cancels to about `kn N/l`.

    Parameters
    ----------
    state : ContactState
        Contacts.
    law : ContactLaw
        Their law.
    regime : (..., C) array of int8
        Their regime.

    Returns
    -------
    (..., C, 2, 2) array
        `k^-1` in the global frame (length per force); not finite where `k` is singular.
    """
    a = local_blocks(state, law, regime)
    det = a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] * a[..., 1, 0]
    inverse = np.empty_like(a)
    inverse[..., 0, 0], inverse[..., 1, 1] = a[..., 1, 1], a[..., 0, 0]
    inverse[..., 0, 1], inverse[..., 1, 0] = -a[..., 0, 1], -a[..., 1, 0]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return _to_global(state, inverse / det[..., None, None])


def compliance_growth(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """Factor by which the inversion of each block amplifies rounding.

    The sum of the terms of its determinant over the determinant: 1 where nothing cancels, large
    where `kt` and `N/l` nearly do.

    Parameters
    ----------
    state : ContactState
        Contacts.
    law : ContactLaw
        Their law.
    regime : (..., C) array of int8
        Their regime.

    Returns
    -------
    (..., C) array
        At least 1; infinite where the block is singular.
    """
    a = local_blocks(state, law, regime)
    material = np.abs(a[..., 1, 1] + state.normal_force / state.length)
    turning = material + np.abs(state.normal_force / state.length)
    terms = np.abs(a[..., 0, 0]) * turning + np.abs(a[..., 0, 1] * a[..., 1, 0])
    det = np.abs(a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] * a[..., 1, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(det > 0, terms / det, np.inf)


def contact_tangent(state: ContactState, law: ContactLaw, regime: Regimes) -> ContactTangent:
    """Tangent of the contacts with translations and spins.

    The contact force acts at the lever arms `a_i`, `a_j`; each grain receives the moment `-a T`
    and `a` moves with `l` (theory note, section 2).

    Parameters
    ----------
    state : ContactState
        Contacts.
    law : ContactLaw
        Their law.
    regime : (..., C) array of int8
        Their regime.

    Returns
    -------
    ContactTangent
        Blocks of force and moment rates.
    """
    stiffness = law.local_stiffness(state, regime)
    g, b_i, b_j = law.shear_kinematics(state)
    # Rates per unit of shear displacement: force along n and t, and T' alone.
    shear = stiffness[..., 0, 1, None] * state.n + stiffness[..., 1, 1, None] * state.t
    t_rate = stiffness[..., 1, 0, None] * state.n + (g * stiffness[..., 1, 1])[..., None] * state.t
    arm_growth = 0.5 * state.shear_force[..., None] * state.n
    a_i, a_j = state.arm_i, state.arm_j
    kt = stiffness[..., 1, 1]
    rolling = law.rolling_stiffness(state, regime)
    c = np.stack(
        [
            np.stack([a_i * kt * b_i + rolling, a_i * kt * b_j - rolling], axis=-1),
            np.stack([a_j * kt * b_i - rolling, a_j * kt * b_j + rolling], axis=-1),
        ],
        axis=-2,
    )
    return ContactTangent(
        k=translational_blocks(state, law, regime),
        q_i=b_i[..., None] * shear,
        q_j=b_j[..., None] * shear,
        p_i=arm_growth - a_i[..., None] * t_rate,
        p_j=arm_growth - a_j[..., None] * t_rate,
        c=c,
    )


def local_blocks(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """Translational block of each contact in its own frame (n, t).

    Material stiffness of the law, with the shear lever `g`, then `-N/l` and `T/l` from the turning
    of the frame (theory note, section 2).

    Parameters
    ----------
    state : ContactState
        Contacts, batch axes `...` allowed.
    law : ContactLaw
        Their law.
    regime : (..., C) array of int8
        Their regimes.

    Returns
    -------
    (..., C, 2, 2) array
        Rows: force on j along n, t; columns: relative displacement along n, t (force per length),
        compression positive.
    """
    local = law.local_stiffness(state, regime)
    g, _, _ = law.shear_kinematics(state)
    local[..., :, 1] *= g[..., None]
    local[..., 1, 1] -= state.normal_force / state.length
    local[..., 0, 1] += state.shear_force / state.length
    return local


def _to_global(state: ContactState, local: Floats) -> Floats:
    frame = np.stack([state.n, state.t], axis=-1)
    return frame @ local @ np.swapaxes(frame, -1, -2)
