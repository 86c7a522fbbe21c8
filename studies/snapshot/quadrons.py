"""Quadrons of a snapshot: table, summary and figure of `grainloops snapshot --quadrons`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from loops import quadrons
from loops.arrays import Floats, Integers
from patterns import Snapshot
from studies.output import Columns, Summary
from studies.style import BLACK, GREY, ORDER_COLOURS, new_panels, styled

# Orders that have a curve of their own, all larger ones share the last.
DRAWN_ORDERS = range(3, 9)
# Bins of areas over the mean area, up to so many times it.
BINS = np.linspace(-0.5, 5.0, 56)


def quadron_columns(snapshot: Snapshot) -> Columns:
    """Return one row a quadron: its loop and grain, area and shape; about the grains' centres."""
    faces = snapshot.faces
    found = quadrons(snapshot.graph, faces)
    area = found.area
    return {
        "loop": np.searchsorted(faces.loops, found.face),
        "order": found.order,
        "grain": snapshot.ids[found.grain],
        "area": area,
        "relative_area": area / area.mean() if len(area) else area,
        "elongation": found.elongation,
        "skew": found.skew,
    }


def quadron_summary(table: Columns) -> Summary:
    """Return number, mean and spread of the quadrons, and both by the order of their loops."""
    area, order = table["area"], table["order"]
    if not len(area):
        return {"count": 0}
    orders = np.unique(order)
    return {
        "count": len(area),
        "mean_area": float(area.mean()),
        "variation": float(area.std() / area.mean()),
        "turned_over": float((area < 0).mean()),
        "share_by_order": {str(n): float((order == n).mean()) for n in orders},
        "mean_by_order": {str(n): float(area[order == n].mean() / area.mean()) for n in orders},
    }


def densities(relative: Floats, order: Integers) -> dict[int, Floats]:
    """Return densities of relative areas on `BINS`: of all (order 0), and of each drawn order.

    Those of the orders are parts of the whole: they add up to it.
    """
    width = np.diff(BINS)
    grouped = np.minimum(order, DRAWN_ORDERS[-1])
    whole = {0: np.ones(len(order), dtype=bool)}
    rows = whole | {n: grouped == n for n in DRAWN_ORDERS}
    return {
        n: np.histogram(relative[own], BINS)[0] / width / max(len(relative), 1)
        for n, own in rows.items()
    }


@styled()
def quadron_figure(table: Columns) -> Figure:
    """Draw the areas over their mean: of all, by order of the loop, and the means of each order."""
    figure, ((left, right),) = new_panels(1, 2, 2.8)
    found = densities(table["relative_area"], table["order"])
    draw_densities(left, found)
    order, relative = table["order"], table["relative_area"]
    for n in np.unique(order[order <= 3 * DRAWN_ORDERS[-1]]):
        own = relative[order == n]
        error = own.std() / np.sqrt(len(own))
        right.errorbar(n, own.mean(), error, fmt="o", color=BLACK, markersize=3.5)
    right.axhline(1.0, color=GREY, linewidth=0.8)
    right.set(xlabel="loop order (number of grains)", ylabel="mean area over that of all (–)")
    return figure


def draw_densities(
    ax: Axes, found: dict[int, Floats], errors: Mapping[int, Floats] | None = None, **how: Any
) -> None:
    """Draw densities of areas over the mean, the whole in black and its parts by order."""
    middle = 0.5 * (BINS[:-1] + BINS[1:])
    for n, values in found.items():
        shown = values > 0
        last = DRAWN_ORDERS[-1]
        label = "all" if n == 0 else f"order {n}{'+' if n == last else ''}"
        colour = BLACK if n == 0 else ORDER_COLOURS[n - DRAWN_ORDERS[0]]
        error = None if errors is None else errors[n][shown]
        # The whole is wider: where one order has all, its line is seen on it.
        width = 1.3 if n else 2.6
        look: Any = {"color": colour, "label": label, "linewidth": width, "elinewidth": 0.6} | how
        ax.errorbar(middle[shown], values[shown], error, **look)
    ax.set(yscale="log", xlabel="area of a quadron over the mean (–)", ylabel="density (–)")
    ax.legend(ncols=2)
