"""Roses: how contacts and unstable loops are directed."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from loops import GrainGraph, branch_vectors
from studies.snapshot.mechanics import CLOSURES, unstable_loops
from studies.snapshot.statistics import axes_density
from studies.style import (
    BLACK,
    BLUE,
    LIGHT_GREY,
    SKY,
    TWO_COLUMNS,
    VERMILION,
    new_figure,
    styled,
)

Floats = NDArray[np.float64]
COLOURS = {"affine": BLUE, "traction": VERMILION}
# Widths of the bins of many and of few axes, degrees; a half turn holds a whole number of each.
FINE, COARSE, FEW = 10.0, 20.0, 200


@styled()
def fabric_rose(graph: GrainGraph, summary: dict[str, Any]) -> Figure:
    """Density of the contact directions, and its Fourier series of second order.

    Parameters
    ----------
    graph : GrainGraph
        The packing, at least one contact.
    summary : dict
        From `snapshot_summary`.

    Returns
    -------
    matplotlib.figure.Figure
        A polar diagram; each contact counts in both its directions.
    """
    figure = new_figure(3.5, 3.6)
    ax = _polar(figure, 111)
    _bars(ax, _contact_axes(graph), FINE, SKY, "contacts", filled=True)
    fabric = summary["contact_fabric"]
    theta = np.linspace(0, 2 * np.pi, 721)
    a, density = fabric["fourier_amplitude"], _second_order(theta, fabric)
    label = f"second order: a = {a:.3f}, {fabric['direction']:.1f}°"
    ax.plot(theta, density, color=VERMILION, label=label)
    _finish(ax, "contact direction", "probability density (1/rad)")
    return figure


def fabric_table(graph: GrainGraph, summary: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """The numbers behind `fabric_rose`.

    Parameters
    ----------
    graph : GrainGraph
        The packing.
    summary : dict
        From `snapshot_summary`.

    Returns
    -------
    dict of str to array
        As `axes_density`, and `second_order`, the Fourier series at the centre of each bin.
    """
    columns = axes_density(_contact_axes(graph), FINE)
    second = _second_order(np.radians(columns["angle"]), summary["contact_fabric"])
    return columns | {"second_order": second}


def _contact_axes(graph: GrainGraph) -> Floats:
    d = branch_vectors(graph)
    return np.degrees(np.arctan2(d[:, 1], d[:, 0]))


def _second_order(theta: Floats, fabric: dict[str, Any]) -> Floats:
    swing = np.cos(2 * (theta - np.radians(fabric["direction"])))
    return (1 + fabric["fourier_amplitude"] * swing) / (2 * np.pi)


@styled()
def unstable_rose(table: dict[str, Any], summary: dict[str, Any]) -> Figure:
    """Directions of the unstable loops: of their smallest eigenvalue, and of their long axes.

    Parameters
    ----------
    table : dict of str to array
        From `loop_table`.
    summary : dict
        From `snapshot_summary`.

    Returns
    -------
    matplotlib.figure.Figure
        Two polar diagrams; an axis counts in both its directions. A line shows the mean axis, as
        long as the resultant of the outer circle.
    """
    figure = new_figure(TWO_COLUMNS, 3.7)
    for place, (title, column, key) in enumerate(
        (
            ("soft direction", "{}_soft_angle", "soft_angle"),
            ("long axis of the polygon", "orientation", "long_axis"),
        )
    ):
        ax = _polar(figure, 121 + place)
        for closure in CLOSURES:
            rows = unstable_loops(table, closure)
            angles = table[column.format(closure)][rows]
            angles = angles[np.isfinite(angles)]
            width = FINE if len(angles) >= FEW else COARSE
            label = f"{closure}, {len(angles)} loops"
            _bars(ax, angles, width, COLOURS[closure], label, filled=False)
        for closure in CLOSURES:
            _mean_axis(ax, summary["soft_loops"][closure][key], COLOURS[closure])
        _finish(ax, f"{title}, unstable loops", "probability density (1/rad)")
    return figure


def _polar(figure: Figure, place: int) -> PolarAxes:
    ax = figure.add_subplot(place, projection="polar")
    assert isinstance(ax, PolarAxes)
    return ax


def _bars(ax: Axes, axes: Floats, width: float, colour: str, label: str, *, filled: bool) -> None:
    """Density of axes over the full circle, both directions of each alike."""
    density = axes_density(axes, width)["density"]
    centre = np.radians(width) * np.arange(2 * len(density))
    ax.bar(
        centre,
        np.tile(density, 2),
        np.radians(width),
        color=colour if filled else "none",
        edgecolor="white" if filled else colour,
        linewidth=0.4 if filled else 1.1,
        label=label,
    )


def _mean_axis(ax: Axes, block: dict[str, Any], colour: str) -> None:
    if block["count"] == 0:
        return
    ax.set_ylim(0.0, ax.get_ylim()[1])
    reach = block["resultant"] * ax.get_ylim()[1]
    angle = np.radians(block["direction"])
    ax.plot([angle, angle + np.pi], [reach, reach], "o", color=colour, markersize=3)
    ax.plot([angle, angle + np.pi], [reach, reach], color=colour, linewidth=2.2)


def _finish(ax: PolarAxes, title: str, unit: str) -> None:
    ax.set_thetagrids(range(0, 360, 45))
    ax.set_rticks(MaxNLocator(3).tick_values(0.0, ax.get_ylim()[1])[1:-1])
    ax.tick_params(axis="y", labelsize=6, labelcolor=BLACK)
    ax.set_rlabel_position(22.5)
    ax.grid(color=LIGHT_GREY, linewidth=0.5)
    ax.set_title(f"{title}\n{unit}")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=1)
