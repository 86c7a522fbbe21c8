"""Figures of a path: stress and volume over what is driven, and the loops' second-order work."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from loops import Faces
from loops.arrays import Floats
from patterns import Snapshot
from studies.series.animation import write_animation
from studies.snapshot.loop_map import draw_values, loop_drawer
from studies.style import BLUE, DIVERGING, GREY, VERMILION, Drawing, new_panels, styled

_STRESS = (
    "Changes of nominal stress and volume over {driven}, along the path; rings: the DEM's own next "
    "states, where given; ticks on the lower edge: instabilities. {said}"
)
STRESSES = {"P11": (BLUE, "-"), "P22": (VERMILION, "--")}
_MAP = (
    "Second-order work W2 of every loop from the start to the end of the path, over the mean kn "
    "(left), and the value of {driven} at the first row where it is negative (right; white: never)."
)


def path_drawings(
    snapshot: Snapshot, tables: dict[str, Any], summary: dict[str, Any]
) -> Iterator[Drawing]:
    """Every figure of a path."""
    driven, said = summary["driven"], f"{summary['status']}: {summary['message']}."
    caption, drawn = _STRESS.format(driven=driven, said=said), stress_strain(tables, driven)
    yield Drawing("stress_strain", "Stress and strain", caption, drawn)
    drawn = work_map(snapshot, snapshot.faces, tables["loops"], summary)
    yield Drawing("map", "Loops", _MAP.format(driven=driven), drawn)


@styled()
def stress_strain(tables: dict[str, Any], driven: str) -> Figure:
    """Both normal stresses and the volume along the path, the DEM's beside."""
    path, dem, events = tables["path"], tables.get("dem"), tables["events"]
    figure, ((stress, volume),) = new_panels(1, 2, 2.7)
    _draw_stresses(stress, path, driven)
    volume.plot(path["driven"], path["H11"] + path["H22"], color=BLUE, label="path")
    if dem is not None:
        at = dem[driven] - (path[driven][0] if driven[0] == "P" else 0.0)
        ring: dict[str, Any] = {"linestyle": "none", "marker": "o", "fillstyle": "none"}
        stress.plot(at, dem["P11"] - path["P11"][0], color=BLUE, label="DEM", **ring)
        stress.plot(at, dem["P22"] - path["P22"][0], color=VERMILION, **ring)
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


def _draw_stresses(ax: Axes, path: dict[str, Any], driven: str) -> None:
    """Changes of both normal stresses along the path."""
    for name, (colour, style) in STRESSES.items():
        start = path[name][0]
        label = f"${name[0]}_{{{name[1:]}}}$, from {start:.4g}"
        ax.plot(path["driven"], path[name] - start, style, color=colour, label=label)
    ax.set(xlabel=f"${_change(driven)}$", ylabel="change of nominal stress\n(force/length)")
    ax.ticklabel_format(axis="x", scilimits=(-3, 3))


def _change(driven: str) -> str:
    """The change of what is driven, between dollars."""
    return f"\\Delta {driven[0]}_{{{driven[1:]}}}"


@styled()
def animate_path(
    snapshot: Snapshot,
    faces: Faces,
    works: Floats,
    path: dict[str, Any],
    summary: dict[str, Any],
    folder: Path,
) -> list[str]:
    """The loops' normalised work since the start, (rows, loops), row by row beside the stresses."""
    figure, ((left, right),) = new_panels(1, 2, 3.4)
    draw, colours = loop_drawer(snapshot, faces), (mpl.colormaps[DIVERGING], Normalize(-1.0, 1.0))
    loops: Any = draw(left, works[0], *colours)
    label = "normalised $W_2$ since the start"
    figure.colorbar(ScalarMappable(*colours[::-1]), ax=left, shrink=0.75, label=label)
    _draw_stresses(right, path, summary["driven"])
    rings = [right.plot([0.0], [0.0], "o", color=colour)[0] for colour, _ in STRESSES.values()]
    right.legend()

    def show(row: int) -> None:
        # Many loops are a picture, whose colours are of pixels: all are drawn anew.
        nonlocal loops
        loops.remove()
        loops = draw(left, works[row], *colours)
        for ring, name in zip(rings, STRESSES, strict=True):
            ring.set_data([path["driven"][row]], [path[name][row] - path[name][0]])

    return write_animation(folder, figure, map(show, range(1, len(works))), summary["provenance"])


@styled()
def work_map(
    snapshot: Snapshot, faces: Faces, loops: dict[str, Any], summary: dict[str, Any]
) -> Figure:
    """Loops by their second-order work, and by when it first was negative."""
    figure, ((work, first),) = new_panels(1, 2, 3.0)
    draw = loop_drawer(snapshot, faces)
    label = r"$W_2$ / mean $k_n$"
    draw_values(draw, work, loops["W2"] / summary["mean_kn"], label, signed=True)
    driven = summary["driven"]
    begun = np.abs(loops["negative_from"])
    label = f"$|{_change(driven)}|$ where $W_2$ is first negative"
    draw_values(draw, first, begun, label)
    return figure
