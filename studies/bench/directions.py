"""Second-order work over directions of the plane: sampled, or the cone in closed form."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from loops.arrays import Floats
from stability import plane_cone, polar_diagram, symmetric_spectrum
from studies.bench.measure import Rows
from studies.fifty_digits import DIGITS

ORACLE = "cone in closed form, 50 digits"
COUNTS = (36, 360, 3600, 36_000)
DRAWN = 360


def direction_methods(quick: bool) -> Rows:
    """Error of the unstable fraction and of the smallest W2 over the number of directions."""
    operators = np.random.default_rng(2).standard_normal((40, 2, 2)) + 0.5 * np.eye(2)
    exact = np.array([_exact(K) for K in operators])
    open_cone = (exact[:, 0] > 0.0) & (exact[:, 0] < 1.0)
    operators, exact = operators[open_cone], exact[open_cone]
    rows = Rows("directions", ORACLE, quick)
    ways: list[tuple[str, str, Callable[[], Floats]]] = [
        ("sampled", f"{count:,} directions", partial(_sampled, operators, count))
        for count in COUNTS[: 2 if quick else None]
    ]
    ways.append(("closed", "plane_cone, eigvalsh", partial(_closed, operators)))
    for way, setting, call in ways:
        for what, gap in zip(("fraction", "smallest W2"), (call() - exact).T, strict=True):
            rows.add(f"{way}: {what}", setting, call, gap, len(operators), way == "closed")
    return rows


def _sampled(operators: Floats, count: int) -> Floats:
    """(K, 2) share of directions with W2 < 0, and the smallest W2 per unit strain rate."""
    diagram = polar_diagram(operators, directions=count)
    e = diagram.direction
    work = np.einsum("di,kij,dj->kd", e, operators, e, optimize=True)
    return np.stack([(diagram.work < 0.0).mean(axis=1), work.min(axis=1)], axis=1)


def _closed(operators: Floats) -> Floats:
    opening = plane_cone(operators).opening / np.pi
    return np.stack([opening, symmetric_spectrum(operators)[:, 0]], axis=1)


def _exact(K: Floats) -> tuple[float, float]:
    import mpmath as mp

    with mp.workdps(DIGITS):
        (a, b), (c, d) = ((mp.mpf(float(v)) for v in row) for row in K)
        mean, radius = (a + d) / 2, mp.sqrt(((a - d) / 2) ** 2 + ((b + c) / 2) ** 2)
        if radius <= abs(mean):
            return float(mean < 0), float(mean - radius)
        return float(mp.acos(mean / radius) / mp.pi), float(mean - radius)
