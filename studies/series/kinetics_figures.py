"""The figure of a series' kinetics: openings against closings, observed and steady orders."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from studies.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    SKY,
    VERMILION,
    key_columns,
    new_panels,
    styled,
)

# Orders beyond it aren't drawn.
LAST_DRAWN = 12
COLOURS = dict(zip(range(4, 9), (SKY, BLUE, GREEN, ORANGE, VERMILION), strict=True))


@styled()
def kinetics_figure(tables: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Openings against closings of every pair of orders; the steady state beside the observed."""
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


def _balance(ax: Axes, table: Mapping[str, Any]) -> None:
    opened, closed = table["openings"], table["closings"]
    last = max(COLOURS)
    merged = np.minimum(table["order_merged"], last)
    top = 2.0 * max(opened.max(), closed.max(), 1)
    ax.plot([0, top], [0, top], color=GREY, linewidth=0.8, label="balance")
    for order, colour in COLOURS.items():
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
