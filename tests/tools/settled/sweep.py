"""At which strain do 100,000 random diamonds yield, and how long does the answer take?

Point B, where all four contacts slide under constant s2, from the exact solution for all diamonds
at once (`tests.oracles.drained`), against scipy's `solve_ivp` on (33), one path at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from loops.arrays import Floats
from patterns.diamond import TABLE_1
from studies.examples import run_example, save
from studies.style import LINE_COLOURS, SEQUENTIAL, TWO_COLUMNS, new_figure, styled
from tests.oracles.drained import drained_end

# Ranges of alpha0, kappa, phi and the isotropic strain at A; degrees.
LOWEST = np.array([5.0, 0.05, 1.0, 1e-4])
HIGHEST = np.array([85.0, 1.5, 35.0, 0.5])
INTEGRATORS = (("RK45", 1e-3), ("DOP853", 1e-8), ("DOP853", 1e-12))


def drained(
    alpha0: float, kappa: float, phi: float, confinement: float
) -> tuple[Callable[..., tuple[float, float]], Callable[..., float]]:
    """Rates and friction left of a diamond of sticking contacts under constant s2.

    Both take `E1, E2, s1`. Rates are `dE2/dE1 = -K21/K22` and `ds1/dE1 = det K/K22` (26), (33); the
    friction left is `mu N - |T|` over `kn l0`, from balance (12), zero at yield.
    """
    t0, sin0, cos0, mu = math.tan(alpha0), math.sin(alpha0), math.cos(alpha0), math.tan(phi)
    s2 = confinement * t0

    # Plain floats: half the time of numpy's scalars.
    def rates(E1: float, E2: float, s1: float) -> tuple[float, float]:
        t = t0 * (1.0 - E2) / (1.0 - E1)
        cos2, p1, p2 = 1.0 / (1.0 + t * t), s1 / (1.0 - E2), s2 / (1.0 - E1)
        K22 = cos2 * (t * t + kappa - t * p1) * t0
        K21 = cos2 * ((1.0 - kappa) * t + t * t * p1)
        return -K21 / K22, (kappa - cos2 * t * (p2 + p1)) / K22

    def friction_left(E1: float, E2: float, s1: float) -> float:
        a = math.atan2((1.0 - E2) * sin0, (1.0 - E1) * cos0)
        F1, F2, c, s = s1 * sin0, s2 * cos0, math.cos(a), math.sin(a)
        return mu * (F1 * c + F2 * s) - abs(F1 * s - F2 * c)

    return rates, friction_left


def by_scipy(
    diamond: Sequence[float], method: str, rtol: float, atol: float, end: float = 1.0 - 1e-9
) -> tuple[float, float, float]:
    """Point B of a diamond by scipy's integrators with their event location; NaN if it folds."""
    rates, friction_left = drained(*diamond)
    E = diamond[3]

    def slope(E1: float, y: Floats) -> tuple[float, float]:
        return rates(float(E1), *y.tolist())

    def left(E1: float, y: Floats) -> float:
        return friction_left(float(E1), *y.tolist())

    left.terminal = True  # type: ignore[attr-defined]
    start = np.array([E, E / math.tan(diamond[0])])
    found = solve_ivp(slope, (E, end), start, method, events=left, rtol=rtol, atol=atol)
    if found.status != 1:
        return math.nan, math.nan, math.nan
    E2, s1 = found.y_events[0][0]
    return float(found.t_events[0][0]), float(E2), float(s1)


def random_diamonds(count: int, seed: int = 1) -> Floats:
    """(count, 4): alpha0, kappa, phi, confinement; radians."""
    drawn = np.random.default_rng(seed).uniform(LOWEST, HIGHEST, (count, 4))
    drawn[:, [0, 2]] = np.radians(drawn[:, [0, 2]])
    return drawn


def compare_methods(diamonds: Floats, paths: int) -> tuple[dict[str, int], list[dict[str, Any]]]:
    """Counts by how paths end; by method, time a path and difference at B from the exact sweep."""
    start = perf_counter()
    end = drained_end(*diamonds.T)
    seconds = (perf_counter() - start) / len(diamonds)
    names, counts = np.unique(end.status, return_counts=True)
    picked = np.flatnonzero(end.status == "yield")[:paths]
    exact = np.stack([end.state.E1, end.state.E2, end.state.s1], axis=-1)[picked]
    rows: list[dict[str, Any]] = [
        {"method": "exact, all at once", "seconds": seconds, "error": 0.0}
    ]
    for method, rtol in INTEGRATORS:
        start = perf_counter()
        found = np.array(
            [by_scipy(diamonds[k].tolist(), method, rtol, 1e-3 * rtol) for k in picked]
        )
        seconds, error = (perf_counter() - start) / len(picked), np.nanmax(np.abs(found - exact))
        rows.append({"method": f"{method}, {rtol:g}", "seconds": seconds, "error": float(error)})
    return dict(zip(names.tolist(), counts.tolist(), strict=True)), rows


@styled()
def draw(rows: list[dict[str, Any]]) -> Figure:
    """E1 at B over angle and stiffness with the friction of Table 1; difference over time."""
    figure = new_figure(TWO_COLUMNS, 2.8)
    left, right = figure.subplots(1, 2)
    alpha0, kappa = np.radians(np.linspace(5.0, 85.0, 161)), np.linspace(0.05, 1.5, 161)
    end = drained_end(alpha0, kappa[:, None], TABLE_1.phi, TABLE_1.confinement)
    mesh = left.pcolormesh(np.degrees(alpha0), kappa, end.state.E1, cmap=SEQUENTIAL,
                           rasterized=True, shading="auto")  # fmt: skip
    figure.colorbar(mesh, ax=left, label="$E_1$ at B")
    left.set(xlabel=r"$\alpha_0$ (degrees)", ylabel=r"$\kappa$ (blank: no yield)")
    for row, colour in zip(rows, LINE_COLOURS, strict=False):
        at = (row["seconds"], max(row["error"], 1e-16))
        right.loglog(*at, "o", color=colour, label=row["method"])
    right.set(xlabel="time per path (s)", ylabel="largest difference at B")
    right.legend()
    return figure


def main(out: Path, diamonds: int = 100_000, paths: int = 300) -> dict[str, Any]:
    """Sweep, compare, write the table and the figure."""
    status, rows = compare_methods(random_diamonds(diamonds), paths)
    numbers = {"diamonds": diamonds, "status": status, "methods": rows}
    return save(out, "sweep", draw(rows), numbers, pd.DataFrame(rows), "dimensionless, seconds")


if __name__ == "__main__":
    run_example(main)
