"""Figures of predictions in a series: second-order work, skill of each predictor, maps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from loops.arrays import Floats
from loops.tracking import LoopFates
from patterns import Snapshot
from studies.series.skill import (
    CLOSURE_PREDICTORS,
    EVENT_PREDICTORS,
    INDICATORS,
    PREDICTORS,
    TARGETS,
)
from studies.snapshot.figures import draw_scaled, loop_drawer
from studies.style import (
    BLACK,
    BLUE,
    DIVERGING,
    GREEN,
    GREY,
    LIGHT_GREY,
    ORANGE,
    PURPLE,
    SEQUENTIAL,
    SKY,
    VERMILION,
    figure_key,
    figure_of,
    key_columns,
    new_panels,
    panel,
    styled,
)

# Predictors drawn from interval to interval; the figure of all predictors shows the others.
FOLLOWED = {
    "packing": (BLUE, "o"),
    "own_motion": (GREEN, "^"),
    "persistence": (VERMILION, "s"),
    "traction_free": (ORANGE, "D"),
    "order": (PURPLE, "v"),
    "smallest_N": (SKY, "P"),
}


class MappedInterval(NamedTuple):
    """An interval to draw maps of; the packing's predictions are for all earlier loops."""

    before: Snapshot
    fates: LoopFates
    increments: Mapping[str, Any]
    predicted: Mapping[str, Any]


@styled()
def work_signs(increments: Mapping[str, Any]) -> Figure:
    """Distribution of the actual work by the sign of its prediction."""
    figure, axes = new_panels(2, 2, 4.6, sharex=True, sharey=True)
    actual, bins = np.asarray(increments["w2"]), np.linspace(-1, 1, 41)
    for ax, (name, column) in zip(axes.ravel(), CLOSURE_PREDICTORS.items(), strict=True):
        predicted = np.asarray(increments[column])
        known = np.isfinite(predicted) & (actual != 0)
        parts = actual[known & (predicted < 0)], actual[known & (predicted >= 0)]
        labels = [rf"predicted $W_2 {sign} 0$" for sign in ("<", r"\geq")]
        ax.hist(parts, bins, stacked=True, color=[VERMILION, BLUE], label=labels)
        ax.axvline(0, color=GREY, linewidth=0.8)
        # Shares of the loops of negative and of positive work whose sign was predicted rightly.
        rates = []
        for sign, right, wrong in (
            ("<", np.sum(parts[0] < 0), np.sum(parts[1] < 0)),
            (">", np.sum(parts[1] > 0), np.sum(parts[0] > 0)),
        ):
            share = f"{right / (right + wrong):.0%}" if right + wrong else "none"
            rates.append(rf"{share} of $w_2 {sign} 0$")
        ax.set_title(f"{PREDICTORS[name]}\nsign predicted: {', '.join(rates)}")
    for ax in axes[1]:
        ax.set(xlabel=r"actual $w_2$", xlim=(-1, 1))
    for ax in axes[:, 0]:
        ax.set_ylabel("survived loops")
    figure_key(figure, ncols=2)
    return figure


@panel(4.6, 4.0)
def work_map(mapped: MappedInterval, ax: Axes) -> None:
    """Loops of the earlier snapshot by their normalised actual second-order work."""
    before, fates, increments, _ = mapped
    work = np.full(len(fates.before), np.nan)
    work[increments["loop_before"]] = increments["w2"]
    palette = mpl.colormaps[DIVERGING].with_extremes(bad=LIGHT_GREY)
    shown: Any = {"label": r"actual $w_2 = dP:dH/(|dP||dH|)$, corotated", "shrink": 0.8}
    draw_scaled(loop_drawer(before), ax, work, palette, Normalize(-1.0, 1.0), **shown)
    handle = Patch(color=LIGHT_GREY, label="did not survive the interval")
    ax.legend(handles=[handle], loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)


