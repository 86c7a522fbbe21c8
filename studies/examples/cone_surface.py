"""Which strain rates lie in the instability cone of a loop, in three dimensions?

A hexagon whose centres may relax: compressed isotropically beyond its threshold, and on a drained
biaxial path whose contacts slide. Drawn is the unit sphere of strain rates with the rims W2 = 0.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D  # type: ignore[import-untyped]

from loops import LinearFrictional, Scene
from loops.arrays import Floats
from patterns import regular_polygon
from stability import (
    RTOL,
    Stage,
    follow,
    operator_norm,
    programmes,
    second_order_work,
    symmetric_modes,
    symmetric_spectrum,
    unstable_fraction,
)
from studies.examples import run_example, save
from studies.style import BLACK, GREY, SKY, TWO_COLUMNS, VERMILION, new_figure, styled

AXES = (r"$\dot E_{11}$", r"$\dot E_{22}$", r"$\sqrt{2}\,\dot E_{12}$")
LAW = LinearFrictional(kn=1.0, kt=0.2, mu=float(np.tan(np.radians(5.0))))
ISOTROPIC = programmes.isotropic_strain()
DRAINED = programmes.drained_biaxial()
PATHS = {
    "isotropic, $E$ = 0.2": [Stage(ISOTROPIC, "H11", 0.2)],
    "drained biaxial, $E_1$ = 0.2": [Stage(ISOTROPIC, "H11", 0.1), Stage(DRAINED, "H11", 0.2)],
}


def states() -> dict[str, Floats]:
    """Tangent (3, 3) in the symmetric subspace at the end of each path."""
    how: dict[str, Any] = {"closure": "traction", "subspace": "symmetric"}
    return {name: follow(Scene(regular_polygon(6), LAW), stages, **how).K[-1]
            for name, stages in PATHS.items()}  # fmt: skip


def cone_edge(K: Floats, count: int = 145) -> tuple[Floats, Floats, bool]:
    """Axis v, unit directions (count, 3) of one nappe of W2 = 0, whether W2 < 0 inside it.

    One eigenvalue of Ks has a sign of its own; v is its direction. With the others b, c, W2
    vanishes along `v + rho (cos(phi) b + sin(phi) c)`,
    `rho^2 = -lambda_v/(lambda_b cos^2 + lambda_c sin^2)`. No directions if Ks is not indefinite
    beyond rounding.
    """
    values, vectors = symmetric_modes(K)
    band = RTOL * float(operator_norm(K))
    inside = bool(values[1] > -band)
    alone, others = (0, [1, 2]) if inside else (2, [0, 1])
    axis = vectors[:, alone]
    if not (values[0] < -band and values[2] > band):
        return axis, np.zeros((0, 3)), inside
    phi = np.linspace(0.0, 2.0 * np.pi, count)
    circle = np.stack([np.cos(phi), np.sin(phi)])
    spread = np.maximum(np.abs(values[others]), band) @ circle**2
    # The cotangent of the angle from the axis is finite for a plane edge too.
    polar = np.arctan2(np.sqrt(np.abs(values[alone])), np.sqrt(spread))[:, None]
    return axis, np.cos(polar) * axis + np.sin(polar) * (vectors[:, others] @ circle).T, inside


def draw_sphere(K: Floats, ax: Axes3D, title: str) -> None:
    """The sphere coloured by the sign of W2, the cone within it and its rims."""
    polar, phi = np.meshgrid(np.linspace(0, np.pi, 91), np.linspace(0, 2 * np.pi, 181))
    ring = np.sin(polar)
    sphere = np.stack([ring * np.cos(phi), ring * np.sin(phi), np.cos(polar)], axis=-1)
    sign = (second_order_work(K, sphere) < 0)[..., None]
    colours = np.where(sign, to_rgba(VERMILION, 0.3), to_rgba(SKY, 0.12))
    flat: dict[str, Any] = {"shade": False, "linewidth": 0, "rasterized": True}
    ax.plot_surface(*np.moveaxis(sphere, -1, 0), facecolors=colours, rstride=1, cstride=1, **flat)
    axis, edge, inside = cone_edge(K)
    for rim in (edge, -edge) if len(edge) else ():
        cone = np.stack([0.0 * rim, rim])
        colour = to_rgba(VERMILION if inside else SKY, 0.5)
        ax.plot_surface(*np.moveaxis(cone, -1, 0), color=colour, **flat)
        ax.plot(*rim.T, color=BLACK, linewidth=1.0)
    for k, name in enumerate(AXES):
        end = 1.35 * np.eye(3)[k]
        ax.plot(*np.stack([-end, end]).T, color=BLACK, linewidth=0.7)
        ax.text(*(1.12 * end), name, ha="center", va="center")
    isotropic = 1.3 * np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    ax.plot(*np.stack([-isotropic, isotropic]).T, color=GREY, linestyle="--")
    share = 100.0 * float(unstable_fraction(symmetric_spectrum(K)))
    ax.set_title(f"{title}\nunstable: {share:.1f} % of directions")
    ax.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
    ax.set_box_aspect((1, 1, 1), zoom=1.03)
    ax.view_init(elev=22.0, azim=float(np.degrees(np.arctan2(axis[1], axis[0]))) - 70.0)
    ax.set_axis_off()


@styled()
def draw(found: dict[str, Floats]) -> Figure:
    """States side by side; W2 < 0 in vermilion, isotropic strain dashed."""
    figure = new_figure(TWO_COLUMNS, 3.4)
    for k, (name, K) in enumerate(found.items(), start=1):
        draw_sphere(K, figure.add_subplot(1, len(found), k, projection="3d"), name)
    return figure


def main(out: Path) -> dict[str, Any]:
    """Follow both paths; write eigenvalues, unstable fractions, the rims and the figure."""
    found = states()
    edges = {name: cone_edge(K)[1] for name, K in found.items()}
    rims = []
    for name, edge in edges.items():
        along = dict(zip(("E11", "E22", "sqrt2_E12"), edge.T, strict=True))
        rims.append(pd.DataFrame({"state": name, **along}))
    table = pd.concat(rims, ignore_index=True)
    spectra = {name: symmetric_spectrum(K) for name, K in found.items()}
    shares = {name: float(unstable_fraction(values)) for name, values in spectra.items()}
    numbers = {"eigenvalues_Ks": spectra, "unstable_fraction": shares}
    return save(out, "cone_surface", draw(found), numbers, table, "K over kn")


if __name__ == "__main__":
    run_example(main)
