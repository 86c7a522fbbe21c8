"""Summaries of one snapshot and of one interval of a series, each a row of `evolution`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from loops import InputError, Regime, euler_check, love_weber_stress, outline_area
from loops.arrays import Floats
from loops.loop_strain import best_fit_strain
from loops.tracking import Fate, LoopFates
from patterns import Snapshot
from stability import COMPONENTS, RTOL
from stability.packing.probe import probe_edge
from studies.series.increments import PREDICTIONS
from studies.snapshot.in_packing import sample_edge
from studies.snapshot.statistics import LAST_ORDER
from studies.snapshot.summary import judges

CONE = ("probe_cone_begin_deg", "probe_cone_end_deg")
PROBE = ("probe_w2", "probe_theta_deg", "probe_unstable_fraction", *CONE, "probe_undetermined")


def evolution_row(state: Snapshot, table: Mapping[str, Any]) -> dict[str, Any]:
    """Sum up one snapshot of a series; unknown values are None.

    Orders from 8 on count as 8. With forces also the Love-Weber stress `S11..S22` over the area,
    and the shares of loops with a negative eigenvalue of Ks, by each judge of the table.
    """
    graph, faces = state.graph, state.faces
    order, loop_area = np.asarray(table["order"]), np.asarray(table["area"])
    euler, area = euler_check(graph, faces), outline_area(graph, faces)
    row: dict[str, Any] = {
        "step": state.step,
        "grains": graph.grain_count,
        "contacts": graph.contact_count,
        "loops": len(faces.loops),
        "area": area,
        "coordination": _ratio(2 * euler.edges, euler.vertices),
        "mean_order": _ratio(float(np.sum(order)), len(order)),
    }
    groups = {n: np.minimum(order, LAST_ORDER) == n for n in range(3, LAST_ORDER + 1)}
    for n, rows in groups.items():
        row[f"share_{n}"] = _ratio(int(np.count_nonzero(rows)), len(order))
    for n, rows in groups.items():
        row[f"area_share_{n}"] = _ratio(float(loop_area[rows].sum()), float(loop_area.sum()))
    if state.regime is None:
        return row
    stress = love_weber_stress(graph, area).ravel().tolist() if area > 0 else [None] * 4
    row |= {f"S{ij}": value for ij, value in zip(COMPONENTS, stress, strict=True)}
    sliding = int(np.count_nonzero(state.regime == Regime.SLIDING))
    row["sliding_fraction"] = _ratio(sliding, graph.contact_count)
    for judge in judges(table):
        smallest = np.asarray(table[f"{judge}_lambda_min"])
        known = smallest[np.isfinite(smallest)]
        row[f"{judge}_unstable"] = _ratio(int(np.count_nonzero(known < -RTOL)), len(known))
    return row


def probe_row(
    state: Snapshot, directions: int, yield_band: float
) -> tuple[dict[str, Any], list[str]]:
    """Columns of the probes of one snapshot (None if unknown) and notes."""
    row: dict[str, Any] = dict.fromkeys(PROBE)
    try:
        edge = sample_edge(state, yield_band)
    except InputError as error:
        return row, [f"not probed: {error}"]
    found = probe_edge(edge, directions, faces=state.faces)
    row["probe_undetermined"] = int(np.count_nonzero(~found.determined))
    if found.softest is not None:
        row["probe_w2"] = float(found.normalised[found.softest])
        row["probe_theta_deg"] = float(np.degrees(found.theta[found.softest]))
        row["probe_unstable_fraction"] = found.unstable_fraction
    if len(found.cones):
        widest = np.degrees(found.cones[np.argmax(np.ptp(found.cones, axis=1))])
        row |= dict(zip(CONE, widest.tolist(), strict=True))
    return row, []


def interval_row(
    before: Snapshot, after: Snapshot, fates: LoopFates, table: Mapping[str, Any]
) -> dict[str, Any]:
    """Sum up one interval: strain, opened and closed contacts, number of loops by fate.

    With forces also the number of survived loops of negative corotated work and, for every
    prediction, numbers of loops by the sign of the actual and of the predicted work.
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
        actual = np.asarray(table["W2"])
        row["negative_W2"] = int(np.count_nonzero(actual < 0))
        for name in PREDICTIONS:
            predicted = np.asarray(table[name])
            known = np.isfinite(predicted) & (actual != 0)
            for a, own in (("negative", actual < 0), ("positive", actual >= 0)):
                for p, told in (("negative", predicted < 0), ("positive", predicted >= 0)):
                    row[f"{name}_{a}_{p}"] = int(np.count_nonzero(known & own & told))
    return row


def sample_strain(
    before: Snapshot, after: Snapshot
) -> tuple[Floats, Literal["cell", "grains", "unknown"]]:
    """Displacement gradient of the sample between two snapshots, and its source.

    The source is the periodic cell, else the best fit to the motion of the grains in both.
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


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None
