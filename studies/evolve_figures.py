"""Figures of a path: stress and volume over the driven component, second-order work of loops."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from loops.arrays import Floats
from patterns import Snapshot
from studies.snapshot.loop_map import draw_values, loop_drawer
from studies.style import BLUE, DIVERGING, GREY, VERMILION, new_panels, styled, write_animation

FORECAST_LOOKS: dict[str, tuple[str, dict[str, Any]]] = {
    "dem": ("DEM", {"linestyle": "none", "marker": "o", "fillstyle": "none", "color": "black"}),
    "events": ("path by events", {"linestyle": "-", "marker": ".", "color": BLUE}),
    "replay": ("replay", {"linestyle": "--", "marker": ".", "color": VERMILION}),
    "persistence": ("stress of the start", {"linestyle": ":", "color": GREY}),
}
STRESS_LOOKS = {"P11": (BLUE, "-"), "P22": (VERMILION, "--")}


def path_figures(
    snapshot: Snapshot, tables: dict[str, pd.DataFrame], summary: dict[str, Any]
) -> Iterator[tuple[str, Figure]]:
    """Every figure of a path by name."""
    yield "stress_strain", stress_and_volume(tables, summary["driven"])
    if summary["forecast"] is not None:
        yield "forecast", forecast_figure(tables, summary["driven"])
    yield "map", work_maps(snapshot, tables["loops"], summary)


@styled()
def stress_and_volume(tables: dict[str, pd.DataFrame], driven: str) -> Figure:
    """Both normal stresses and the volume along the path, with the DEM's for comparison."""
    path, dem, events = tables["path"], tables.get("dem"), tables["events"]
    figure, ((stress, volume),) = new_panels(1, 2, 2.7)
    _draw_stresses(stress, path, driven)
    volume.plot(path["driven"], path["H11"] + path["H22"], color=BLUE, label="path")
    if dem is not None:
        at = dem[driven] - (path[driven].iloc[0] if driven[0] == "P" else 0.0)
        ring: dict[str, Any] = {"linestyle": "none", "marker": "o", "fillstyle": "none"}
        stress.plot(at, dem["P11"] - path["P11"].iloc[0], color=BLUE, label="DEM", **ring)
        stress.plot(at, dem["P22"] - path["P22"].iloc[0], color=VERMILION, **ring)
        volume.plot(at, dem["H11"] + dem["H22"], color=BLUE, label="DEM", **ring)
    unstable = events["driven"][events["kind"] == "instability"]
    stress.plot(
        unstable, np.zeros(len(unstable)), "|", color=GREY, markersize=8,
        transform=stress.get_xaxis_transform(), clip_on=False,
    )  # fmt: skip
    volume.set(xlabel=f"${_change(driven)}$", ylabel=r"$H_{11} + H_{22}$")
    volume.ticklabel_format(axis="x", scilimits=(-3, 3))
    for ax in (stress, volume):
        ax.legend()
    return figure


@styled()
def forecast_figure(tables: dict[str, pd.DataFrame], driven: str) -> Figure:
    """Changes of the driven stress and the area: predicted at the snapshots of the DEM, its own."""
    table = tables["forecast"]
    figure, ((stress, volume),) = new_panels(1, 2, 2.7)
    start, at = table["stress_persistence"].iloc[0], np.append(0.0, table["driven"])
    for quantity, ax, first in (("stress", stress, start), ("volume", volume, 0.0)):
        for name, (label, look) in FORECAST_LOOKS.items():
            column = f"{quantity}_{name}"
            if column in table:
                ax.plot(at, np.append(0.0, table[column] - first), label=label, **look)
        ax.set_xlabel(f"${_change(driven)}$ from the start of the forecast")
        ax.ticklabel_format(axis="x", scilimits=(-3, 3))
    for number, k in enumerate(np.flatnonzero(table["drop"])):
        look = {"color": GREY, "alpha": 0.25, "linewidth": 0}
        stress.axvspan(at[k], at[k + 1], label="_" * (number > 0) + "drop in the DEM", **look)
    stress.set_ylabel(f"$P_{{{driven[1:]}}}$ - {start:.4g} (force/length)")
    volume.set_ylabel(r"change of area $H_{11} + H_{22}$ (1)")
    for ax in (stress, volume):
        ax.legend()
    return figure


def _draw_stresses(ax: Axes, path: pd.DataFrame, driven: str) -> None:
    """Changes of both normal stresses along the path."""
    for name, (colour, style) in STRESS_LOOKS.items():
        start = path[name].iloc[0]
        label = f"${name[0]}_{{{name[1:]}}}$, from {start:.4g}"
        ax.plot(path["driven"], path[name] - start, style, color=colour, label=label)
    ax.set(xlabel=f"${_change(driven)}$", ylabel="change of nominal stress\n(force/length)")
    ax.ticklabel_format(axis="x", scilimits=(-3, 3))


def _change(driven: str) -> str:
    """Mathematical text for the change of the driven component."""
    return f"\\Delta {driven[0]}_{{{driven[1:]}}}"


@styled()
def animate_path(
    snapshot: Snapshot, works: Floats, path: pd.DataFrame, summary: dict[str, Any], folder: Path
) -> list[Path]:
    """Animate the loops' normalised work since the start, (rows, loops), beside the stresses."""
    figure, ((left, right),) = new_panels(1, 2, 3.4)
    draw, colours = loop_drawer(snapshot), (mpl.colormaps[DIVERGING], Normalize(-1.0, 1.0))
    loops: Any = draw(left, works[0], *colours)
    label = "normalised $W_2$ since the start"
    figure.colorbar(ScalarMappable(*colours[::-1]), ax=left, shrink=0.75, label=label)
    _draw_stresses(right, path, summary["driven"])
    rings = [right.plot([0.0], [0.0], "o", color=colour)[0] for colour, _ in STRESS_LOOKS.values()]
    right.legend()

    def show(row: int) -> None:
        # A picture of many loops has the colours of its pixels: it is drawn again.
        nonlocal loops
        loops.remove()
        loops = draw(left, works[row], *colours)
        for ring, name in zip(rings, STRESS_LOOKS, strict=True):
            ring.set_data([path["driven"][row]], [path[name][row] - path[name].iloc[0]])

    return write_animation(folder, figure, map(show, range(1, len(works))), summary["provenance"])


@styled()
def work_maps(snapshot: Snapshot, loops: pd.DataFrame, summary: dict[str, Any]) -> Figure:
    """Loops by their second-order work, and by the driven value where it is first negative."""
    figure, ((work, first),) = new_panels(1, 2, 3.0)
    draw = loop_drawer(snapshot)
    label = r"$W_2$ / mean $k_n$"
    draw_values(draw, work, loops["W2"].to_numpy() / summary["mean_kn"], label, signed=True)
    driven = summary["driven"]
    begun = np.abs(loops["negative_from"].to_numpy())
    label = f"$|{_change(driven)}|$ where $W_2$ is first negative"
    draw_values(draw, first, begun, label)
    return figure
