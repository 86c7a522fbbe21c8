"""The boundary's share of the stress: contacts with walls, and loops cut off at the outline."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import love_weber_stress
from patterns import Snapshot, WallContacts
from studies.snapshot.statistics import spread

Floats = NDArray[np.float64]
# Sine of the angle by which walls of an upright box may lean, and how flat they are.
UPRIGHT = 1e-6


def wall_summary(snapshot: Snapshot, outline: float) -> dict[str, Any]:
    """Stress that the contacts with walls carry, and their share of the whole.

    With walls the sample reaches to them: its area is that of the box if all walls are upright,
    and the polygon around the network otherwise. The share does not depend on that area.

    Parameters
    ----------
    snapshot : Snapshot
        Grains, contacts and walls.
    outline : float
        Area of the cell or of the polygons around the network (length squared).

    Returns
    -------
    dict
        `stress_walls`, `stress_total`, `boundary_area`, `boundary_area_is`, `boundary_share`,
        `wall_force`; nothing if the forces of the walls are not known.
    """
    walls = snapshot.walls
    if walls is None or not snapshot.mechanical or len(walls.grain) == 0:
        return {}
    box = None if snapshot.graph.cell is not None else _box_area(snapshot.graph.x, walls)
    area = outline if box is None else box
    if not area > 0:
        return {}
    at_walls = walls.force.T @ walls.branch / area
    total = at_walls + love_weber_stress(snapshot.graph, area)
    kind = "cell" if snapshot.graph.cell is not None else "outline of the network"
    return {
        "stress_walls": at_walls,
        "stress_total": total,
        "boundary_area": area,
        "boundary_area_is": kind if box is None else "box within the walls",
        "boundary_share": float(np.trace(at_walls) / np.trace(total)),
        "wall_force": spread(np.hypot(*walls.force.T)),
    }


def _box_area(x: Floats, walls: WallContacts) -> float | None:
    """Area within upright walls, all four of them touched; None for anything else."""
    feet = x[walls.grain] - walls.branch
    length = np.hypot(*walls.branch.T)
    across = np.abs(walls.branch) > UPRIGHT * length[:, None]
    if across.all(axis=1).any():
        return None
    sides = []
    for axis in (0, 1):
        own = across[:, axis]
        low = own & (walls.branch[:, axis] > 0)
        high = own & (walls.branch[:, axis] < 0)
        if not (low.any() and high.any()):
            return None
        side = float(feet[high, axis].mean() - feet[low, axis].mean())
        if max(np.ptp(feet[low, axis]), np.ptp(feet[high, axis])) > UPRIGHT * side:
            return None
        sides.append(side)
    return sides[0] * sides[1]
