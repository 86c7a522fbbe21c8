"""Figures of the search for flutter: maps over T/N and N/l, shares by order."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from studies.style import (
    GREY,
    LIGHT_GREY,
    LINE_COLOURS,
    SEQUENTIAL,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    new_figure,
    styled,
)

Floats = NDArray[np.float64]
Maps = dict[tuple[str, str, str], tuple[Floats, Floats]]


@styled()
def draw_map(
    friction: Floats, overlap: Floats, ratio: Floats, share: Floats, ax: Axes | None = None
) -> QuadMesh:
    """Largest |Im|/|eigenvalue| over T/N and N/l; white: none flutters, grey: no loop bears it.

    The line bounds the cells of which a tenth of the loops or more flutter.

    Parameters
    ----------
    friction, overlap : (F,), (O,) array
        Levels.
    ratio, share : (O, F) array
        From `flutter_map`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    QuadMesh
        For a colour bar.
    """
    ax = axes_or_new(ax)
    colours = mpl.colormaps[SEQUENTIAL].with_extremes(under="white")
    shown = np.ma.masked_invalid(np.where(ratio > 0.0, ratio, ratio - 1.0))
    mesh = ax.pcolormesh(
        friction, overlap, shown, cmap=colours, vmin=0.0, vmax=1.0, rasterized=True
    )
    ax.set_facecolor(LIGHT_GREY)
    if np.nanmin(share) < 0.1 < np.nanmax(share):
        ax.contour(friction, overlap, share, levels=[0.1], colors=VERMILION, linewidths=1.2)
    ax.set(yscale="log")
    return mesh


@styled()
def draw_maps(friction: Floats, overlap: Floats, maps: Maps) -> Figure:
    """Maps of every family, closures in rows.

    Parameters
    ----------
    friction, overlap : (F,), (O,) array
        Levels.
    maps : dict
        (ratio, share) by (closure, forces, contacts).

    Returns
    -------
    Figure
    """
    closures = list(dict.fromkeys(key[0] for key in maps))
    families = list(dict.fromkeys(key[1:] for key in maps))
    fig = new_figure(TWO_COLUMNS, 3.9)
    axes = fig.subplots(len(closures), len(families), sharex=True, sharey=True, squeeze=False)
    for row, closure in zip(axes, closures, strict=True):
        for ax, family in zip(row, families, strict=True):
            mesh = draw_map(friction, overlap, *maps[closure, *family], ax)
            if closure == closures[0]:
                ax.set_title(f"{family[0]} forces, {family[1]}")
        row[0].set_ylabel(f"{closure} closure\n" + r"$N/(k_n l)$ (–)")
    for ax in axes[-1]:
        ax.set_xlabel(r"largest $|T|/N$ (–)")
    label = r"largest $|\mathrm{Im}\,\lambda|/|\lambda|$ (–)"
    fig.colorbar(mesh, ax=axes, label=label, shrink=0.8)
    line = Line2D([], [], color=VERMILION, linewidth=1.2, label="a tenth of the loops flutter")
    blank = Patch(facecolor="white", edgecolor=GREY, linewidth=0.5, label="none does")
    unborne = Patch(facecolor=LIGHT_GREY, label="no loop bears it")
    fig.legend(handles=[line, blank, unborne], loc="outside lower center", ncols=3)
    return fig


@styled()
def draw_shares(rows: list[dict[str, Any]]) -> Figure:
    """Share of irregular loops that flutter, by order.

    Parameters
    ----------
    rows : list of dict
        From `search`.

    Returns
    -------
    Figure
    """
    names = ("affine symmetric", "traction symmetric", "grains")
    titles = ("affine, symmetric", "traction, symmetric", "grain-level")
    fig = new_figure(TWO_COLUMNS, 2.5)
    axes = fig.subplots(1, len(names), sharey=True)
    for ax, name, title in zip(axes, names, titles, strict=True):
        own = [row for row in rows if row["operator"] == name and row["shape"] == "irregular"]
        families = list(dict.fromkeys((row["forces"], row["contacts"]) for row in own))
        for family, colour in zip(families, LINE_COLOURS, strict=False):
            mine = [row for row in own if (row["forces"], row["contacts"]) == family]
            share = [row["share"] or np.nan for row in mine]
            label = f"{family[0]} forces, {family[1]}"
            ax.semilogy([row["order"] for row in mine], share, "o-", color=colour, label=label)
        ax.set(xlabel="order (number of grains)", title=title)
    axes[0].set_ylabel("share of loops with flutter (–)")
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=4)
    return fig
