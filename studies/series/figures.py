"""Figures of a series: orders, fates and stress over strain, the exchange of orders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from loops.arrays import Floats
from loops.tracking import ExchangeCounts, LoopFates, exchange_matrix
from patterns import Snapshot
from studies.snapshot.loop_map import loop_drawer
from studies.snapshot.statistics import GROUPS, LAST_ORDER
from studies.style import (
    BLACK,
    BLUE,
    DIVERGING,
    GREY,
    LIGHT_GREY,
    ORANGE,
    ORDER_COLOURS,
    PURPLE,
    SEQUENTIAL,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    figure_of,
    new_panels,
    save_figures,
    say_empty,
    styled,
)

Columns = Mapping[str, Sequence[Any]]
STRAIN_LABEL = r"accumulated shear strain, $\Sigma\,(\varepsilon_1 - \varepsilon_2)/2$"
MARKERS = "os^DvP"
FATES = {
    "split": BLUE,
    "merged": ORANGE,
    "changed": PURPLE,
    "died": BLACK,
}
TITLES = {
    "affine_W2": "affine closure, spins blocked",
    "affine_free_W2": "affine closure, spins free",
    "traction_W2": "traction closure, spins blocked",
    "traction_free_W2": "traction closure, spins free",
}


class MappedInterval(NamedTuple):
    """An interval to draw a map of; what the packing foretells is of all earlier loops."""

    before: Snapshot
    fates: LoopFates
    increments: Mapping[str, NDArray[Any]]
    foretold: Mapping[str, NDArray[Any]] = MappingProxyType({})


def draw_series(
    folder: Path,
    evolution: Columns,
    exchange: ExchangeCounts,
    increments: Mapping[str, NDArray[Any]],
    mapped: MappedInterval | None,
    source: dict[str, Any],
) -> list[str]:
    """Draw a series as PNG and SVG."""
    figures = {"orders_over_strain": orders_over_strain(evolution)}
    if len(evolution["shear_strain"]) > 1:
        figures["fates"] = figure_of(fates_over_strain(evolution))
        figures["exchange"] = figure_of(exchange_heatmap(exchange))
    if "S11" in evolution:
        figures["stress_strain"] = stress_strain(evolution)
    if "probe_w2" in evolution:
        figures["probes"] = probes_over_strain(evolution)
    if len(increments.get("W2", ())):
        figures["work_signs"] = work_signs(increments)
    if mapped is not None and "W2" in mapped.increments:
        figures["work_map"] = figure_of(work_map(mapped))
    save_figures(figures, folder, source)
    return list(figures)


@styled()
def orders_over_strain(evolution: Columns) -> Figure:
    """Shares of the loops by order along the series, in number and in area."""
    figure, (axes,) = new_panels(1, 2, 2.6, sharey=True)
    strain = _column(evolution, "shear_strain")
    for ax, kind, title in zip(
        axes,
        ("share", "area_share"),
        ("in number", "in area"),
        strict=True,
    ):
        for n, (group, colour, marker) in enumerate(
            zip(GROUPS, ORDER_COLOURS, MARKERS, strict=True)
        ):
            values = _column(evolution, f"{kind}_{3 + n}")
            ax.plot(strain, values, marker=marker, color=colour, label=f"order {group}")
        ax.set(xlabel=STRAIN_LABEL, title=title)
    figure.axes[0].set(ylabel="share of the loops", ylim=(0, None))
    key = figure.axes[0].get_legend_handles_labels()
    figure.legend(*key, loc="outside upper center", ncols=3)
    return figure


@styled()
def fates_over_strain(evolution: Columns, ax: Axes | None = None) -> Axes:
    """What became of the loops of each interval that did not survive it, stacked."""
    ax = axes_or_new(ax, TWO_COLUMNS, 2.6)
    counts = {name: _column(evolution, name)[1:] for name in FATES}
    total = np.maximum(_column(evolution, "survived")[1:] + sum(counts.values()), 1)
    place, bottom = _column(evolution, "snapshot")[1:], np.zeros(len(total))
    for name, colour in FATES.items():
        share = 100 * counts[name] / total
        ax.bar(place, share, 0.6, bottom=bottom, color=colour, label=name)
        bottom = bottom + share
    born = 100 * _column(evolution, "born")[1:] / total
    ax.plot(place, born, "x", color=VERMILION, label="born, over\nearlier loops")
    if not bottom.any() and not born.any():
        say_empty(ax, "every loop survived every interval")
    # A bar is no wider than one of eight.
    wide = max(8 - np.ptp(place), 1) / 2
    ax.set(xlim=(place[0] - wide, place[-1] + wide), ylim=(0, None))
    ax.set_xticks(place[:: len(place) // 12 + 1])
    ax.set(xlabel="interval, by its later snapshot", ylabel="share of the earlier loops (%)")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), title="did not survive")
    return ax


@styled()
def exchange_heatmap(exchange: ExchangeCounts, ax: Axes | None = None) -> Axes:
    """Exchange matrix between orders: counts as numbers, shares of each row as colours."""
    ax = axes_or_new(ax, 4.6, 3.9)
    matrix = exchange_matrix(exchange, LAST_ORDER)
    orders = [*range(3, LAST_ORDER + 1), 0]
    counts = matrix[np.ix_(orders, orders)]
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    palette = mpl.colormaps[SEQUENTIAL].with_extremes(bad="white")
    # Few loops change their order: the colours tell one in a thousand from none.
    image = ax.imshow(np.ma.masked_equal(share, 0), cmap=palette, norm=LogNorm(1e-3, 1))
    for (row, column), number in np.ndenumerate(counts):
        if number:
            colour = "white" if share[row, column] < 0.04 else BLACK
            ax.text(column, row, f"{number}", ha="center", va="center", color=colour, fontsize=6)
    ax.set_xticks(range(len(orders)), labels=[*GROUPS, "died"])
    ax.set_yticks(range(len(orders)), labels=[*GROUPS, "born"])
    ax.set(xlabel="order of the successor", ylabel="order before")
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    figure_of(ax).colorbar(image, ax=ax, label="share of the row", shrink=0.8, extend="min")
    return ax


@styled()
def stress_strain(evolution: Columns) -> Figure:
    """Stress of the sample along the series, and the unstable and sliding shares below it."""
    figure, ((left, right),) = new_panels(1, 2, 2.8)
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


@styled()
def probes_over_strain(evolution: Columns) -> Figure:
    """Smallest second-order work and the share of unstable directions, above the stress ratio."""
    figure, ((left, right),) = new_panels(1, 2, 2.6)
    strain = _column(evolution, "shear_strain")
    left.plot(strain, _column(evolution, "probe_w2"), "o-", color=BLUE)
    left.axhline(0, color=LIGHT_GREY, linewidth=0.7, zorder=0)
    left.set(xlabel=STRAIN_LABEL, ylabel=r"smallest $w_2$ of the sample")
    share = 100 * _column(evolution, "probe_unstable_fraction")
    right.plot(strain, share, "s-", color=VERMILION)
    right.set(xlabel=STRAIN_LABEL, ylabel=r"directions with $W_2 < 0$ (%)", ylim=(0, None))
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


@styled()
def work_map(mapped: MappedInterval, ax: Axes | None = None) -> Axes:
    """Loops of the earlier snapshot by their normalised actual second-order work."""
    before, fates, increments, _ = mapped
    ax = axes_or_new(ax, 4.6, 4.0)
    work = np.full(len(fates.before), np.nan)
    work[increments["loop_before"]] = increments["w2"]
    palette = mpl.colormaps[DIVERGING].with_extremes(bad=LIGHT_GREY)
    draw = loop_drawer(before)
    colours = draw(ax, work, palette, Normalize(-1.0, 1.0))
    bar = figure_of(ax).colorbar(colours, ax=ax, shrink=0.8)
    bar.set_label(r"actual $w_2 = dP:dH/(|dP||dH|)$, corotated")
    handle = Patch(color=LIGHT_GREY, label="did not survive the interval")
    ax.legend(handles=[handle], loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    return ax


@styled()
def work_signs(increments: Mapping[str, NDArray[Any]]) -> Figure:
    """Distribution of the actual work by the sign of its prediction."""
    figure, axes = new_panels(2, 2, 4.6, sharex=True, sharey=True)
    actual, bins = increments["w2"], np.linspace(-1, 1, 41)
    for ax, (name, title) in zip(axes.ravel(), TITLES.items(), strict=True):
        predicted = increments[name]
        known = np.isfinite(predicted) & (actual != 0)
        parts = actual[known & (predicted < 0)], actual[known & (predicted >= 0)]
        labels = [rf"predicted $W_2 {sign} 0$" for sign in ("<", r"\geq")]
        ax.hist(parts, bins, stacked=True, color=[VERMILION, BLUE], label=labels)
        ax.axvline(0, color=GREY, linewidth=0.8)
        ax.set_title(f"{title}\nright: {_rate(*parts)}")
    for ax in axes[1]:
        ax.set(xlabel=r"actual $w_2$", xlim=(-1, 1))
    for ax in axes[:, 0]:
        ax.set_ylabel("survived loops")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _rate(negative: Floats, positive: Floats) -> str:
    """Shares of the loops of either actual sign that were predicted so."""
    found = []
    for right, wrong, sign in (
        (np.sum(negative < 0), np.sum(positive < 0), "<"),
        (np.sum(positive > 0), np.sum(negative > 0), ">"),
    ):
        share = f"{right / (right + wrong):.0%}" if right + wrong else "none"
        found.append(rf"{share} of $w_2 {sign} 0$")
    return ", ".join(found)
