"""What the domain study is asked: diamonds, and how many programmes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from loops import InputError
from patterns.diamond import TABLE_1, TABLE_2


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
        """The diamond as the table and the summary name it, angles in degrees."""
        alpha0, phi = (round(float(np.degrees(angle)), 12) for angle in (self.alpha0, self.phi))
        return {"alpha0_deg": alpha0, "kappa": self.kappa, "phi_deg": phi}


def rows_of(table: pd.DataFrame, case: Case) -> pd.DataFrame:
    """The rows of one diamond."""
    named = case.described()
    return table[(table[list(named)] == list(named.values())).all(axis=1)]


TABLES = tuple(Case(table.alpha0, table.kappa, table.phi) for table in (TABLE_1, TABLE_2))


@dataclass(frozen=True)
class DomainParameters:
    """Arguments of the study. Angles in degrees."""

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
        """Every value in force, under the names of the command line."""
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
