"""Figures of the page on larger loops."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from studies.larger_loops.cost import PATH_ORDERS, TANGENT_ORDERS
from studies.larger_loops.numbers import (
    KAPPA,
    LONGER,
    diamond_threshold,
    rolling_threshold,
)
from studies.polygon.comparison_figures import draw_critical_strain, draw_stress_strain
from studies.polygon.figures import draw_unstable_fraction
from studies.polygon.parameters import PolygonParameters
from studies.polygon.path import follow_polygon
from studies.polygon.scenes import draw_loops
from studies.style import BLUE, GREY, LINE_COLOURS, TWO_COLUMNS, VERMILION, new_figure, styled

Floats = NDArray[np.float64]


def all_figures(numbers: dict[str, Any], cost: dict[str, Floats]) -> dict[str, Figure]:
    """Every figure of the page by its name.

    Parameters
    ----------
    numbers : dict
        From `collect`.
    cost : dict
        `tangent` and `path`, seconds.

    Returns
    -------
    dict of str to Figure
    """
    hexagon = follow_polygon(
        PolygonParameters(6, kappa=KAPPA, phi_deg=20.0, closure="traction", confine=0.1, end=0.35),
        ("diagonal",),
    )
    return {
        "thresholds": draw_thresholds(numbers),
        "stress-strain": draw_curves(numbers),
        "laws": draw_laws(numbers),
        "hexagon": draw_loops(hexagon),
        "unstable-fraction": draw_shares(hexagon),
        "cost": draw_cost(cost),
    }


@styled()
def draw_thresholds(numbers: dict[str, Any]) -> Figure:
    """Critical isotropic strain over the order, under both closures.

    Parameters
    ----------
    numbers : dict
        From `collect`.

    Returns
    -------
    Figure
    """
    fig = new_figure(TWO_COLUMNS, 2.6)
    for ax, closure in zip(fig.subplots(1, 2, sharey=True), numbers["compared"], strict=True):
        draw_critical_strain(numbers["compared"][closure], ax)
        ax.get_legend().remove()
        ax.set_title(f"{closure} closure, spins blocked")
        ax.label_outer()
    fig.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


@styled()
def draw_curves(numbers: dict[str, Any]) -> Figure:
    """Axial stress on drained paths of orders 3 to 12, under both closures.

    Parameters
    ----------
    numbers : dict
        From `collect`.

    Returns
    -------
    Figure
    """
    fig = new_figure(TWO_COLUMNS, 2.8)
    for ax, closure in zip(fig.subplots(1, 2, sharey=True), numbers["compared"], strict=True):
        draw_stress_strain(numbers["compared"][closure], ax)
        if closure == "affine":
            ax.get_legend().remove()
        ax.set_title(f"{closure} closure")
        ax.label_outer()
    return fig


@styled()
def draw_laws(numbers: dict[str, Any]) -> Figure:
    """Critical strain of spheres over kappa, and of rolling resistance over its stiffness.

    Parameters
    ----------
    numbers : dict
        From `collect`.

    Returns
    -------
    Figure
    """
    fig = new_figure(TWO_COLUMNS, 2.6)
    spheres, rolling = fig.subplots(1, 2)
    kappa = np.linspace(0.0, 1.1, 100)
    spheres.plot(kappa, diamond_threshold_of(kappa, 1.0), color=BLUE, label="linear")
    spheres.plot(kappa, diamond_threshold_of(kappa, 1.5), color=VERMILION, label="Hertz-Mindlin")
    rows = numbers["hertz"]
    spheres.plot([r["kappa"] for r in rows], [r["found"] for r in rows], "o", color=VERMILION)
    spheres.set(xlabel=r"$\kappa = k_t/k_n$ (–)", ylabel="critical isotropic strain (–)")
    spheres.legend(loc="lower right")
    k_r = np.logspace(-4, 1, 60)
    for order, colour in zip(LONGER, LINE_COLOURS, strict=False):
        curve = [rolling_threshold(order, KAPPA, float(k)) for k in k_r]
        rolling.plot(k_r, curve, color=colour, label=f"$n = {order}$")
        points = [row["found"][order] for row in numbers["rolling"]]
        rolling.plot([row["k_r"] for row in numbers["rolling"]], points, "o", color=colour)
    rolling.axhline(diamond_threshold(KAPPA), color=GREY, linewidth=0.7, linestyle=(0, (4, 2)))
    rolling.set(xscale="log", xlabel=r"rolling stiffness $k_r/(k_n l_0^2)$ (–)")
    rolling.legend(loc="lower right")
    return fig


def diamond_threshold_of(kappa: Floats, exponent: float) -> Floats:
    """Threshold `kappa/(kappa + 1/p)` of a normal force that grows as `delta^p`.

    Parameters
    ----------
    kappa : array
        Stiffness ratios.
    exponent : float
        p: 1 linear, 3/2 Hertz.

    Returns
    -------
    array

    Examples
    --------
    >>> import numpy as np
    >>> diamond_threshold_of(np.array([1.0]), 1.5).round(3).tolist()
    [0.6]
    """
    return np.asarray(kappa / (kappa + 1.0 / exponent))


@styled()
def draw_shares(found: Any) -> Figure:
    """Unstable directions along the hexagon's drained path.

    Parameters
    ----------
    found : PolygonPath
        The hexagon.

    Returns
    -------
    Figure
    """
    fig = new_figure(4.2, 2.6)
    draw_unstable_fraction(found, fig.add_subplot())
    return fig


@styled()
def draw_cost(cost: dict[str, Floats]) -> Figure:
    """Measured times over the order, with lines of slope 1.

    Parameters
    ----------
    cost : dict
        `tangent` and `path`, seconds.

    Returns
    -------
    Figure
    """
    fig = new_figure(TWO_COLUMNS, 2.5)
    for ax, name, orders, title in zip(
        fig.subplots(1, 2),
        ("tangent", "path"),
        (TANGENT_ORDERS, PATH_ORDERS),
        ("traction tangent, force method", "drained biaxial path"),
        strict=True,
    ):
        n, seconds = np.array(orders), cost[name]
        ax.loglog(n, seconds, "o-", color=BLUE, label="measured")
        ax.loglog(n, seconds[-1] * n / n[-1], color=GREY, linewidth=0.8, label="in proportion to n")
        ax.set(xlabel="order of the loop, $n$", ylabel="time (s)", title=title)
    ax.legend(loc="best")
    return fig
