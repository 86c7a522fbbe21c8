"""The numbers of a series: one row a snapshot, one row an interval, and the two put together.

How the pieces of a series chain: `evolution_row` sums a snapshot up. For two neighbours
`track_loops` says what became of every loop, `increments` what the survived ones went through,
`interval_row` sums both up and `exchange_counts` counts orders. Snapshots and intervals are
independent tasks; `evolution_table` joins their rows, adding up the strain, and `draw_series` and
`animate_series` draw the result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from loops import Regime, euler_check, love_weber_stress, outline_area
from loops.arrays import Floats, Integers
from loops.loop_strain import best_fit_strain, rotation_and_stretch
from loops.tracking import Fate, LoopFates
from patterns import Snapshot
from stability import COMPONENTS, RTOL
from studies.series.increments import PREDICTIONS
from studies.snapshot.statistics import LAST_ORDER
from studies.snapshot.summary import judges


def evolution_row(state: Snapshot, table: Mapping[str, Any]) -> dict[str, Any]:
    """Sum up one snapshot of a series; None where there is no such number.

    Orders from 8 on count as 8. With forces also the Love-Weber stress `S11..S22` over the area,
    and the shares of loops with a negative eigenvalue of Ks, by each judge of the table.
    """
    graph = state.graph
    euler, area = euler_check(graph, state.faces), outline_area(graph, state.faces)
    row: dict[str, Any] = {
        "step": state.step,
        "grains": graph.grain_count,
        "contacts": graph.contact_count,
        "loops": len(state.faces.loops),
        "area": area,
        "coordination": _ratio(2 * euler.edges, euler.vertices),
        "mean_order": _ratio(float(np.sum(table["order"])), len(table["order"])),
        **_shares(np.asarray(table["order"]), np.asarray(table["area"])),
    }
    if state.regime is None:
        return row
    stress = love_weber_stress(graph, area).ravel().tolist() if area > 0 else [None] * 4
    row |= {f"S{ij}": value for ij, value in zip(COMPONENTS, stress, strict=True)}
    sliding = int(np.count_nonzero(state.regime == Regime.SLIDING))
    row["sliding_fraction"] = _ratio(sliding, graph.contact_count)
    for judge in judges(table):
        smallest = np.asarray(table[f"{judge}_lambda_min"])
        known = smallest[np.isfinite(smallest)]
        unstable = int(np.count_nonzero(known < -RTOL))
        row[f"{judge}_unstable"] = _ratio(unstable, len(known))
    return row


def interval_row(
    before: Snapshot, after: Snapshot, fates: LoopFates, table: Mapping[str, Any]
) -> dict[str, Any]:
    """Sum up what happened between two snapshots: strain, contacts, loops by fate.

    With forces also the survived loops of negative corotated work, and for every prediction loops
    by the sign of the actual, then of the predicted work.
    """
    H, source = sample_strain(before, after)
    row: dict[str, Any] = dict(
        zip((f"dH{ij}" for ij in COMPONENTS), H.ravel().tolist(), strict=True)
    )
    row |= {"strain_from": source, "opened": fates.contacts.opened, "closed": fates.contacts.closed}
    for fate in Fate:
        loops = fates.after if fate == Fate.BORN else fates.before
        row[fate.name.lower()] = int(np.count_nonzero(loops == fate))
    if "W2" in table:
        row["negative_W2"] = int(np.count_nonzero(table["W2"] < 0))
        for name in PREDICTIONS:
            row |= _signs(name, np.asarray(table["W2"]), np.asarray(table[name]))
    return row


def sample_strain(
    before: Snapshot, after: Snapshot
) -> tuple[Floats, Literal["cell", "grains", "unknown"]]:
    """Displacement gradient of the sample between two snapshots, and where it is known from.

    From the periodic cell, else the best fit to the motion of the grains that both have.
    """
    one, two = before.graph, after.graph
    if one.cell is not None and two.cell is not None:
        return cell_strain(one.cell, two.cell), "cell"
    _, here, there = np.intersect1d(before.ids, after.ids, assume_unique=True, return_indices=True)
    if len(here) < 3:
        return np.full((2, 2), np.nan), "unknown"
    return best_fit_strain(one.x[here], two.x[there]), "grains"


def cell_strain(before: Floats, after: Floats) -> Floats:
    """Displacement gradient between two cells, by the lattice vectors nearest to the earlier ones.

    A code may flip a tilted cell.
    """
    lattice = np.rint(np.linalg.solve(after, before))
    return np.asarray(np.eye(2) - after @ lattice @ np.linalg.inv(before))


def evolution_table(
    rows: Sequence[Mapping[str, Any]], intervals: Sequence[Mapping[str, Any]]
) -> dict[str, list[Any]]:
    """Join the rows of a series to one table, one row a snapshot.

    Adds `H11..H22`, the displacement gradient since the first snapshot (`F = F_n ... F_1`),
    `shear_strain`, the sum of `(e1 - e2)/2` of the intervals' stretches, and the interval that led
    to each snapshot.
    """
    joined = [dict(row) for row in rows]
    F, shear = np.eye(2), 0.0
    for k, row in enumerate(joined):
        interval: Mapping[str, Any] = intervals[k - 1] if k else {}
        if interval:
            H = np.array([_number(interval[f"dH{ij}"]) for ij in COMPONENTS]).reshape(2, 2)
            F = (np.eye(2) - H) @ F
            shear += _shear(H)
        total = (np.eye(2) - F).ravel().tolist()
        row |= {f"H{ij}": value for ij, value in zip(COMPONENTS, total, strict=True)}
        row["shear_strain"] = float(shear)
        row |= interval
    names = dict.fromkeys(name for row in joined for name in row)
    return {name: [row.get(name) for row in joined] for name in names}


def _shear(H: Floats) -> float:
    """Half the difference of the principal stretches."""
    _, e = rotation_and_stretch(H)
    return float(np.hypot(0.5 * (e[0, 0] - e[1, 1]), e[0, 1]))


def _number(value: float | None) -> float:
    # JSON has no number for what is unknown.
    return np.nan if value is None else value


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def _shares(order: Integers, area: Floats) -> dict[str, float | None]:
    pooled = np.minimum(order, LAST_ORDER)
    row: dict[str, float | None] = {}
    for n in range(3, LAST_ORDER + 1):
        row[f"share_{n}"] = _ratio(int(np.count_nonzero(pooled == n)), len(order))
    for n in range(3, LAST_ORDER + 1):
        row[f"area_share_{n}"] = _ratio(float(area[pooled == n].sum()), float(area.sum()))
    return row


def _signs(name: str, actual: Floats, predicted: Floats) -> dict[str, int]:
    """Loops by the signs of actual and predicted work; without either a loop is left out."""
    known = np.isfinite(predicted) & (actual != 0)
    a, p = actual < 0, predicted < 0
    return {
        f"{name}_negative_negative": int(np.count_nonzero(known & a & p)),
        f"{name}_negative_positive": int(np.count_nonzero(known & a & ~p)),
        f"{name}_positive_negative": int(np.count_nonzero(known & ~a & p)),
        f"{name}_positive_positive": int(np.count_nonzero(known & ~a & ~p)),
    }
