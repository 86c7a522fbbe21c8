"""Regimes of contacts at yield or just touching: options, symmetry, the rate problem."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from loops import Scene
from loops.arrays import ROUNDING, Flags, Floats, Integers, Regimes
from loops.closures import Closure, Spins
from loops.graph import ContactState
from loops.laws.frictional import Regime, edge_of, edge_rates
from loops.stress_strain import cauchy_rate
from loops.symmetry import PointGroup, identity, point_group
from stability.paths.model import PathModel, compressed_state, path_model
from stability.paths.state import Mode, Rates, initial_state, start_mode, with_forces
from stability.paths.state_rates import UNIT_PARAMETER, StateRates
from stability.programmes import NOTHING, Programme
from stability.regimes import (
    CHOICES,
    ENUMERATION_LIMIT,
    INSIDE,
    LEFT,
    OPEN,
    RIGHT,
    EdgeProblem,
    EdgeRates,
    agreeing,
    combination_count,
    edge_options,
    first_option,
    given_regimes,
    sides,
)
from stability.regimes import Regimes as Found

# Regimes that all contacts at the edge are told to have.
Held = Literal["elastic", "sliding"]
# Lengths over r_i + r_j at which the laws of contacts are compared.
PROBES = (0.9, 0.99)
# Over the largest rate of all contacts: events are located closer than this.
LOCATED = 1e-10
# Over kn l: a force that is rounding, as the crossings of events tell the limit of friction.
ROUNDED_FORCE = 1e-13
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


def edge_choices(here: StateRates, fired: Mapping[int, int]) -> Flags:
    """Regimes that each contact may take, (C, 4) as `stability.regimes.CHOICES`; none without.

    Contacts whose event has `fired` are at the edge, however few digits their forces have left.
    """
    model, contacts, closed = here.model, here.contacts, here.mode.regime != Regime.OPEN
    normal = np.where(closed, contacts.normal_force, model.law.closed_force(contacts))
    edge = edge_of(model.law, replace(contacts, normal_force=normal), closed)
    touching, at_yield = edge.touching.copy(), edge.at_yield.copy()
    # A limit that is met at a force of rounding may be the opening of the contact.
    rounded = normal <= ROUNDED_FORCE * model.stiffness * model.length
    for c, regime in fired.items():
        touching[c] |= regime == OPEN or not closed[c] or rounded[c]
        at_yield[c] |= regime in (LEFT, RIGHT) and not edge.apex[c]
    at_edge = touching | at_yield
    options = edge_options(touching, at_yield, edge.apex, model.mu == 0.0, contacts.shear_force)
    options[~at_edge] = False
    if model.search_all:
        options[closed & model.has_cone & ~at_edge] = INSIDE
    return options


def edge_problem(
    here: StateRates,
    *,
    preferred: Mapping[int, int],
    direction: Floats | None,
    held: Held | None = None,
    in_full: int = ENUMERATION_LIMIT,
) -> Found[EdgeTrial]:
    """Rate problem of one state: under a unit rate of the loading parameter, by its first gauge.

    Contacts that the model's symmetry maps on each other take the same regime, so that only motions
    that keep the symmetry are found. With regimes that are `held` nothing is searched: contacts at
    the edge all stick, or all slide that may.
    """
    model, mode, options = here.model, here.mode, edge_choices(here, preferred)
    orbits = edge_orbits(model, options)
    closed = Mode(np.full(model.contact_count, Regime.ELASTIC, dtype=np.int8), mode.side)
    contacts = with_forces(model.law, here.contacts, closed)
    inside = (orbits.options == INSIDE).all(axis=1)

    def rates_for(regimes: Regimes) -> EdgeTrial:
        chosen = orbits.mode(mode, regimes)
        at = replace(here, mode=chosen)
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

    problem = EdgeProblem(orbits.options, rates_for, in_full)
    if held is None:
        wanted = first_regimes(orbits, mode, preferred)
        first = first_option(orbits.options, CHOICES == wanted[:, None])
        found = agreeing(problem, preferred=first, direction=direction)
    else:
        # A contact that cannot do that has the first of its options.
        wished = Regime.ELASTIC if held == "elastic" else Regime.SLIDING
        found = given_regimes(problem, first_option(orbits.options, np.abs(CHOICES) == wished))
    count = combination_count(options[options.any(axis=1)])
    return replace(found, combinations=count, contacts=orbits.representatives)


def rates_of_loop(
    scene: Scene, programme: Programme, closure: Closure, spins: Spins, held: Held | None
) -> Found[EdgeTrial]:
    """Find the rates of a loop under a programme, see `stability.rates_at`."""
    contacts = scene.contact_state
    model = path_model(scene.graph, contacts, scene.law, closure, spins, scene.given_volume)
    about = initial_state(model, contacts), start_mode(model, contacts), programme
    here = StateRates(model, *about, UNIT_PARAMETER)
    return edge_problem(here, preferred={}, direction=None, held=held)


def rate_vector(model: PathModel, rates: Rates) -> Floats:
    """(8 + 2 C,) `H'`, `P'`, `N'` and `T'` in comparable units, by which solutions are compared."""
    force = model.stiffness * model.length
    forces = np.concatenate([rates.normal_force, rates.shear_force]) / force
    return np.concatenate([rates.H, rates.P / model.stiffness, forces])


def path_symmetry(here: StateRates, programmes: Iterable[Programme]) -> PointGroup | None:
    """Point group of a state and of the programmes that follow.

    Its rates, if they are the only ones, are as symmetric: the group stays that of the path. Normal
    forces follow from the geometry and are not compared.
    """
    model, mode, contacts = here.model, here.mode, here.contacts
    if not model.watches_pairs:
        return None
    shear = contacts.shear_force
    slides = (mode.regime == Regime.SLIDING) & (model.mu > 0)
    group = point_group(
        [model.x0, here.x],
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
    """Orbits of contacts at the edge: one contact of each takes a regime, the others follow.

    `representatives` (m,): First contact of every orbit; `options` (m, 4): Its regimes;
    `contacts` (E,): All contacts of these orbits; `orbit` (E,): Orbit of each; `sign` (E,): Factor
    from the side of the orbit's first contact to its own.
    """

    representatives: Integers
    options: Flags
    contacts: Integers
    orbit: Integers
    sign: Floats

    def mode(self, before: Mode, regimes: Regimes) -> Mode:
        """Regimes of all contacts for one per orbit."""
        regime, side = before.regime.copy(), before.side.copy()
        chosen = regimes[self.orbit]
        regime[self.contacts], side[self.contacts] = np.abs(chosen), sides(chosen) * self.sign
        return Mode(regime, side)


def edge_orbits(model: PathModel, options: Flags) -> EdgeOrbits:
    """Orbits of the contacts at the edge, those with options, under the model's symmetry."""
    group = model.symmetry or identity(model.grain_count, model.contact_count)
    first, at_edge = group.contact_orbits, np.flatnonzero(options.any(axis=1))
    # A mirror turns the side; without friction there is none to turn.
    parity = np.where(model.mu > 0, group.contact_parity, 1.0)
    representatives, index = np.unique(first[at_edge], return_index=True)
    one = at_edge[index]
    # As options of the orbit's first contact; on a mirror nothing slides.
    sticks, parts, left, right = options[one].T
    turned, slides = parity[one] < 0.0, parity[one] != 0.0
    left, right = slides & np.where(turned, [right, left], [left, right])
    contacts = np.flatnonzero(np.isin(first, representatives))
    orbit = np.searchsorted(representatives, first[contacts])
    own = np.column_stack([sticks, parts, left, right])
    return EdgeOrbits(representatives, own, contacts, orbit, parity[contacts])


def first_regimes(orbits: EdgeOrbits, mode: Mode, preferred: Mapping[int, int]) -> Regimes:
    """Preferred regimes of any contact of an orbit as of its first one, (m,); else present ones."""
    slides = mode.regime == Regime.SLIDING
    own = np.where(slides, mode.side * LEFT, mode.regime).astype(np.int8)
    wanted = own[orbits.representatives]
    # Of several contacts of an orbit the first decides.
    for c, k, sign in zip(*map(np.flip, (orbits.contacts, orbits.orbit, orbits.sign)), strict=True):
        if (regime := preferred.get(int(c))) is not None:
            wanted[k] = regime * sign if regime in (LEFT, RIGHT) else regime
    return wanted
