"""The peak of the axial stress on the loading stage."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from stability import Path
from studies.polygon.path import PolygonPath

# Slopes of s1 over E1 below this, and steps of E1, are none.
FLAT, STILL = 1e-10, 1e-12


def axial_peak(found: PolygonPath) -> dict[str, float] | None:
    """Largest axial stress of the loading stage, if it lies within it.

    On a drained path it is a row: det K = 0 in (11, 22), or an event where the response turns
    over. Elsewhere it lies between rows, on the cubic through the values and slopes of two.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.

    Returns
    -------
    dict or None
        `E1, E2, s1`; None where s1 only falls, or still rises at the end.

    Examples
    --------
    >>> from studies.polygon import PolygonParameters
    >>> from studies.polygon.path import follow_polygon
    >>> found = follow_polygon(PolygonParameters(6, closure="traction"), ("diagonal",))
    >>> round(axial_peak(found)["E1"], 6)
    0.132639
    """
    path, rows = found.path, found.loading
    if len(rows) == 0:
        return None
    s1 = path.P[rows, 0]
    k = int(np.argmax(s1))
    # Rows twice recorded, before and after a change, are one.
    if s1[k] <= s1[0] + STILL or (s1[k] <= s1[-1] + STILL):
        return None
    row = int(rows[k])
    between = _between(path, row)
    if between is not None:
        return between
    return {
        "E1": float(path.H[row, 0]),
        "E2": float(path.H[row, 3]),
        "s1": float(path.P[row, 0]),
    }


def _between(path: Path, row: int) -> dict[str, float] | None:
    """The peak beside a row, on the side where s1 still rises; none if it is the row itself."""
    rate = path.H_rate[row, 0]
    if abs(rate) < STILL or abs(path.P_rate[row, 0] / rate) < FLAT:
        return None
    a, b = (row, row + 1) if path.P_rate[row, 0] > 0.0 else (row - 1, row)
    rates = path.H_rate[[a, b]]
    E1 = path.H[[a, b], 0]
    if path.stage[a] != path.stage[b] or E1[1] - E1[0] < STILL or not (rates[:, 0] > STILL).all():
        return None
    axial = CubicHermiteSpline(E1, path.P[[a, b], 0], path.P_rate[[a, b], 0] / rates[:, 0])
    lateral = CubicHermiteSpline(E1, path.H[[a, b], 3], rates[:, 3] / rates[:, 0])
    inner = [x for x in axial.derivative().roots(extrapolate=False) if np.isfinite(x)]
    if not inner:
        return None
    best = max(inner, key=lambda x: float(axial(x)))
    return {"E1": float(best), "E2": float(lateral(best)), "s1": float(axial(best))}
