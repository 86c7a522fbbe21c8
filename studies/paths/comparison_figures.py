"""Figures of a comparison of orders."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.paths.comparison import Compared
from studies.paths.figures import SHARES
from studies.style import (
    BLUE,
    GREY,
    SEQUENTIAL,
    VERMILION,
    axes_or_new,
    figure_of,
    key_columns,
    new_panels,
    styled,
)

MARKERS = {"diagonal": "o", "symmetric": "x", "full": "+"}


def comparison_figures(compared: Compared) -> dict[str, Figure]:
    """Every figure of a comparison by its name."""
    return {
        "critical_strain": figure_of(draw_critical_strain(compared)),
        "first_loss": draw_yield_and_peak(compared),
        "stress_strain": figure_of(draw_stress_strain(compared)),
    }


@styled()
def draw_critical_strain(compared: Compared, ax: Axes | None = None) -> Axes:
    """Critical isotropic strain over the order, by subspace, with the two thresholds."""
    ax = axes_or_new(ax, 4.2, 2.8)
    columns, kappa = compared.tables()["compare"], compared.options.shared.kappa
    for label, level in (
        (r"$\kappa/(1+\kappa)$", kappa / (1 + kappa)),
        (r"$(1+\kappa)/(2+\kappa)$", (1 + kappa) / (2 + kappa)),
    ):
        ax.axhline(level, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)), zorder=0)
        ax.annotate(
            label, (1.0, level), (2, 0), xycoords=("axes fraction", "data"),
            textcoords="offset points", va="center", color=GREY,
        )  # fmt: skip
    for subspace, colour, _, label in SHARES:
        ax.plot(
            columns["order"], columns[f"critical_strain_{subspace}"], MARKERS[subspace],
            color=colour, markerfacecolor="none", markersize=6, label=label,
        )  # fmt: skip
    _order_axis(ax, columns["order"])
    ax.set(ylabel="critical isotropic strain (–)", ylim=(-0.02, None))
    beside = key_columns(figure_of(ax), 3)
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=beside, columnspacing=1.0)
    return ax


@styled()
def draw_yield_and_peak(compared: Compared) -> Figure:
    """First yield and peak of the axial stress over the order: strain and stress."""
    fig, (axes,) = new_panels(1, 2, 2.6)
    columns = compared.tables()["compare"]
    for ax, key, label in zip(
        axes, ("E1", "s1"), ("axial strain (–)", "axial stress (–)"), strict=True
    ):
        for name, mark, colour, said in (
            ("first_yield", "o", BLUE, "first yield"),
            ("peak", "x", VERMILION, "peak of $s_1$"),
        ):
            ax.plot(
                columns["order"], columns[f"{name}_{key}"], mark, color=colour, label=said,
                markerfacecolor="none", markersize=6,
            )  # fmt: skip
        _order_axis(ax, columns["order"])
        ax.set(ylabel=label)
        ax.margins(y=0.15)
    ax.legend(loc="best")
    return fig


@styled()
def draw_stress_strain(compared: Compared, ax: Axes | None = None) -> Axes:
    """Axial stress over axial strain, a curve an order; a ring where a path ends early."""
    ax = axes_or_new(ax, 4.6, 3.0)
    shades = colormaps[SEQUENTIAL](np.linspace(0.0, 0.92, len(compared.found)))
    for order, found, shade in zip(compared.options.orders, compared.found, shades, strict=True):
        ax.plot(found.E1, found.s1, color=shade, linewidth=1.1, label=f"{order}")
        if found.path.status != "finished":
            ax.plot(found.E1[-1], found.s1[-1], "o", color=shade, markerfacecolor="white")
    ax.set(xlabel="axial strain $E_1$ (–)", ylabel="axial stress $s_1$ (–)", xlim=(0.0, None))
    ax.legend(title="order", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return ax


def _order_axis(ax: Axes, orders: list[int]) -> None:
    ax.set(xlabel="order of the loop, $n$", xticks=orders[:: max(len(orders) // 10, 1)])
