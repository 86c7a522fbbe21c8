"""At which strain do loops of any order lose stability under other laws, and at which cost?

The isotropic strain at which Ks of a regular loop first loses definiteness in (11, 22), as a root
on the operator whose centres may relax: spheres (Hertz-Mindlin) over their stiffness ratio, and
free spins with rolling resistance over its stiffness. Beside it the time of a tangent over the
number of grains.
"""

from __future__ import annotations

import time
import timeit
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from loops import GrainGraph, HertzMindlin, LinearFrictional, RollingResistance, traction_tangent
from loops.arrays import Floats
from patterns import regular_polygon
from studies.examples import run_example, save
from studies.paths.followed import isotropic_threshold
from studies.style import BLUE, GREY, LINE_COLOURS, TWO_COLUMNS, VERMILION, new_figure, styled

KAPPA = 0.3
LINEAR = LinearFrictional(kn=1.0, kt=KAPPA)
ORDERS = (5, 6, 8, 12)
POISSON = (0.0, 0.3, 0.5)
ROLLING = (0.003, 0.03, 0.3)
SIZES = (6, 10, 20, 40, 80, 150, 300, 600, 1000)


def threshold(
    order: int,
    law: Any,
    spins: Any = "blocked",
    *,
    closure: Any = "traction",
    subspace: str = "diagonal",
    orientation: Any = "vertex",
) -> float | None:
    """Least isotropic strain at which Ks is not definite, to rounding; None if below 0.99 it is."""

    def strained(strain: Any) -> GrainGraph:
        return regular_polygon(order, strain=strain, orientation=orientation)

    return isotropic_threshold(strained, law, closure, spins, subspace)


def rolling_threshold(order: int, kappa: float, k_r: float) -> float:
    """Root of `E/(1 - E) = kt'/kn`, `1/kt' = 1/kt + l^2 cot^2(2 pi/n)/(4 k_r)`, `l = 1 - E`."""
    a = 1.0 / np.tan(2.0 * np.pi / order) ** 2 / 4.0 / k_r
    # With E = 1 - l: (1 - l)(1/kappa + a l^2) = l, a cubic in l.
    roots = np.roots([-a, a, -1.0 / kappa - 1.0, 1.0 / kappa])
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(1.0 - real[(real > 0.0) & (real < 1.0)].max())


def tangent_seconds(orders: tuple[int, ...] = SIZES, grains: int = 400_000) -> Floats:
    """Seconds for the traction tangent of one loop, within a batch."""
    found = []
    for order in orders:
        count = max(grains // order, 1)
        loop = regular_polygon(order, strain=np.linspace(0.01, 0.1, count))
        tangent = partial(traction_tangent, loop, LINEAR)
        found.append(
            min(timeit.repeat(tangent, timer=time.process_time, number=1, repeat=5)) / count
        )
    return np.array(found)


@styled()
def draw(spheres: dict[str, Any], rolling: dict[str, Any], seconds: Floats) -> Figure:
    """Thresholds (dots) on their closed forms, and the time of a tangent."""
    figure = new_figure(TWO_COLUMNS, 2.6)
    left, middle, right = figure.subplots(1, 3)
    kappa = np.linspace(0.0, 1.1, 100)
    left.plot(kappa, kappa / (kappa + 1.0), color=BLUE, label="linear")
    left.plot(kappa, kappa / (kappa + 2.0 / 3.0), color=VERMILION, label="Hertz-Mindlin")
    left.plot(spheres["kappa"], spheres["threshold"], "o", color=VERMILION)
    left.set(xlabel=r"$\kappa = k_t/k_n$", ylabel="critical isotropic strain")
    left.legend()
    k_r = np.logspace(-4, 1, 60)
    for order, colour in zip(ORDERS, LINE_COLOURS, strict=False):
        curve = [rolling_threshold(order, KAPPA, float(k)) for k in k_r]
        middle.plot(k_r, curve, color=colour, label=f"n = {order}")
        middle.plot(ROLLING, rolling[f"n = {order}"], "o", color=colour)
    middle.axhline(KAPPA / (1 + KAPPA), color=GREY, linestyle="--")
    middle.set(xscale="log", xlabel=r"rolling stiffness $k_r/(k_n l_0^2)$")
    middle.legend()
    right.loglog(SIZES, seconds, "o-", color=BLUE)
    right.loglog(SIZES, seconds[-1] * np.array(SIZES) / SIZES[-1], "--", color=GREY)
    right.set(xlabel="order n (dashed: in proportion)", ylabel="time of a tangent (s)")
    return figure


def main(out: Path) -> dict[str, Any]:
    """Find the thresholds, time the tangents; write table and figure."""
    laws = [HertzMindlin(young=1.0, poisson=nu) for nu in POISSON]
    spheres = {"poisson": POISSON, "kappa": [float(law.stiffness_ratio) for law in laws],
               "threshold": [threshold(6, law) for law in laws]}  # fmt: skip
    rollers = [RollingResistance(LINEAR, k_r=k_r) for k_r in ROLLING]
    rolling: dict[str, Any] = {"k_r": list(ROLLING)}
    rolling |= {f"n = {n}": [threshold(n, law, "free") for law in rollers] for n in ORDERS}
    seconds = tangent_seconds()
    large = np.array(SIZES) >= 80
    power = np.polyfit(np.log(np.array(SIZES)[large]), np.log(seconds[large]), 1)[0]
    numbers = {"spheres": spheres, "rolling": rolling, "power_of_n": float(power)}
    return save(
        out, "larger_loops", draw(spheres, rolling, seconds), numbers, pd.DataFrame(rolling)
    )


if __name__ == "__main__":
    run_example(main)
