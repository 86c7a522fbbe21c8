"""Does a disc between two others slip, when they are pushed together, and by how much?

Kuhn, Prunier and Daouadji (arXiv 1810.11862) analyse three discs whose two contacts are at the
friction limit: the lower one is held, the upper one comes down without turning, the one between
them is free. `beta` is the angle between its branches and the way down. Below a first angle both
contacts may stick, and besides there is a line of solutions, of which only the sum of both slips is
known; above a second one there is the line alone; between the two no regimes agree.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.optimize import brentq

from loops import GrainGraph, LinearFrictional, Scene, Support
from loops.arrays import Floats
from stability import Family, rates_at, slip_problem
from studies.examples import run_example, save
from studies.style import BLUE, GREY, LIGHT_GREY, VERMILION, new_panels, styled

LAW = LinearFrictional(kn=1.0, kt=1.0, mu=0.5)
RADIUS = 1.0
NORMAL_FORCE = 1e-3
# The lower disc is held, the upper one comes down by one and does not turn.
SUPPORT = Support(held=[True, False, True], motion=[[0, 0, 0], [0, 0, 0], [0, -1, 0]])
# The cases of the paper, in degrees.
CASES = 20.0, float(np.degrees(np.arctan(LAW.mu))), 40.0
SWEEP = np.concatenate([np.linspace(10.0, 60.0, 101), np.linspace(25.0, 29.0, 81)])
# The paper's middle case lies between both angles at which the kind of answer changes.
NEAR_ANGLES = np.linspace(26.5, 26.68, 37)


def discs(beta: float) -> GrainGraph:
    """Return the three discs at an angle (degrees), both contacts at the friction limit."""
    s, c = np.sin(np.radians(beta)), np.cos(np.radians(beta))
    return GrainGraph(
        x=2.0 * RADIUS * np.array([[0.0, 0.0], [s, c], [0.0, 2.0 * c]]),
        radii=[RADIUS] * 3,
        contacts=[[0, 1], [1, 2]],
        normal_force=[NORMAL_FORCE] * 2,
        shear_force=[LAW.mu * NORMAL_FORCE, -LAW.mu * NORMAL_FORCE],
    )


def closed_forms(beta: Floats | float) -> tuple[Any, Any]:
    """Return `q` of each contact and every entry of `M` at an angle (degrees)."""
    s, c = np.sin(np.radians(beta)), np.cos(np.radians(beta))
    kn, kt, mu = LAW.kn, LAW.kt, LAW.mu
    g = NORMAL_FORCE / (2.0 * RADIUS) * (c + mu * s)
    along = kn * s**2 + kt * c**2 - g * c
    v = ((kn - kt) * s * c + g * s) / (2.0 * along)
    q = 0.5 * (mu * kn * c - kt * s) - (mu * kn * s + kt * c) * v
    return q, 0.5 * (1.0 - c * (mu * kn * s + kt * c) / along)


def changing_angles() -> tuple[float, float]:
    """Return the angles (degrees) at which `q` and `M` vanish, for `kn = kt`."""
    mu, h = LAW.mu, NORMAL_FORCE / (2.0 * RADIUS * LAW.kn)
    first = mu * (1.0 - h) / (1.0 + h * mu**2)
    second = 0.5 * ((1.0 + h) * mu + np.sqrt((1.0 + h) ** 2 * mu**2 + 4.0 * h))
    return float(np.degrees(np.arctan(first))), float(np.degrees(np.arctan(second)))


def response_at(beta: float) -> dict[str, Any]:
    """Return status, kind, `q`, `M` and the sum of both slips on the line at an angle (degrees)."""
    graph = discs(beta)
    q, M = slip_problem(graph, LAW, SUPPORT)
    found = rates_at(Scene(graph, LAW), SUPPORT)
    sticks = any((one.rates.regime == 1).all() for one in found.solutions)
    line: Family | None = found.families[0] if found.families else None
    kind = " ".join(["stick,"] * sticks + ["line"] * bool(line)).rstrip(",") or "none"
    total = np.nan if line is None else float(line.corners[0].sum())
    row = {
        "beta_deg": beta,
        "status": found.status,
        "kind": kind,
        "solutions": len(found.solutions),
    }
    return row | {"q": float(q[0]), "M": float(M[0, 1]), "slip": total}


def located() -> tuple[float, float]:
    """Return the angles (degrees) at which the platform's `q` and `M` change sign."""
    first = brentq(lambda beta: response_at(beta)["q"], 20.0, 40.0, xtol=1e-13)
    second = brentq(lambda beta: response_at(beta)["M"], 20.0, 40.0, xtol=1e-13)
    return float(first), float(second)


@styled()
def draw(rows: pd.DataFrame, ends: tuple[float, float]) -> Figure:
    """Draw the sum of both slips over the angle, and `q` and `M` where the kind changes."""
    figure, ((slips, near),) = new_panels(1, 2, 2.6)
    for axes in (slips, near):
        axes.axvspan(*ends, color=LIGHT_GREY, linewidth=0.0, label="no solution")
    for kind, part in rows[rows.kind != "none"].groupby("kind", sort=False):
        slips.plot(part.beta_deg, part.slip, color=VERMILION, label="line of slips", zorder=3)
        if kind.startswith("stick"):
            slips.plot(part.beta_deg, 0.0 * part.slip, color=BLUE, linewidth=2.5, label="stick")
    lines = dict(zip(*reversed(slips.get_legend_handles_labels()), strict=True))
    slips.legend(lines.values(), lines.keys(), loc="upper right")
    slips.set(
        xlabel=r"angle $\beta$ (degrees)",
        ylabel="sum of both slips over approach (–)",
        ylim=(-0.3, 8),
    )
    close = rows[rows.beta_deg.between(NEAR_ANGLES[0], NEAR_ANGLES[-1])]
    near.axhline(0.0, color=GREY, linewidth=0.6)
    near.plot(close.beta_deg, 1e3 * close.q, color=BLUE, label=r"$10^3\,q$")
    near.plot(close.beta_deg, 1e3 * close.M, color=VERMILION, label=r"$10^3\,M$", dashes=(4, 2))
    near.set(xlabel=r"angle $\beta$ (degrees)", ylabel="$10^3$ of $q$ and $M$ (–)")
    near.legend(loc="lower left")
    return figure


def main(out: Path) -> dict[str, Any]:
    """Ask over the angle; write the answers, the paper's cases and the figure."""
    angles = np.unique(np.concatenate([SWEEP, NEAR_ANGLES]))
    rows = pd.DataFrame([response_at(beta) for beta in angles.tolist()])
    ends, found = changing_angles(), located()
    numbers = {
        "cases": [response_at(beta) for beta in CASES],
        "changes_deg": {"closed_form": list(ends), "located": list(found)},
        "largest_difference": max(
            float(np.abs(rows[name] - exact).max())
            for name, exact in zip(("q", "M"), closed_forms(rows.beta_deg.to_numpy()), strict=True)
        ),
    }
    return save(out, "three_discs", draw(rows, ends), numbers, rows)


if __name__ == "__main__":
    run_example(main)
