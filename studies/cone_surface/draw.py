"""The instability cone in space: where W2 = 0 over (E11, E22, sqrt2 E12), as a picture."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.axes3d import Axes3D  # type: ignore[import-untyped]
from numpy.typing import ArrayLike, NDArray

from loops import InputError
from stability import RTOL, operator_norm, symmetric_modes, symmetric_spectrum, unstable_fraction
from stability.subspaces import as_operator
from studies.style import (
    BLACK,
    GREY,
    SKY,
    TWO_COLUMNS,
    VERMILION,
    new_figure,
    styled,
)

Floats = NDArray[np.float64]
Colour = tuple[float, float, float, float]

AXES = (r"$\dot E_{11}$", r"$\dot E_{22}$", r"$\sqrt{2}\,\dot E_{12}$")
AROUND, ALONG = 145, 13
# Lines and words in front of every surface.
FRONT = 100
UNSTABLE, STABLE, NEUTRAL = "$W_2 < 0$", "$W_2 > 0$", "$W_2 = 0$: rims of the cone"


def cone_edge(K: ArrayLike, count: int = AROUND) -> tuple[Floats, Floats, bool]:
    """Directions of one nappe of the cone W2 = 0 of an operator in three dimensions.

    One eigenvalue of Ks has a sign of its own; its direction v is the axis. With the others b, c,
    W2 vanishes along `v + rho(phi) (cos(phi) b + sin(phi) c)`,
    `rho^2 = -lambda_v/(lambda_b cos^2 + lambda_c sin^2)`.

    Parameters
    ----------
    K : array_like, shape (3, 3)
        Not symmetrised.
    count : int
        Number of directions, the first one again at the end.

    Returns
    -------
    axis : (3,) array
        Unit direction v.
    edge : (count, 3) array
        Unit directions; none, (0, 3), if Ks is not indefinite within round-off.
    inside : bool
        Whether W2 < 0 inside the nappe, about the axis, rather than around it.

    Raises
    ------
    InputError
        If K is not (3, 3) or not finite.

    Examples
    --------
    >>> axis, edge, inside = cone_edge(np.diag([-1.0, 3.0, 3.0]), 3)
    >>> axis.tolist(), (edge[:, 0] ** 2).round(12).tolist(), inside
    ([1.0, 0.0, 0.0], [0.75, 0.75, 0.75], True)
    """
    operator = as_operator(K, size=3)
    if operator.ndim != 2:
        raise InputError("operator", f"shape {operator.shape}", "one operator", "Pick one.")
    if not np.isfinite(operator).all():
        raise InputError("operator", "not finite", "finite numbers", "Leave this state out.")
    values, vectors = symmetric_modes(operator)
    band = RTOL * float(operator_norm(operator))
    inside = bool(values[1] > -band)
    alone, others = (0, (1, 2)) if inside else (2, (0, 1))
    axis = vectors[:, alone]
    if not (values[0] < -band and values[2] > band):
        return axis, np.zeros((0, 3)), inside
    phi = np.linspace(0.0, 2.0 * np.pi, count)
    b, c = (vectors[:, k] for k in others)
    weights = np.stack([np.cos(phi) ** 2, np.sin(phi) ** 2])
    spread = np.abs(np.maximum(np.abs(values[list(others)]), band) @ weights)
    # The polar angle from the axis has cotangent sqrt(spread/|lambda|): finite for a plane edge.
    polar = np.arctan2(np.sqrt(np.abs(values[alone])), np.sqrt(spread))
    turned = np.cos(phi)[:, None] * b + np.sin(phi)[:, None] * c
    return axis, np.cos(polar)[:, None] * axis + np.sin(polar)[:, None] * turned, inside


@styled()
def draw_cone_surface(K: ArrayLike, ax: Axes3D | None = None, title: str = "") -> Axes3D:
    """The cone W2 = 0 within the unit sphere of strain rates, unstable directions in vermilion.

    Parameters
    ----------
    K : array_like, shape (3, 3)
        Tangent restricted to `symmetric`: components (11, 22, (12 + 21)/sqrt 2).
    ax : Axes3D, optional
        Where to draw; a new figure if left out.
    title : str
        Written above, with the unstable fraction of directions.

    Returns
    -------
    Axes3D

    Examples
    --------
    >>> ax = draw_cone_surface(np.diag([-1.0, 3.0, 3.0]))
    >>> ax.get_title()
    'unstable: 13.4 % of directions'
    """
    if ax is None:
        ax = new_figure(3.5, 3.3).add_subplot(projection="3d")
    axis, edge, inside = cone_edge(K)
    values = symmetric_spectrum(K)
    values = np.where(np.abs(values) <= RTOL * operator_norm(K), 0.0, values)
    share = float(unstable_fraction(values))
    if len(edge):
        _draw_regions(ax, axis, edge, inside)
    else:
        _surface(ax, _sphere(), to_rgba(VERMILION if share > 0.0 else SKY, 0.25))
    _draw_frame(ax, axis)
    said = f"unstable: {100.0 * share:.1f} % of directions"
    ax.set_title(f"{title}\n{said}" if title else said, pad=6.0)
    return ax


def _draw_regions(ax: Axes3D, axis: Floats, edge: Floats, inside: bool) -> None:
    """Both nappes, the caps that they cut from the sphere and the band between."""
    cap, band = (VERMILION, SKY) if inside else (SKY, VERMILION)
    share = np.linspace(0.0, 1.0, ALONG)[:, None, None]
    for sense in (1.0, -1.0):
        rim = sense * edge
        # The cone itself is solid with its rays drawn, the regions of the sphere are glass.
        _surface(ax, share[[0, -1]] * rim, _tint(cap, 0.5), rays=_tint(cap, 1.0))
        arc = _arc(np.broadcast_to(sense * axis, rim.shape), rim, share)
        _surface(ax, arc, to_rgba(cap, 0.22 if inside else 0.1))
        ax.plot(*rim.T, color=BLACK, linewidth=1.0, zorder=FRONT)
    # Around the band by way of its middle: opposite rims may lie more than a right angle apart.
    middle = edge - (edge @ axis)[:, None] * axis
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    mirror = 2.0 * (edge @ middle.T).diagonal()[:, None] * middle - edge
    for rim in (edge, mirror):
        glass = to_rgba(band, 0.1 if inside else 0.14)
        _surface(ax, _arc(middle, rim, share), glass)


def _arc(start: Floats, end: Floats, share: Floats) -> Floats:
    """(n, count, 3) great arcs between unit vectors (count, 3)."""
    angle = np.arccos(np.clip((start * end).sum(axis=1), -1.0, 1.0))[:, None]
    sine = np.where(angle > 0.0, np.sin(angle), 1.0)
    first, last = np.sin((1.0 - share) * angle) / sine, np.sin(share * angle) / sine
    flat = angle == 0.0
    return np.asarray(np.where(flat, 1.0, first) * start + np.where(flat, 0.0, last) * end)


def _sphere() -> Floats:
    polar, phi = np.meshgrid(np.linspace(0.0, np.pi, ALONG), np.linspace(0.0, 2.0 * np.pi, AROUND))
    ring = np.sin(polar)
    return np.stack([ring * np.cos(phi), ring * np.sin(phi), np.cos(polar)], axis=-1)


def _surface(ax: Axes3D, points: Floats, colour: Colour, rays: Colour | None = None) -> None:
    x, y, z = np.moveaxis(points, -1, 0)
    ax.plot_surface(
        x, y, z, color=colour, shade=False, rstride=1, cstride=3, edgecolor=rays or "none",
        linewidth=0.3 if rays else 0.0, antialiased=rays is not None, rasterized=True,
    )  # fmt: skip


def _tint(colour: str, share: float) -> Colour:
    """The colour's share with white: opaque."""
    r, g, b = (1.0 - share + share * value for value in to_rgb(colour))
    return r, g, b, 1.0


