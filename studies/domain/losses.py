"""First losses of `det Ks` and `det K` along straight strain programmes, exact.

Sticking contacts have `det K = kappa - N/l` (35) and `det Ks = det K - (T/2l)^2`, because
`K12 - K21 = -T/l`: in terms of the branch alone, the same for every `alpha0`. With
`T = s mu N` they slide, and `det K = -(1 + mu^2) N/l` (36) is negative at once: where a programme
yields before, both determinants are lost in a jump.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from loops import InputError
from loops.arrays import Floats
from patterns.diamond import TABLE_1, TABLE_2
from patterns.diamond.strain_lines import (
    StrainLine,
    bisect,
    sticking_shear,
    strain_line,
    yield_position,
)

# Points of a programme among which the first change of sign of det Ks is bracketed.
POINTS = 256


class Case(NamedTuple):
    """One diamond: reference angle and friction angle in radians, stiffness ratio."""

    alpha0: float
    kappa: float
    phi: float

    @property
    def mu(self) -> float:
        """Coefficient of friction; infinite where nothing slides."""
        return float(np.tan(self.phi)) if self.phi < 0.5 * np.pi else float("inf")

    def described(self) -> dict[str, float]:
        """Columns of the table and the summary that name the diamond, angles in degrees."""
        alpha0, phi = (round(float(np.degrees(angle)), 12) for angle in (self.alpha0, self.phi))
        return {"alpha0_deg": alpha0, "kappa": self.kappa, "phi_deg": phi}


def rows_of(table: pd.DataFrame, case: Case) -> pd.DataFrame:
    """The rows of one diamond."""
    named = case.described()
    return table[(table[list(named)] == list(named.values())).all(axis=1)]


TABLES = tuple(Case(table.alpha0, table.kappa, table.phi) for table in (TABLE_1, TABLE_2))


@dataclass(frozen=True)
class DomainParameters:
    """Options of `grainloops domain`; angles in degrees."""

    alpha0_deg: tuple[float, ...] | None = None
    kappa: tuple[float, ...] | None = None
    phi_deg: float | None = None
    directions: int = 1441

    def __post_init__(self) -> None:
        _each("--alpha0", self.alpha0_deg, lambda a: 0.0 < a < 90.0, "degrees in (0, 90)")
        _each("--kappa", self.kappa, lambda k: 0.0 < k < np.inf, "positive ratios")
        phi = None if self.phi_deg is None else (self.phi_deg,)
        _each("--phi", phi, lambda p: 0.0 < p <= 90.0, "degrees in (0, 90]")
        if self.directions < 3 or self.directions % 2 == 0:
            raise InputError(
                "--directions", str(self.directions), "an odd number from 3 on", "Correct it."
            )

    def cases(self) -> tuple[Case, ...]:
        """The diamonds, in radians."""
        if self.alpha0_deg is None and self.kappa is None and self.phi_deg is None:
            return TABLES
        angles = (TABLE_1.alpha0,) if self.alpha0_deg is None else np.radians(self.alpha0_deg)
        ratios = (TABLE_1.kappa,) if self.kappa is None else self.kappa
        phi = TABLE_1.phi if self.phi_deg is None else float(np.radians(self.phi_deg))
        return tuple(Case(float(a), k, phi) for a, k in product(angles, ratios))

    def described(self) -> dict[str, Any]:
        """Value of every option by its name on the command line."""
        cases = [case.described() for case in self.cases()]
        return {"cases": cases, "directions": self.directions}


def _each(
    name: str, values: tuple[float, ...] | None, holds: Callable[[float], bool], expected: str
) -> None:
    if values is None:
        return
    wrong = [f"{value:.17g}" for value in values if not holds(value)]
    if wrong or not values:
        received = ", ".join(wrong) or "an empty list"
        raise InputError(name, received, expected, f"Correct {name}.")


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
    """Programmes that compress the virgin loop, evenly spread about the isotropic one.

    Evenly by the angle between the line and the branch, in half diagonals: the forces along them
    are then those of every other `alpha0`.
    """
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
