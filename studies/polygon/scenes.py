"""Pictures of a polygon: the loop with its forces, and its polar diagrams."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from loops import Regime, macroscopic_tangent
from patterns import regular_polygon
from stability import restrict
from studies.diamond.directions import draw_polar
from studies.polygon.parameters import PolygonParameters
from studies.polygon.path import PolygonPath
from studies.style import (
    BLACK,
    BLUE,
    GREY,
    LIGHT_GREY,
    ONE_COLUMN,
    TWO_COLUMNS,
    VERMILION,
    new_figure,
    styled,
)

Floats = NDArray[np.float64]
COLOURS = {Regime.ELASTIC: BLUE, Regime.SLIDING: VERMILION, Regime.OPEN: LIGHT_GREY}
# Width of the line of the largest force, in points.
WIDEST = 4.0


@styled()
def draw_loops(found: PolygonPath) -> Figure:
    """The loop at A and at the end of its path, with its contact forces.

    A line along the force of every contact, its width in proportion: blue where the contact
    sticks, vermilion where it slides, grey where it is open.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.

    Returns
    -------
    Figure
    """
    names = list(found.marks)
    fig = new_figure(ONE_COLUMN * len(names), 3.3)
    axes = fig.subplots(1, len(names), squeeze=False, sharex=True, sharey=True)[0]
    for ax, name in zip(axes, names, strict=True):
        draw_loop(found, found.marks[name], ax)
        E1, E2 = found.path.H[found.marks[name], [0, 3]]
        ax.set_title(f"{name}: $E_1 = {E1:.4f}$, $E_2 = {E2:.4f}$")
        ax.label_outer()
    return fig


@styled()
def draw_loop(found: PolygonPath, row: int, ax: Axes) -> Axes:
    """The loop at one row of its path.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.
    row : int
        Which.
    ax : Axes
        Where to draw.

    Returns
    -------
    Axes
    """
    path = found.path
    x, ring = path.x[row], path.contacts
    size = np.ones(len(x))
    ax.add_collection(
        EllipseCollection(
            size, size, np.zeros(len(x)), units="xy", offsets=x, offset_transform=ax.transData,
            facecolors="none", edgecolors=GREY, linewidths=0.7,
        )
    )  # fmt: skip
    ax.add_collection(LineCollection(list(x[ring]), colors=LIGHT_GREY, linewidths=0.6))
    force = np.hypot(path.normal_force[row], path.shear_force[row])
    width = WIDEST * force / max(float(force.max()), np.finfo(float).tiny)
    colours = [COLOURS[Regime(int(regime))] for regime in path.regime[row]]
    lines = _force_lines(path.normal_force[row], path.shear_force[row], x[ring])
    ax.add_collection(LineCollection(list(lines), colors=colours, linewidths=width))
    ax.plot(*x.T, "o", color=BLACK, markersize=1.5)
    reach = float(np.abs(path.x[[row, *found.marks.values()]]).max()) + 0.6
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach))
    ax.set(aspect="equal", xlabel=r"$x_1 / l_0$ (–)", ylabel=r"$x_2 / l_0$ (–)")
    return ax


def _force_lines(N: Floats, T: Floats, ends: Floats) -> Floats:
    """(C, 2, 2) lines through the contacts along their forces, as long as the branches."""
    d = ends[:, 1] - ends[:, 0]
    t = np.stack([-d[:, 1], d[:, 0]], axis=1)
    along = N[:, None] * d + T[:, None] * t
    size = np.linalg.norm(along, axis=1, keepdims=True)
    length = np.linalg.norm(d, axis=1, keepdims=True)
    half = 0.5 * length * along / np.where(size > 0.0, size, 1.0)
    middle = ends.mean(axis=1)
    return np.stack([middle - half, middle + half], axis=1)


@styled()
def draw_polar_figure(found: PolygonPath, critical: float | None) -> Figure:
    """Polar diagrams of w2 in the plane (11, 22): at the critical strain, at A and at the end.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.
    critical : float, optional
        Critical isotropic strain; left out of the figure where there is none or it is 0.

    Returns
    -------
    Figure
    """
    operators = {"critical": isotropic_operator(found.parameters, critical)} if critical else {}
    operators |= {name: found.path.K[row] for name, row in found.marks.items()}
    known = {name: K for name, K in operators.items() if np.isfinite(K).all()}
    count = max(len(known), 1)
    fig = new_figure(0.5 + count * (TWO_COLUMNS - 0.5) / 3.0, 2.75)
    axes = fig.subplots(1, count, sharey=True, squeeze=False)[0]
    for ax, (name, K) in zip(axes, known.items(), strict=False):
        draw_polar(K, ax, name)
        ax.label_outer()
    return fig


def isotropic_operator(parameters: PolygonParameters, strain: float) -> Floats:
    """K of the loop in (11, 22) under an isotropic strain.

    Parameters
    ----------
    parameters : PolygonParameters
        The loop.
    strain : float
        `E1 = E2`.

    Returns
    -------
    (2, 2) array
    """
    loop = regular_polygon(parameters.order, orientation=parameters.orientation, strain=strain)
    tangent = macroscopic_tangent(
        loop, parameters.law(), parameters.closure, spins=parameters.spins
    )
    return restrict(tangent.matrix, "diagonal")