def _draw_frame(ax: Axes3D, axis: Floats) -> None:
    """Axes through the centre with their names, the direction of isotropic strain, the view."""
    for k, name in enumerate(AXES):
        end = (1.2 if k == 2 else 1.4) * np.eye(3)[k]
        ax.plot(*np.stack([-end, end]).T, color=BLACK, linewidth=0.7)
        ax.text(*(1.12 * end), name, ha="center", va="center", zorder=FRONT)
    isotropic = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    ax.plot(*np.stack([-1.3 * isotropic, 1.3 * isotropic]).T, color=GREY, linestyle=(0, (4, 2)))
    ax.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
    ax.set_box_aspect((1, 1, 1), zoom=1.15)
    ax.view_init(elev=22.0, azim=_azimuth(axis))
    ax.set_axis_off()


def _azimuth(axis: Floats) -> float:
    """View from the side of the cone's axis, and as far in front as that allows (degrees)."""
    about = float(np.degrees(np.arctan2(axis[1], axis[0])))
    sides = [(about + turn + 180.0) % 360.0 - 180.0 for turn in (-110.0, -70.0, 70.0, 110.0)]
    return min(sides, key=abs)


@styled()
def draw_states(states: dict[str, Floats]) -> Figure:
    """Cones of several states side by side.

    Parameters
    ----------
    states : dict of str to (3, 3) array
        Tangent by the name of its state.

    Returns
    -------
    Figure
    """
    fig = new_figure(TWO_COLUMNS, 3.6)
    for k, (name, K) in enumerate(states.items(), start=1):
        draw_cone_surface(K, fig.add_subplot(1, len(states), k, projection="3d"), name)
    keys = [
        Patch(facecolor=to_rgba(c, 0.6), label=n) for c, n in ((VERMILION, UNSTABLE), (SKY, STABLE))
    ]
    rim = Line2D([], [], color=BLACK, linewidth=1.0, label=NEUTRAL)
    pressure = Line2D([], [], color=GREY, linestyle=(0, (4, 2)), label="isotropic strain")
    fig.legend(handles=[*keys, rim, pressure], loc="outside lower center", ncols=4)
    return fig
