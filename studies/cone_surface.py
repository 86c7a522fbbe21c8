"""The instability cone in space: where W2 = 0 over (E11, E22, sqrt2 E12), as a picture.

Run as `python -m studies.cone_surface --out DIR`: a hexagon beyond its threshold, compressed
isotropically, and one whose contacts slide on a drained biaxial path.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.axes3d import Axes3D  # type: ignore[import-untyped]
from numpy.typing import ArrayLike, NDArray

from loops import InputError, LinearFrictional
from patterns import regular_polygon
from stability import (
    RTOL,
    Stage,
    follow,
    operator_norm,
    programmes,
    symmetric_modes,
    symmetric_spectrum,
    unstable_fraction,
)
from stability.subspaces import as_operator
from studies.output import provenance, result_folder, write_summary, write_table
from studies.style import (
    BLACK,
    GREY,
    SKY,
    TWO_COLUMNS,
    VERMILION,
    new_figure,
    save_figure,
    styled,
)

Floats = NDArray[np.float64]
Colour = tuple[float, float, float, float]

AXES = (r"$\dot E_{11}$", r"$\dot E_{22}$", r"$\sqrt{2}\,\dot E_{12}$")
AROUND, ALONG = 145, 25
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
        If K is not (3, 3).

    Examples
    --------
    >>> axis, edge, inside = cone_edge(np.diag([-1.0, 3.0, 3.0]), 3)
    >>> axis.tolist(), (edge[:, 0] ** 2).round(12).tolist(), inside
    ([1.0, 0.0, 0.0], [0.75, 0.75, 0.75], True)
    """
    operator = as_operator(K, size=3)
    if operator.ndim != 2:
        raise InputError("operator", f"shape {operator.shape}", "one operator", "Pick one.")
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
    if len(edge):
        _draw_regions(ax, axis, edge, inside)
    else:
        unstable = bool(values[0] < -RTOL * operator_norm(K))
        _surface(ax, _sphere(), to_rgba(VERMILION if unstable else SKY, 0.25), shade=False)
    _draw_frame(ax)
    share = float(unstable_fraction(values)) if len(edge) else float(values[2] < 0.0)
    said = f"unstable: {100.0 * share:.1f} % of directions"
    ax.set_title(f"{title}\n{said}" if title else said, pad=6.0)
    return ax


def _draw_regions(ax: Axes3D, axis: Floats, edge: Floats, inside: bool) -> None:
    """Both nappes, the caps that they cut from the sphere and the band between."""
    cap, band = (VERMILION, SKY) if inside else (SKY, VERMILION)
    share = np.linspace(0.0, 1.0, ALONG)[:, None, None]
    for sense in (1.0, -1.0):
        rim = sense * edge
        # The cone itself is solid and shaded, the regions of the sphere are glass.
        _surface(ax, share * rim, to_rgba(cap), shade=True)
        arc = _arc(np.broadcast_to(sense * axis, rim.shape), rim, share)
        _surface(ax, arc, to_rgba(cap, 0.3 if inside else 0.15), shade=False)
        ax.plot(*rim.T, color=BLACK, linewidth=1.0)
    # Around the band by way of its middle: opposite rims may lie more than a right angle apart.
    middle = edge - (edge @ axis)[:, None] * axis
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    mirror = 2.0 * (edge @ middle.T).diagonal()[:, None] * middle - edge
    for rim in (edge, mirror):
        glass = to_rgba(band, 0.12 if inside else 0.25)
        _surface(ax, _arc(middle, rim, share), glass, shade=False)


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


def _surface(ax: Axes3D, points: Floats, colour: Colour, *, shade: bool) -> None:
    x, y, z = np.moveaxis(points, -1, 0)
    ax.plot_surface(
        x, y, z, color=colour, shade=shade, rstride=4, cstride=3, edgecolor="none",
        linewidth=0.0, antialiased=False, rasterized=True,
    )  # fmt: skip


