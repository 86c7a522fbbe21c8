"""Figures of the diamond study. Each function draws into the axes it is given, or new ones."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from patterns.diamond import external_forces
from stability import spectrum, symmetric_spectrum
from studies.diamond.path import DiamondPath
from studies.diamond.polar import RADIUS, settled_diagram
from studies.diamond.states import loop_graph
from studies.style import (
    BLACK,
    BLUE,
    GREY,
    LIGHT_GREY,
    ORANGE,
    SKY,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    figure_of,
    new_figure,
    save_figure,
    styled,
)

STRAIN = r"axial strain $E_1$ (–)"


def draw_figures(path: DiamondPath, folder: Path, source: Mapping[str, Any]) -> None:
    """Draw and save every figure of the study.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    folder : Path
        Where.
    source : mapping
        From `studies.output.provenance`.
    """
    save_figure(figure_of(draw_determinant(path)), folder, "determinant", source)
    save_figure(figure_of(draw_eigenvalues(path)), folder, "eigenvalues", source)
    if path.marks:
        save_figure(draw_polar_figure(path), folder, "polar", source)
    if "A" in path.marks:
        save_figure(figure_of(draw_loop(path, "A")), folder, "loop_A", source)


@styled()
def draw_determinant(path: DiamondPath, ax: Axes | None = None) -> Axes:
    """Determinants of K and of Ks along the path, with its events.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax)
    E1, found = path.states.E1, path.operators
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    ax.plot(E1, found.det_K, color=BLUE, label=r"$\det K$")
    ax.plot(E1, found.det_Ks, color=ORANGE, linestyle=(0, (4, 3)), label=r"$\det K_s$")
    _mark_states(path, ax, found.det_K)
    ax.set(xlabel=STRAIN, ylabel="determinant (–)")
    _mark_touch(path, ax)
    ax.legend(loc="lower left")
    return ax


@styled()
def draw_eigenvalues(path: DiamondPath, ax: Axes | None = None) -> Axes:
    """Eigenvalues of K (real parts) and of Ks along the path, with its events.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax)
    values, symmetric = spectrum(path.operators.K).real, symmetric_spectrum(path.operators.K)
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    for k in range(2):
        ax.plot(path.states.E1, values[:, k], color=BLUE, label="$K$" if k == 0 else None)
        ax.plot(
            path.states.E1,
            symmetric[:, k],
            color=ORANGE,
            linestyle=(0, (4, 3)),
            label="$K_s$" if k == 0 else None,
        )
    _mark_states(path, ax, symmetric[:, 0])
    ax.set(xlabel=STRAIN, ylabel="eigenvalues (–)")
    _mark_touch(path, ax)
    ax.legend(loc="center left")
    return ax


@styled()
def draw_polar(K: NDArray[np.float64], ax: Axes | None = None, name: str = "") -> Axes:
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
    ax = axes_or_new(ax, 2.5, 2.5)
    diagram = settled_diagram(K)
    closed = np.concatenate([diagram.points, diagram.points[:1]])
    angle = np.append(diagram.angle, 2.0 * np.pi)
    circle = RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inside = np.append(diagram.work, diagram.work[0]) < 0.0
    for part in _runs(inside):
        outline = np.concatenate([closed[part], circle[part][::-1]])
        ax.fill(*outline.T, facecolor=VERMILION, alpha=0.35, linewidth=0.0)
    ax.plot(*circle.T, color=GREY, linewidth=0.8, linestyle=(0, (3, 2)))
    ax.plot(*closed.T, color=BLUE)
    ax.text(0.0, 0.0, name, ha="center", va="center", fontweight="bold")
    ax.set(xlim=(-3.15, 3.15), ylim=(-3.15, 3.15), aspect="equal")
    ax.set(xticks=[-2, 0, 2], yticks=[-2, 0, 2])
    ax.set(xlabel=r"$(2 + w_2)\,\cos\alpha_E$ (–)", ylabel=r"$(2 + w_2)\,\sin\alpha_E$ (–)")
    return ax


@styled()
def draw_polar_figure(path: DiamondPath) -> Figure:
    """Polar diagrams of the named states side by side.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    Figure
    """
    count = len(path.marks)
    fig = new_figure(0.5 + count * (TWO_COLUMNS - 0.5) / 3.0, 2.6)
    axes = fig.subplots(1, count, sharey=True, squeeze=False)[0]
    for ax, (name, row) in zip(axes, path.marks.items(), strict=True):
        draw_polar(path.operators.K[row], ax, name)
        ax.label_outer()
    return fig


@styled()
def draw_loop(path: DiamondPath, name: str, ax: Axes | None = None) -> Axes:
    """The loop at a named state: grains, contact forces and external forces.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    name : {'I', 'A'}
        Which state.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax, 3.0, 3.0)
    row, graph = path.marks[name], loop_graph(path.loop, path.states)
    x, radius = graph.x[row], float(graph.radii[row, 0])
    for centre in x:
        ax.add_patch(Circle(centre, radius, facecolor=SKY, alpha=0.3, linewidth=0.0))
        ax.add_patch(Circle(centre, radius, fill=False, edgecolor=BLACK, linewidth=0.8))
    force = np.hypot(graph.normal_force[row], graph.shear_force[row])
    largest = max(float(force.max()), np.finfo(float).tiny)
    for (i, j), size in zip(graph.contacts, force, strict=True):
        width = 4.0 * size / largest
        ax.plot(*x[[i, j]].T, color=VERMILION, linewidth=width, solid_capstyle="round")
    ax.plot(*x.T, "o", color=BLACK, markersize=2.5)
    _external_forces(path, row, x, radius, ax)
    ax.set(aspect="equal", xlabel=r"$x_1 / l_0$ (–)", ylabel=r"$x_2 / l_0$ (–)")
    return ax


