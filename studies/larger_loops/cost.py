"""How the cost of a loop grows with its order."""

from __future__ import annotations

from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from loops import LinearFrictional, traction_tangent
from patterns import regular_polygon
from studies.polygon.parameters import PolygonParameters
from studies.polygon.path import follow_polygon

Floats = NDArray[np.float64]

TANGENT_ORDERS = (6, 10, 20, 40, 80, 150, 300, 600, 1000)
PATH_ORDERS = (6, 12, 25, 50, 100, 200)
# Numbers of grains held at a time while tangents are timed: calls cost nothing beside them.
BATCH = 400_000
REPEATS = 3


def tangent_seconds(orders: tuple[int, ...] = TANGENT_ORDERS, batch: int = BATCH) -> Floats:
    """Seconds for the traction tangent of one loop by the force method, within a batch.

    Parameters
    ----------
    orders : tuple of int
        Numbers of grains.
    batch : int
        Grains in a batch.

    Returns
    -------
    (len(orders),) array
        Best of three.
    """
    law = LinearFrictional(kn=1.0, kt=0.3)
    found = []
    for order in orders:
        count = max(batch // order, 1)
        loop = regular_polygon(order, strain=np.linspace(0.01, 0.1, count))
        best = np.inf
        for _ in range(REPEATS):
            start = perf_counter()
            traction_tangent(loop, law, method="force")
            best = min(best, perf_counter() - start)
        found.append(best / count)
    return np.array(found)


def path_seconds(orders: tuple[int, ...] = PATH_ORDERS) -> tuple[Floats, Floats]:
    """Seconds for a drained biaxial path under the traction closure, and its rows.

    Confined to 5 %, then loaded to 10 %; nothing slides, so that paths of all orders are alike.

    Parameters
    ----------
    orders : tuple of int
        Numbers of grains.

    Returns
    -------
    seconds, rows : (len(orders),) array
    """
    seconds, rows = [], []
    for order in orders:
        parameters = PolygonParameters(
            order, kappa=0.3, phi_deg=90.0, closure="traction", confine=0.05, end=0.1
        )
        start = perf_counter()
        found = follow_polygon(parameters, ("diagonal",))
        seconds.append(perf_counter() - start)
        rows.append(len(found.path))
    return np.array(seconds), np.array(rows, dtype=float)


def exponent(orders: tuple[int, ...], seconds: Floats, least: int) -> float:
    """Power of the order by which times grow, from loops of at least `least` grains.

    Parameters
    ----------
    orders : tuple of int
        Numbers of grains.
    seconds : array
        Times.
    least : int
        Smaller loops are left out.

    Returns
    -------
    float

    Examples
    --------
    >>> import numpy as np
    >>> round(exponent((1, 10, 100), np.array([5.0, 1.0, 10.0]), 10), 12)
    1.0
    """
    n = np.array(orders, dtype=float)
    large = n >= least
    return float(np.polyfit(np.log(n[large]), np.log(seconds[large]), 1)[0])
