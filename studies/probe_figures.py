"""Figures of a probe: response envelope, polar diagram of w2, orders and the map of the loops."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from loops.arrays import Floats
from patterns import Snapshot
from stability.packing import Probe
from studies.snapshot.loop_map import draw_values, loop_drawer
from studies.style import (
    BLUE,
    GREY,
    LIGHT_GREY,
    ONE_COLUMN,
    ORANGE,
    SEQUENTIAL,
    SKY,
    VERMILION,
    axes_or_new,
    figure_of,
    new_figure,
    styled,
)

# The circle of w2 = 0 of the polar diagram (Nicot et al. 2016, Fig. 11).
RADIUS = 2.0


def probe_figures(
    snapshot: Snapshot, found: Probe, loops: pd.DataFrame, summary: dict[str, Any]
) -> Iterator[tuple[str, Figure]]:
    """Every figure of a probe by name."""
    yield "envelope", figure_of(response_envelope(found, summary["mean_kn"]))
    yield "work", polar_work(found)
    if found.softest is not None:
        yield "orders", figure_of(order_shares(summary["orders"]))
        yield (
            "map",
            additive_work_map(snapshot, loops["additive_w"].to_numpy() / summary["mean_kn"]),
        )


@styled()
def response_envelope(found: Probe, kn: float, ax: Axes | None = None) -> Axes:
    """Response to driven rates of unit length, and the elastic response."""
    ax = axes_or_new(ax, ONE_COLUMN, 3.6)
    if found.control == "strain":
        answers = found.stress_rate / kn, found.elastic_stress / kn
        labels = r"$P'_{11}$ / mean $k_n$", r"$P'_{22}$ / mean $k_n$"
    else:
        answers = found.strain_rate * kn, found.elastic_strain * kn
        labels = r"$H'_{11}$ · mean $k_n$", r"$H'_{22}$ · mean $k_n$"
    parts = [values[:, [0, 1], [0, 1]] for values in answers]
    if found.subspace == "diagonal":
        own, elastic = (np.vstack([part, part[:1]]) for part in parts)
        ax.plot(*elastic.T, "--", color=GREY, linewidth=1.0, label="elastic")
        ax.plot(*own.T, "o-", color=BLUE, markersize=2.2, linewidth=1.0, label="with sliding")
    else:
        ax.plot(*parts[1].T, "o", color=LIGHT_GREY, markersize=2.2, label="elastic")
        dots = ax.scatter(
            parts[0][:, 0], parts[0][:, 1], c=found.directions[:, 2], s=6, cmap=SEQUENTIAL
        )
        figure_of(ax).colorbar(dots, ax=ax, shrink=0.7, label="shear part of the direction")
    softest = found.softest
    if softest is not None:
        ax.plot(*parts[0][softest], "D", color=VERMILION, markersize=5, label="softest direction")
    ax.axhline(0.0, color=LIGHT_GREY, linewidth=0.7, zorder=0)
    ax.axvline(0.0, color=LIGHT_GREY, linewidth=0.7, zorder=0)
    ax.set(xlabel=labels[0], ylabel=labels[1], aspect="equal")
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, columnspacing=1.0)
    return ax


@styled()
def polar_work(found: Probe) -> Figure:
    """Normalised second-order work over the directions, with the cones."""
    figure = new_figure(ONE_COLUMN, 3.5)
    ax = figure.add_subplot(projection="polar")
    assert isinstance(ax, PolarAxes)
    circle = np.linspace(0.0, 2.0 * np.pi, 361)
    ax.plot(circle, np.full(361, RADIUS), color=GREY, linewidth=0.8)
    for begin, end in found.cones:
        arc = np.linspace(begin, end, 181)
        ax.fill_between(arc, 0.0, RADIUS + 1.0, color=ORANGE, alpha=0.35, linewidth=0)
    theta, radius = found.theta, RADIUS + found.normalised
    if found.subspace == "diagonal":
        order = np.append(np.argsort(theta), np.argmin(theta))
        ax.plot(theta[order], radius[order], "o-", color=BLUE, markersize=2.2, linewidth=1.0)
    else:
        dots = ax.scatter(theta, radius, c=found.directions[:, 2], s=6, cmap=SEQUENTIAL)
        figure.colorbar(dots, ax=ax, shrink=0.7, pad=0.12, label="shear part of the direction")
    unknown = theta[~found.determined]
    ax.plot(unknown, np.full(len(unknown), RADIUS + 1.0), "x", color=GREY, markersize=3.5)
    driven = "H" if found.control == "strain" else "P"
    ax.set_ylim(0.0, RADIUS + 1.05)
    ax.set_rticks([1.0, 2.0, 3.0], ["−1", "0", "1"])
    ax.set_rlabel_position(112.5)
    ax.set_thetagrids(range(0, 360, 45))
    ax.grid(color=LIGHT_GREY, linewidth=0.5)
    note = f"; x: {len(unknown)} undetermined" if len(unknown) else ""
    share = f"{100 * found.unstable_fraction:.2g} %" if found.determined.any() else "unknown share"
    ax.set_title(
        rf"$w_2$ along $({driven}'_{{11}}, {driven}'_{{22}})$, degrees{note}"
        f"\n$w_2 < 0$ in {share} of directions"
    )
    return figure


@styled()
def order_shares(orders: dict[str, dict[str, float]], ax: Axes | None = None) -> Axes:
    """Shares of the loops by order in area, in W2 and in its negative part."""
    ax = axes_or_new(ax)
    # Contacts in no loop or in only one are drawn before the triangles.
    numbers = np.array([int(n) or 2 for n in orders])
    for k, (name, colour, label) in enumerate(
        (
            ("area_share", SKY, "of the area"),
            ("W2_share", BLUE, r"of $W_2$"),
            ("negative_share", VERMILION, "of its negative part"),
        )
    ):
        values = [row[name] for row in orders.values()]
        ax.bar(numbers + 0.27 * (k - 1), values, 0.27, color=colour, label=label)
    ax.axhline(0.0, color=GREY, linewidth=0.7)
    ax.set(xlabel="loop order (number of grains)", ylabel="share of the loops of an order")
    shown = numbers[:: len(numbers) // 13 + 1]
    ax.set_xticks(shown, labels=["none" if n == 2 else str(n) for n in shown])
    ax.legend()
    return ax


@styled()
def additive_work_map(snapshot: Snapshot, work: Floats) -> Figure:
    """Loops coloured by their additive second-order work."""
    figure = new_figure(4.4, 4.0)
    label = r"additive $w = -\sum f' \cdot d' / (2 V_l)$ / mean $k_n$"
    draw_values(loop_drawer(snapshot), figure.add_subplot(), work, label, signed=True)
    return figure
