"""Contacts at the edge of their law on a path: their options and the rate problem."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import prod

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.contact_state import ContactState
from loops.laws.frictional import edge_of, edge_rates
from loops.laws.protocol import Regime
from stability.paths.equations import UNIT_PARAMETER
from stability.paths.look import Look
from stability.paths.model import PathModel
from stability.paths.rates import Rates
from stability.paths.state import (
    Mode,
    PathState,
    contacts_of,
)
from stability.paths.symmetry import asked_first, edge_orbits
from stability.programmes import Programme
from stability.rate_problem import (
    INSIDE,
    Choice,
    EdgeRates,
    RateProblem,
    edge_options,
    solve_rate_problem,
)


@dataclass(frozen=True, eq=False)
class EdgeTrial:
    """Rates of the whole model for one combination of regimes, see `rate_problem.Trial`."""

    mode: Mode
    rates: Rates
    edge: EdgeRates
    vector: Floats
    trusted: bool


def edge_choices(
    model: PathModel, state: PathState, mode: Mode, fired: dict[int, Choice]
) -> dict[int, tuple[Choice, ...]]:
    """Contacts with more than one possible regime, and their options.

    Those whose event has `fired` are at the edge, however few digits their forces have left.
    """
    contacts = contacts_of(model, state, mode)
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
) -> RateProblem[EdgeTrial]:
    """Rate problem of one state under a unit rate of the loading parameter.

    Contacts that the model's symmetry sends to each other take the same regime: one of them is
    asked, and only motions that keep the symmetry are found.
    """
    options = edge_choices(model, state, mode, preferred)
    orbits = edge_orbits(model, options)
    closed = Mode(np.full(model.contact_count, Regime.ELASTIC, dtype=np.int8), mode.side)
    contacts = contacts_of(model, state, closed)
    inside = np.array([each == INSIDE for each in orbits.options], dtype=bool)

    def rates_for(choices: tuple[Choice, ...]) -> EdgeTrial:
        chosen = orbits.applied(mode, choices)
        rates = Look(model, state, chosen, programme, gauge).raw_rates
        edge = _edge_rates(model, contacts, chosen, rates, orbits.asked, inside)
        return EdgeTrial(chosen, rates, edge, rate_vector(model, rates), rates.trusted)

    hints = asked_first(model, orbits, preferred)
    first = [hints.get(int(c), _current(mode, int(c))) for c in orbits.asked]
    first = [
        choice if choice in can else can[0]
        for can, choice in zip(orbits.options, first, strict=True)
    ]
    found = solve_rate_problem(orbits.options, rates_for, preferred=first, direction=direction)
    return replace(found, combinations=prod(float(len(can)) for can in options.values()))


def rate_vector(model: PathModel, rates: Rates) -> Floats:
    """(8 + 2 C,) `H'`, `P'`, `N'` and `T'` in comparable units: what tells solutions apart."""
    force = model.stiffness * model.length
    forces = np.concatenate([rates.normal_force, rates.shear_force]) / force
    return np.concatenate([rates.H, rates.P / model.stiffness, forces])


def _current(mode: Mode, c: int) -> Choice:
    regime = Regime(int(mode.regime[c]))
    return Choice(regime, float(mode.side[c]) if regime == Regime.SLIDING else 0.0)


def _edge_rates(
    model: PathModel,
    state: ContactState,
    mode: Mode,
    rates: Rates,
    contacts: Integers,
    inside: Flags,
) -> EdgeRates:
    _, shear, strength = edge_rates(model.law, state, mode.side, rates.un, rates.ut)
    # A contact that never slides has no strength to compare with.
    strength = np.where(inside, np.inf, np.where(np.isfinite(model.mu), strength, 0.0)[contacts])
    return EdgeRates(model.stiffness * rates.un[contacts], shear[contacts], strength)
