"""Figures of a series: orders, fates and stress over strain, the exchange of orders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from loops.tracking import ExchangeCounts, exchange_matrix
from studies.series.work_figures import MappedInterval, work_map, work_signs
from studies.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    ORANGE,
    PURPLE,
    SEQUENTIAL,
    SKY,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    figure_of,
    new_figure,
    save_figure,
    styled,
)

Floats = NDArray[np.float64]
Columns = Mapping[str, Sequence[Any]]
STRAIN_LABEL = r"accumulated shear strain, $\Sigma\,(\varepsilon_1 - \varepsilon_2)/2$"
# One colour and marker for each order; the last one stands for all beyond.
ORDERS = {3: (BLUE, "o"), 4: (SKY, "s"), 5: (GREEN, "^"), 6: (ORANGE, "D")}
FATES = {
    "survived": SKY,
    "split": BLUE,
    "merged": ORANGE,
    "changed": PURPLE,
    "died": BLACK,
}
# Orders beyond it share the last row and column of the matrix.
LAST_SHOWN = 9


def draw_series(
    folder: Path,
    evolution: Columns,
    exchange: ExchangeCounts,
    increments: Mapping[str, NDArray[Any]],
    mapped: MappedInterval | None,
    source: dict[str, Any],
) -> list[str]:
    """Draw a series as PNG and SVG.

    Parameters
    ----------
    folder : Path
        Where to write.
    evolution : mapping of str to sequence
        From `evolution_table`.
    exchange : ExchangeCounts
        Of all intervals joined.
    increments : mapping of str to array
        Columns of all intervals joined; `w2` and the predictions are drawn if there are forces.
    mapped : MappedInterval or None
        The interval to draw a map of, if any.
    source : dict
        Provenance, written into the files.

    Returns
    -------
    list of str
        Names of the figures: `orders_over_strain`; with two snapshots or more also `fates`,
        `exchange`; with forces `stress_strain`, `work_signs`, `work_map`.
    """
    figures = {"orders_over_strain": orders_over_strain(evolution)}
    if len(evolution["shear_strain"]) > 1:
        figures["fates"] = figure_of(fates_over_strain(evolution))
        figures["exchange"] = figure_of(exchange_heatmap(exchange))
    if "S11" in evolution:
        figures["stress_strain"] = stress_strain(evolution)
    if len(increments.get("W2", ())):
        figures["work_signs"] = work_signs(increments)
    if mapped is not None and "W2" in mapped.increments:
        figures["work_map"] = figure_of(work_map(mapped))
    for name, figure in figures.items():
        save_figure(figure, folder, name, source)
    return list(figures)


@styled()
def orders_over_strain(evolution: Columns) -> Figure:
    """Shares of the loops by order along the series, in number and in area.

    Parameters
    ----------
    evolution : mapping of str to sequence
        From `evolution_table`.

    Returns
    -------
    Figure
    """
    figure = new_figure(TWO_COLUMNS, 2.6)
    strain = _column(evolution, "shear_strain")
    for ax, kind, title in zip(
        figure.subplots(1, 2, sharey=True),
        ("share", "area_share"),
        ("in number", "in area"),
        strict=True,
    ):
        for order, (colour, marker) in ORDERS.items():
            label = f"order {order}" if order < max(ORDERS) else f"order {order} and beyond"
            values = _column(evolution, f"{kind}_{order}")
            ax.plot(strain, values, marker=marker, color=colour, label=label)
        ax.set(xlabel=STRAIN_LABEL, title=title)
    figure.axes[0].set(ylabel="share of the loops", ylim=(0, None))
    figure.axes[0].legend(ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.08))
    return figure


@styled()
def fates_over_strain(evolution: Columns, ax: Axes | None = None) -> Axes:
    """What became of the loops of each interval, stacked, one bar an interval.

    Parameters
    ----------
    evolution : mapping of str to sequence
        From `evolution_table`, of two snapshots or more.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax, TWO_COLUMNS, 2.6)
    counts = {name: _column(evolution, name)[1:] for name in FATES}
    total = np.maximum(sum(counts.values()), 1)
    place, bottom = np.arange(1, len(total) + 1), np.zeros(len(total))
    for name, colour in FATES.items():
        share = counts[name] / total
        ax.bar(place, share, 0.85, bottom=bottom, color=colour, label=name)
        bottom = bottom + share
    born = _column(evolution, "born")[1:] / total
    ax.plot(place, born, "x", color=VERMILION, label="born, over earlier loops")
    widths = np.diff(_column(evolution, "shear_strain"))
    ax.set_xticks(place, labels=[f"{width:.2g}" for width in widths], rotation=60)
    ax.set(xlabel="shear strain of the interval, in the order of the series", ylim=(0, 1))
    ax.set_ylabel("share of the earlier loops")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return ax


