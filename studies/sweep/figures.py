"""Figure of the sweep: `E1` at B over the parameters, and error against time per path."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from patterns.diamond import TABLE_1, drained_end
from studies.style import (
    GREY,
    LINE_COLOURS,
    SEQUENTIAL,
    TWO_COLUMNS,
    new_figure,
    save_figure,
    styled,
)
from studies.sweep.methods import EXACT

# Contour lines of the map.
LEVELS = (0.35, 0.4, 0.5, 0.7)


def draw(rows: list[dict[str, Any]], folder: Path, source: Mapping[str, Any]) -> None:
    """Draw `E1` at B over angle and stiffness, and error against time per path.

    Parameters
    ----------
    rows : list of dict
        From `compare`.
    folder : Path
        Where to write `sweep` as PNG and SVG.
    source : mapping
        Provenance.
    """
    with styled():
        figure = new_figure(TWO_COLUMNS, 2.8)
        left, right = figure.subplots(1, 2)
        _draw_map(figure, left)
        _draw_methods(rows, right)
        save_figure(figure, folder, "sweep", source)


def _draw_map(figure: Figure, ax: Axes) -> None:
    """`E1` at B with the friction and the confinement of Table 1."""
    alpha0, kappa = np.radians(np.linspace(5.0, 85.0, 241)), np.linspace(0.05, 1.5, 241)
    end = drained_end(alpha0, kappa[:, None], TABLE_1.phi, TABLE_1.confinement)
    mesh = ax.pcolormesh(
        np.degrees(alpha0), kappa, end.state.E1, cmap=SEQUENTIAL, rasterized=True, shading="auto"
    )
    figure.colorbar(mesh, ax=ax, label="$E_1$ at B")
    lines = ax.contour(
        np.degrees(alpha0), kappa, end.state.E1, LEVELS, colors="white", linewidths=0.6
    )
    ax.clabel(lines, fontsize=6.0)
    at = (float(np.degrees(TABLE_1.alpha0)), TABLE_1.kappa)
    ax.plot(*at, "o", color="white")
    near: Any = {
        "xytext": (2, 5),
        "fontsize": 7.0,
        "textcoords": "offset points",
        "color": "white",
        "ha": "right",
    }
    ax.annotate("Table 1", at, **near)
    ax.annotate("no yield", (0.04, 0.06), xycoords="axes fraction", color=GREY)
    ax.set(xlabel=r"$\alpha_0$ (degrees)", ylabel=r"$\kappa$")


def _draw_methods(rows: list[dict[str, Any]], ax: Axes) -> None:
    for row, colour in zip(rows, LINE_COLOURS, strict=False):
        time_per_path = row["seconds"] / row["paths"]
        low, high = row["error_median"], row["error_max"]
        ax.loglog([time_per_path] * 2, [low, high], "-", color=colour)
        ax.loglog(time_per_path, high, "o", color=colour)
        right = 1 if row["method"] == EXACT else -1
        beside: Any = {"xytext": (6 * right, 0), "textcoords": "offset points", "va": "center"}
        beside["ha"] = "left" if right > 0 else "right"
        ax.annotate(row["method"], (time_per_path, high), color=colour, **beside)
        ax.loglog(time_per_path, low, "_", color=colour, markersize=8)
    ax.set(xlabel="time per path (s)", ylabel="error at B, median to largest")
