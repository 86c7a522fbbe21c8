"""The first losses of stability of diamonds along straight strain programmes, in closed form.

Sticking contacts have `det K = kappa - N/l` (35) and `det Ks = det K - (T/2l)^2`; with
`T = s mu N` they slide, and both are lost in a jump.
"""

from dataclasses import dataclass

import numpy as np

from tests.oracles.diamond import DiamondParameters as Case
from tests.oracles.strain_lines import (
    StrainLine,
    bisect,
    sticking_shear,
    strain_line,
    yield_position,
)

Floats = np.ndarray

# Points of a programme among which the first change of sign of det Ks is bracketed.
POINTS = 256


@dataclass(frozen=True, eq=False)
class Losses:
    """First losses along the programmes of a fan; arrays (n,), NaN where there is none.

    Positions `u` on `line`, of yield too: a loss at yield is a jump. `programme` holds angles in
    (E1, E2), radians; `mu` is infinite where the contacts stick.
    """

    programme: Floats
    line: StrainLine
    mu: float
    det_Ks_zero: Floats
    det_K_zero: Floats
    yields: Floats


def programme_fan(alpha0: float, directions: int) -> tuple[Floats, StrainLine]:
    """Programmes that compress the virgin loop, evenly spread in half diagonals; their lines."""
    spread = 0.5 * np.pi * np.arange(-(directions // 2), directions // 2 + 1)
    turned = alpha0 + spread / (directions // 2 + 1)
    programme = np.arctan2(np.sin(turned) / np.sin(alpha0), np.cos(turned) / np.cos(alpha0))
    return programme, strain_line(alpha0, 0.0, 0.0, programme)


def first_losses(case: Case, directions: int, *, friction: bool) -> Losses:
    """Losses of one diamond along its fan of programmes."""
    programme, line = programme_fan(case.alpha0, directions)
    last = np.minimum(line.opening, line.folding)
    lost_K = _within(sticking_det_K_zero(line, case.kappa), last)
    lost_Ks = sticking_det_Ks_zero(line, case.kappa, lost_K, last)
    mu = case.mu if friction else float("inf")
    yields = _within(yield_position(line, case.kappa, mu), last)
    return Losses(
        programme=programme,
        line=line,
        mu=mu,
        # fmin takes the other where one of the two is NaN.
        det_Ks_zero=np.fmin(lost_Ks, yields),
        det_K_zero=np.fmin(lost_K, yields),
        yields=yields,
    )


def sticking_det_K_zero(line: StrainLine, kappa: float) -> Floats:
    """`u` where `l = 1/(1 + kappa)`, the zero of (35); NaN on lines that never come so close."""
    with np.errstate(invalid="ignore"):
        return -np.sqrt((1.0 + kappa) ** -2 - line.distance**2)


def sticking_det_Ks(line: StrainLine, u: Floats, kappa: float) -> Floats:
    """`det Ks = kappa - N/l - (T/2l)^2` of sticking contacts."""
    length = np.hypot(line.distance, u)
    # The branch vanishes at the limit of a radial line: avoid a division by zero there.
    length = np.maximum(length, np.finfo(float).tiny)
    T = sticking_shear(line, u, kappa)
    return kappa + 1.0 - 1.0 / length - (0.5 * T / length) ** 2


def sticking_det_Ks_zero(line: StrainLine, kappa: float, lost_K: Floats, last: Floats) -> Floats:
    """First `u` where `det Ks = 0`, no later than `lost_K` (Bromwich); NaN if none."""
    high = np.where(np.isnan(lost_K), last, lost_K)
    grid = line.start + np.linspace(0.0, 1.0, POINTS)[:, None] * (high - line.start)
    lost = sticking_det_Ks(line, grid, kappa) < 0.0
    # On a line without shear both vanish together, and rounding may hide the sign.
    lost[-1] |= ~np.isnan(lost_K)
    first, rows = np.argmax(lost, axis=0), np.arange(high.size)
    bracket = grid[np.maximum(first - 1, 0), rows], grid[first, rows]
    root = bisect(lambda u: -sticking_det_Ks(line, u, kappa), *bracket)
    return np.where(lost.any(axis=0), root, np.nan)


def _within(u: Floats, last: Floats) -> Floats:
    with np.errstate(invalid="ignore"):
        return np.where(u <= last, u, np.nan)
