"""The numbers that a snapshot comes down to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import Faces, Regime, euler_check, love_weber_stress, outline_area
from patterns import Snapshot
from stability import RTOL

DEFINITIONS = {
    "area_sum": "sum of the areas of the loops",
    "coordination": "2 edges / vertices, of the network without dangling grains",
    "coordination_all": "2 contacts / grains, of all grains",
    "dangling_grains": "grains removed because fewer than two contacts are left to them, "
    "those without any contact included",
    "faces": "half-edge cycles of the network, outer ones included",
    "mean_order_from_coordination": "2 z / (z - 2), exact for one cluster that winds around a "
    "periodic cell",
    "mean_unstable_directions": "mean over the loops of an order of the share of directions with "
    "negative second-order work",
    "sliding_fraction": "share of the contacts between grains that slide",
    "stress": "Love-Weber stress of the contacts between grains over `area`: of the periodic cell, "
    "else of the polygons around the network; row = force, column = branch",
    "unstable_fraction": "share of the loops of an order with a negative eigenvalue of Ks beyond "
    "the tolerance, symmetric subspace, spins blocked, contacts flagged sliding as sliding",
}


def snapshot_summary(
    snapshot: Snapshot, faces: Faces, table: dict[str, NDArray[Any]]
) -> dict[str, Any]:
    """Counts, Euler check, loop orders, stress and unstable fractions of a snapshot.

    Parameters
    ----------
    snapshot : Snapshot
        Grains, contacts, law and regimes.
    faces : Faces
        Its faces.
    table : dict of str to array
        From `loop_table`.

    Returns
    -------
    dict
        Plain values by key; see `DEFINITIONS`.
    """
    graph = snapshot.graph
    euler = euler_check(graph, faces)
    order = table["order"]
    area = outline_area(graph, faces)
    z = 2 * euler.edges / euler.vertices if euler.vertices else 0.0
    degree = np.bincount(graph.contacts.ravel(), minlength=graph.grain_count)
    return {
        "grains": graph.grain_count,
        "contacts": graph.contact_count,
        "wall_contacts": snapshot.wall_contacts,
        "rattlers": int(np.count_nonzero(degree == 0)),
        "dangling_grains": graph.grain_count - euler.vertices,
        "components": euler.components,
        "vertices": euler.vertices,
        "edges": euler.edges,
        "faces": euler.faces,
        "euler_ok": euler.ok,
        "coordination": z,
        "coordination_all": 2 * graph.contact_count / graph.grain_count,
        "loops": len(order),
        "orders": {
            str(n): int(k) for n, k in zip(*np.unique(order, return_counts=True), strict=True)
        },
        "mean_order": float(order.mean()) if len(order) else None,
        "mean_order_from_coordination": 2 * z / (z - 2) if z > 2 else None,
        "area": area,
        "area_sum": float(table["area"].sum()),
        "stress": love_weber_stress(graph, area) if area > 0 else None,
        "mean_kn": float(np.mean(snapshot.law.kn)),
        "sliding_fraction": float(np.mean(snapshot.regime == Regime.SLIDING)),
        "unstable_fraction": _by_order(table, _unstable),
        "mean_unstable_directions": _by_order(table, _directions),
        "untrusted_loops": {
            closure: int(np.count_nonzero(np.isnan(table[f"{closure}_lambda_min"])))
            for closure in ("affine", "traction")
        },
        "notes": list(snapshot.notes),
        "definitions": DEFINITIONS,
    }


def _by_order(table: dict[str, NDArray[Any]], measure: Any) -> dict[str, dict[str, float]]:
    return {
        closure: {
            str(n): measure(table, closure, table["order"] == n)
            for n in np.unique(table["order"]).tolist()
        }
        for closure in ("affine", "traction")
    }


def _unstable(table: dict[str, NDArray[Any]], closure: str, rows: NDArray[np.bool_]) -> float:
    """Share of trusted loops below zero; eigenvalues are over the mean kn, so of order one."""
    smallest = table[f"{closure}_lambda_min"][rows]
    known = smallest[~np.isnan(smallest)]
    return float(np.mean(known < -RTOL)) if len(known) else float("nan")


def _directions(table: dict[str, NDArray[Any]], closure: str, rows: NDArray[np.bool_]) -> float:
    share = table[f"{closure}_unstable_fraction"][rows]
    known = share[~np.isnan(share)]
    return float(known.mean()) if len(known) else float("nan")
