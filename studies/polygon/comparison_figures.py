"""Figures of a comparison of orders."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.polygon.comparison import Compared, compared_tables
from studies.polygon.parameters import SUBSPACES
from studies.style import (
    BLUE,
    GREEN,
    GREY,
    SEQUENTIAL,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    figure_of,
    new_figure,
    save_figure,
    styled,
)

MARKERS = {"diagonal": ("o", BLUE), "symmetric": ("x", VERMILION), "full": ("+", GREEN)}
NAMES = {
    "diagonal": "(11, 22)",
    "symmetric": r"(11, 22, (12+21)/$\sqrt{2}$)",
    "full": "all four components",
}


def draw_comparison_figures(compared: Compared, folder: Path, source: Mapping[str, Any]) -> None:
    """Draw and save every figure of a comparison.

    Parameters
    ----------
    compared : Compared
        From `compare`.
    folder : Path
        Where.
    source : mapping
        From `studies.output.provenance`.
    """
    figures = {
        "critical_strain": figure_of(draw_critical_strain(compared)),
        "first_loss": draw_yield_and_peak(compared),
        "stress_strain": figure_of(draw_stress_strain(compared)),
    }
    for name, figure in figures.items():
        save_figure(figure, folder, name, source)


@styled()
def draw_critical_strain(compared: Compared, ax: Axes | None = None) -> Axes:
    """Critical isotropic strain over the order, by subspace, with the two thresholds.

    Parameters
    ----------
    compared : Compared
        From `compare`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax, 4.2, 2.8)
    columns, kappa = compared_tables(compared)["compare"], compared.parameters.shared.kappa
    for label, level in (
        (r"$\kappa/(1+\kappa)$", kappa / (1 + kappa)),
        (r"$(1+\kappa)/(2+\kappa)$", (1 + kappa) / (2 + kappa)),
    ):
        ax.axhline(level, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)), zorder=0)
        ax.annotate(
            label, (1.0, level), (2, 0), xycoords=("axes fraction", "data"),
            textcoords="offset points", va="center", color=GREY,
        )  # fmt: skip
    for subspace in SUBSPACES:
        marker, colour = MARKERS[subspace]
        ax.plot(
            columns["order"], columns[f"critical_strain_{subspace}"], marker, color=colour,
            markerfacecolor="none", markersize=6, label=NAMES[subspace],
        )  # fmt: skip
    _order_axis(ax, columns["order"])
    ax.set(ylabel="critical isotropic strain (–)", ylim=(-0.02, None))
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, columnspacing=1.0)
    return ax


@styled()
def draw_yield_and_peak(compared: Compared) -> Figure:
    """First yield and peak of the axial stress over the order: strain and stress.

    Parameters
    ----------
    compared : Compared
        From `compare`.

    Returns
    -------
    Figure
    """
    fig = new_figure(TWO_COLUMNS, 2.6)
    columns = compared_tables(compared)["compare"]
    for ax, key, label in zip(
        fig.subplots(1, 2), ("E1", "s1"), ("axial strain (–)", "axial stress (–)"), strict=True
    ):
        ax.plot(
            columns["order"], columns[f"first_yield_{key}"], "o", color=BLUE, label="first yield",
            markerfacecolor="none", markersize=6,
        )  # fmt: skip
        ax.plot(
            columns["order"], columns[f"peak_{key}"], "x", color=VERMILION, label="peak of $s_1$"
        )
        _order_axis(ax, columns["order"])
        ax.set(ylabel=label)
        ax.margins(y=0.15)
    ax.legend(loc="best")
    return fig


@styled()
def draw_stress_strain(compared: Compared, ax: Axes | None = None) -> Axes:
    """Axial stress over axial strain, a curve an order; a ring where a path ends early.

    Parameters
    ----------
    compared : Compared
        From `compare`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax, 4.6, 3.0)
    shades = colormaps[SEQUENTIAL](np.linspace(0.0, 0.92, len(compared.found)))
    for found, shade in zip(compared.found, shades, strict=True):
        E1, s1 = found.path.H[:, 0], found.path.P[:, 0]
        ax.plot(E1, s1, color=shade, linewidth=1.1, label=f"{found.parameters.order}")
        if found.path.status != "finished":
            ax.plot(E1[-1], s1[-1], "o", color=shade, markerfacecolor="white")
    ax.set(xlabel="axial strain $E_1$ (–)", ylabel="axial stress $s_1$ (–)", xlim=(0.0, None))
    ax.legend(title="order", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return ax


def _order_axis(ax: Axes, orders: list[int]) -> None:
    ax.set(xlabel="order of the loop, $n$", xticks=orders[:: max(len(orders) // 10, 1)])
