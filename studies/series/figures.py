"""Figures over a series: orders, fates, stress, probes, exchange of orders, survival, kinetics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from loops.arrays import Floats
from loops.tracking import ExchangeCounts, exchange_matrix
from studies.series.survival import ALL, VERDICTS, pooled
from studies.snapshot.figures import JUDGE_TITLES
from studies.snapshot.statistics import GROUPS, LAST_ORDER
from studies.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    ORANGE,
    ORDER_COLOURS,
    PURPLE,
    SEQUENTIAL,
    SKY,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    figure_of,
    key_columns,
    new_panels,
    say_empty,
    styled,
)

STRAIN_LABEL = r"accumulated shear strain, $\Sigma\,(\varepsilon_1 - \varepsilon_2)/2$"
ORDER_MARKERS = "os^DvP"
FATE_COLOURS = {
    "split": BLUE,
    "merged": ORANGE,
    "changed": PURPLE,
    "died": BLACK,
}
LOOKS = dict(zip(VERDICTS, ((BLUE, "o"), (VERMILION, "s"), (GREY, "^")), strict=True))
# Largest order in the figure of kinetics, and colours of the merged loops by order.
LAST_DRAWN = 12
MERGED = dict(zip(range(4, 9), (SKY, BLUE, GREEN, ORANGE, VERMILION), strict=True))


@styled()
def orders_over_strain(evolution: pd.DataFrame) -> Figure:
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
            zip(GROUPS, ORDER_COLOURS, ORDER_MARKERS, strict=True)
        ):
            values = _column(evolution, f"{kind}_{3 + n}")
            ax.plot(strain, values, marker=marker, color=colour, label=f"order {group}")
        ax.set(xlabel=STRAIN_LABEL, title=title)
    figure.axes[0].set(ylabel="share of the loops", ylim=(0, None))
    key = figure.axes[0].get_legend_handles_labels()
    figure.legend(*key, loc="outside upper center", ncols=3)
    return figure


@styled()
def fates_over_strain(evolution: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Shares of the loops of each interval that did not survive it, by fate, stacked."""
    ax = axes_or_new(ax, TWO_COLUMNS, 2.6)
    counts = {name: _column(evolution, name)[1:] for name in FATE_COLOURS}
    total = np.maximum(_column(evolution, "survived")[1:] + sum(counts.values()), 1)
    place, bottom = _column(evolution, "snapshot")[1:], np.zeros(len(total))
    for name, colour in FATE_COLOURS.items():
        share = 100 * counts[name] / total
        ax.bar(place, share, 0.6, bottom=bottom, color=colour, label=name)
        bottom = bottom + share
    born = 100 * _column(evolution, "born")[1:] / total
    ax.plot(place, born, "x", color=VERMILION, label="born, over\nearlier loops")
    if not bottom.any() and not born.any():
        say_empty(ax, "every loop survived every interval")
    # Fewer than eight bars keep the width of eight.
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
    # Few loops change their order: the colours must show one in a thousand.
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
def stress_strain(evolution: pd.DataFrame) -> Figure:
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
    unstable = _column(evolution, "traction_unstable")
    right.plot(strain, unstable, "s-", color=VERMILION, label="loops unstable, traction closure")
    sliding = _column(evolution, "sliding_fraction")
    right.plot(strain, sliding, "^-", color=GREY, label="contacts sliding")
    if "negative_W2" in evolution:
        with np.errstate(invalid="ignore"):
            worked = _column(evolution, "negative_W2") / _column(evolution, "survived")
        label = r"survived loops with $W_2 < 0$ in the interval"
        right.plot(strain, worked, "o-", color=BLUE, label=label)
    right.set(xlabel=STRAIN_LABEL, ylabel="share", ylim=(0, None))
    right.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return figure


@styled()
def probes_over_strain(evolution: pd.DataFrame) -> Figure:
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


def _column(evolution: pd.DataFrame, name: str) -> Floats:
    """A column as numbers, nan where it is missing."""
    return evolution[name].to_numpy(dtype=float, na_value=np.nan)


