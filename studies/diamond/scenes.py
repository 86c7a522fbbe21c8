"""Pictures: the loop at a state, and the two routes of the paper's Fig. 4."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from patterns.diamond import external_forces
from studies.diamond.path import DiamondPath
from studies.diamond.path_dependence import path_dependence_table
from studies.diamond.states import loop_graph
from studies.style import (
    BLACK,
    BLUE,
    GREY,
    SKY,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    new_figure,
    styled,
)


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


@styled()
def draw_path_dependence(path: DiamondPath) -> Figure:
    """Two routes between the same two positions of a contact, and the work along each (Fig. 4).

    Parameters
    ----------
    path : DiamondPath
        Gives the stiffness ratio and the compression.

    Returns
    -------
    Figure
        Lines are (9) and (10), points the integrated rate law.
    """
    table = path_dependence_table(path.loop)
    fig = new_figure(TWO_COLUMNS, 2.8)
    geometry, works = fig.subplots(1, 2, width_ratios=[1.0, 1.25])
    _draw_routes(float(table["compression"][0]), geometry)
    for route, colour, label in (
        ("shear_then_compress", BLUE, r"$\mathcal{E}_1$ (9): A, B, C"),
        ("compress_then_shear", VERMILION, r"$\mathcal{E}_2$ (10): A, D, C"),
    ):
        works.plot(table["alpha_deg"], table[route], color=colour, label=label)
        points = slice(None, None, 5)
        works.plot(
            table["alpha_deg"][points], table[f"{route}_integrated"][points], "o",
            color=colour, markerfacecolor="white", markersize=3.5,
        )  # fmt: skip
    works.plot([], [], "o", color=GREY, markerfacecolor="white", label="rate law integrated")
    works.set(xlabel=r"turn $\alpha$ (degrees)", ylabel=r"work over $k_n l^2$ (–)", xlim=(0, 45))
    works.set(ylim=(0.0, None))
    works.legend(loc="upper left")
    return fig


def _draw_routes(compression: float, ax: Axes) -> None:
    """The centre of sphere 2 about that of sphere 1: A to C by B, or by D."""
    alpha, start = np.radians(40.0), np.radians(20.0)
    arc = start + np.linspace(0.0, alpha, 60)
    for radius, colour in ((1.0, BLUE), (1.0 - compression, VERMILION)):
        ax.plot(radius * np.cos(arc), radius * np.sin(arc), color=colour)
    ends = {"A": (1.0, arc[0]), "B": (1.0, arc[-1])}
    ends |= {"D": (1.0 - compression, arc[0]), "C": (1.0 - compression, arc[-1])}
    at = {name: (float(r * np.cos(a)), float(r * np.sin(a))) for name, (r, a) in ends.items()}
    ax.plot(*np.stack([at["B"], at["C"]]).T, color=BLUE)
    ax.plot(*np.stack([at["A"], at["D"]]).T, color=VERMILION)
    for name in ("C", "D"):
        ax.plot(*np.stack([np.zeros(2), at[name]]).T, color=GREY, linewidth=0.6, zorder=0)
    for centre, style in (((0.0, 0.0), "-"), (at["A"], "-"), (at["C"], "--")):
        ax.add_patch(Circle(centre, 0.5, fill=False, color=GREY, linewidth=0.8, linestyle=style))
    ax.plot(0.0, 0.0, "o", color=BLACK)
    for name, offset in (("A", (6, -6)), ("B", (-1, 6)), ("C", (-11, 3)), ("D", (1, -11))):
        ax.plot(*at[name], "o", color=BLACK)
        ax.annotate(name, at[name], offset, textcoords="offset points", fontweight="bold")
    ax.annotate("O", (0, 0), (-9, -9), textcoords="offset points", fontweight="bold")
    ax.annotate("sphere 1", (-0.05, -0.3), ha="center", color=GREY, fontsize=7)
    ax.annotate(
        "sphere 2", (at["A"][0] + 0.12, at["A"][1] - 0.28), ha="center", color=GREY, fontsize=7
    )
    middle = start + 0.5 * alpha
    ax.annotate(r"$\alpha$", (0.27 * np.cos(middle), 0.27 * np.sin(middle)), ha="center")
    ax.set(aspect="equal", xlim=(-0.6, 1.55), ylim=(-0.6, 1.35))
    ax.set_axis_off()