def _external_forces(
    path: DiamondPath, row: int, x: NDArray[np.float64], radius: float, ax: Axes
) -> None:
    """Arrows towards the four grains, their length in proportion to the forces (12)."""
    states = path.states
    forces = external_forces(states.N[row], states.T[row], states.alpha[row])
    largest = max(float(f) for f in forces)
    for grain, centre in enumerate(x if largest > 0.0 else []):
        outward = centre / np.linalg.norm(centre)
        size = float(forces[grain % 2]) / largest
        tip, tail = centre + radius * outward, centre + (radius + 0.1 + 0.5 * size) * outward
        ax.annotate("", tip, tail, arrowprops={"arrowstyle": "-|>", "color": BLACK})
        if grain < 2:
            ax.annotate(f"$F_{grain % 2 + 1}$", tail, (5, 3), textcoords="offset points", ha="left")
    reach = radius + 0.75
    ax.set_xlim(-x[0, 0] - reach, x[0, 0] + reach)
    ax.set_ylim(-x[1, 1] - reach, x[1, 1] + reach)


def _mark_states(path: DiamondPath, ax: Axes, values: NDArray[np.float64]) -> None:
    for name, row in path.marks.items():
        at = path.states.E1[row], values[row]
        ax.plot(*at, "o", color=BLACK, zorder=3)
        text = ax.annotate(name, at, (4, 4), textcoords="offset points", fontweight="bold")
        text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def _mark_touch(path: DiamondPath, ax: Axes) -> None:
    """A line where opposite grains meet, named above the axes, where no curve runs."""
    for event in path.events:
        if event.kind == "opposite_contact":
            ax.axvline(event.E, color=LIGHT_GREY, linewidth=1.0, zorder=0)
            ax.annotate(
                "opposite grains touch",
                (event.E, 1.0),
                (0, 2),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                ha="center",
                va="bottom",
                color=GREY,
                fontsize=7,
            )


def _runs(inside: NDArray[np.bool_]) -> list[slice]:
    """Stretches of True, as slices that reach one point beyond either end."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int64), [0]])))
    last = len(inside)
    return [slice(max(a - 1, 0), min(b + 1, last)) for a, b in edges.reshape(-1, 2)]
