"""Regimes of contacts at yield that agree with their rates, by principal pivots.

After Cottle and Dantzig: the slip rate of a contact (or its way off the cone) is raised from zero
until it agrees with its regime; whoever would disagree on the way changes regime.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from loops.arrays import Floats, Integers
from stability.packing.frozen_packing import ELASTIC, SLIDING, Combination, FrozenPacking

STEPS = 40


class Control(NamedTuple):
    """`stress @ P' + strain @ H' = rate` in the current geometry."""

    stress: Floats
    strain: Floats
    rate: Floats


class UnsolvedError(Exception):
    """A pair found no regimes: the motion that nothing stops, whether det K changes sign."""

    def __init__(self, contact: int, motion: Floats, turns: bool) -> None:
        super().__init__("the rate problem has no solution")
        self.contact, self.motion, self.turns = contact, motion, turns


def flip(pieces: FrozenPacking, c: int) -> None:
    """Stick to slide, on the side that stands in `pieces.side`, and back."""
    sticks = pieces.regime[c] == ELASTIC
    pieces.set_regime(c, SLIDING if sticks else ELASTIC, pieces.side[c])


def pivot(
    pieces: FrozenPacking, control: Control, c: int, critical: Integers, tiny: float
) -> list[int]:
    """Bring one contact at yield to agree; all the pairs that changed regime.

    `critical` are the pairs at yield that agree already, or have a turn of their own to come.
    """
    others = critical[critical != c]
    every = np.append(others, c)
    changed: list[int] = []
    column = pieces.column(len(pieces.frame.rows) + c)
    raised, base = 0.0, pieces.solve(*control)
    for _ in range(STEPS):
        unit = pieces.driven(control.stress, control.strain, column)
        # A force -s on the shear row is one unit of slip, or of the way off the cone.
        push = -pieces.side[c]
        value, along = pieces.edge((base, unit), every).T
        sticks = np.where(pieces.regime[every] == ELASTIC, 1.0, -1.0)
        value, along = sticks * value, push * sticks * along
        along[-1] += 1.0
        now = value + raised * along
        if now[-1] >= -tiny:
            flip(pieces, c)
            return [*changed, c]
        own = raised - now[-1] / along[-1] if along[-1] > 1e-12 else np.inf
        falls = (along[:-1] < -1e-12) & (now[:-1] > -tiny)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(falls, raised + np.maximum(now[:-1], 0.0) / -along[:-1], np.inf)
        if changed:
            reach[others == changed[-1]] = np.inf
        k = int(np.argmin(reach)) if len(reach) else -1
        if k >= 0 and reach[k] < own:
            raised = float(reach[k])
            flip(pieces, int(others[k]))
            base = pieces.solve(*control)
            changed.append(int(others[k]))
        elif np.isfinite(own):
            flip(pieces, c)
            return [*changed, c]
        else:
            break
    for other in changed:
        flip(pieces, other)
    turns = pieces.sign(control.stress, control.strain)
    flip(pieces, c)
    turns *= pieces.sign(control.stress, control.strain)
    flip(pieces, c)
    raise UnsolvedError(c, pieces.motion(unit), turns < 0)


def disagreeing(
    pieces: FrozenPacking, rates: Combination, critical: Integers, tiny: float
) -> Integers:
    """Pairs at yield whose regime disagrees with their rates, the worst first."""
    sticks = np.where(pieces.regime[critical] == ELASTIC, 1.0, -1.0)
    value = sticks * pieces.edge((rates,), critical)[:, 0]
    wrong = np.flatnonzero(value < -tiny)
    return critical[wrong[np.argsort(value[wrong])]]
