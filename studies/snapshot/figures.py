"""Figures of a snapshot: the map of its loops and their orders."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from loops import Faces, loop_batches
from patterns import Snapshot
from studies.style import (
    BLUE,
    DIVERGING,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    figure_of,
    new_figure,
    save_figure,
    styled,
)

Floats = NDArray[np.float64]
# Beyond so many loops the polygons are drawn as pixels in the SVG too.
VECTOR_LIMIT = 20_000
# One colour for each order from 3 on; the last one stands for all beyond.
ORDER_COLOURS = (BLUE, SKY, GREEN, ORANGE, VERMILION, PURPLE)
LAST_ORDER = 3 + len(ORDER_COLOURS) - 1


def draw_figures(
    snapshot: Snapshot,
    faces: Faces,
    table: dict[str, Any],
    summary: dict[str, Any],
    folder: Path,
    source: dict[str, Any],
) -> None:
    """Draw `map` and `orders` as PNG and SVG.

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
    """
    save_figure(loop_map(snapshot, faces, table), folder, "map", source)
    save_figure(figure_of(order_bars(summary, table)), folder, "orders", source)


@styled()
def loop_map(snapshot: Snapshot, faces: Faces, table: dict[str, Any]) -> Figure:
    """Loops coloured by order and by the smallest eigenvalue of Ks, side by side.

    Parameters
    ----------
    snapshot : Snapshot
        Grains and contacts.
    faces : Faces
        Their faces.
    table : dict of str to array
        From `loop_table`.

    Returns
    -------
    matplotlib.figure.Figure
        Two maps of one sample.
    """
    polygons, rows = _polygons(snapshot, faces)
    extent = np.ptp(snapshot.graph.x, axis=0)
    # A panel is as wide as half the page less its colour bar and labels.
    ratio = extent[1] / extent[0] if extent[0] > 0 else 1.0
    height = float(np.clip((0.5 * TWO_COLUMNS - 0.95) * ratio + 0.5, 2.0, 9.0))
    figure = new_figure(TWO_COLUMNS, height)
    left, right = figure.subplots(1, 2)
    order = np.minimum(table["order"], LAST_ORDER)
    bounds = np.arange(2.5, LAST_ORDER + 1)
    colours = _fill(
        left,
        polygons,
        order[rows],
        ListedColormap(ORDER_COLOURS),
        BoundaryNorm(bounds, len(ORDER_COLOURS)),
    )
    bar = figure.colorbar(colours, ax=left, ticks=range(3, LAST_ORDER + 1), shrink=0.75)
    bar.ax.set_yticklabels([*map(str, range(3, LAST_ORDER)), f"{LAST_ORDER}+"])
    bar.set_label("loop order (grains)")
    smallest = table["traction_lambda_min"]
    colours = _fill(
        right, polygons, smallest[rows], mpl.colormaps[DIVERGING], _around_zero(smallest)
    )
    bar = figure.colorbar(colours, ax=right, extend="both", shrink=0.75)
    low, high = colours.get_clim()
    bar.set_ticks(
        [low, 0.5 * low, 0.0, 0.5 * high, high],
        labels=[f"{tick:.2g}" for tick in (low, 0.5 * low, 0.0, 0.5 * high, high)],
    )
    bar.set_label(r"smallest eigenvalue of $K_s$ / mean $k_n$")
    _outline(right, polygons, smallest[rows] < 0)
    return figure


def _outline(ax: Axes, polygons: list[Floats], unstable: NDArray[np.bool_]) -> None:
    """Draw a line around the unstable loops: some are too soft to show by their colour."""
    picked = [polygons[k] for k in np.flatnonzero(unstable)]
    ax.add_collection(
        PolyCollection(
            picked,
            facecolors="none",
            edgecolors=VERMILION,
            linewidths=0.8 * _line_width(len(polygons)),
            rasterized=len(picked) > VECTOR_LIMIT,
        )
    )
    handle = Line2D([], [], color=VERMILION, label="unstable, traction closure")
    ax.legend(handles=[handle], loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)


def _line_width(polygons: int) -> float:
    return float(min(1.0, 60.0 / max(polygons, 1) ** 0.5))


def _polygons(snapshot: Snapshot, faces: Faces) -> tuple[list[Floats], NDArray[np.int64]]:
    """Corners of every loop, and its row in the table."""
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(len(faces.loops))
    polygons: list[Floats] = []
    rows = []
    for batch in loop_batches(snapshot.graph, faces):
        polygons.extend(batch.graph.x)
        rows.append(row[batch.face])
    return polygons, np.concatenate(rows) if rows else np.empty(0, dtype=np.int64)


def _around_zero(values: Floats) -> Normalize:
    """Zero in the middle of the colours; each side has its own reach, so that few show as well."""
    known = values[np.isfinite(values)]
    if not known.any():
        return TwoSlopeNorm(0.0, vmin=-1.0, vmax=1.0)
    high = max(np.percentile(known, 98), 0.0)
    low = max(-np.percentile(known, 2), -known.min() / 4, 0.0)
    smallest = 0.05 * max(high, low, np.abs(known).max())
    return TwoSlopeNorm(0.0, vmin=-max(low, smallest), vmax=max(high, smallest))


def _fill(
    ax: Axes,
    polygons: list[Floats],
    values: NDArray[Any],
    colours: Colormap,
    scale: Normalize,
) -> PolyCollection:
    collection = PolyCollection(
        polygons,
        array=values,
        cmap=colours,
        norm=scale,
        edgecolors="white",
        linewidths=0.4 * _line_width(len(polygons)),
        rasterized=len(polygons) > VECTOR_LIMIT,
    )
    ax.add_collection(collection)
    ax.set(aspect="equal", xlabel=r"$x_1$ (length unit of the input)", ylabel=r"$x_2$")
    ax.margins(0.01)
    ax.autoscale_view()
    return collection


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
    area = np.array([table["area"][table["order"] == n].sum() for n in orders])
    unstable = np.array(list(summary["unstable_fraction"]["traction"].values()))
    ax.bar(orders - 0.2, number, 0.4, color=SKY, label="in number")
    ax.bar(orders + 0.2, area / area.sum(), 0.4, color=ORANGE, label="in area")
    ax.bar(
        orders - 0.2,
        number * unstable,
        0.4,
        color=VERMILION,
        label="unstable, in number\n(traction closure)",
    )
    mean = summary["mean_order"]
    ax.axvline(mean, color=GREY, linewidth=0.8, linestyle="--", label=f"mean order {mean:.2f}")
    ax.set(xlabel="loop order (number of grains)", ylabel="share of the loops")
    ax.xaxis.set_major_locator(MaxNLocator(12, integer=True))
    ax.legend()
    return ax