@styled()
def skill_by_predictor(table: pd.DataFrame) -> Figure:
    """AUC of every predictor, one dot per interval and the mean of them, for each target."""
    walked = set(table["predictor"])
    asked = {*EVENT_PREDICTORS, *INDICATORS}
    names = [name for name in PREDICTORS if name in walked or name not in asked]
    figure, axes = new_panels(2, 2, 4.6 if len(names) < 20 else 7.0, sharex=True, sharey=True)
    axes = axes.ravel()
    for ax, target in zip(axes, TARGETS, strict=True):
        for place, name in enumerate(names):
            auc = _column(table, "auc", target, name)
            auc = auc[np.isfinite(auc)]
            colour = FOLLOWED.get(name, (GREY, ""))[0]
            ax.plot(auc, np.full(len(auc), place), "o", color=colour, alpha=0.35, markersize=3)
            if not len(auc):
                ax.annotate(
                    "not applicable", (0.03, place), xycoords=("axes fraction", "data"),
                    va="center", color=GREY, fontsize=6,
                    bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
                )  # fmt: skip
            if len(auc):
                ax.plot(auc.mean(), place, "|", color=BLACK, markersize=9, markeredgewidth=1.6)
        past = _column(table, "auc", target, "persistence")
        if np.isfinite(past).any():
            ax.axvline(np.nanmean(past), color=VERMILION, linestyle="--", linewidth=0.9)
        ax.axvline(0.5, color=LIGHT_GREY, linewidth=0.9, zorder=0)
        base = _column(table, "base", target, "order")
        base = base[np.isfinite(base)]
        shown = f"{base.mean():.3f} ({base.min():.3f} to {base.max():.3f})" if len(base) else "-"
        ax.set_title(f"{TARGETS[target]}\nbase rate {shown}")
    axes[0].set_yticks(range(len(names)), labels=[PREDICTORS[name] for name in names])
    axes[0].invert_yaxis()
    for ax in axes[2:]:
        ax.set_xlabel("AUC (bar: mean; dashed: persistence)")
    return figure


@styled()
def skill_by_interval(table: pd.DataFrame) -> Figure:
    """AUC of the main predictors from interval to interval, above the base rate."""
    figure, axes = new_panels(2, 2, 4.4, sharex=True, sharey=True)
    axes = axes.ravel()
    for ax, target in zip(axes, TARGETS, strict=True):
        for name, (colour, marker) in FOLLOWED.items():
            auc = _column(table, "auc", target, name)
            if np.isfinite(auc).any():
                look: Any = {"marker": marker, "markersize": 3.5, "linewidth": 0.9}
                after = _column(table, "snapshot_after", target, name)
                ax.plot(after, auc, color=colour, label=PREDICTORS[name], **look)
        after, base = (
            _column(table, column, target, "order") for column in ("snapshot_after", "base")
        )
        ax.fill_between(after, base, color=LIGHT_GREY, step="mid", label="base rate", zorder=0)
        ax.axhline(0.5, color=GREY, linewidth=0.7, zorder=0)
        ax.set(title=TARGETS[target], ylim=(0, 1.02))
    for ax in axes[2:]:
        ax.set_xlabel("interval, by the snapshot that ends it")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    for ax in axes[::2]:
        ax.set_ylabel("AUC; share of the loops")
    figure_key(figure, ncols=key_columns(figure, 4))
    return figure


def _column(table: pd.DataFrame, column: str, target: str, name: str) -> Floats:
    rows = (table["target"] == target) & (table["predictor"] == name)
    return table.loc[rows, column].to_numpy(dtype=float)


@styled()
def nonaffinity_map(mapped: MappedInterval) -> Figure:
    """Non-affinity of every loop: predicted by the packing, and actual."""
    before, fates, increments, predicted = mapped
    actual = np.full(len(fates.before), np.nan)
    actual[increments["loop_before"]] = increments["nonaffinity"]
    figure, (axes,) = new_panels(1, 2, 3.6)
    known = actual[np.isfinite(actual) & (actual > 0)]
    low, high = np.percentile(known, [2, 98]) if len(known) else (0.1, 10.0)
    high = max(high, 1.01 * low)
    scale = LogNorm(low, high)
    palette = mpl.colormaps[SEQUENTIAL].with_extremes(bad=LIGHT_GREY)
    draw = loop_drawer(before)
    panels = {"predicted by the packing": predicted["packing_nonaffinity"], "actual": actual}
    for ax, (title, values) in zip(axes, panels.items(), strict=True):
        draw(ax, values, palette, scale)
        ax.set_title(title)
    colours = ScalarMappable(scale, palette)
    bar = figure_of(axes[0]).colorbar(colours, ax=axes, shrink=0.75, extend="both")
    ticks = [tick for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50) if low < tick < high]
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks], minor=False)
    bar.minorticks_off()
    bar.set_label(r"non-affinity, $|\varepsilon_l - \varepsilon|\,/\,|\varepsilon|$")
    handle = Patch(color=LIGHT_GREY, label="carries no force; did not survive the interval")
    figure.legend(handles=[handle], loc="outside lower center")
    return figure
