"""Regimes of contacts at yield or just touching: options, symmetry, the rate problem."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import prod
from typing import Literal

import numpy as np

from loops.arrays import ROUNDING, Flags, Floats, Integers
from loops.graph import ContactState
from loops.laws.frictional import Regime, edge_of, edge_rates
from loops.stress_strain import cauchy_rate
from loops.symmetry import PointGroup, point_group
from stability.paths.model import PathModel, compressed_state
from stability.paths.state import Mode, PathState, Rates, centres, contacts_at, unpack
from stability.paths.state_rates import UNIT_PARAMETER, StateRates
from stability.programmes import NOTHING, Programme
from stability.regimes import (
    ENUMERATION_LIMIT,
    INSIDE,
    Choice,
    EdgeRates,
    FullProblem,
    Regimes,
    agreeing,
    edge_options,
    given_regimes,
)

# Regimes that all contacts at the edge are told to have.
Held = Literal["elastic", "sliding"]
# Lengths over r_i + r_j at which the laws of contacts are compared.
PROBES = (0.9, 0.99)
# Over the largest rate of all contacts: events are located closer than this.
LOCATED = 1e-10
# Row spaces of two controls that differ by less are the same.
CONTROL_RTOL = 1e-12


@dataclass(frozen=True, eq=False)
class EdgeTrial:
    """Rates of the model for one combination of regimes, see `stability.regimes.Trial`."""

    mode: Mode
    rates: Rates
    edge: EdgeRates
    vector: Floats
    trusted: bool
    state: StateRates

    @property
    def strain_rate(self) -> Floats:
        """Return `H'` (2, 2)."""
        return self.rates.H.reshape(2, 2)

    @property
    def stress_rate(self) -> Floats:
        """Return `P'` (2, 2)."""
        return self.rates.P.reshape(2, 2)

    @property
    def cauchy_rate(self) -> Floats:
        """Return the rate (2, 2) of the Cauchy stress."""
        H, P = self.state.H.reshape(2, 2), self.state.P.reshape(2, 2)
        return cauchy_rate(H, P, self.strain_rate, self.stress_rate)


def edge_choices(
    model: PathModel, state: PathState, mode: Mode, fired: dict[int, Choice]
) -> dict[int, tuple[Choice, ...]]:
    """Contacts with more than one possible regime, and their options.

    Contacts whose event has `fired` are at the edge, however few digits their forces have left.
    """
    contacts = contacts_at(model, state, mode)
    closed = mode.regime != Regime.OPEN
    normal = np.where(closed, contacts.normal_force, model.law.closed_force(contacts))
    edge = edge_of(model.law, replace(contacts, normal_force=normal), closed)
    touching, at_yield = edge.touching.copy(), edge.at_yield.copy()
    for c, choice in fired.items():
        touching[c] |= choice.regime == Regime.OPEN or not closed[c]
        at_yield[c] |= choice.regime == Regime.SLIDING and not edge.apex[c]
    options: dict[int, tuple[Choice, ...]] = {}
    for c in np.flatnonzero(touching | at_yield).tolist():
        options[c] = edge_options(
            touching=bool(touching[c]),
            at_yield=bool(at_yield[c]),
            apex=bool(edge.apex[c]),
            frictionless=bool(model.mu[c] == 0.0),
            side=float(contacts.shear_force[c]),
        )
    if model.search_all:
        for c in np.flatnonzero(closed & model.has_cone).tolist():
            options.setdefault(c, INSIDE)
    return dict(sorted(options.items()))


def edge_problem(
    model: PathModel,
    state: PathState,
    mode: Mode,
    programme: Programme,
    *,
    preferred: dict[int, Choice],
    direction: Floats | None,
    gauge: Floats = UNIT_PARAMETER,
    held: Held | None = None,
    in_full: int = ENUMERATION_LIMIT,
) -> Regimes[EdgeTrial]:
    """Rate problem of one state under a unit rate of the loading parameter.

    Contacts that the model's symmetry maps on each other take the same regime, so that only motions
    that keep the symmetry are found. With regimes that are `held` nothing is searched: contacts at
    the edge all stick, or all slide that may.
    """
    options = edge_choices(model, state, mode, preferred)
    orbits = edge_orbits(model, options)
    closed = Mode(np.full(model.contact_count, Regime.ELASTIC, dtype=np.int8), mode.side)
    contacts = contacts_at(model, state, closed)
    inside = np.array([each == INSIDE for each in orbits.options], dtype=bool)

    def rates_for(choices: tuple[Choice, ...]) -> EdgeTrial:
        chosen = orbits.applied(mode, choices)
        at = StateRates(model, state, chosen, programme, gauge)
        rates = at.raw_rates
        _, shear, strength = edge_rates(model.law, contacts, chosen.side, rates.un, rates.ut)
        # A contact that never slides has no strength to compare with.
        strength = np.where(np.isfinite(model.mu), strength, 0.0)[orbits.representatives]
        moved = ROUNDING * model.length * np.abs(rates.H).max()
        error = model.stiffness * (moved + LOCATED * np.abs([rates.un, rates.ut]).max())
        edge = EdgeRates(
            model.stiffness * rates.un[orbits.representatives],
            shear[orbits.representatives],
            np.where(inside, np.inf, strength),
            error,
        )
        return EdgeTrial(chosen, rates, edge, rate_vector(model, rates), rates.trusted, at)

    wanted = first_choices(model, orbits, preferred)
    first = []
    for c, can in zip(orbits.representatives.tolist(), orbits.options, strict=True):
        regime = Regime(int(mode.regime[c]))
        present = Choice(regime, float(mode.side[c]) if regime == Regime.SLIDING else 0.0)
        choice = wanted.get(c, present)
        first.append(choice if choice in can else can[0])
    problem = FullProblem(orbits.options, rates_for, in_full)
    if held is None:
        found = agreeing(problem, preferred=first, direction=direction)
    else:
        wished = Regime.ELASTIC if held == "elastic" else Regime.SLIDING
        # What a contact has where it cannot do that.
        told = [next((c for c in can if c.regime == wished), can[0]) for can in orbits.options]
        found = given_regimes(problem, told)
    count = prod(float(len(can)) for can in options.values())
    return replace(found, combinations=count, contacts=orbits.representatives)


def rate_vector(model: PathModel, rates: Rates) -> Floats:
    """(8 + 2 C,) `H'`, `P'`, `N'` and `T'` in comparable units, by which solutions are compared."""
    force = model.stiffness * model.length
    forces = np.concatenate([rates.normal_force, rates.shear_force]) / force
    return np.concatenate([rates.H, rates.P / model.stiffness, forces])


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
    contacts = contacts_at(model, state, mode)
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
    """Values of the law in a few states, (C,) each: contacts of equal values have equal laws."""
    law, unit, marks = model.law, model.stiffness, []
    elastic = np.full(model.contact_count, Regime.ELASTIC, dtype=np.int8)
    for length in PROBES:
        state = compressed_state(contacts, law, length)
        D = law.local_stiffness(state, elastic) / unit
        strength = law.strength(state) / (unit * model.length)
        N = state.normal_force / (unit * model.length)
        rolling = law.rolling_stiffness(state, elastic) / (unit * model.volume)
        marks += [D[:, 0, 0], D[:, 1, 1], strength, N, law.gap(state) / model.length]
        marks.append(np.broadcast_to(rolling, model.contact_count))
    return marks


def keeps_control(programme: Programme, maps: Floats) -> Flags:
    """Orthogonal maps (S, 2, 2) under which a programme controls the same, (S,).

    `H'` and `P'` turn as tensors; the equations of the programme, rates included, must span the
    same rows. The row of constant area does so by itself: `det F` is no matter of the frame; that
    of a Cauchy stress does in a state that the maps keep where it does without stress and strain.
    """
    stress, strain, rate = programme.equations(NOTHING, NOTHING)
    rows = np.column_stack([strain, stress, rate])
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
    return np.asarray(np.abs(left).max(axis=(1, 2)) <= CONTROL_RTOL)


@dataclass(frozen=True, eq=False)
class EdgeOrbits:
    """Orbits of contacts at the edge: one contact of each takes a choice, the others follow.

    `representatives` (m,): First contact of every orbit; `options`: Its regimes; `contacts` (E,):
    All contacts of these orbits; `orbit` (E,): Orbit of each; `sign` (E,): Factor from the side of
    the orbit's first contact to its own.
    """

    representatives: Integers
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
    """Orbits of the contacts at the edge under the model's symmetry, if it has one."""
    at_edge = np.array(list(options), dtype=np.int64)
    if model.symmetry is None:
        each = np.arange(len(at_edge))
        return EdgeOrbits(at_edge, tuple(options.values()), at_edge, each, np.ones(len(each)))
    first = model.symmetry.contact_orbits
    # A mirror turns the side; without friction there is none to turn.
    parity = np.where(model.mu > 0, model.symmetry.contact_parity, 1.0)
    allowed: dict[int, tuple[Choice, ...]] = {}
    for c, can in options.items():
        # As options of the orbit's first contact; on a mirror nothing slides.
        sign = float(parity[c])
        as_first = [
            Choice(each.regime, sign * each.side) for each in can if each.side == 0.0 or sign != 0.0
        ]
        allowed.setdefault(int(first[c]), tuple(as_first))
    representatives = np.array(list(allowed), dtype=np.int64)
    contacts = np.flatnonzero(np.isin(first, representatives))
    orbit = np.argsort(representatives)[np.searchsorted(np.sort(representatives), first[contacts])]
    return EdgeOrbits(representatives, tuple(allowed.values()), contacts, orbit, parity[contacts])


def first_choices(
    model: PathModel, orbits: EdgeOrbits, preferred: Mapping[int, Choice]
) -> dict[int, Choice]:
    """Preferred choices of any contact of an orbit, as choices of its first contact."""
    if model.symmetry is None:
        return dict(preferred)
    first: dict[int, Choice] = {}
    for c, k, sign in zip(orbits.contacts, orbits.orbit, orbits.sign, strict=True):
        choice = preferred.get(int(c))
        if choice is not None:
            first.setdefault(
                int(orbits.representatives[k]), Choice(choice.regime, sign * choice.side)
            )
    return first
