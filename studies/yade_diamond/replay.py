"""Yade's rule for the shear force, replayed at Yade's own step."""

from __future__ import annotations

import numpy as np

from loops.laws.linear_frictional import ShearIncrement
from patterns.diamond.strain_lines import Floats, StrainLine
from studies.yade_diamond.probes import KAPPA


def replayed_shear(
    line: StrainLine, rise: float, steps: int, mu: float, increment: ShearIncrement
) -> Floats:
    """Shear force by Yade's rule at Yade's step: cut back to Coulomb's cone once a step.

    Each step adds the displacement of a step at the geometry it finds, the first one too: the
    velocity of the probe is set before the grains have moved, one increment too many. The shear
    vector is turned by subtracting its cross product with the turn and then projected, which
    multiplies it by `cos + sin^2` of the turn.

    Parameters
    ----------
    line : StrainLine
        The line.
    rise : float
        What `u` gains in all.
    steps : int
        Number of steps.
    mu : float
        Coefficient of friction; may be infinite.
    increment : {'branch', 'radii'}
        Shear increment.

    Returns
    -------
    T : ndarray (steps + 1,)
        Over `kn l0`.
    """
    u = line.start + rise * np.arange(steps + 1) / steps
    length = np.hypot(line.distance, u)
    # The turn of a radial line is none; 1 stands for its distance.
    angle = line.sense * np.arctan(u / (line.distance if line.sense else 1.0))
    turn = np.diff(angle, prepend=angle[0])
    swept = KAPPA * line.sense * line.distance * rise / steps / length
    added = swept / length if increment == "radii" else swept
    with np.errstate(invalid="ignore"):
        cone = np.where(length < 1.0, mu * (1.0 - length), 0.0)
    T, shear = 0.0, np.empty(steps + 1)
    factor = np.cos(turn) + np.sin(turn) ** 2
    for k, (growth, step, limit) in enumerate(zip(factor, added, cone, strict=True)):
        T = min(max(T * growth + step, -limit), limit)
        shear[k] = T
    return shear
