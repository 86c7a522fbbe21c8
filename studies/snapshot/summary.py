"""The numbers that a snapshot comes down to."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import Faces, branch_vectors, euler_check, outline_area
from loops.arrays import Floats, Integers
from loops.fabric import direction_tensors, edge_tensors, mean_tensor
from patterns import Snapshot
from studies.columns import definitions
from studies.snapshot.in_packing import packing_summary
from studies.snapshot.mechanics import mechanics_summary
from studies.snapshot.statistics import (
    GROUPS,
    Groups,
    axes_block,
    group_rows,
    spread,
    spread_by_group,
    tensor_block,
)


def snapshot_summary(
    snapshot: Snapshot,
    faces: Faces,
    table: dict[str, NDArray[Any]],
    in_packing: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Counts, Euler check, loop orders, fabric, stress and stability of a snapshot.

    `in_packing` is what `add_in_packing` tells of the loops in place, if they were asked for.
    """
    area, groups = outline_area(snapshot.graph, faces), group_rows(table["order"])
    # Arrays as long as these leave the interpreter free: two threads share the work.
    with ThreadPoolExecutor(2) as pool:
        fabric = pool.submit(_fabric, snapshot, faces, table, groups)
        forces = None
        if snapshot.mechanical:
            forces = pool.submit(mechanics_summary, snapshot, table, groups, area)
        counted = pool.submit(_network, snapshot, faces)
        summary = _orders(table, groups) | counted.result() | fabric.result()
        summary |= {} if forces is None else forces.result()
    parts = ["snapshot", *(["snapshot_forces"] if snapshot.mechanical else [])]
    if in_packing is not None:
        summary |= packing_summary(table, groups, in_packing)
        parts.append("snapshot_in_packing")
    return {
        **summary,
        "area": area,
        "area_sum": float(table["area"].sum()),
        "notes": list(snapshot.notes),
        "definitions": definitions(*parts),
    }


def _network(snapshot: Snapshot, faces: Faces) -> dict[str, Any]:
    """Counts of grains and contacts, Euler's formula, coordination."""
    graph = snapshot.graph
    euler = euler_check(graph, faces)
    degree = np.bincount(graph.contacts.ravel(), minlength=graph.grain_count)
    # Every contact of the pruned network is two half-edges of its faces.
    inner = np.bincount(faces.grains, minlength=graph.grain_count)
    z = 2 * euler.edges / euler.vertices if euler.vertices else 0.0
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
        "contacts_per_grain": spread(inner[inner > 0]),
        "mean_order_from_coordination": 2 * z / (z - 2) if z > 2 else None,
    }


def _orders(table: dict[str, NDArray[Any]], groups: Groups) -> dict[str, Any]:
    """Loops by order, in number and in area."""
    order, area = table["order"], table["area"]
    number, by_area = np.bincount(order), np.bincount(order, area)
    orders = np.flatnonzero(number)
    names = list(map(str, orders.tolist()))
    return {
        "loops": len(order),
        "orders": dict(zip(names, number[orders].tolist(), strict=True)),
        "orders_area": dict(zip(names, by_area[orders].tolist(), strict=True)),
        "orders_grouped": {name: _group(area, groups[name]) for name in GROUPS},
        "mean_order": float(order.mean()) if len(order) else None,
        "mean_order_by_area": float(np.average(order, weights=area)) if len(order) else None,
        "order_spread": spread(order),
    }


def _group(area: Floats, rows: Integers | slice) -> dict[str, Any]:
    number, covered = len(area[rows]), float(area[rows].sum())
    return {
        "loops": number,
        "area": covered,
        "share": number / len(area) if len(area) else None,
        "area_share": covered / float(area.sum()) if len(area) else None,
    }


def _fabric(
    snapshot: Snapshot, faces: Faces, table: dict[str, NDArray[Any]], groups: Groups
) -> dict[str, Any]:
    """How contacts and loops are oriented, and how large and long the loops are."""
    area, branches = table["area"], branch_vectors(snapshot.graph)
    of_contacts, shapes = _contact_fabric(branches), edge_tensors(branches, faces)
    return {
        **of_contacts,
        "loop_shape": {
            name: tensor_block(mean_tensor(shapes[rows], area[rows]))
            for name, rows in groups.items()
        },
        "long_axis": axes_block(table["orientation"]),
        "elongation_by_order": spread_by_group(groups, table["elongation"]),
        "loop_area_by_order": spread_by_group(groups, area),
    }


def _contact_fabric(branches: Floats) -> dict[str, Any]:
    """How contacts are oriented, each counted once and by its length."""
    directions = direction_tensors(branches)
    contacts = tensor_block(mean_tensor(directions))
    by_length = mean_tensor(directions, np.hypot(branches[:, 0], branches[:, 1]))
    return {
        "contact_fabric": contacts | {"fourier_amplitude": 2 * contacts["anisotropy"]},
        "contact_fabric_by_length": tensor_block(by_length),
    }
