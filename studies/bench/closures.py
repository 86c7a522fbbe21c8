"""Closures: force method, saddle system, least squares; where the force method gives way."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from loops import assemble_tangent, boundary_vectors, polygon_area, traction_tangent
from loops.arrays import Floats
from loops.closures.traction import FORCE_METHOD_LIMIT, SADDLE_GAIN
from studies.bench.measure import Row, Rows, largest, least_seconds
from studies.bench.rings import Rings, random_rings

ORACLE = "primal system, 50 digits"
LIMITS = (1.0, 1e2, 1e4, 1e6, 1e8, 1e10)


def closure_methods(quick: bool) -> list[Row]:
    """Time and error of the traction closure of rings, soft and stiff together."""
    rows = _of_order(6, 200 if quick else 2000, 8 if quick else 60, quick)
    return rows if quick else rows + _of_order(20, 300, 12, quick)


def _of_order(order: int, loops: int, checked: int, quick: bool) -> list[Row]:
    batch = random_rings(loops, order, seed=7)
    exact = {k: batch.exact(k, "traction") for k in range(checked)}
    rows = Rows(f"closures, n = {order}", ORACLE, quick)
    for method, name in (("force", "force method"), ("saddle", "dense saddle"), ("auto", "both")):
        call, setting = partial(_solve, batch, method), f"method='{method}'"
        rows.add(name, setting, call, _error(call(), exact), loops, method == "auto")
    few = batch.first(max(60, checked))
    call, setting = partial(least_squares, few), "numpy lstsq, one by one"
    rows.add("least squares", setting, call, _error(call(), exact), len(few.regime))
    return rows + (_limits(batch, exact, quick) if order == 6 else [])


def least_squares(batch: Rings) -> Floats:
    """Traction tangents by the minimum-norm solution of the saddle system."""
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


def _limits(batch: Rings, exact: dict[int, Floats], quick: bool) -> list[Row]:
    """The choice of `auto` for other limits, put together from both methods' results and times."""
    force = traction_tangent(batch.graph, batch.law, regime=batch.regime, method="force")
    saddle = traction_tangent(batch.graph, batch.law, regime=batch.regime, method="saddle")
    seconds = [
        least_seconds(partial(_solve, batch, name), quick=quick) for name in ("force", "saddle")
    ]
    rows = []
    for limit in LIMITS:
        poor = ~(force.condition <= limit)
        taken = poor & (SADDLE_GAIN * saddle.condition < force.condition)
        matrix = np.where(taken[:, None, None], saddle.matrix, force.matrix)
        time = seconds[0] + seconds[1] * float(poor.mean())
        named = ("closure switch", "force, saddle beyond the limit", f"condition {limit:.0e}")
        count, error = len(poor), _error(matrix, exact)
        default = limit == FORCE_METHOD_LIMIT
        rows.append(Row(*named, count, time / count, error, float("nan"), ORACLE, default))
    return rows


def _solve(batch: Rings, method: Any) -> Floats:
    return traction_tangent(batch.graph, batch.law, regime=batch.regime, method=method).matrix


def _error(found: Floats, exact: dict[int, Floats]) -> float:
    """Largest error over the operator's norm."""
    gaps = [np.linalg.norm(found[k] - A) / np.linalg.norm(A) for k, A in exact.items()]
    return largest(np.array(gaps))
