"""Statistics of a snapshot that need forces: stress, sliding, stability by order of the loops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import Regime, love_weber_stress
from loops.arrays import Flags, Floats, Integers
from loops.fabric import mean_tensor
from patterns import Snapshot, WallContacts
from stability import RTOL
from studies.snapshot.in_packing import PLACE
from studies.snapshot.statistics import (
    Groups,
    axes_block,
    share,
    share_by_group,
    spread,
    spread_by_group,
)
from studies.snapshot.table import EIGENVALUES, FREE

Table = dict[str, Any]
CLOSURES = ("affine", "traction")
# Sine of the angle by which walls of an upright box may lean, and how flat they are.
UPRIGHT = 1e-6
# Whatever judges a loop: both closures with blocked spins, the traction closure with free ones, and
# the packing where it was asked.
JUDGES = (*CLOSURES, FREE, PLACE)
STRESSES = ("stress_11", "stress_12", "stress_21", "stress_22")


def judges(table: Mapping[str, Any]) -> list[str]:
    """Those of the judges that a table has."""
    return [judge for judge in JUDGES if f"{judge}_lambda_min" in table]


def unstable_loops(table: Table, closure: str) -> Flags:
    """Loops with an eigenvalue of Ks below zero, beyond the tolerance."""
    unstable: Flags = table[f"{closure}_lambda_min"] < -RTOL
    return unstable


def mechanics_summary(
    snapshot: Snapshot, table: Table, groups: Groups, area: float
) -> dict[str, Any]:
    """Stress, sliding and stability of a snapshot with forces."""
    law, regime = snapshot.mechanics()
    sliding = regime == Regime.SLIDING
    return {
        "stress": love_weber_stress(snapshot.graph, area) if area > 0 else None,
        "stress_loops": _loop_stress(table) / area if area > 0 else None,
        "mean_kn": float(np.mean(law.kn)),
        "normal_force": spread(snapshot.graph.normal_force),
        "sliding_fraction": float(np.mean(sliding)),
        "sliding_contacts": share(sliding),
        "sliding_by_order": spread_by_group(groups, table["sliding_contacts"] / table["order"]),
        "stress_by_order": _stress_by_group(table, groups),
        "untrusted_loops": {
            judge: int(np.count_nonzero(np.isnan(table[f"{judge}_lambda_min"])))
            for judge in judges(table)
        },
        **_stability(table, groups),
        **wall_summary(snapshot, area),
    }


def _loop_stress(table: Table) -> Floats:
    """Sum of stress times area over the loops."""
    sums = [float(np.dot(table[name], table["area"])) for name in STRESSES]
    return np.reshape(sums, (2, 2))


def _stress_by_group(table: Table, groups: Groups) -> dict[str, Any]:
    """Area-weighted pressure, deviator and mean stress tensor of each group of orders."""
    area = table["area"]
    parts: dict[str, Any] = {
        name: spread_by_group(groups, table[name], area) for name in ("pressure", "deviator")
    }
    tensors = np.stack([table[name] for name in STRESSES], axis=1).reshape(-1, 2, 2)
    means = {name: mean_tensor(tensors[rows], area[rows]) for name, rows in groups.items()}
    parts["tensor"] = {
        name: {"mean": found.mean, "std": found.std, "count": found.number}
        for name, found in means.items()
    }
    return parts


def _stability(table: Table, groups: Groups) -> dict[str, Any]:
    """What the tangents tell, by closure and order."""
    order = table["order"]
    keys = ("unstable_loops", "unstable_by_order", "eigenvalues", "mean_unstable_directions")
    found: dict[str, Any] = {
        key: {} for key in (*keys, "unstable_directions", "cone_opening", "soft_loops")
    }
    for judge in judges(table):
        unstable, known = unstable_loops(table, judge), ~np.isnan(table[f"{judge}_lambda_min"])
        found["unstable_loops"][judge] = _mean_by_order(order, unstable, known)
        found["unstable_by_order"][judge] = share_by_group(groups, unstable, known)
        found["eigenvalues"][judge] = {
            name: spread_by_group(groups, table[f"{judge}_{name}"]) for name in EIGENVALUES
        }
    for closure in CLOSURES:
        unstable = unstable_loops(table, closure)
        directions = table[f"{closure}_unstable_fraction"]
        opening = table[f"{closure}_cone_opening"]
        found["mean_unstable_directions"][closure] = _mean_by_order(
            order, directions, ~np.isnan(directions)
        )
        found["unstable_directions"][closure] = spread_by_group(groups, directions)
        # Where there is no cone there is no opening: stable loops don't count as zero.
        found["cone_opening"][closure] = spread_by_group(
            groups, np.where(opening > 0, opening, np.nan)
        )
        found["soft_loops"][closure] = {
            "long_axis": axes_block(table["orientation"][unstable]),
            "soft_angle": axes_block(table[f"{closure}_soft_angle"][unstable]),
        }
    return found


def _mean_by_order(order: Integers, values: NDArray[Any], known: Flags) -> dict[str, float]:
    """Mean for each order, of what is known."""
    number = np.bincount(order, known)
    total = np.bincount(order, np.where(known, values, 0.0))
    orders = np.flatnonzero(np.bincount(order))
    with np.errstate(invalid="ignore"):
        means = total[orders] / number[orders]
    return dict(zip(map(str, orders.tolist()), means.tolist(), strict=True))


def wall_summary(snapshot: Snapshot, outline: float) -> dict[str, Any]:
    """Stress that the contacts with walls carry, and their share of the whole.

    With walls the sample reaches to them: its area is that of the box if all walls are upright,
    and the polygon around the network otherwise. The share does not depend on that area.
    """
    walls = snapshot.walls
    if walls is None or not snapshot.mechanical or len(walls.grain) == 0:
        return {}
    box = None if snapshot.graph.cell is not None else box_area(snapshot.graph.x, walls)
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


def box_area(x: Floats, walls: WallContacts) -> float | None:
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
