"""Paths by the smallest and by the full model: their cost and largest difference."""

from __future__ import annotations

from dataclasses import dataclass
from time import process_time
from typing import Any

import numpy as np

from loops import LinearFrictional
from loops.closures import Closure, Spins
from patterns import regular_polygon
from stability import Path, Stage, follow, programmes

LAW = LinearFrictional(kn=1.0, kt=0.8, mu=float(np.tan(np.radians(20.0))))
STAGES = (
    Stage(programmes.isotropic_strain(), "H11", 0.1),
    Stage(programmes.drained_biaxial(), "H11", 0.25),
)
STATES = (
    "parameter", "H", "P", "x", "normal_force", "shear_force", "A", "H_rate", "P_rate", "work"
)  # fmt: skip


@dataclass(frozen=True)
class Family:
    """Regular polygons, a corner on axis 1, confined to 10 % and loaded to 25 %."""

    closure: Closure
    spins: Spins
    orders: tuple[int, ...]

    @property
    def name(self) -> str:
        """Closure and spins in words."""
        return f"{self.closure}, spins {self.spins}"


FAMILIES = (
    Family("affine", "blocked", (4, 6, 8, 12, 20, 40, 100)),
    Family("traction", "blocked", (4, 6, 8, 12, 20, 40, 100)),
    Family("traction", "affine", (4, 6, 8, 12, 20, 40, 100)),
    Family("traction", "free", (4, 6, 8, 12, 20, 40)),
)


def smallest_model_rows() -> list[dict[str, Any]]:
    """One row for each family and order."""
    return [compared(family, order) for family in FAMILIES for order in family.orders]


def compared(family: Family, order: int) -> dict[str, Any]:
    """Cost of one loop by both models, and their largest difference."""
    small, seconds_small = _timed(family, order, "auto")
    full, seconds_full = _timed(family, order, "full")
    unknowns, of_all = small.model.unknowns.split(" of ")
    return {
        "scene": family.name,
        "order": order,
        "symmetry": small.model.symmetry,
        "freedoms": small.model.freedoms,
        "seconds_auto": seconds_small,
        "seconds_full": seconds_full,
        "saved": seconds_full / seconds_small,
        "unknowns_auto": int(unknowns),
        "unknowns_full": int(of_all),
        "solves_auto": small.model.branch_solves,
        "solves_full": full.model.branch_solves,
        "difference": largest_difference(small, full),
        "status": small.status,
    }


def largest_difference(small: Path, full: Path) -> float:
    """Largest difference of two paths at their events and ends, over the size of each quantity.

    States, tangents and rates; sizes below 1 count as 1. The steps between are each path's own.
    """
    told = [[(each.kind, each.contacts) for each in path.events] for path in (small, full)]
    if told[0] != told[1] or small.status != full.status:
        return float("inf")
    at = [[*(event.index for event in path.events), -1] for path in (small, full)]
    apart = 0.0
    for name in STATES:
        a, b = getattr(small, name)[at[0]], getattr(full, name)[at[1]]
        if not np.array_equal(np.isnan(a), np.isnan(b)):
            return float("inf")
        size = max(1.0, float(np.nanmax(np.abs(b), initial=0.0)))
        apart = max(apart, float(np.nanmax(np.abs(a - b), initial=0.0)) / size)
    return apart


def _timed(family: Family, order: int, model: Any) -> tuple[Path, float]:
    how: Any = {"closure": family.closure, "spins": family.spins, "model": model}
    start = process_time()
    path = follow(regular_polygon(order), LAW, STAGES, **how)
    return path, process_time() - start
