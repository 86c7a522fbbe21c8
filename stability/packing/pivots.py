"""Regimes of contacts at yield that agree with the rates, one contact after the other."""

from __future__ import annotations

from typing import Any

import numpy as np

from loops.arrays import Floats, Integers
from stability.packing.controls import MixedControl
from stability.packing.regime_factor import ELASTIC, SLIDING, Combination, RegimeFactor
from stability.regimes import SlipProblem, agreeing

# Grains that move by more than this share of the largest displacement are in an unstable mode.
MODE_SHARE = 0.1
# Changes of regime within one pivot.
PIVOT_STEPS = 40


def unstable_mode(motion: Floats, turns: bool) -> dict[str, Any]:
    """Facts of a motion that nothing stops, as `Event` has them: its grains, and what det K does.

    `turns` tells whether det K changes sign.
    """
    square = np.sum(motion.reshape(-1, 3)[:, :2] ** 2, axis=1)
    size = np.linalg.norm(motion.reshape(-1, 3), axis=1)
    return {
        "taking_part": float(square.sum() ** 2 / max(float(np.sum(square**2)), 1e-300)),
        "sign_changes": turns,
        "grains": tuple(np.flatnonzero(size > MODE_SHARE * size.max()).tolist()),
    }


def pivot(
    packing: RegimeFactor,
    control: MixedControl,
    c: int,
    critical: Integers,
    rounding: float,
) -> tuple[list[int] | None, dict[str, Any]]:
    """Bring one contact at yield to agree with its rates; all pairs that changed regime.

    The method of Cottle and Dantzig: the slip rate of the contact (or the distance of its rates
    from the cone) is raised from zero until it agrees with its regime, and others change regime
    where they would disagree. `critical` are the pairs at yield that agree, or have an event to
    come. Where that meets no end regimes are as before: None, and the facts of `unstable_mode`.
    """
    others = critical[critical != c]
    every = np.append(others, c)
    changed: list[int] = []
    column = packing.column(len(packing.frame) + c)
    raised, base = 0.0, packing.solve(control)
    for _ in range(PIVOT_STEPS):
        (unit,) = packing.driven(control, [column])
        # A force -s on the shear row is one unit of slip, or of the distance from the cone.
        push = -packing.side[c]
        value, along = packing.edge((base, unit), every).T
        sticks = np.where(packing.regime[every] == ELASTIC, 1.0, -1.0)
        value, along = sticks * value, push * sticks * along
        along[-1] += 1.0
        now = value + raised * along
        if now[-1] >= -rounding:
            packing.flip(c)
            return [*changed, c], {}
        own = raised - now[-1] / along[-1] if along[-1] > 1e-12 else np.inf
        falls = (along[:-1] < -1e-12) & (now[:-1] > -rounding)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(falls, raised + np.maximum(now[:-1], 0.0) / -along[:-1], np.inf)
        if changed:
            reach[others == changed[-1]] = np.inf
        k = int(np.argmin(reach)) if len(reach) else -1
        if k >= 0 and reach[k] < own:
            raised = float(reach[k])
            packing.flip(int(others[k]))
            base = packing.solve(control)
            changed.append(int(others[k]))
        elif np.isfinite(own):
            packing.flip(c)
            return [*changed, c], {}
        else:
            break
    for other in changed:
        packing.flip(other)
    turns = packing.sign(control)
    packing.flip(c)
    turns *= packing.sign(control)
    packing.flip(c)
    return None, unstable_mode(packing.motion(unit), bool(turns < 0))


def seek(
    packing: RegimeFactor, control: MixedControl, contacts: Integers, rounding: float
) -> tuple[list[int] | None, str]:
    """Seek regimes of all contacts at yield that agree, where a pivot meets no end.

    All that changed regime, or None and the cause: a proof that there are none, or not.
    """
    found = agreeing(SlipProblem(*packing.problem(control, contacts), low=rounding))
    if not found.solutions:
        return None, "no_regimes" if found.proof else "none_found"
    active = found.taken.rates
    changed = contacts[active != (packing.regime[contacts] == SLIDING)].tolist()
    packing.set_regimes(contacts, np.where(active, SLIDING, ELASTIC))
    return changed, ""


def disagreeing(
    packing: RegimeFactor, rates: Combination, critical: Integers, rounding: float
) -> Integers:
    """Pairs at yield whose regime disagrees with their rates, the worst first."""
    sticks = np.where(packing.regime[critical] == ELASTIC, 1.0, -1.0)
    value = sticks * packing.edge((rates,), critical)[:, 0]
    wrong = np.flatnonzero(value < -rounding)
    return critical[wrong[np.argsort(value[wrong])]]
