"""The tangent of one contact, and the grain-level tangent of any graph assembled from it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, Integers, Regimes
from loops.graph import ContactState, GrainGraph, contact_state
from loops.laws.frictional import ContactLaw, require_law
from loops.validation import checked_regimes

if TYPE_CHECKING:
    from scipy import sparse

# Moments of a rolling spring on both grains per spin of either, over its stiffness.
ROLL = np.array([[1.0, -1.0], [-1.0, 1.0]])


# Motion `r = (d', w_i, w_j)` of a contact from that of its grains, `x_i, y_i, x_j, y_j, w_i, w_j`.
RELATIVE = np.eye(4, 6, 2) - np.eye(4, 6) * [[1.0], [1.0], [0.0], [0.0]]


def contact_regime(
    state: ContactState, law: ContactLaw, regime: ArrayLike | None = None
) -> Regimes:
    """Regime of the contacts: as given, else that of the graph, else by the law from the state."""
    if regime is not None:
        return checked_regimes(regime, state.length.shape[-1])
    return law.regime(state) if state.regime is None else state.regime


def translational_blocks(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """Tangent blocks `k` of the contacts with spins blocked, `f' = -k d'`.

    With the linear-frictional law and the shear increment `branch` these are

        elastic   k = kn n(x)n + (kt - N/l) t(x)t + (T/l) n(x)t
        sliding   k = kn n(x)n + s mu kn t(x)n - (N/l) t(x)t + (T/l) n(x)t

    (Nicot et al. 2016, equations 13-19, for one branch). The terms with `N/l` and `T/l` arise
    because the frame turns with the branch; where it keeps its direction there are none.

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
    return _turned(_frame(state), local_blocks(state, law, regime))


