"""Figures of the second-order work between two snapshots: its map, and against its prediction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from loops.tracking import LoopFates
from studies.series.increments import PREDICTIONS
from studies.series.tracked import TrackedState
from studies.snapshot.loop_map import loop_drawer
from studies.style import (
    BLUE,
    DIVERGING,
    GREY,
    LIGHT_GREY,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    figure_of,
    new_figure,
    styled,
)

Floats = NDArray[np.float64]
TITLES = {
    "affine_W2": "affine closure, spins blocked",
    "traction_W2": "traction closure, spins blocked",
    "traction_free_W2": "traction closure, spins free",
}


class MappedInterval(NamedTuple):
    """An interval to draw a map of.

    Attributes
    ----------
    before : TrackedState
        Its earlier snapshot.
    fates : LoopFates
        From `track_loops`.
    increments : mapping of str to array
        From `increments`.
    """

    before: TrackedState
    fates: LoopFates
    increments: Mapping[str, NDArray[Any]]


@styled()
def work_map(mapped: MappedInterval, ax: Axes | None = None) -> Axes:
    """Loops of the earlier snapshot by their normalised actual second-order work.

    Parameters
    ----------
    mapped : MappedInterval
        With forces.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
        Loops that did not survive the interval are grey.
    """
    before, fates, increments = mapped
    ax = axes_or_new(ax, 4.6, 4.0)
    work = np.full(len(fates.before), np.nan)
    work[increments["loop_before"]] = increments["w2"]
    palette = mpl.colormaps[DIVERGING].with_extremes(bad=LIGHT_GREY)
    draw = loop_drawer(before.snapshot, before.faces)
    colours = draw(ax, work, palette, Normalize(-1.0, 1.0))
    bar = figure_of(ax).colorbar(colours, ax=ax, shrink=0.8)
    bar.set_label(r"actual $w_2 = dP:dH/(|dP||dH|)$, corotated")
    handle = Patch(color=LIGHT_GREY, label="did not survive the interval")
    ax.legend(handles=[handle], loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)
    return ax


@styled()
def work_signs(increments: Mapping[str, NDArray[Any]]) -> Figure:
    """Distribution of the actual work by the sign of its prediction.

    Parameters
    ----------
    increments : mapping of str to array
        From `increments`, of one interval or several joined, with forces.

    Returns
    -------
    Figure
        One panel a prediction; its title gives the shares of loops of negative and of positive
        actual work that were predicted so. Loops that did not move are left out.
    """
    figure = new_figure(TWO_COLUMNS, 2.7)
    actual, bins = increments["w2"], np.linspace(-1, 1, 41)
    for ax, (name, title) in zip(
        figure.subplots(1, len(PREDICTIONS), sharey=True), TITLES.items(), strict=True
    ):
        predicted = increments[name]
        known = np.isfinite(predicted) & (actual != 0)
        parts = actual[known & (predicted < 0)], actual[known & (predicted >= 0)]
        labels = [rf"predicted $W_2 {sign} 0$" for sign in ("<", r"\geq")]
        ax.hist(parts, bins, stacked=True, color=[VERMILION, BLUE], label=labels)
        ax.axvline(0, color=GREY, linewidth=0.8)
        ax.set(xlabel=r"actual $w_2$", xlim=(-1, 1))
        ax.set_title(f"{title}\nright: {_rate(*parts)}")
    figure.axes[0].set_ylabel("survived loops")
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
