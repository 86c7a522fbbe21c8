"""The symmetry that a path keeps: that of its state and of everything that controls it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.contact_state import ContactState
from loops.laws.protocol import Regime
from loops.symmetry import PointGroup, identity, point_group
from stability.paths.model import PathModel, compressed
from stability.paths.state import Mode, centres, contacts_of, unpack
from stability.programmes import Programme
from stability.rate_problem import Choice

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
        state = compressed(contacts, law, length)
        D = law.local_stiffness(state, elastic) / unit
        strength = law.strength(state) / (unit * model.length)
        N = state.normal_force / (unit * model.length)
        rolling = law.rolling_stiffness(state, elastic) / (unit * model.volume)
        marks += [D[:, 0, 0], D[:, 1, 1], strength, N, law.gap(state) / model.length]
        marks.append(np.broadcast_to(rolling, model.contact_count))
    return marks


def keeps_control(programme: Programme, maps: Floats) -> Flags:
    """Orthogonal maps (S, 2, 2) under which a programme asks for the same, (S,).

    `H'` and `P'` turn as tensors; the equations of the programme, rates included, must span the
    same rows. The row of constant area does so by itself: `det F` is no matter of the frame.
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


@dataclass(frozen=True, eq=False)
class EdgeOrbits:
    """Contacts at the edge in orbits: one of each is asked, the others follow.

    `asked` (m,): First contact of every orbit; `options`: Its regimes; `contacts` (E,): All
    contacts of these orbits,; `orbit` (E,): the orbit of each, and; `sign` (E,): what turns the
    side of the first into its own.
    """

    asked: Integers
    options: tuple[tuple[Choice, ...], ...]
    contacts: Integers
    orbit: Integers
    sign: Floats

    def applied(self, mode: Mode, choices: Sequence[Choice]) -> Mode:
        """Regimes of all contacts for one choice per orbit."""
        regime, side = mode.regime.copy(), mode.side.copy()
        chosen = np.array([choice.regime for choice in choices], dtype=np.int8)
        chosen_side = np.array([choice.side for choice in choices], dtype=float)
        regime[self.contacts] = chosen[self.orbit]
        side[self.contacts] = chosen_side[self.orbit] * self.sign
        return Mode(regime, side)


def edge_orbits(model: PathModel, options: Mapping[int, tuple[Choice, ...]]) -> EdgeOrbits:
    """Gather contacts at the edge by the model's symmetry; each by itself without one."""
    at_edge = np.array(list(options), dtype=np.int64)
    if model.symmetry is None:
        each = np.arange(len(at_edge))
        return EdgeOrbits(at_edge, tuple(options.values()), at_edge, each, np.ones(len(each)))
    first = model.symmetry.contact_orbits
    # A mirror turns the side; without friction there is none to turn.
    parity = np.where(model.mu > 0, model.symmetry.contact_parity, 1.0)
    allowed: dict[int, tuple[Choice, ...]] = {}
    for c, can in options.items():
        allowed.setdefault(int(first[c]), _carried(can, float(parity[c])))
    asked = np.array(list(allowed), dtype=np.int64)
    contacts = np.flatnonzero(np.isin(first, asked))
    orbit = np.argsort(asked)[np.searchsorted(np.sort(asked), first[contacts])]
    return EdgeOrbits(asked, tuple(allowed.values()), contacts, orbit, parity[contacts])


def asked_first(
    model: PathModel, orbits: EdgeOrbits, preferred: Mapping[int, Choice]
) -> dict[int, Choice]:
    """Preferred choices of any contact of an orbit, as the one that is asked has them."""
    if model.symmetry is None:
        return dict(preferred)
    first: dict[int, Choice] = {}
    for c, k, sign in zip(orbits.contacts, orbits.orbit, orbits.sign, strict=True):
        choice = preferred.get(int(c))
        if choice is not None:
            first.setdefault(int(orbits.asked[k]), Choice(choice.regime, sign * choice.side))
    return first


def _carried(can: tuple[Choice, ...], parity: float) -> tuple[Choice, ...]:
    """Options as the first contact of the orbit has them; on a mirror nothing slides."""
    return tuple(
        Choice(each.regime, parity * each.side) for each in can if each.side == 0.0 or parity != 0.0
    )