def translational_sizes(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """Sums of the sizes of the terms of `translational_blocks`."""
    return _turned(np.abs(_frame(state)), local_sizes(state, law, regime))


def contact_tangent(
    state: ContactState, law: ContactLaw, regime: Regimes, arms: tuple[Floats, Floats] | None = None
) -> Floats:
    """Tangent of the contacts with translations and spins, `s' = -S r`.

    `r = (d', w_i, w_j)` is the motion at a contact: the branch rate and the spins of its grains
    (counter-clockwise positive). `s' = (f', m_i', m_j')` are the rates of the force of grain i on
    grain j and of the moments that the contact exerts on its grains. The force acts at the lever
    arms `a_i`, `a_j`; each grain receives the moment `-a T` and `a` moves with `l`.

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
    (..., C, 4, 4) array
        `S`: the translational block (force per length), force per spin and moment per branch rate
        (force), moment per spin (force times length).
    """
    stiffness = law.local_stiffness(state, regime)
    g, *own = law.shear_kinematics(state)
    a, b = _pair(state.arm_i, state.arm_j), _pair(*(own if arms is None else arms))
    # Rates per unit of shear displacement: force along n and t, and T' alone.
    shear = stiffness[..., 0, 1, None] * state.n + stiffness[..., 1, 1, None] * state.t
    t_rate = stiffness[..., 1, 0, None] * state.n + (g * stiffness[..., 1, 1])[..., None] * state.t
    arm_growth = 0.5 * state.shear_force[..., None] * state.n
    kt = stiffness[..., 1, 1, None, None]
    return _joined(
        translational_blocks(state, law, regime),
        -shear[..., :, None] * b[..., None, :],
        arm_growth[..., None, :] - a[..., :, None] * t_rate[..., None, :],
        a[..., :, None] * kt * b[..., None, :] + _rolling(state, law, regime) * ROLL,
    )


def contact_sizes(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """Sums of the sizes of the terms of `contact_tangent`: errors of its entries over rounding."""
    stiffness = np.abs(law.local_stiffness(state, regime))
    g, b_i, b_j = law.shear_kinematics(state)
    n, t, l_size = np.abs(state.n), np.abs(state.t), state.length + state.touching_length
    shear = stiffness[..., 0, 1, None] * n + stiffness[..., 1, 1, None] * t
    t_rate = stiffness[..., 1, 0, None] * n + (g * stiffness[..., 1, 1])[..., None] * t
    growth = 0.5 * np.abs(state.shear_force)[..., None] * n
    # The arms are differences of lengths as large as the larger grain.
    a, b = _pair(np.abs(state.arm_i), np.abs(state.arm_j)), _pair(np.abs(b_i), np.abs(b_j))
    size = 0.5 * l_size[..., None]
    kt = stiffness[..., 1, 1, None, None]
    moment = a[..., :, None] * size[..., None, :] + size[..., :, None] * b[..., None, :]
    return _joined(
        translational_sizes(state, law, regime),
        shear[..., :, None] * size[..., None, :],
        growth[..., None, :] + size[..., :, None] * t_rate[..., None, :],
        kt * moment + np.abs(_rolling(state, law, regime)),
    )


def contact_kinematics(state: ContactState, law: ContactLaw) -> Floats:
    """(..., C, 2, 4) relative displacement rates `(un', ut')` per motion `r` of a contact."""
    g, b_i, b_j = law.shear_kinematics(state)
    rows = np.zeros((*np.broadcast_shapes(state.length.shape, b_i.shape), 2, 4))
    rows[..., 0, :2] = state.n
    rows[..., 1, :2] = g[..., None] * state.t
    rows[..., 1, 2], rows[..., 1, 3] = -b_i, -b_j
    return rows


def local_blocks(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """(..., C, 2, 2) translational block of each contact in its own frame (n, t).

    Material stiffness of the law, with the shear lever `g`, then `-N/l` and `T/l` from the turning
    of the frame; rows the force on j, columns the relative displacement.
    """
    g, _, _ = law.shear_kinematics(state)
    local = law.local_stiffness(state, regime)
    local[..., :, 1] *= g[..., None]
    local[..., 1, 1] -= state.turns * state.normal_force / state.length
    local[..., 0, 1] += state.turns * state.shear_force / state.length
    return local


def local_sizes(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """Sums of the sizes of the terms of `local_blocks`, where `kt` and `N/l` may cancel."""
    local = local_blocks(state, law, regime)
    for entry, force in (((1, 1), state.normal_force), ((0, 1), -state.shear_force)):
        turning = state.turns * force / state.length
        at = (..., *entry)
        local[at] = np.abs(local[at] + turning) + np.abs(turning)
    return np.abs(local)


def _pair(i: Floats, j: Floats) -> Floats:
    """(..., C, 2) values of grain i and of grain j, stacked."""
    return np.stack(np.broadcast_arrays(i, j), axis=-1)


def _rolling(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """(..., C, 1, 1) rolling stiffness, or that of all contacts."""
    rolling = law.rolling_stiffness(state, regime)
    return np.asarray(rolling[..., None, None])


def _joined(k: Floats, q: Floats, p: Floats, c: Floats) -> Floats:
    """(..., C, 4, 4) from its four (..., C, 2, 2) blocks."""
    shape = np.broadcast_shapes(*(block.shape[:-2] for block in (k, q, p, c)))
    joined = np.empty((*shape, 4, 4))
    joined[..., :2, :2], joined[..., :2, 2:] = k, q
    joined[..., 2:, :2], joined[..., 2:, 2:] = p, c
    return joined


def _frame(state: ContactState) -> Floats:
    """Return the axes of each contact as columns, (..., C, 2, 2)."""
    return np.stack([state.n, state.t], axis=-1)


def _turned(frame: Floats, local: Floats) -> Floats:
    return frame @ local @ np.swapaxes(frame, -1, -2)


def assemble_tangent(
    graph: GrainGraph, law: ContactLaw, *, spins: bool = False, regime: ArrayLike | None = None
) -> Floats:
    """Dense grain-level tangent `K`: external force rates `F' = K v` that move the grains by `v`.

    Freedoms in the order `x_0, y_0, x_1, y_1, ...`, then the spins `w_0, w_1, ...`
    (counter-clockwise positive) if wanted; the forces in the same order, moments last. Each
    contact adds its block, with dead forces and moments in the current state; `K` is left
    nonsymmetric (Nicot et al. 2016, equation 20, for any graph).

    Parameters
    ----------
    graph : GrainGraph
        Grains and contacts, batch axes `...` allowed.
    law : ContactLaw
        Contact law.
    spins : bool
        Whether the spins are freedoms; otherwise they are blocked.
    regime : (..., C) array of Regime, optional
        Regime of each contact; read from the state by the law if left out.

    Returns
    -------
    (..., 2 G, 2 G) or (..., 3 G, 3 G) array
        The tangent (force per length; moments per angle in the last block).

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, assemble_tangent
    >>> pair = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> assemble_tangent(pair, LinearFrictional(kn=1.0, kt=0.5)).tolist()[0]
    [1.0, 0.0, -1.0, 0.0]
    """
    require_law(law, graph.contact_shape)
    state = contact_state(graph)
    S = contact_tangent(state, law, contact_regime(state, law, regime))
    return assembled(S, *grain_ends(graph.contacts, graph.grain_count, spins))


def grain_ends(contacts: Integers, grains: int, spins: bool = True) -> tuple[Integers, int]:
    """(C, 6) freedoms of each contact's grains, `x_i, y_i, x_j, y_j, w_i, w_j`, and their number.

    -1 stands for no freedom.
    """
    i, j = contacts.T
    w_i, w_j = (2 * grains + i, 2 * grains + j) if spins else (np.full_like(i, -1),) * 2
    ends = np.stack([2 * i, 2 * i + 1, 2 * j, 2 * j + 1, w_i, w_j], axis=1)
    return ends, (3 if spins else 2) * grains


def assembled(S: Floats, ends: Integers, size: int, signed: bool = True) -> Floats:
    """`K = D^T S D`, (..., size, size), from contact tangents (..., C, 4, 4), `r = D v`.

    Not `signed`: with `|D|`, for sizes of terms.
    """
    relative = RELATIVE if signed else np.abs(RELATIVE)
    K = np.zeros((*S.shape[:-3], size + 1, size + 1))
    at: Any = (..., ends[:, :, None], ends[:, None, :])
    np.add.at(K, at, relative.T @ S @ relative)
    return K[..., :size, :size]


def assembled_sparse(S: Floats, ends: Integers, size: int) -> sparse.csc_array:
    """The same of one state as a sparse matrix."""
    from scipy import sparse

    elements = RELATIVE.T @ S @ RELATIVE
    rows, columns = np.repeat(ends, 6, axis=1), np.tile(ends, (1, 6))
    inside = (rows >= 0) & (columns >= 0)
    values = elements.reshape(len(elements), 36)[inside]
    places = (rows[inside], columns[inside])
    return sparse.coo_array((values, places), shape=(size, size)).tocsc()


def motions(v: Floats, ends: Integers) -> Floats:
    """`r = D v`, (..., C, 4, k), from k motions of the freedoms, (..., size, k)."""
    held = np.zeros((*v.shape[:-2], 1, v.shape[-1]))
    return RELATIVE @ np.concatenate([v, held], axis=-2)[..., ends, :]


def balancing(s: Floats, ends: Integers, size: int, signed: bool = True) -> Floats:
    """`D^T s`, (..., size, k): external forces that balance k sets of contact forces `-s`."""
    forces = np.zeros((*s.shape[:-3], size + 1, s.shape[-1]))
    at: Any = (..., ends, slice(None))
    np.add.at(forces, at, (RELATIVE if signed else np.abs(RELATIVE)).T @ s)
    return forces[..., :size, :]