@styled()
def survival_by_verdict(table: pd.DataFrame) -> Figure:
    """Share of the loops that survive, a row a judge: interval by interval, and order by order.

    Bars are Wilson's 95 % intervals: the uncertainty of so few loops, not the spread between
    intervals.
    """
    present, numbers = table["judge"].unique(), table["snapshot_after"].unique()
    figure, panels = new_panels(len(present), 2, 0.6 + 1.5 * len(present), sharey=True)
    orders = range(3, 3 + len(GROUPS))
    for judge, (left, right) in zip(present, panels, strict=True):
        for shift, (verdict, look) in zip((-0.12, 0.12, 0.0), LOOKS.items(), strict=True):
            own = table[(table["judge"] == judge) & (table["verdict"] == verdict)]
            whole = own[own["order"] == ALL]
            _draw_shares(left, whole["snapshot_after"] + shift, whole, look, verdict)
            found = {n: pooled(table, judge, verdict, n) for n in orders}
            shares = pd.DataFrame({n: one for n, one in found.items() if one is not None}).T
            _draw_shares(right, shares.index + shift, shares, look, verdict)
        left.set_xticks(numbers[:: len(numbers) // 12 + 1])
        left.set_xlim(numbers[0] - 0.5, numbers[-1] + 0.5)
        right.set_xticks(orders, labels=GROUPS)
        right.set_xlim(2.5, 2.5 + len(GROUPS))
        left.set_ylabel(f"{JUDGE_TITLES[judge]}\nshare that survives")
    keys = [ax.get_legend_handles_labels() for ax in figure.axes]
    shown = {label: handle for key in keys for handle, label in zip(*key, strict=True)}
    figure.legend(list(shown.values()), list(shown), loc="outside upper center", ncols=3)
    low = table["share_low"].min()
    figure.axes[0].set_ylim(low - 0.05 * (1.0 - low), 1.0 + 0.05 * (1.0 - low))
    left.set_xlabel("interval, by its later snapshot")
    right.set_xlabel("order before, all intervals together")
    return figure


def _draw_shares(
    ax: Axes, place: Any, rows: pd.DataFrame, look: tuple[str, str], name: str
) -> None:
    """Draw the shares of survived loops with their intervals."""
    if rows.empty:
        return
    share, low, high = (
        rows[key].to_numpy(dtype=float) for key in ("share", "share_low", "share_high")
    )
    colour, marker = look
    ax.errorbar(
        place, share, (share - low, high - share), fmt=marker,
        color=colour, markersize=3.5, elinewidth=0.9, label=name,
    )  # fmt: skip


@styled()
def kinetics_figure(tables: Mapping[str, pd.DataFrame]) -> Figure:
    """Openings against closings of every pair of orders; steady state and observed orders."""
    figure, ((left, right),) = new_panels(1, 2, 3.4)
    _balance(left, tables["kinetics"])
    key, beside = left.get_legend_handles_labels(), key_columns(figure, 6)
    figure.legend(*key, title="merged loop", loc="outside lower center", ncols=beside)
    orders = tables["kinetics_orders"]
    shown = orders["order"] <= LAST_DRAWN
    order, share = orders["order"][shown], orders["steady_share"][shown]
    right.plot(order, orders["observed_share"][shown], "o", color=BLUE, label="observed, mean")
    known = bool(np.isfinite(share).any())
    right.errorbar(
        order + 0.15, share, orders["steady_error"][shown], fmt="s", color=VERMILION,
        markersize=3.5, elinewidth=0.8, capsize=2.0,
        label="steady state of the rates" if known else "steady state: too few events",
    )  # fmt: skip
    right.set(yscale="log", xlabel="loop order (number of grains)", ylabel="share of the loops")
    least = orders["observed_share"][shown]
    right.set_ylim(0.3 * least[least > 0].min(), 1.0)
    right.legend()
    return figure


def _balance(ax: Axes, table: pd.DataFrame) -> None:
    """Draw openings against closings, a colour for each order of the merged loop."""
    opened, closed = table["openings"], table["closings"]
    last = max(MERGED)
    merged = np.minimum(table["order_merged"], last)
    top = 2.0 * max(opened.max(), closed.max(), 1)
    ax.plot([0, top], [0, top], color=GREY, linewidth=0.8, label="balance")
    for order, colour in MERGED.items():
        rows = merged == order
        ax.errorbar(
            closed[rows], opened[rows], np.sqrt(opened[rows]), np.sqrt(closed[rows]), fmt="o",
            color=colour, markersize=3.5, elinewidth=0.6,
            label=f"order {order}{'+' if order == last else ''}",
        )  # fmt: skip
    for m, n, x, y, p in zip(
        table["order_1"], table["order_2"], closed, opened, table["balance_p"], strict=True
    ):
        if p < 0.01 and x > 0 and y > 0:
            ax.annotate(f"{m}+{n}", (x, y), (3, 3), textcoords="offset points", color=BLACK,
                        fontsize=6)  # fmt: skip
    ax.set(xscale="symlog", yscale="symlog", xlim=(0, top), ylim=(0, top), aspect="equal")
    ticks = [0] + [k for k in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 10000) if k <= top]
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_ticks(ticks if len(ticks) < 9 else [0, *(10**k for k in range(5) if 10**k <= top)])
        axis.set_major_formatter("{x:.0f}")
        axis.set_minor_locator(NullLocator())
    ax.set(xlabel="contacts that closed (splits)", ylabel="contacts that opened (mergers)")
