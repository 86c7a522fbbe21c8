"""Figures of the loads that a sample sustains: limits by direction, paths, orders, map."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from patterns import Snapshot
from stability.packing import Probe, Sustained
from studies.packing_figures import additive_work_map, order_shares, polar_work
from studies.style import (
    BLUE,
    GREY,
    LIGHT_GREY,
    ONE_COLUMN,
    ORANGE,
    SKY,
    VERMILION,
    figure_of,
    new_figure,
    new_panels,
    styled,
)

# Loads below this share of the largest load are drawn at the centre.
LOW = 1e-5
LOOKS = {
    "held": ("o", BLUE, "held"),
    "snapped": ("s", ORANGE, "held through snaps"),
    "failed": ("X", VERMILION, "failed"),
    "unfinished": ("d", GREY, "unfinished"),
}


def sustain_figures(
    snapshot: Snapshot,
    found: Sustained,
    rates: Probe,
    tables: dict[str, pd.DataFrame],
    summary: dict[str, Any],
) -> Iterator[tuple[str, Figure]]:
    """Every figure by name."""
    yield "limits", limit_surface(found, rates)
    yield "work", polar_work(rates)
    yield "paths", load_curves(found, tables["paths"])
    if summary["weakest"] is not None:
        yield "orders", figure_of(order_shares(summary["orders"]))
        work = tables["loops"]["additive_w"].to_numpy() / summary["mean_kn"]
        yield "map", additive_work_map(snapshot, work)


@styled()
def limit_surface(found: Sustained, rates: Probe) -> Figure:
    """Loads at the first event, the first instability and the limit over the stress direction."""
    figure = new_figure(ONE_COLUMN, 4.4)
    ax = figure.add_subplot(projection="polar")
    assert isinstance(ax, PolarAxes)
    largest, theta = found.largest, found.theta
    table = {
        name: np.array([getattr(path, name) for path in found.paths])
        for name in ("first_event", "first_instability", "limit")
    }
    for begin, end in rates.cones:
        arc = np.linspace(begin, end, 181)
        ax.fill_between(arc, 0.0, 1.1, color=ORANGE, alpha=0.25, linewidth=0)
    for name, colour, label in (
        ("first_event", SKY, "first event"),
        ("first_instability", ORANGE, "first instability"),
    ):
        radius = _radius(np.where(np.isnan(table[name]), largest, table[name]) / largest)
        if found.subspace == "diagonal":
            ax.plot(*_closed(theta, radius), color=colour, linewidth=1.0, label=label)
    radius = _radius(table["limit"] / largest)
    if found.subspace == "diagonal":
        ax.plot(*_closed(theta, radius), color=GREY, linewidth=1.0, label="limit")
    for status, (marker, colour, label) in LOOKS.items():
        own = found.status == status
        if own.any():
            ax.plot(
                theta[own], radius[own], marker, color=colour, markersize=5,
                linestyle="none", label=label,
            )  # fmt: skip
    ax.set_ylim(0.0, 1.1)
    decades = np.arange(np.ceil(np.log10(LOW * largest)), np.log10(largest) + 1e-9)
    loads = 10.0**decades
    ax.set_rticks(_radius(loads / largest), [f"{load:g}" for load in loads])
    ax.set_rlabel_position(22.5)
    ax.set_thetagrids(range(0, 360, 45))
    ax.grid(color=LIGHT_GREY, linewidth=0.5)
    ax.set_title("load (force/length) along $(P'_{11}, P'_{22})$")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=2)
    return figure


def _radius(share: Any) -> Any:
    """Logarithmic radius of a load over the largest one."""
    return 1.0 - np.log10(np.clip(share, LOW, 1.0)) / np.log10(LOW)


def _closed(theta: Any, radius: Any) -> tuple[Any, Any]:
    """The curve through all directions, in the order of their angles, closed."""
    order = np.append(np.argsort(theta), np.argmin(theta))
    return theta[order], radius[order]


@styled()
def load_curves(found: Sustained, paths: pd.DataFrame) -> Figure:
    """Load over the size of the strain along every direction."""
    figure, ((ax,),) = new_panels(1, 1, 2.9)
    size = np.sqrt(sum(paths[f"H{ij}"] ** 2 for ij in ("11", "12", "21", "22")))
    # The start is at minus infinity: a line from there would look like a snap.
    size = size.where(size > 0)
    shown = set()
    for angle, status in zip(np.degrees(found.theta), found.status, strict=True):
        own = paths["theta_deg"] == angle
        marker, colour, label = LOOKS[status]
        ax.plot(
            size[own], paths["load"][own], color=colour, linewidth=0.9,
            label=None if status in shown else label,
        )  # fmt: skip
        shown.add(status)
        ax.plot(size[own].iloc[-1], paths["load"][own].iloc[-1], marker, color=colour, markersize=4)
    ax.set(xlabel=r"strain $|H|$ since the start", ylabel="load (force/length)", xscale="log")
    ax.legend()
    return figure
