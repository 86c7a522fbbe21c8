"""Force chains of a snapshot, and the loops beside them against the others."""

from __future__ import annotations

from typing import Any

import numpy as np

from loops import ForceChains, branch_vectors
from loops.arrays import Floats
from patterns import Snapshot
from studies.snapshot.mechanics import judges, unstable_loops
from studies.snapshot.statistics import GROUPS, group_rows, share

PLACES = ("beside", "elsewhere")


def chains_summary(chains: ForceChains, table: dict[str, Any]) -> dict[str, Any]:
    """Number and length of the chains, and how many loops lie beside them."""
    lengths = np.bincount(chains.chain[chains.chain >= 0])
    return {
        "chains": len(lengths),
        "grains": int(lengths.sum()),
        "share_of_grains": float(lengths.sum() / max(len(chains.chain), 1)),
        "mean_length": float(lengths.mean()) if len(lengths) else None,
        "longest": int(lengths.max(initial=0)),
        "loops_beside": share(table["chain_contacts"] > 0),
    }


def chains_table(table: dict[str, Any]) -> dict[str, list[Any]]:
    """Loops beside chains and elsewhere by groups of orders: eigenvalues, unstable share."""
    near, groups = table["chain_contacts"] > 0, group_rows(table["order"])
    every, unstable = np.arange(len(near)), {j: unstable_loops(table, j) for j in judges(table)}
    rows: dict[str, list[Any]] = {"place": [], "orders": [], "loops": [], "mean_order": []}
    for place, here in zip(PLACES, (near, ~near), strict=True):
        for name in (*GROUPS, "all"):
            own = every[groups[name]]
            inside = own[here[own]]
            order = table["order"][inside]
            mean = float(order.mean()) if len(order) else np.nan
            told = {"place": place, "orders": name, "loops": len(order), "mean_order": mean}
            for judge in unstable:
                smallest = table[f"{judge}_lambda_min"][inside]
                known = np.isfinite(smallest)
                beyond = share(unstable[judge][inside][known])
                told[f"{judge}_lambda_min"] = np.median(smallest[known]) if known.any() else np.nan
                told[f"{judge}_unstable"] = beyond["mean"]
                told[f"{judge}_unstable_error"] = beyond["std_error"]
            for column, value in told.items():
                rows.setdefault(column, []).append(value)
    return rows


def chain_segments(snapshot: Snapshot, chains: ForceChains) -> Floats:
    """(L, 2, 2) the two ends of every link, across a border on the side of its first grain."""
    start = snapshot.graph.x[snapshot.graph.contacts[chains.links, 0]]
    return np.stack([start, start + branch_vectors(snapshot.graph)[chains.links]], axis=1)
