"""Figures of a series that its packings foretell: what that is worth, and a map of one interval."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from loops.arrays import Floats
from studies.series.figures import MappedInterval
from studies.series.targets import BY_EVENTS, OTHERS, TARGET
from studies.snapshot.loop_map import loop_drawer
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
    VERMILION,
    figure_of,
    key_columns,
    new_panels,
    styled,
)

TARGETS = (TARGET, *OTHERS)
TITLES = {
    "W2_negative": r"negative work, $W_2 < 0$",
    "nonaffine": "least affine tenth",
    "contact_lost": "a contact lost",
    "topology": "topology changed",
}
NAMES = {
    "packing": "packing",
    "packing_path": "packing, by events",
    "replay": "replay",
    "own_motion": "own motion (bound)",
    "persistence": "persistence",
    "traction_free": "traction, free spins",
    "traction": "traction, blocked",
    "affine_free": "affine, free spins",
    "affine": "affine, blocked",
    "packing_lambda_min": r"$\lambda_{\min}$ in its packing",
    "traction_free_lambda_min": r"$\lambda_{\min}$ traction, free",
    "traction_lambda_min": r"$\lambda_{\min}$ traction, blocked",
    "affine_lambda_min": r"$\lambda_{\min}$ affine, blocked",
    "order": "order",
    "sliding": "number sliding",
    "smallest_N": "smallest N",
}
# Followed from interval to interval; the others are told by their spread alone.
FOLLOWED = {
    "packing": (BLUE, "o"),
    "own_motion": (GREEN, "^"),
    "persistence": (VERMILION, "s"),
    "traction_free": (ORANGE, "D"),
    "order": (PURPLE, "v"),
    "smallest_N": (SKY, "P"),
}
Table = Mapping[str, Sequence[Any]]


@styled()
def skill_by_predictor(table: Table) -> Figure:
    """AUC of every predictor, a dot an interval and the mean of them, for each target."""
    walked = set(table["predictor"])
    names = [name for name in NAMES if name in walked or name not in BY_EVENTS]
    figure, axes = new_panels(2, 2, 4.6, sharex=True, sharey=True)
    axes = axes.ravel()
    for ax, target in zip(axes, TARGETS, strict=True):
        for place, name in enumerate(names):
            auc = _column(table, "auc", target, name)
            auc = auc[np.isfinite(auc)]
            colour = FOLLOWED.get(name, (GREY, ""))[0]
            ax.plot(auc, np.full(len(auc), place), "o", color=colour, alpha=0.35, markersize=3)
            if not len(auc):
                ax.annotate(
                    "says nothing of it", (0.03, place), xycoords=("axes fraction", "data"),
                    va="center", color=GREY, fontsize=6,
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
                )  # fmt: skip
            if len(auc):
                ax.plot(auc.mean(), place, "|", color=BLACK, markersize=9, markeredgewidth=1.6)
        past = _column(table, "auc", target, "persistence")
        if np.isfinite(past).any():
            ax.axvline(np.nanmean(past), color=VERMILION, linestyle="--", linewidth=0.9)
        ax.axvline(0.5, color=LIGHT_GREY, linewidth=0.9, zorder=0)
        ax.set_title(f"{TITLES[target]}\nbase rate {_base(table, target)}")
    axes[0].set_yticks(range(len(names)), labels=[NAMES[name] for name in names])
    axes[0].invert_yaxis()
    for ax in axes[2:]:
        ax.set_xlabel("AUC (bar: mean; dashed: persistence)")
    return figure


@styled()
def skill_by_interval(table: Table) -> Figure:
    """AUC of the main predictors from interval to interval, above the base rate."""
    figure, axes = new_panels(2, 2, 4.4, sharex=True, sharey=True)
    axes = axes.ravel()
    for ax, target in zip(axes, TARGETS, strict=True):
        for name, (colour, marker) in FOLLOWED.items():
            _follow(ax, table, target, name, color=colour, marker=marker, label=NAMES[name])
        after, base = _interval(table, target, "order"), _column(table, "base", target, "order")
        ax.fill_between(after, base, color=LIGHT_GREY, step="mid", label="base rate", zorder=0)
        ax.axhline(0.5, color=GREY, linewidth=0.7, zorder=0)
        ax.set(title=TITLES[target], ylim=(0, 1.02))
    for ax in axes[2:]:
        ax.set_xlabel("interval, by the snapshot that ends it")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    for ax in axes[::2]:
        ax.set_ylabel("AUC; share of the loops")
    lines: dict[str, Artist] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        lines |= dict(zip(labels, handles, strict=True))
    beside = key_columns(figure, 4)
    figure.legend(list(lines.values()), list(lines), loc="outside lower center", ncols=beside)
    return figure


def _follow(ax: Axes, table: Table, target: str, name: str, **style: Any) -> None:
    auc = _column(table, "auc", target, name)
    if np.isfinite(auc).any():
        ax.plot(_interval(table, target, name), auc, markersize=3.5, linewidth=0.9, **style)


def _rows(table: Table, target: str, name: str) -> Any:
    return (np.array(table["target"]) == target) & (np.array(table["predictor"]) == name)


def _column(table: Table, column: str, target: str, name: str) -> Floats:
    return np.array(table[column], dtype=float)[_rows(table, target, name)]


def _interval(table: Table, target: str, name: str) -> Floats:
    return _column(table, "snapshot_after", target, name)


def _base(table: Table, target: str) -> str:
    base = _column(table, "base", target, "order")
    base = base[np.isfinite(base)]
    if not len(base):
        return "-"
    return f"{base.mean():.3f} ({base.min():.3f} to {base.max():.3f})"


@styled()
def nonaffinity_map(mapped: MappedInterval) -> Figure:
    """Non-affinity that the packing foretells of every loop beside the actual one."""
    before, fates, increments, foretold = mapped
    actual = np.full(len(fates.before), np.nan)
    actual[increments["loop_before"]] = increments["nonaffinity"]
    figure, (axes,) = new_panels(1, 2, 3.6)
    known = actual[np.isfinite(actual) & (actual > 0)]
    low, high = np.percentile(known, [2, 98]) if len(known) else (0.1, 10.0)
    high = max(high, 1.01 * low)
    scale = LogNorm(low, high)
    palette = mpl.colormaps[SEQUENTIAL].with_extremes(bad=LIGHT_GREY)
    draw = loop_drawer(before)
    panels = {"foretold by the packing": foretold["packing_nonaffinity"], "actual": actual}
    for ax, (title, values) in zip(axes, panels.items(), strict=True):
        colours = draw(ax, values, palette, scale)
        ax.set_title(title)
    bar = figure_of(axes[0]).colorbar(colours, ax=axes, shrink=0.75, extend="both")
    ticks = [tick for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50) if low < tick < high]
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks], minor=False)
    bar.minorticks_off()
    bar.set_label(r"non-affinity, $|\varepsilon_l - \varepsilon|\,/\,|\varepsilon|$")
    handle = Patch(color=LIGHT_GREY, label="carries nothing; did not survive the interval")
    figure.legend(handles=[handle], loc="outside lower center")
    return figure
