"""Contacts at the edge of their law on a path: their options and the rate problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from loops.laws.protocol import Regime
from stability.paths.model import PathModel
from stability.paths.rates import UNIT_PARAMETER, Gauge, Rates, state_rates
from stability.paths.state import (
    Mode,
    PathState,
    contacts_of,
    overlaps,
    relative_displacements,
)
from stability.programmes import Programme
from stability.rate_problem import (
    ELASTIC,
    LEFT,
    OPEN,
    RIGHT,
    Choice,
    EdgeRates,
    RateProblem,
    solve_rate_problem,
)

Floats = NDArray[np.float64]

# A contact within this fraction of mu N of yield, or of r_i + r_j of touching, is at the edge.
YIELD_BAND = 1e-10
TOUCH_BAND = 1e-13


@dataclass(frozen=True, eq=False)
class EdgeTrial:
    """Rates of the whole model for one combination of regimes, see `rate_problem.Trial`."""

    mode: Mode
    rates: Rates
    edge: EdgeRates
    vector: Floats
    trusted: bool


def edge_contacts(model: PathModel, state: PathState, mode: Mode) -> dict[int, tuple[Choice, ...]]:
    """Contacts with more than one possible regime, and their options.

    Parameters
    ----------
    model, state, mode
        Where the path is and what its contacts did so far.

    Returns
    -------
    dict
        Options by contact. Frictionless closed contacts slide and are no question.
    """
    contacts = contacts_of(model, state, mode)
    moved = relative_displacements(model, state.place)
    overlap = overlaps(model, moved) / model.touching
    normal, shear = contacts.normal_force, contacts.shear_force
    options: dict[int, tuple[Choice, ...]] = {}
    for c in range(model.contact_count):
        mu = float(model.mu[c])
        if abs(overlap[c]) <= TOUCH_BAND:
            options[c] = _touching(mu)
        elif mode.regime[c] != Regime.OPEN and 0 < mu < np.inf:
            if abs(shear[c]) >= mu * normal[c] * (1 - YIELD_BAND):
                options[c] = (ELASTIC, LEFT if shear[c] > 0 else RIGHT)
    return options


def edge_problem(
    model: PathModel,
    state: PathState,
    mode: Mode,
    programme: Programme,
    *,
    preferred: dict[int, Choice],
    direction: Floats | None,
    gauge: Gauge = UNIT_PARAMETER,
) -> RateProblem[EdgeTrial]:
    """Rate problem of one state under a unit rate of the loading parameter.

    Parameters
    ----------
    model, state, mode
        Where the path is and what its contacts did so far.
    programme : Programme
        Control.
    preferred : dict
        Choices that break ties; a contact that is not named keeps its regime.
    direction : (8 + 2 C,) array or None
        Rates before, as `rate_vector`.
    gauge : Gauge
        `UNIT_PARAMETER`, or `RECEDING` for a falling loading parameter.

    Returns
    -------
    RateProblem
    """
    options = edge_contacts(model, state, mode)
    at_edge = np.array(list(options), dtype=np.int64)

    def rates_for(choices: tuple[Choice, ...]) -> EdgeTrial:
        chosen = _apply(mode, at_edge, choices)
        rates = state_rates(model, state, chosen, programme, gauge)
        edge = _edge_rates(model, rates, at_edge)
        return EdgeTrial(chosen, rates, edge, rate_vector(model, rates), rates.trusted)

    first = [preferred.get(int(c), _current(mode, int(c))) for c in at_edge]
    first = [
        choice if choice in options[int(c)] else options[int(c)][0]
        for c, choice in zip(at_edge, first, strict=True)
    ]
    return solve_rate_problem(
        list(options.values()), rates_for, preferred=first, direction=direction
    )


def rate_vector(model: PathModel, rates: Rates) -> Floats:
    """(8 + 2 C,) `H'`, `P'`, `N'` and `T'` in comparable units: what tells solutions apart."""
    force = model.stiffness * model.length
    forces = np.concatenate([rates.normal_force, rates.shear_force]) / force
    return np.concatenate([rates.H, rates.P / model.stiffness, forces])


def _touching(mu: float) -> tuple[Choice, ...]:
    if mu == np.inf:
        return (ELASTIC, OPEN)
    return (LEFT, OPEN) if mu == 0 else (ELASTIC, OPEN, LEFT, RIGHT)


def _apply(mode: Mode, contacts: NDArray[np.int64], choices: Sequence[Choice]) -> Mode:
    regime, side = mode.regime.copy(), mode.side.copy()
    regime[contacts] = [choice.regime for choice in choices]
    side[contacts] = [choice.side for choice in choices]
    return Mode(regime, side)


def _current(mode: Mode, c: int) -> Choice:
    regime = Regime(int(mode.regime[c]))
    return Choice(regime, float(mode.side[c]) if regime == Regime.SLIDING else 0.0)


def _edge_rates(model: PathModel, rates: Rates, contacts: NDArray[np.int64]) -> EdgeRates:
    un = model.kn[contacts] * rates.un[contacts]
    shear = -model.kt[contacts] * rates.ut[contacts]
    return EdgeRates(un, shear, -model.friction[contacts] * un)
