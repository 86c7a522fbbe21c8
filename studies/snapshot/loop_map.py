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

from loops import Faces
from loops.arrays import Flags, Floats, Integers
from patterns import Snapshot
from studies.snapshot.polygons import half_edges_of_loops, loop_corners
from studies.snapshot.statistics import GROUPS, LAST_ORDER
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

# Draws values of the loops into axes, by a map of colours and a scale.
Drawer = Callable[..., ScalarMappable]
# Beyond so many loops the polygons are drawn as pixels in the SVG too.
VECTOR_LIMIT = 20_000
# Beyond so many loops they are painted into one picture instead of drawn one by one.
PAINT_LIMIT = 100_000
# Pixels along the longer side of that picture: as many as a panel has on a page at 600 dpi.
PIXELS = 1600
# Every order up to the last group has its own colour.
ORDER_SCALE = BoundaryNorm(np.arange(2.5, LAST_ORDER + 1), len(ORDER_COLOURS))


@styled()
def loop_map(snapshot: Snapshot, faces: Faces, table: dict[str, Any], draw: Drawer) -> Figure:
    """Loops coloured by order, and by the smallest eigenvalue of Ks if there are forces.

    Small packings are drawn loop by loop. Large ones are painted into a picture, each pixel in the
    colour of the loop that its centre lies in.
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
        draw_values(
            draw, axes[1], smallest, r"smallest eigenvalue of $K_s$ / mean $k_n$", signed=True
        )
        _outline(snapshot, faces, axes[1], smallest < 0)
    return figure


def draw_orders(draw: Drawer, ax: Axes, order: Integers) -> None:
    """Loops coloured by order."""
    order_bar(
        draw(ax, np.minimum(order, LAST_ORDER), ListedColormap(ORDER_COLOURS), ORDER_SCALE), ax
    )


def order_bar(colours: ScalarMappable, ax: Axes) -> None:
    """The key of the orders beside a map."""
    bar = figure_of(ax).colorbar(colours, ax=ax, ticks=range(3, LAST_ORDER + 1), shrink=0.75)
    bar.ax.set_yticklabels(GROUPS)
    bar.set_label("loop order (grains)")


def draw_values(
    draw: Drawer, ax: Axes, values: Floats, label: str, *, signed: bool = False
) -> None:
    """Loops coloured by a value of each: around zero if `signed` or if there are negative ones."""
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
    """Zero in the middle of the colours; each side has its own reach, so that few show as well."""
    known = values[np.isfinite(values)]
    if not known.any():
        return TwoSlopeNorm(0.0, vmin=-1.0, vmax=1.0)
    high = max(np.percentile(known, 98), 0.0)
    negative = known[known < 0]
    low = -np.percentile(negative, 10) if len(negative) else 0.0
    smallest = 0.05 * max(high, low, np.finfo(float).tiny)
    return TwoSlopeNorm(0.0, vmin=-max(low, smallest), vmax=max(high, smallest))


def loop_drawer(snapshot: Snapshot, faces: Faces) -> Drawer:
    """Prepare the loops of a snapshot for drawing, once for all panels."""
    many = len(faces.loops) > PAINT_LIMIT
    return _painter(snapshot, faces) if many else _polygon_drawer(snapshot, faces)


def _polygon_drawer(snapshot: Snapshot, faces: Faces) -> Drawer:
    """A function that draws every loop as a polygon."""
    polygons = _polygons(snapshot, faces)

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


def _painter(snapshot: Snapshot, faces: Faces) -> Drawer:
    """A function that shows the loops as pixels, painted once for all panels."""
    from studies.snapshot.paint import paint_loops

    painting = paint_loops(snapshot.graph, faces, PIXELS)

    def draw(ax: Axes, values: NDArray[Any], colours: Colormap, scale: Normalize) -> ScalarMappable:
        # Of every loop and of none: there are more pixels than loops, and each is looked at often.
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
    ax.set(aspect="equal", xlabel=r"$x_1$ (length unit of the input)", ylabel=r"$x_2$")


def _outline(snapshot: Snapshot, faces: Faces, ax: Axes, unstable: Flags) -> None:
    """Draw a line around the unstable loops: some are too soft to show by their colour."""
    picked = np.flatnonzero(unstable)
    if len(picked) > VECTOR_LIMIT:
        return
    ax.add_collection(
        PolyCollection(
            _polygons(snapshot, faces, picked),
            facecolors="none",
            edgecolors=VERMILION,
            linewidths=0.8 * _line_width(len(faces.loops)),
            rasterized=len(faces.loops) > VECTOR_LIMIT,
        ),
        autolim=False,
    )
    handle = Line2D([], [], color=VERMILION, label="unstable, traction closure, spins blocked")
    ax.legend(handles=[handle], loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)


def _line_width(loops: int) -> float:
    return float(np.clip(60.0 / max(loops, 1) ** 0.5, 0.25, 1.0))


def _polygons(
    snapshot: Snapshot, faces: Faces, picked: Integers | slice = slice(None)
) -> list[Floats]:
    """Corners of each loop, or of those picked."""
    offsets, at = half_edges_of_loops(faces, picked)
    corners = loop_corners(snapshot.graph, faces, offsets, at)
    return [corners[a:b] for a, b in pairwise(offsets.tolist())]
