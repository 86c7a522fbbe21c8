"""The tangent of one contact: force rates from the motion of its two grains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, Regimes
from loops.contact_state import ContactState
from loops.errors import InputError
from loops.laws.protocol import ContactLaw
from loops.validation import checked_regimes


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
    """Regime of the contacts: the given one, else the graph's, else what the law reads."""
    if regime is not None:
        return checked_regimes(regime, state.length.shape[-1])
    return law.regime(state) if state.regime is None else state.regime


def _stiffness(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """Material stiffness, or `InputError` if parameters of the law don't fit the contacts."""
    count = state.length.shape[-1]
    try:
        stiffness = law.local_stiffness(state, regime)
        rolling = np.broadcast_shapes(law.rolling_stiffness(state, regime).shape, (count,))
        fits = stiffness.shape[-3:-2] == rolling[-1:] == (count,)
    except InputError:
        raise
    except ValueError:
        fits = False
    if fits:
        return stiffness
    raise InputError(
        "parameters of the contact law",
        "arrays that do not fit the graph",
        f"numbers, or arrays of shape (..., {count}), one value a contact",
        "Use law.take(contacts) for the law of a part of the contacts.",
    )


def translational_blocks(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """Tangent blocks `k` of the contacts with spins blocked, `f' = -k d'`.

    With the linear-frictional law and the shear increment `branch` these are

        elastic   k = kn n(x)n + (kt - N/l) t(x)t + (T/l) n(x)t
        sliding   k = kn n(x)n + s mu kn t(x)n - (N/l) t(x)t + (T/l) n(x)t

    (Nicot et al. 2016, equations 13-19, for one branch). The terms with `N/l` and `T/l` arise
    because the frame turns with the branch.

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
    """Inverse blocks `k^-1` (..., C, 2, 2), not finite where `k` is singular.

    Inverted in the local frame: in the global one the determinant of a stiff sliding contact
    cancels to about `kn N/l`.
    """
    a = local_blocks(state, law, regime)
    det = a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] * a[..., 1, 0]
    inverse = np.empty_like(a)
    inverse[..., 0, 0], inverse[..., 1, 1] = a[..., 1, 1], a[..., 0, 0]
    inverse[..., 0, 1], inverse[..., 1, 0] = -a[..., 0, 1], -a[..., 1, 0]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return _to_global(state, inverse / det[..., None, None])


def compliance_growth(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """(..., C) factor by which the inversion of each block amplifies rounding.

    The sum of the terms of its determinant over the determinant: 1 where nothing cancels, large
    where `kt` and `N/l` nearly do, infinite where the block is singular.
    """
    a, size = local_blocks(state, law, regime), local_sizes(state, law, regime)
    det = np.abs(a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] * a[..., 1, 0])
    terms = size[..., 0, 0] * size[..., 1, 1] + size[..., 0, 1] * size[..., 1, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(det > 0, terms / det, np.inf)


def contact_tangent(
    state: ContactState, law: ContactLaw, regime: Regimes, arms: tuple[Floats, Floats] | None = None
) -> ContactTangent:
    """Tangent of the contacts with translations and spins.

    The contact force acts at the lever arms `a_i`, `a_j`; each grain receives the moment `-a T`
    and `a` moves with `l`.

    Parameters
    ----------
    state : ContactState
        Contacts.
    law : ContactLaw
        Their law.
    regime : (..., C) array of int8
        Their regime.
    arms : pair of (..., C) arrays, optional
        Arms `b_i`, `b_j` by which spins make shear (length), if other than the law's.

    Returns
    -------
    ContactTangent
        Blocks of force and moment rates.
    """
    stiffness = _stiffness(state, law, regime)
    g, b_i, b_j = law.shear_kinematics(state)
    b_i, b_j = (b_i, b_j) if arms is None else arms
    # Rates per unit of shear displacement: force along n and t, and T' alone.
    shear = stiffness[..., 0, 1, None] * state.n + stiffness[..., 1, 1, None] * state.t
    t_rate = stiffness[..., 1, 0, None] * state.n + (g * stiffness[..., 1, 1])[..., None] * state.t
    arm_growth = 0.5 * state.shear_force[..., None] * state.n
    a_i, a_j = state.arm_i, state.arm_j
    kt, rolling = stiffness[..., 1, 1], law.rolling_stiffness(state, regime)
    return ContactTangent(
        k=translational_blocks(state, law, regime),
        q_i=b_i[..., None] * shear,
        q_j=b_j[..., None] * shear,
        p_i=arm_growth - a_i[..., None] * t_rate,
        p_j=arm_growth - a_j[..., None] * t_rate,
        c=_square(
            a_i * kt * b_i + rolling,
            a_i * kt * b_j - rolling,
            a_j * kt * b_i - rolling,
            a_j * kt * b_j + rolling,
        ),
    )


def contact_sizes(state: ContactState, law: ContactLaw, regime: Regimes) -> ContactTangent:
    """Sizes of the terms of `contact_tangent`: its entries err by these times the rounding."""
    stiffness = np.abs(law.local_stiffness(state, regime))
    g, b_i, b_j = law.shear_kinematics(state)
    n, t, l_size = np.abs(state.n), np.abs(state.t), state.length + state.touching_length
    shear = stiffness[..., 0, 1, None] * n + stiffness[..., 1, 1, None] * t
    t_rate = stiffness[..., 1, 0, None] * n + (g * stiffness[..., 1, 1])[..., None] * t
    growth = 0.5 * np.abs(state.shear_force)[..., None] * n
    # The arms are differences of lengths as large as the larger grain.
    a_i, a_j, a_size = np.abs(state.arm_i), np.abs(state.arm_j), 0.5 * l_size
    kt, rolling = stiffness[..., 1, 1], np.abs(law.rolling_stiffness(state, regime))
    b_i, b_j, b_size = np.abs(b_i), np.abs(b_j), a_size

    def moment(a: Floats, b: Floats) -> Floats:
        return kt * (a * b_size + a_size * b) + rolling

    frame = np.stack([n, t], axis=-1)
    return ContactTangent(
        k=frame @ local_sizes(state, law, regime) @ np.swapaxes(frame, -1, -2),
        q_i=b_size[..., None] * shear,
        q_j=b_size[..., None] * shear,
        p_i=growth + a_size[..., None] * t_rate,
        p_j=growth + a_size[..., None] * t_rate,
        c=_square(moment(a_i, b_i), moment(a_i, b_j), moment(a_j, b_i), moment(a_j, b_j)),
    )


def local_blocks(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """(..., C, 2, 2) translational block of each contact in its own frame (n, t).

    Material stiffness of the law, with the shear lever `g`, then `-N/l` and `T/l` from the turning
    of the frame; rows the force on j, columns the relative displacement.
    """
    local = _stiffness(state, law, regime)
    g, _, _ = law.shear_kinematics(state)
    local[..., :, 1] *= g[..., None]
    local[..., 1, 1] -= state.normal_force / state.length
    local[..., 0, 1] += state.shear_force / state.length
    return local


def local_sizes(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """Sizes of the terms of `local_blocks`, which `kt` and `N/l` may cancel in."""
    local = local_blocks(state, law, regime)
    for entry, force in (((1, 1), state.normal_force), ((0, 1), -state.shear_force)):
        turning = force / state.length
        at = (..., *entry)
        local[at] = np.abs(local[at] + turning) + np.abs(turning)
    return np.abs(local)


def _square(ii: Floats, ij: Floats, ji: Floats, jj: Floats) -> Floats:
    rows = [np.stack(np.broadcast_arrays(*row), axis=-1) for row in ((ii, ij), (ji, jj))]
    return np.stack(np.broadcast_arrays(*rows), axis=-2)


def _to_global(state: ContactState, local: Floats) -> Floats:
    frame = np.stack([state.n, state.t], axis=-1)
    return frame @ local @ np.swapaxes(frame, -1, -2)
