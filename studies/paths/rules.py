"""Sliding by Coulomb's law and by (8c) as printed, side by side, on the exact drained path."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
from scipy.optimize import brentq

from loops.arrays import Floats
from patterns.diamond import (
    DrainedPath,
    DrainedState,
    drained_path,
    drained_states_after_turn,
    printed_states_after_turn,
)
from studies.paths.options import DiamondOptions, Sliding, last_strain

# Strain after B at which the rules are compared; rows of a curve.
AFTER_YIELD, ROWS = 0.1, 200


def rules_summary(options: DiamondOptions) -> dict[str, Any] | None:
    """What the printed rule does to Coulomb's law, at `strain_after_yield` and at the end.

    None where nothing slides, or both rules are one: where alpha falls N grows.
    """
    exact = drained_path(options.parameters)
    if not differ(exact):
        return None
    found: dict[str, Any] = {"strain_after_yield": AFTER_YIELD}
    for rule in get_args(Sliding):
        turn = _turn_at(exact, rule, float(exact.end.E1) + AFTER_YIELD)
        end = rule_states(exact, rule, _last_turn(options, exact, rule))
        there = None if turn is None else rule_states(exact, rule, np.array([turn]))
        found[rule] = {
            "shear_ratio": None if there is None else float(shear_ratio(exact, there)[0]),
            "s1": None if there is None else float(there.s1[0]),
            "shear_ratio_end": float(shear_ratio(exact, end)[-1]),
            "E1_end": float(end.E1[-1]),
        }
    return found


def rule_curves(options: DiamondOptions) -> dict[str, tuple[Floats, Floats, Floats]] | None:
    """E1, use of friction `|T|/(mu N)` and s1 from A on, by rule; B is row `ROWS`."""
    exact = drained_path(options.parameters)
    if not differ(exact):
        return None
    at_B, curves = float(exact.end.turn), {}
    for rule in get_args(Sliding):
        last = float(_last_turn(options, exact, rule)[0])
        turn = np.concatenate([np.linspace(0.0, at_B, ROWS + 1), np.linspace(at_B, last, ROWS)])
        states = rule_states(exact, rule, turn)
        curves[rule] = states.E1, shear_ratio(exact, states), states.s1
    return curves


def differ(exact: DrainedPath) -> bool:
    """Whether the path slides on beyond B, and under two rules."""
    return (
        exact.status == "yield"
        and exact.direction > 0
        and exact.parameters.mu > 0.0
        and not exact.snaps_back
        and bool(np.isfinite(exact.end.turn))
    )


def rule_states(exact: DrainedPath, rule: str, turn: Floats) -> DrainedState:
    """States after turns of the branch, sliding by one of the rules."""
    if rule == "printed":
        return printed_states_after_turn(exact, turn)
    return drained_states_after_turn(exact, turn)[0]


def shear_ratio(exact: DrainedPath, states: DrainedState) -> Floats:
    """`|T|/(mu N)`: 1 where Coulomb's law holds in sliding contacts."""
    return np.abs(states.T) / (exact.parameters.mu * states.N)


def _last_turn(options: DiamondOptions, exact: DrainedPath, rule: str) -> Floats:
    turn = _turn_at(exact, rule, last_strain(options.parameters, exact))
    return np.array([exact.end.turn if turn is None else turn])


def _turn_at(exact: DrainedPath, rule: str, goal: float) -> float | None:
    """Turn beyond B at which E1 reaches a goal; None if it never does."""

    def excess(turn: float) -> float:
        return float(rule_states(exact, rule, np.array([turn])).E1[0]) - goal

    latest = 0.5 * np.pi - exact.parameters.alpha0 - 1e-9
    if excess(latest) <= 0.0:
        return None
    return float(brentq(excess, float(exact.end.turn), latest, xtol=1e-15))
