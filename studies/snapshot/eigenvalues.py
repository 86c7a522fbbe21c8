"""Distribution of the eigenvalues of the loops by order."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from studies.snapshot.mechanics import JUDGES, unstable_loops
from studies.snapshot.statistics import GROUPS, Groups, group_rows
from studies.snapshot.table import EIGENVALUES
from studies.style import (
    BLUE,
    GREEN,
    LIGHT_GREY,
    ORANGE,
    TWO_COLUMNS,
    VERMILION,
    new_figure,
    styled,
)

Floats = NDArray[np.float64]
COLOURS = dict(zip(GROUPS, (BLUE, GREEN, ORANGE, VERMILION), strict=True))
NAMES = ("smallest", "middle", "largest")
TITLES = {
    "affine": "affine, spins blocked",
    "traction": "traction, spins blocked",
    "traction_free": "traction, spins free",
}
BINS = 60
# The axes leave out this share of the loops at either end; the first and the last bin hold them.
TAIL = 0.002
# Part of the axis that negative values may take beyond that.
NEGATIVE = 0.15


@styled()
def eigenvalue_distribution(table: dict[str, Any]) -> Figure:
    """Histograms of the three eigenvalues of Ks, a row a closure, a colour a group of orders.

    Parameters
    ----------
    table : dict of str to array
        From `loop_table`, one loop at least.

    Returns
    -------
    matplotlib.figure.Figure
        Nine panels; grey marks negative values, the legends tell the share of loops there.
    """
    figure = new_figure(TWO_COLUMNS, 5.6)
    panels = figure.subplots(len(JUDGES), 3, sharey=True)
    groups = group_rows(table["order"])
    for k, (name, shown) in enumerate(zip(EIGENVALUES, NAMES, strict=True)):
        edges = _edges(np.concatenate([table[f"{closure}_{name}"] for closure in JUDGES]))
        for row, closure in enumerate(JUDGES):
            ax = panels[row, k]
            for group in GROUPS:
                values = table[f"{closure}_{name}"][groups[group]]
                _histogram(ax, values, edges, group)
            ax.set(yscale="log", xlim=(edges[0], edges[-1]))
            if edges[0] < 0:
                ax.axvspan(edges[0], 0, color=LIGHT_GREY, alpha=0.5, linewidth=0, zorder=0)
            if row == len(JUDGES) - 1:
                ax.set_xlabel(shown)
            if k == 0:
                ax.set_ylabel(f"{TITLES[closure]}\nshare of the loops per bin")
            if k == 2:
                _legend(ax, table, closure, groups)
    figure.supxlabel(r"eigenvalue of $K_s$ / mean $k_n$", fontsize=8)
    return figure


def _edges(values: Floats) -> Floats:
    """Bins over nearly all values; zero is a border of a bin."""
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return np.linspace(0.0, 1.0, BINS + 1)
    low, high = np.quantile(known, [TAIL, 1 - TAIL])
    if known.min() < 0:
        low = max(known.min(), min(low, -NEGATIVE * abs(high)))
    width = max((high - low) / BINS, 1e-9)
    first, last = np.floor(low / width), np.ceil(high / width)
    return width * np.arange(first, last + 1.5)


def _histogram(ax: Axes, values: Floats, edges: Floats, group: str) -> None:
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return
    number = np.histogram(np.clip(known, edges[0], edges[-1]), edges)[0]
    ax.stairs(number / len(known), edges, color=COLOURS[group], linewidth=1.0, baseline=None)


def _legend(ax: Axes, table: dict[str, Any], closure: str, groups: Groups) -> None:
    """Share of unstable loops of each group."""
    unstable = unstable_loops(table, closure)
    known = np.isfinite(table[f"{closure}_lambda_min"])
    for group in GROUPS:
        rows = groups[group]
        if known[rows].any():
            share = 100 * np.count_nonzero(unstable[rows]) / np.count_nonzero(known[rows])
            label = f"order {group}: {share:.2g} %"
            ax.plot([], [], color=COLOURS[group], label=label)
    ax.legend(title="unstable", loc="upper left", bbox_to_anchor=(1.0, 1.0))
