"""Figures of the bench: error over time, error over overlap, batches."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from studies.bench.measure import Row, grouped
from studies.style import BLACK, GREY, LINE_COLOURS, key_columns, new_panels, styled

# Stands for an error of zero.
LEAST = 1e-17
EPS = float(np.finfo(float).eps)
OWN_FIGURE = ("batch or one by one", "precision", "compiled or plain")
STIFF = {
    "stiff-grains": "hexagon, elastic",
    "stiff-sliding-grains": "hexagon, all sliding",
    "stiff-sliding-diamond": "diamond, all sliding",
}
MEASURES = {
    "operator_error": "operator",
    "eigenvalue_error": "eigenvalues of Ks",
    "cone_error": "cone's edges (rad)",
    "fraction_error": "unstable fraction",
}
MARKERS = "osD^vPX"


def all_figures(results: Any) -> dict[str, Figure]:
    """Figures by name."""
    groups = grouped(results.rows, "group")
    figures = {}
    fronts = {name: rows for name, rows in groups.items() if name not in OWN_FIGURE}
    if fronts:
        figures["pareto"] = pareto(fronts)
    if all(name in groups for name in OWN_FIGURE[:2]):
        figures["batches"] = batches(groups[OWN_FIGURE[0]], groups[OWN_FIGURE[1]])
    if any(row["case"] in STIFF for row in results.tangents):
        figures["stiff"] = stiff(results.tangents)
    return figures


@styled()
def pareto(groups: dict[str, list[Row]]) -> Figure:
    """Error over time, a panel for each group; the default is ringed."""
    columns = min(3, len(groups))
    lines = -(-len(groups) // columns)
    figure, axes = new_panels(lines, columns, 2.75 * lines)
    axes = axes.ravel()
    for ax, (name, rows) in zip(axes, groups.items(), strict=False):
        _front(ax, name, rows)
    for ax in axes[len(groups) :]:
        ax.set_visible(False)
    for line in range(lines):
        axes[line * columns].set_ylabel("error")
    return figure


def _front(ax: Axes, name: str, rows: list[Row]) -> None:
    methods = grouped(rows, "method")
    for k, (method, own) in enumerate(methods.items()):
        seconds = [row.seconds_per_item for row in own]
        errors = [max(row.error, LEAST) for row in own]
        colour, marker = LINE_COLOURS[k % len(LINE_COLOURS)], MARKERS[k % len(MARKERS)]
        ax.loglog(seconds, errors, marker + "-", color=colour, label=method, markersize=3.5)
    for row in rows:
        if row.default:
            at = (row.seconds_per_item, max(row.error, LEAST))
            ax.plot(*at, "o", markersize=9, markerfacecolor="none", color=BLACK, zorder=5)
    ax.axhline(EPS, color=GREY, linewidth=0.7, linestyle=":")
    ax.set(title=name, xlabel="time per item (s)", ylim=(0.3 * LEAST, 9.0))
    _whole_decades(ax, [row.seconds_per_item for row in rows])
    below: Any = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.24), "fontsize": 5.8}
    ax.legend(**below, ncols=2 if len(methods) > 3 else 1)


def _whole_decades(ax: Axes, seconds: list[float]) -> None:
    """Abscissa from a power of ten to a power of ten: narrow ranges would crowd the labels."""
    low, high = np.floor(np.log10(min(seconds))), np.ceil(np.log10(max(seconds)))
    ax.set_xlim(0.7 * 10.0**low, 1.4 * 10.0**high)
    ax.xaxis.set_minor_formatter(NullFormatter())


@styled()
def batches(sizes: list[Row], precisions: list[Row]) -> Figure:
    """Time per loop over the number of loops at once; error over the overlap by precision."""
    figure, ((left, right),) = new_panels(1, 2, 2.6)
    for k, (method, own) in enumerate(grouped(sizes, "method").items()):
        seconds = [row.seconds_per_item for row in own]
        style: Any = {"color": LINE_COLOURS[k], "label": method}
        left.loglog([row.items for row in own], seconds, MARKERS[k] + "-", **style)
    left.set(xlabel="hexagons at once", ylabel="time per hexagon (s)")
    for k, (method, own) in enumerate(grouped(precisions, "method").items()):
        overlap = [float(row.setting.split()[-1]) for row in own]
        errors = [max(row.error, LEAST) for row in own]
        style = {"color": LINE_COLOURS[k], "label": method}
        right.loglog(overlap, errors, MARKERS[k] + "-", **style)
    right.set(xlabel="overlap $N/(k_n l_0)$", ylabel=r"error of $\lambda_{min}$ over the overlap")
    for ax in (left, right):
        ax.legend()
    return figure


@styled()
def stiff(rows: list[dict[str, Any]]) -> Figure:
    """Errors over the overlap: elastic and sliding loops, both closures."""
    figure, axes = new_panels(3, 2, 6.2, sharex=True, sharey=True)
    for down, (case, what) in enumerate(STIFF.items()):
        for across, closure in enumerate(("affine", "traction")):
            own = [r for r in rows if r["case"] == case and r["closure"] == closure]
            _errors(axes[down, across], own)
            axes[down, across].set_title(f"{what}, {closure} closure")
    for ax in axes[-1]:
        ax.set_xlabel("overlap $N/(k_n l_0)$")
    for ax in axes[:, 0]:
        ax.set_ylabel("error")
    handles, labels = axes[1, 1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=key_columns(figure, 5))
    return figure


def _errors(ax: Axes, rows: list[dict[str, Any]]) -> None:
    overlap = [row["value"] for row in rows]
    for k, (name, label) in enumerate(MEASURES.items()):
        errors = np.maximum([row[name] for row in rows], LEAST)
        ax.loglog(overlap, errors, MARKERS[k] + "-", color=LINE_COLOURS[k], label=label)
    bound = [row["bound"] for row in rows]
    ax.loglog(overlap, bound, "--", color=GREY, label="stated bound of the operator")
    ax.set_ylim(0.3 * LEAST, 1.0)
