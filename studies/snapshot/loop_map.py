"""The map of a snapshot's loops: by order and by stability."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from loops.arrays import Floats, Integers
from patterns import Snapshot
from studies.output import Columns
from studies.snapshot.polygons import half_edges_of_loops, loop_corners
from studies.snapshot.table import GROUPS, LAST_ORDER
from studies.style import (
    DIVERGING,
    ORDER_COLOURS,
    SEQUENTIAL,
    TWO_COLUMNS,
    VERMILION,
    figure_of,
    new_panels,
    panel_width,
    styled,
)

# A function (axes, values of the loops, colour map, scale) that draws the loops.
Drawer = Callable[..., ScalarMappable]
# More loops than these are pixels in the SVG too.
VECTOR_LIMIT = 20_000
# More loops than these are painted into one picture instead of drawn one by one.
PAINT_LIMIT = 100_000
# Pixels along the longer side of that picture: a panel on a page at 600 dpi.
PIXELS = 1600
# Every group of orders has its own colour.
ORDER_SCALE = BoundaryNorm(np.arange(2.5, LAST_ORDER + 1), len(ORDER_COLOURS))


@styled()
def loop_map(snapshot: Snapshot, table: Columns, draw: Drawer) -> Figure:
    """Loops coloured by order and, with forces, by the smallest eigenvalue of Ks.

    Loops of small packings are polygons. Large packings are painted into a picture, each pixel in
    the colour of the loop that contains its centre.
    """
    extent = np.ptp(snapshot.graph.x, axis=0)
    # A panel is as wide as half the page less its colour bar and labels.
    ratio = extent[1] / extent[0] if extent[0] > 0 else 1.0
    height = float(np.clip((panel_width(2) - 0.95) * ratio + 0.5, 2.0, 9.0))
    panels = 2 if snapshot.mechanical else 1
    figure, (axes,) = new_panels(1, panels, height, TWO_COLUMNS * panels / 2)
    draw_orders(draw, axes[0], table["order"])
    if snapshot.mechanical:
        smallest = table["traction_lambda_min"]
        label = r"smallest eigenvalue of $K_s$ / mean $k_n$"
        draw_values(draw, axes[1], smallest, label, signed=True)
        unstable = np.flatnonzero(smallest < 0)
        # Some unstable loops are too soft to show by their colour: a line goes around them.
        if len(unstable) <= VECTOR_LIMIT:
            outlines = PolyCollection(
                polygons_of_loops(snapshot, unstable),
                facecolors="none",
                edgecolors=VERMILION,
                linewidths=0.8 * _line_width(len(smallest)),
                rasterized=len(smallest) > VECTOR_LIMIT,
            )
            axes[1].add_collection(outlines, autolim=False)
            name = "unstable, traction closure, spins blocked"
            key: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
            axes[1].legend(handles=[Line2D([], [], color=VERMILION, label=name)], **key)
    return figure


def draw_orders(draw: Drawer, ax: Axes, order: Integers) -> None:
    """Loops coloured by order."""
    order_bar(
        draw(ax, np.minimum(order, LAST_ORDER), ListedColormap(ORDER_COLOURS), ORDER_SCALE), ax
    )


def order_bar(colours: ScalarMappable, ax: Axes) -> None:
    """Draw the colour bar of the orders beside a map."""
    bar = figure_of(ax).colorbar(colours, ax=ax, ticks=range(3, LAST_ORDER + 1), shrink=0.75)
    bar.ax.set_yticklabels(GROUPS)
    bar.set_label("loop order (grains)")


def draw_values(
    draw: Drawer, ax: Axes, values: Floats, label: str, *, signed: bool = False
) -> None:
    """Loops coloured by a value of each; zero in the middle if `signed` or if any is negative."""
    known = values[np.isfinite(values)]
    signed = signed or bool((known < 0).any()) or len(known) == 0
    top = np.percentile(known, 98) if len(known) else 1.0
    scale = around_zero(values) if signed else Normalize(known.min(), top)
    colours = draw(ax, values, mpl.colormaps[DIVERGING if signed else SEQUENTIAL], scale)
    bar = figure_of(ax).colorbar(colours, ax=ax, extend="both", shrink=0.75)
    low, high = colours.get_clim()
    middle = 0.0 if signed else 0.5 * (low + high)
    ticks = [low, 0.5 * (low + middle), middle, 0.5 * (middle + high), high]
    bar.set_ticks(ticks, labels=[f"{tick:.2g}" for tick in ticks])
    bar.set_label(label)


def around_zero(values: Floats) -> Normalize:
    """Scale with zero in the middle; each side has its own range, so that few values show too."""
    known = values[np.isfinite(values)]
    if not known.any():
        return TwoSlopeNorm(0.0, vmin=-1.0, vmax=1.0)
    high = max(np.percentile(known, 98), 0.0)
    negative = known[known < 0]
    low = -np.percentile(negative, 10) if len(negative) else 0.0
    smallest = 0.05 * max(high, low, np.finfo(float).tiny)
    return TwoSlopeNorm(0.0, vmin=-max(low, smallest), vmax=max(high, smallest))


def loop_drawer(snapshot: Snapshot) -> Drawer:
    """Prepare the loops of a snapshot for drawing, once for all panels."""
    return (_painter if len(snapshot.faces.loops) > PAINT_LIMIT else _polygon_drawer)(snapshot)


def _polygon_drawer(snapshot: Snapshot) -> Drawer:
    """Return a function that draws every loop as a polygon."""
    polygons = polygons_of_loops(snapshot)

    def draw(ax: Axes, values: NDArray[Any], colours: Colormap, scale: Normalize) -> ScalarMappable:
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
        _label(ax)
        ax.margins(0.01)
        ax.autoscale_view()
        return collection

    return draw


def _painter(snapshot: Snapshot) -> Drawer:
    """Return a function that shows the loops as pixels."""
    from studies.snapshot.paint import paint_loops

    painting = paint_loops(snapshot.graph, snapshot.faces, PIXELS)

    def draw(ax: Axes, values: NDArray[Any], colours: Colormap, scale: Normalize) -> ScalarMappable:
        # A pixel outside all loops is -1, which finds the last value. Colours are computed for
        # each loop, not for each pixel: there are more pixels than loops.
        known = np.ma.masked_invalid(np.append(values, np.nan))
        shades = ScalarMappable(scale, colours).to_rgba(known, bytes=True)
        image = ax.imshow(
            shades[painting.loop],
            origin="lower",
            extent=painting.extent,
            cmap=colours,
            norm=scale,
            interpolation="none",
            rasterized=True,
        )
        _label(ax)
        return image

    return draw


def _label(ax: Axes) -> None:
    unit = "(length unit of the input)"
    ax.set(aspect="equal", xlabel=rf"$x_1$ {unit}", ylabel=rf"$x_2$ {unit}")


def _line_width(loops: int) -> float:
    return float(np.clip(60.0 / max(loops, 1) ** 0.5, 0.25, 1.0))


def polygons_of_loops(snapshot: Snapshot, picked: Integers | slice = slice(None)) -> list[Floats]:
    """Corners of each loop, or of those picked."""
    offsets, at = half_edges_of_loops(snapshot.faces, picked)
    corners = loop_corners(snapshot.graph, snapshot.faces, offsets, at)
    return [corners[a:b] for a, b in pairwise(offsets.tolist())]
