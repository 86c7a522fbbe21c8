"""The symmetry that a path keeps: that of its state and of everything that controls it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from loops.contact_state import ContactState
from loops.laws.protocol import Regime
from loops.symmetry import PointGroup, identity, point_group
from stability.paths.model import PathModel, probe
from stability.paths.state import Mode, centres, contacts_of, unpack
from stability.programmes import Programme

Floats = NDArray[np.float64]

# Lengths over r_i + r_j at which the laws of contacts are compared.
PROBES = (0.9, 0.99)

# Row spaces of a control that differ by less are the same.
SAME_CONTROL = 1e-12


def path_symmetry(
    model: PathModel, y: Floats, mode: Mode, programmes: Iterable[Programme], periodic: bool = False
) -> PointGroup | None:
    """Point group of a state and of the programmes that follow.

    Its rates, if they are the only ones, are as symmetric: the group stays that of the path. Normal
    forces follow from the geometry and are not compared.

    Parameters
    ----------
    model, y, mode
        Where the path is and what its contacts do.
    programmes : iterable of Programme
        Control from here on.
    periodic : bool
        Whether the graph is periodic: then nothing is looked for.

    Returns
    -------
    PointGroup or None
        None where nothing but the identity is found.
    """
    if periodic:
        return None
    state = unpack(model, y)
    contacts = contacts_of(model, state, mode)
    shear = contacts.shear_force
    slides = (mode.regime == Regime.SLIDING) & (model.mu > 0)
    group = point_group(
        [model.x0, centres(model, state.place)],
        model.contacts,
        model.radii,
        even=[mode.regime, model.mu, *law_marks(model, contacts)],
        odd=[shear / (model.stiffness * model.length), np.where(slides, mode.side, 0.0)],
    )
    for programme in programmes:
        group = group.only(keeps_control(programme, group.maps))
    return group if group.order > 1 else None


def law_marks(model: PathModel, contacts: ContactState) -> list[Floats]:
    """What the law says of each contact in a few states, (C,) each: equal contacts, equal laws."""
    law, unit, marks = model.law, model.stiffness, []
    elastic = np.full(model.contact_count, Regime.ELASTIC, dtype=np.int8)
    for length in PROBES:
        state = probe(contacts, law, length)
        D = law.local_stiffness(state, elastic) / unit
        strength = law.strength(state) / (unit * model.length)
        N = state.normal_force / (unit * model.length)
        rolling = law.rolling_stiffness(state, elastic) / (unit * model.volume)
        marks += [D[:, 0, 0], D[:, 1, 1], strength, N, law.gap(state) / model.length]
        marks.append(np.broadcast_to(rolling, model.contact_count))
    return marks


def keeps_control(programme: Programme, maps: Floats) -> NDArray[np.bool_]:
    """Orthogonal maps (S, 2, 2) under which a programme asks for the same, (S,).

    `H'` and `P'` turn as tensors; the equations of the programme, rates included, must span the
    same rows. The row of constant area does so by itself: `det F` is no matter of the frame.

    Parameters
    ----------
    programme : Programme
        Control.
    maps : (S, 2, 2) array
        Rotations and mirrors.

    Returns
    -------
    (S,) array of bool

    Examples
    --------
    >>> import numpy as np
    >>> from stability import programmes
    >>> quarter, mirror = np.array([[0.0, -1], [1, 0]]), np.diag([1.0, -1])
    >>> maps = np.array([quarter, mirror])
    >>> [keeps_control(p, maps).tolist() for p in (
    ...     programmes.isotropic_strain(), programmes.drained_biaxial())]
    [[True, True], [False, True]]
    """
    rows = np.column_stack([programme.strain, programme.stress, programme.rate])
    if programme.isochoric_row is not None:
        rows = np.delete(rows, programme.isochoric_row, axis=0)
    rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    turn = np.zeros((len(maps), 9, 9))
    turn[:, 8, 8] = 1.0
    pairs = np.einsum("sik,sjl->sijkl", maps, maps).reshape(-1, 4, 4)
    turn[:, :4, :4] = turn[:, 4:8, 4:8] = pairs
    image = rows @ turn
    basis, _ = np.linalg.qr(rows.T)
    left = image - image @ basis @ basis.T
    return np.asarray(np.abs(left).max(axis=(1, 2)) <= SAME_CONTROL)


def symmetry_or_identity(model: PathModel) -> PointGroup:
    """The symmetry that the model keeps, the identity for None."""
    return model.symmetry or identity(model.grain_count, model.contact_count)