@styled()
def exchange_heatmap(exchange: ExchangeCounts, ax: Axes | None = None) -> Axes:
    """Exchange matrix between orders: counts as numbers, shares of each row as colours.

    Parameters
    ----------
    exchange : ExchangeCounts
        From `exchange_counts`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax, 4.6, 3.9)
    matrix = exchange_matrix(exchange, LAST_SHOWN)
    orders = [*range(3, LAST_SHOWN + 1), 0]
    counts = matrix[np.ix_(orders, orders)]
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    image = ax.imshow(share, cmap=mpl.colormaps[SEQUENTIAL], vmin=0, vmax=1)
    for (row, column), number in np.ndenumerate(counts):
        if number:
            colour = "white" if share[row, column] < 0.55 else BLACK
            ax.text(column, row, f"{number}", ha="center", va="center", color=colour, fontsize=6)
    names = [*map(str, range(3, LAST_SHOWN)), f"{LAST_SHOWN}+"]
    ax.set_xticks(range(len(orders)), labels=[*names, "died"])
    ax.set_yticks(range(len(orders)), labels=[*names, "born"])
    ax.set(xlabel="order of the successor", ylabel="order before")
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    figure_of(ax).colorbar(image, ax=ax, label="share of the row", shrink=0.8)
    return ax


@styled()
def stress_strain(evolution: Columns) -> Figure:
    """Stress of the sample along the series, and the unstable and sliding shares below it.

    Parameters
    ----------
    evolution : mapping of str to sequence
        From `evolution_table`, with forces.

    Returns
    -------
    Figure
    """
    figure = new_figure(TWO_COLUMNS, 2.8)
    left, right = figure.subplots(1, 2)
    strain = _column(evolution, "shear_strain")
    for name, colour, marker in (("11", BLUE, "o"), ("22", VERMILION, "s")):
        values = _column(evolution, f"S{name}")
        left.plot(strain, values, marker=marker, color=colour, label=rf"$\sigma_{{{name}}}$")
    shear = 0.5 * (_column(evolution, "S12") + _column(evolution, "S21"))
    left.plot(strain, shear, marker="^", color=GREY, label=r"$(\sigma_{12} + \sigma_{21})/2$")
    left.axhline(0, color=LIGHT_GREY, linewidth=0.7, zorder=0)
    left.set(xlabel=STRAIN_LABEL, ylabel="stress (force/length of the input)")
    left.legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    for label, values, style in _shares(evolution):
        right.plot(strain, values, label=label, **style)
    right.set(xlabel=STRAIN_LABEL, ylabel="share", ylim=(0, None))
    right.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return figure


def _shares(evolution: Columns) -> list[tuple[str, Floats, dict[str, str]]]:
    shares = [
        (
            "loops unstable, traction closure",
            _column(evolution, "traction_unstable"),
            {"color": VERMILION, "marker": "s"},
        ),
        (
            "contacts sliding",
            _column(evolution, "sliding_fraction"),
            {"color": GREY, "marker": "^"},
        ),
    ]
    if "negative_W2" in evolution:
        with np.errstate(invalid="ignore"):
            worked = _column(evolution, "negative_W2") / _column(evolution, "survived")
        style = {"color": BLUE, "marker": "o"}
        shares.append((r"survived loops with $W_2 < 0$ in the interval", worked, style))
    return shares


def _column(evolution: Columns, name: str) -> Floats:
    """A column as numbers, None as not a number."""
    return np.array(evolution[name], dtype=float)
