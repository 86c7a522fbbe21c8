"""Figure of a forecast: loops by probability, how reliable that is, the next events."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from loops.arrays import Floats
from patterns import Snapshot, planar
from stability import COMPONENTS
from studies.evolve import DROP, Evolution
from studies.forecast import Calibration, Forecast, calibration, spread_of
from studies.packing_figures import over_driven
from studies.snapshot.figures import draw_scaled, loop_drawer
from studies.study import Drawings
from studies.style import (
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    ORANGE,
    SEQUENTIAL,
    VERMILION,
    edge_ticks,
    new_panels,
    panel,
    styled,
)

KIND_WORDS = {"opens": "a contact opens", "lost": "loop lost", "unstable": "$W_2 < 0$"}
KIND_LOOKS = {"opens": ("s", BLUE), "lost": ("o", VERMILION), "unstable": ("^", GREEN)}
# Loops below which a share says nothing.
FEW = 10
WAY_LOOKS = {"events": ("path by events", BLUE, "-"), "replay": ("replay", VERMILION, "--")}


def figures(snapshot: Snapshot, found: Forecast, tables: Any, summary: Any) -> Drawings:
    """Every figure of a forecast by name."""
    yield "forecast", lambda: forecast_figure(found)


@styled()
def forecast_figure(found: Forecast) -> Figure:
    """Sample with the loops by their probability to be lost; reliability; the next events."""
    figure, (axes,) = new_panels(1, 3, 3.2, width_ratios=(1.3, 1.0, 1.0))
    probability_map(found, ax=axes[0])
    reliability(calibration(), ax=axes[1])
    next_events(found, ax=axes[2])
    return figure


@panel(height=3.8)
def probability_map(found: Forecast, ax: Axes) -> None:
    """Draw the loops of the sample by the probability that they are lost."""
    values = found.loops["lost_probability"].to_numpy()
    driven, to = found.evolution.driven, found.evolution.to
    name = f"{driven[0]}_{{{driven[1:]}}}"
    label = f"probability that a loop is lost\nup to $\\Delta {name}$ = {to:g}"
    draw, colours = loop_drawer(planar(found.evolution.scene)), mpl.colormaps[SEQUENTIAL]
    scale, shown = Normalize(0.0, 1.0), {"location": "bottom", "label": label}
    draw_scaled(draw, ax, values, colours, scale, **shown)
    if not np.isfinite(values).any():
        ax.set_title("no probabilities: see the notes")


@panel()
def reliability(known: Calibration, ax: Axes) -> None:
    """Draw what was said of each series by all others against what happened in it.

    The bin that is farthest from what happened has its numbers beside it.
    """
    ax.plot([0, 1], [0, 1], color=LIGHT_GREY, linewidth=0.8, zorder=0)
    worst = 0.0, 0.0
    for kind, (mark, colour) in KIND_LOOKS.items():
        said, true, loops = reliability_bins(known, kind)
        # Of the share with one loop more of either kind: none or all of a few have an error too.
        share = (true * loops + 1) / (loops + 2)
        error = np.sqrt(share * (1 - share) / (loops + 3))
        ax.errorbar(said, true, error, fmt=mark, color=colour, markersize=3.5, linewidth=0.8,
                    label=KIND_WORDS[kind], clip_on=False)  # fmt: skip
        worst = max(worst, *zip(said, true, strict=True), key=lambda one: abs(one[1] - one[0]))
    look: Any = {"textcoords": "axes fraction", "fontsize": 6, "va": "top"}
    look["arrowprops"] = {"arrowstyle": "-", "color": GREY, "linewidth": 0.5}
    ax.annotate(f"{worst[0]:.2f}: {worst[1]:.2f}\ncame true", worst, (0.02, 0.98), **look)
    intervals = sum(known.provenance["series"].values())
    ax.set_title(f"{intervals} intervals of samples of Yade")
    ax.set(xlim=(0, 1), ylim=(0, 1), xlabel="forecast probability (–)", ylabel="observed share (–)")
    ax.legend(loc="lower right", handletextpad=0.2, borderaxespad=0.1)


def reliability_bins(known: Calibration, kind: str, bins: int = 8) -> tuple[Floats, Floats, Floats]:
    """Return mean forecast probability, observed share and loops, in bins of probability.

    Each series is told by all others; bins of fewer than `FEW` loops are left out.
    """
    rows = known.left_out(kind)
    at = np.minimum((rows[:, 0] * bins).astype(int), bins - 1)
    loops, told, true = (
        np.bincount(at, weights, minlength=bins)
        for weights in (rows[:, 1], rows[:, 0] * rows[:, 1], rows[:, 2])
    )
    some = loops >= FEW
    count = loops[some].astype(float)
    return told[some] / count, true[some] / count, count


@panel()
def next_events(found: Forecast, ax: Axes) -> None:
    """Draw the driven stress on the way, instabilities, and the spread of the next drop."""
    draw_driven_stress(found.evolution, ax=ax)
    rows, drop = found.next, spread_of(found.next, "drop")
    low, high = drop["low"], drop["high"]
    if low is not None and high is not None:
        label = f"next drop, {drop['found']} of {drop['ways']} ways"
        ax.axvspan(low, high, color=ORANGE, alpha=0.35, linewidth=0)
        ax.plot(rows["drop"], np.full(len(rows), 0.05), "v", color=ORANGE, label=label,
                transform=ax.get_xaxis_transform())  # fmt: skip
    else:
        ax.set_title(f"no drop by {DROP:g}\nof the driven stress")
    ax.legend()


@panel(height=2.6)
def draw_driven_stress(found: Evolution, ax: Axes) -> None:
    """Draw the change of the driven stress on each way, and instabilities of the path."""
    at, driven = COMPONENTS.index(found.driven[1:]), found.driven
    for name, way in found.ways.items():
        label, colour, style = WAY_LOOKS[name]
        change = way.P[:, at] - way.P[0, at]
        ax.plot(found.sense * way.parameter, change, style, color=colour, label=label)
    lost = [found.sense * event.parameter for event in found.way.of_kind("instability")]
    edge_ticks(ax, lost, "instabilities")
    over_driven(ax, driven, f"change of $P_{{{driven[1:]}}}$\n(force/length)")
