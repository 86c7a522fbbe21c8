"""Sliding by Coulomb's law and by (8c) as printed, side by side (theory note, section 9.1)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from patterns.diamond import DrainedPath, drained_path
from studies.diamond.drained import sliding_states
from studies.diamond.parameters import DiamondParameters, Sliding
from studies.diamond.path import DiamondPath, follow

Floats = NDArray[np.float64]
# Strain after B at which the rules are compared.
AFTER_YIELD = 0.1


def both_rules(parameters: DiamondParameters) -> dict[Sliding, DiamondPath] | None:
    """The path under either rule, opposite grains ignored.

    Parameters
    ----------
    parameters : DiamondParameters
        What was asked.

    Returns
    -------
    dict or None
        Paths by rule; None where nothing slides or both rules are one, as where N grows.
    """
    plain = replace(parameters, contact_on_touch="ignore")
    paths: dict[Sliding, DiamondPath] = {
        "coulomb": follow(replace(plain, sliding="coulomb")),
        "printed": follow(replace(plain, sliding="printed")),
    }
    rises = drained_path(parameters.loop()).direction > 0
    slides = all(path.states.slip.any() for path in paths.values())
    return paths if slides and rises and parameters.loop().mu > 0.0 else None


def shear_ratio(path: DiamondPath) -> Floats:
    """`|T|/(mu N)` along a path: 1 where Coulomb's law holds in sliding contacts.

    Parameters
    ----------
    path : DiamondPath
        Path with friction.

    Returns
    -------
    ndarray (n,)
        NaN where the contacts carry no force.
    """
    limit = path.loop.mu * path.states.N
    return np.divide(
        np.abs(path.states.T), limit, out=np.full_like(limit, np.nan), where=limit > 0.0
    )


def rules_summary(parameters: DiamondParameters) -> dict[str, Any] | None:
    """What the printed rule does to Coulomb's law.

    Parameters
    ----------
    parameters : DiamondParameters
        What was asked.

    Returns
    -------
    dict or None
        `strain_after_yield`; by rule `shear_ratio` and `s1` at that strain after B,
        `shear_ratio_end` and `E1_end`. None as in `both_rules`.
    """
    paths = both_rules(parameters)
    if paths is None:
        return None
    found: dict[str, Any] = {"strain_after_yield": AFTER_YIELD}
    for rule, path in paths.items():
        ratio, s1 = _after_yield(drained_path(path.loop), rule)
        found[rule] = {
            "shear_ratio": ratio,
            "s1": s1,
            "shear_ratio_end": float(shear_ratio(path)[-1]),
            "E1_end": float(path.states.E1[-1]),
        }
    return found


def _after_yield(path: DrainedPath, rule: Sliding) -> tuple[float | None, float | None]:
    """Shear ratio and axial stress at the compared strain; None beyond E1 = 1."""
    goal, at_B = float(path.end.E1) + AFTER_YIELD, float(path.end.turn)

    def excess(turn: float) -> float:
        return float(sliding_states(path, rule, np.array([turn])).E1[0]) - goal

    latest = 0.5 * np.pi - path.parameters.alpha0 - 1e-9
    if excess(latest) <= 0.0:
        return None, None
    turn = brentq(excess, at_B, latest, xtol=1e-15)
    states = sliding_states(path, rule, np.array([turn]))
    ratio = abs(states.T[0]) / (path.parameters.mu * states.N[0])
    return float(ratio), float(states.s1[0])
