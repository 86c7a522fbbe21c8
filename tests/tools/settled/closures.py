"""Traction closure: least squares in place of the equations of a ring."""

from __future__ import annotations

from functools import partial

import numpy as np

from loops import assemble_tangent, boundary_vectors, polygon_area
from loops.arrays import Floats
from tests.benchmarks.methods import Rings, Rows, irregular_rings, relative_error

ORACLE = "primal system, 50 digits"


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
