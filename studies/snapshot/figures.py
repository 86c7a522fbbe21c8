"""Figures of a snapshot: the map of its loops, their orders, eigenvalues and directions."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from loops import Faces
from patterns import Snapshot
from studies.snapshot.definitions import BLOCKED, FREED
from studies.snapshot.eigenvalues import eigenvalue_distribution
from studies.snapshot.loop_map import loop_map
from studies.snapshot.roses import fabric_rose, unstable_rose
from studies.style import (
    GREY,
    ORANGE,
    SKY,
    VERMILION,
    axes_or_new,
    figure_of,
    save_figure,
    styled,
)


class Drawing(NamedTuple):
    """A figure on its way to a file.

    Attributes
    ----------
    name : str
        Name of the files, without ending.
    title, caption : str
        What it shows.
    figure : Figure
        The figure.
    """

    name: str
    title: str
    caption: str
    figure: Figure


def draw_figures(
    snapshot: Snapshot,
    faces: Faces,
    table: dict[str, Any],
    summary: dict[str, Any],
    folder: Path,
    source: dict[str, Any],
) -> list[tuple[str, str, Path]]:
    """Draw every figure of a snapshot as PNG and SVG.

    Parameters
    ----------
    snapshot : Snapshot
        Grains and contacts.
    faces : Faces
        Their faces.
    table : dict of str to array
        From `loop_table`.
    summary : dict
        From `snapshot_summary`.
    folder : Path
        Where to write.
    source : dict
        Provenance, written into the files.

    Returns
    -------
    list of tuple of str, str, Path
        Title, caption and PNG of each.
    """
    shown = []
    for drawing in _drawings(snapshot, faces, table, summary):
        save_figure(drawing.figure, folder, drawing.name, source)
        shown.append((drawing.title, drawing.caption, folder / f"{drawing.name}.png"))
    return shown


def _drawings(
    snapshot: Snapshot, faces: Faces, table: dict[str, Any], summary: dict[str, Any]
) -> Iterator[Drawing]:
    """One figure after the other: only one is held at a time."""
    yield Drawing("map", "Loops", _MAP, loop_map(snapshot, faces, table))
    orders = figure_of(order_bars(summary, table))
    yield Drawing("orders", "Orders", "Share of the loops by their number of grains.", orders)
    yield Drawing("fabric", "Fabric", _FABRIC, fabric_rose(snapshot.graph, summary))
    if snapshot.mechanical and summary["loops"]:
        yield Drawing("eigenvalues", "Eigenvalues", _EIGENVALUES, eigenvalue_distribution(table))
        yield Drawing("directions", "Unstable loops", _ROSE, unstable_rose(table, summary))


_MAP = "The loops of the sample, coloured by their order and by what else is known of them."
_FABRIC = (
    "Density of the contact directions and its Fourier series of second order, whose amplitude and "
    "direction follow from the contact fabric tensor."
)
_EIGENVALUES = (
    "Eigenvalues of the symmetric part of the loops' tangents over the mean normal stiffness, by "
    "order of the loops; grey: negative, the loop is unstable. Spins blocked: " + BLOCKED + ". "
    "Spins free: " + FREED + "."
)
_ROSE = (
    "Soft directions and long axes of the unstable loops; a thick line shows the mean axis, as "
    "long as its resultant where the outer circle stands for 1."
)


@styled()
def order_bars(summary: dict[str, Any], table: dict[str, Any], ax: Axes | None = None) -> Axes:
    """Share of the loops by order: in number, in area, and the unstable ones among them.

    Parameters
    ----------
    summary : dict
        From `snapshot_summary`.
    table : dict of str to array
        From `loop_table`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
        What was drawn into.
    """
    ax = axes_or_new(ax)
    if summary["loops"] == 0:
        ax.set(xlabel="loop order (number of grains)", ylabel="share of the loops")
        ax.text(0.5, 0.5, "no loops", transform=ax.transAxes, ha="center", color=GREY)
        return ax
    orders = np.array([int(n) for n in summary["orders"]])
    number = np.array(list(summary["orders"].values())) / summary["loops"]
    area = np.array(list(summary["orders_area"].values()))
    ax.bar(orders - 0.2, number, 0.4, color=SKY, label="in number")
    ax.bar(orders + 0.2, area / area.sum(), 0.4, color=ORANGE, label="in area")
    if "unstable_loops" in summary:
        unstable = np.array(list(summary["unstable_loops"]["traction"].values()))
        label = "unstable, in number\n(traction closure, spins blocked)"
        ax.bar(orders - 0.2, number * unstable, 0.4, color=VERMILION, label=label)
    mean = summary["mean_order"]
    ax.axvline(mean, color=GREY, linewidth=0.8, linestyle="--", label=f"mean order {mean:.2f}")
    ax.set(xlabel="loop order (number of grains)", ylabel="share of the loops")
    ax.xaxis.set_major_locator(MaxNLocator(12, integer=True))
    ax.legend()
    return ax
