"""Paths by the smallest and by the full model: their cost, and how far they lie apart."""

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
class Scene:
    """Regular polygons, a corner on axis 1, confined to 10 % and loaded to 25 %."""

    closure: Closure
    spins: Spins
    orders: tuple[int, ...]

    @property
    def name(self) -> str:
        """Closure and spins in words."""
        return f"{self.closure}, spins {self.spins}"


SCENES = (
    Scene("affine", "blocked", (4, 6, 8, 12, 20, 40, 100)),
    Scene("traction", "blocked", (4, 6, 8, 12, 20, 40, 100)),
    Scene("traction", "affine", (4, 6, 8, 12, 20, 40, 100)),
    Scene("traction", "free", (4, 6, 8, 12, 20, 40)),
)


def rows(scenes: tuple[Scene, ...] = SCENES, repeats: int = 2) -> list[dict[str, Any]]:
    """A row for every loop: see `compared`."""
    return [compared(scene, order, repeats) for scene in scenes for order in scene.orders]


def compared(scene: Scene, order: int, repeats: int = 1) -> dict[str, Any]:
    """One loop by both models."""
    small, seconds_small = _timed(scene, order, "auto", repeats)
    full, seconds_full = _timed(scene, order, "full", repeats)
    unknowns, of_all = small.model.unknowns.split(" of ")
    return {
        "scene": scene.name,
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
    """How far two paths lie apart at their events and ends, over the size of each quantity.

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


def _timed(scene: Scene, order: int, model: Any, repeats: int) -> tuple[Path, float]:
    loop, best = regular_polygon(order), np.inf
    for _ in range(repeats):
        start = process_time()
        path = follow(
            loop, LAW, STAGES, closure=scene.closure, spins=scene.spins, model=model
        )  # fmt: skip
        best = min(best, process_time() - start)
    return path, best
