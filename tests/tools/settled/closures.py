"""Traction closure: the limit of the force method, and least squares in its place."""

from __future__ import annotations

from functools import partial

import numpy as np

from loops import assemble_tangent, boundary_vectors, polygon_area, traction_tangent
from loops.arrays import Floats
from loops.closures.tangents import FORCE_METHOD_LIMIT, SADDLE_GAIN
from tests.benchmarks.methods import (
    Rings,
    Row,
    Rows,
    by_method,
    irregular_rings,
    least_seconds,
    relative_error,
)

ORACLE = "primal system, 50 digits"
LIMITS = (1.0, 1e2, 1e4, 1e6, 1e8, 1e10)


def closure_switch(quick: bool) -> list[Row]:
    """`method="auto"` with other limits, put together from both methods' results and times."""
    batch = irregular_rings(200 if quick else 2000, 6, seed=7)
    exact = np.array([batch.exact(k, "traction") for k in range(8 if quick else 60)])
    force = traction_tangent(batch.graph, batch.law, regime=batch.regime, method="force")
    saddle = traction_tangent(batch.graph, batch.law, regime=batch.regime, method="saddle")
    seconds = [
        least_seconds(partial(by_method, batch, name), quick=quick) for name in ("force", "saddle")
    ]
    rows = []
    for limit in LIMITS:
        poor = ~(force.condition <= limit)
        taken = poor & (SADDLE_GAIN * saddle.condition < force.condition)
        matrix = np.where(taken[:, None, None], saddle.matrix, force.matrix)
        time = seconds[0] + seconds[1] * float(poor.mean())
        named = ("closure switch", "force, saddle beyond the limit", f"condition {limit:.0e}")
        count, error = len(poor), relative_error(matrix, exact)
        default = limit == FORCE_METHOD_LIMIT
        rows.append(Row(*named, count, time / count, error, float("nan"), ORACLE, default))
    return rows


def least_squares_methods(quick: bool) -> Rows:
    """numpy's least squares, loop by loop, of hexagons and of rings of 20."""
    rows = Rows("least squares", ORACLE, quick)
    for order, loops, checked in ((6, 200, 8),) if quick else ((6, 2000, 60), (20, 300, 12)):
        batch = irregular_rings(loops, order, seed=7)
        exact = np.array([batch.exact(k, "traction") for k in range(checked)])
        few = batch.first(60)
        call, error = partial(least_squares, few), relative_error(least_squares(few), exact)
        rows.add("numpy lstsq, one by one", f"n = {order}", call, error, len(few.regime))
    return rows


def least_squares(batch: Rings) -> Floats:
    """(L, 4, 4) traction tangents by the minimum-norm solution of the saddle system."""
    graph = batch.graph
    K = assemble_tangent(graph, batch.law, regime=batch.regime)
    area, n = polygon_area(graph.x0), graph.grain_count
    B = np.zeros((len(K), 2 * n, 4))
    for a in range(2):
        B[:, a::2, 2 * a : 2 * a + 2] = boundary_vectors(graph.x0)
    out = np.empty((len(K), 4, 4))
    for k in range(len(K)):
        system = np.block([[K[k], B[k]], [B[k].T, np.zeros((4, 4))]])
        rhs = np.vstack([np.zeros((2 * n, 4)), -area[k] * np.eye(4)])
        out[k] = np.linalg.lstsq(system, rhs)[0][2 * n :]
    return out