def _draw_frame(ax: Axes3D) -> None:
    """Axes through the centre with their names, and the direction of isotropic strain."""
    for k, name in enumerate(AXES):
        end = 1.25 * np.eye(3)[k]
        ax.plot(*np.stack([-end, end]).T, color=BLACK, linewidth=0.7)
        ax.text(*(1.1 * end), name, ha="center", va="center")
    isotropic = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    ax.plot(*np.stack([-1.3 * isotropic, 1.3 * isotropic]).T, color=GREY, linestyle=(0, (4, 2)))
    ax.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
    ax.set_box_aspect((1, 1, 1), zoom=1.15)
    ax.view_init(elev=18.0, azim=-20.0)
    ax.set_axis_off()


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


def hexagon_states(
    order: int, kappa: float, phi: float, compression: float, confine: float, axial: float
) -> dict[str, Floats]:
    """Tangents of a regular loop under the traction closure, in the symmetric subspace.

    Parameters
    ----------
    order : int
        Number of grains.
    kappa, phi : float
        kt/kn; friction angle, degrees.
    compression : float
        Isotropic strain of the first state.
    confine, axial : float
        Isotropic strain, and axial strain to which the drained biaxial path then leads.

    Returns
    -------
    dict of str to (3, 3) array

    Raises
    ------
    InputError
        If the path does not reach its end.
    """
    law = LinearFrictional(kn=1.0, kt=kappa, mu=float(np.tan(np.radians(phi))))
    isotropic = Stage(programmes.isotropic_strain(), "H11", compression)
    drained = [
        Stage(programmes.isotropic_strain(), "H11", confine),
        Stage(programmes.drained_biaxial(), "H11", axial),
    ]
    named = {
        f"isotropic, $E$ = {compression:g}": [isotropic],
        f"drained biaxial, $E_1$ = {axial:g}": drained,
    }
    states = {}
    for name, stages in named.items():
        path = follow(regular_polygon(order), law, stages, closure="traction", subspace="symmetric")
        if path.status != "finished":
            raise InputError(name, path.message, "a path to its end", "Load the loop less.")
        states[name] = path.K[-1]
    return states


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    order: Annotated[int, typer.Option(help="Number of grains.")] = 6,
    kappa: Annotated[float, typer.Option(help="kt/kn.")] = 0.2,
    phi: Annotated[float, typer.Option(help="Friction angle, degrees.")] = 5.0,
    compression: Annotated[float, typer.Option(help="Isotropic strain, first state.")] = 0.2,
    confine: Annotated[float, typer.Option(help="Isotropic strain before the biaxial path.")] = 0.1,
    axial: Annotated[float, typer.Option(help="Axial strain at its end.")] = 0.2,
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Draw the cone of a loop in two states; write the picture and its numbers."""
    given: dict[str, Any] = {
        "order": order, "kappa": kappa, "phi": phi, "compression": compression,
        "confine": confine, "axial": axial,
    }  # fmt: skip
    try:
        with result_folder(out, force=force) as folder:
            states = hexagon_states(**given)
            made = provenance("cone surface", given, "K over kn")
            write_table(folder, "cone_surface", _edges(states), made, csv=True)
            write_summary(folder, {"states": _numbers(states), "provenance": made})
            save_figure(draw_states(states), folder, "cone_surface", made)
    except InputError as error:
        typer.echo(f"cone surface: {' '.join(str(error).split())}", err=True)
        raise typer.Exit(2) from None
    typer.echo(f"results in {out}")


def _numbers(states: dict[str, Floats]) -> dict[str, Any]:
    return {
        name: {
            "K": K,
            "eigenvalues_Ks": symmetric_spectrum(K),
            "unstable_fraction": float(unstable_fraction(symmetric_spectrum(K))),
        }
        for name, K in states.items()
    }


def _edges(states: dict[str, Floats]) -> dict[str, Any]:
    """One row for each direction of each edge."""
    edges = {name: cone_edge(K)[1] for name, K in states.items()}
    every = np.concatenate(list(edges.values()))
    names = [name for name, edge in edges.items() for _ in edge]
    return {"state": names, "E11": every[:, 0], "E22": every[:, 1], "sqrt2_E12": every[:, 2]}


if __name__ == "__main__":
    typer.run(main)
