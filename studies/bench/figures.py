"""Figures of the bench: error over time, error over overlap, batches."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from studies.style import (
    BLACK,
    GREY,
    LINE_COLOURS,
    axes_or_new,
    figure_of,
    key_columns,
    new_panels,
    styled,
)

if TYPE_CHECKING:
    from studies.bench.run import Measured

# Drawn in place of an error of zero.
LEAST = 1e-17
UNIT_ROUND_OFF = float(np.finfo(float).eps)
# The group with a figure of its own, and the groups without a panel in `pareto`.
BATCH_GROUP = "batch or one by one"
OWN_FIGURE = (BATCH_GROUP, "compiled or plain")
STIFF_CASES = {
    "stiff-grains": "hexagon, elastic",
    "stiff-sliding-grains": "hexagon, all sliding",
    "stiff-sliding-diamond": "diamond, all sliding",
}
ERROR_LABELS = {
    "operator_error": "operator",
    "eigenvalue_error": "eigenvalues of Ks",
    "cone_error": "cone's edges (rad)",
    "fraction_error": "unstable fraction",
}
MARKERS = "osD^vPX"


def all_figures(measured: Measured) -> Iterator[tuple[str, Figure]]:
    """Figures of the groups that were measured, with their names."""
    methods, tangents = measured.methods, measured.tangents
    if len(methods):
        fronts = methods[~methods.group.isin(OWN_FIGURE)]
        if len(fronts):
            yield "pareto", pareto(fronts)
        sizes = methods[methods.group == BATCH_GROUP]
        if len(sizes):
            yield "batches", figure_of(batches(sizes))
    if len(tangents) and tangents.case.isin(STIFF_CASES).any():
        yield "stiff", stiff(tangents)


@styled()
def pareto(rows: pd.DataFrame) -> Figure:
    """Error over time, a panel for each group; the default is ringed."""
    groups = rows.groupby("group", sort=False)
    columns = min(3, groups.ngroups)
    lines = -(-groups.ngroups // columns)
    figure, axes = new_panels(lines, columns, 2.75 * lines)
    for ax, (name, own) in zip(axes.flat, groups, strict=False):
        _draw_front(ax, str(name), own)
    for ax in axes.flat[groups.ngroups :]:
        ax.set_visible(False)
    for ax in axes[:, 0]:
        ax.set_ylabel("error")
    return figure


def _draw_front(ax: Axes, name: str, rows: pd.DataFrame) -> None:
    methods = rows.groupby("method", sort=False)
    for k, (method, own) in enumerate(methods):
        colour, marker = LINE_COLOURS[k % len(LINE_COLOURS)], MARKERS[k % len(MARKERS)]
        at = own.seconds_per_item, own.error.clip(lower=LEAST)
        ax.loglog(*at, marker + "-", color=colour, label=method, markersize=3.5)
    default = rows[rows.default]
    at = default.seconds_per_item, default.error.clip(lower=LEAST)
    ax.plot(*at, "o", markersize=9, markerfacecolor="none", color=BLACK, zorder=5)
    ax.axhline(UNIT_ROUND_OFF, color=GREY, linewidth=0.7, linestyle=":")
    ax.set(title=name, xlabel="time per item (s)", ylim=(0.3 * LEAST, 9.0))
    # From a power of ten to a power of ten: labels of narrow ranges would overlap.
    low, high = rows.seconds_per_item.min(), rows.seconds_per_item.max()
    ax.set_xlim(0.7 * 10.0 ** np.floor(np.log10(low)), 1.4 * 10.0 ** np.ceil(np.log10(high)))
    ax.xaxis.set_minor_formatter(NullFormatter())
    below: Any = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.24), "fontsize": 5.8}
    ax.legend(**below, ncols=2 if methods.ngroups > 3 else 1)


@styled()
def batches(rows: pd.DataFrame, ax: Axes | None = None) -> Axes:
    """Time per loop over the number of loops in one call."""
    ax = axes_or_new(ax)
    for k, (method, own) in enumerate(rows.groupby("method", sort=False)):
        style: Any = {"color": LINE_COLOURS[k], "label": method}
        ax.loglog(own["items"], own.seconds_per_item, MARKERS[k] + "-", **style)
    ax.set(xlabel="hexagons at once", ylabel="time per hexagon (s)")
    ax.legend()
    return ax


@styled()
def stiff(rows: pd.DataFrame) -> Figure:
    """Errors over the overlap: elastic and sliding loops, both closures."""
    figure, axes = new_panels(3, 2, 6.2, sharex=True, sharey=True)
    for down, (case, what) in enumerate(STIFF_CASES.items()):
        for across, closure in enumerate(("affine", "traction")):
            own = rows[(rows.case == case) & (rows.closure == closure)]
            ax = axes[down, across]
            for k, (name, label) in enumerate(ERROR_LABELS.items()):
                at = own.value, own[name].clip(lower=LEAST)
                ax.loglog(*at, MARKERS[k] + "-", color=LINE_COLOURS[k], label=label)
            ax.loglog(own.value, own.bound, "--", color=GREY, label="stated bound of the operator")
            ax.set(title=f"{what}, {closure} closure", ylim=(0.3 * LEAST, 1.0))
    for ax in axes[-1]:
        ax.set_xlabel("overlap $N/(k_n l_0)$")
    for ax in axes[:, 0]:
        ax.set_ylabel("error")
    handles, labels = axes[1, 1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=key_columns(figure, 5))
    return figure
