"""Figures over the direction of the strain rate: polar diagrams and the instability cone."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stability import PolarDiagram
from studies.diamond.marking import STRAIN, smooth_rows
from studies.diamond.path import DiamondPath
from studies.diamond.polar import RADIUS, diagram_beyond_yield, settled_diagram, state_diagram
from studies.diamond.table import path_table
from studies.style import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    new_figure,
    styled,
    write_above,
)

Floats = NDArray[np.float64]


@styled()
def draw_polar(K: Floats, ax: Axes | None = None, name: str = "") -> Axes:
    """Polar diagram of the normalised second-order work, as the paper's Fig. 11.

    The curve is `(2 + w2) (cos alphaE, sin alphaE)`, `tan(alphaE) = E1'/E2'`; where it runs inside
    the circle of radius 2 the second-order work is negative.

    Parameters
    ----------
    K : ndarray (2, 2)
        Tangent.
    ax : Axes, optional
        Where to draw; a new figure if left out.
    name : str
        Name of the state, written at the centre.

    Returns
    -------
    Axes
    """
    return _draw_diagram(settled_diagram(K), axes_or_new(ax, 2.5, 2.5), name)


@styled()
def draw_polar_figure(path: DiamondPath) -> Figure:
    """Polar diagrams of the named states side by side.

    At B every direction has the regime it activates, elastic or sliding; a dashed curve shows
    sliding contacts in all directions, the operator of the path beyond B.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    Figure
    """
    count = len(path.marks)
    fig = new_figure(0.5 + count * (TWO_COLUMNS - 0.5) / 3.0, 2.75)
    axes = fig.subplots(1, count, sharey=True, squeeze=False)[0]
    for ax, name in zip(axes, path.marks, strict=True):
        _draw_diagram(state_diagram(path, name), ax, name)
        beyond = diagram_beyond_yield(path) if name == "B" else None
        if beyond is not None:
            closed = np.concatenate([beyond.points, beyond.points[:1]])
            label = "all directions sliding"
            ax.plot(*closed.T, color=ORANGE, linewidth=0.9, linestyle=(0, (3, 2)), label=label)
            ax.legend(loc="lower center", bbox_to_anchor=(0.5, 0.98), borderaxespad=0.0)
        ax.label_outer()
    return fig


@styled()
def draw_cone(path: DiamondPath, ax: Axes | None = None) -> Axes:
    """Opening of the instability cone along the path, with the path's own direction (Fig. 12).

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
        `alphaE` over E1; `tan(alphaE) = E1'/E2'`.
    """
    ax = axes_or_new(ax, 4.2, 2.8)
    rows, E1, first = path_table(path), path.states.E1, True
    upper, lower = (np.mod(90.0 - rows["cone_axis_deg"], 180.0) + half for half in _halves(rows))
    for part in smooth_rows(path):
        ax.fill_between(
            E1[part], lower[part], upper[part],
            facecolor="none", edgecolor=VERMILION, hatch="////", linewidth=0.8,
            label="instability cone" if first else None,
        )  # fmt: skip
        first = False
    ax.plot(E1, rows["loading_alphaE_deg"], color=BLUE, label="loading direction")
    for name, row in path.marks.items():
        ax.axvline(E1[row], color=GREY, linewidth=0.7, linestyle=(0, (2, 2)), zorder=0)
        write_above(ax, E1[row], name, fontweight="bold")
    ax.set(xlabel=STRAIN, ylabel=r"$\alpha_E$ (degrees)", xlim=(0.0, None), ylim=(0.0, 180.0))
    ax.set_yticks(np.arange(0, 181, 45))
    ax.legend(loc="lower left")
    return ax


def _halves(rows: dict[str, NDArray[np.float64]]) -> tuple[Floats, Floats]:
    """Half the opening to either side of the axis; NaN where there is no cone."""
    half = np.where(rows["cone_opening_deg"] > 0.0, 0.5 * rows["cone_opening_deg"], np.nan)
    return half, -half


def _draw_diagram(diagram: PolarDiagram, ax: Axes, name: str) -> Axes:
    closed = np.concatenate([diagram.points, diagram.points[:1]])
    angle = np.append(diagram.angle, 2.0 * np.pi)
    circle = RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inside = np.append(diagram.work, diagram.work[0]) < 0.0
    for part in _runs(inside):
        outline = np.concatenate([closed[part], circle[part][::-1]])
        ax.fill(*outline.T, facecolor=VERMILION, alpha=0.35, linewidth=0.0)
    ax.plot(*circle.T, color=GREY, linewidth=0.8, linestyle=(0, (3, 2)))
    ax.plot(*closed.T, color=BLUE)
    ax.text(0.0, 0.0, name, ha="center", va="center", fontweight="bold", color=BLACK)
    ax.set(xlim=(-3.15, 3.15), ylim=(-3.15, 3.15), aspect="equal")
    ax.set(xticks=[-2, 0, 2], yticks=[-2, 0, 2])
    ax.set(xlabel=r"$(2 + w_2)\,\cos\alpha_E$ (–)", ylabel=r"$(2 + w_2)\,\sin\alpha_E$ (–)")
    return ax


def _runs(inside: NDArray[np.bool_]) -> list[slice]:
    """Stretches of True, as slices that reach one point beyond either end."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int64), [0]])))
    last = len(inside)
    return [slice(max(a - 1, 0), min(b + 1, last)) for a, b in edges.reshape(-1, 2)]
