"""Figures of one polygon's path over the axial strain, and the list of all figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from loops import Regime
from studies.polygon.path import PolygonPath
from studies.polygon.peak import axial_peak
from studies.polygon.scenes import draw_loops, draw_polar_figure
from studies.polygon.table import path_table
from studies.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILION,
    axes_or_new,
    figure_of,
    save_figure,
    styled,
    write_above,
)

STRAIN = "axial strain $E_1$ (–)"
SHARES = (
    ("diagonal", BLUE, "-", "(11, 22)"),
    ("symmetric", VERMILION, (0, (4, 2)), r"(11, 22, (12+21)/$\sqrt{2}$)"),
    ("full", GREEN, (0, (1, 1)), "all four components"),
)


def draw_figures(
    found: PolygonPath,
    critical: dict[str, float | None],
    folder: Path,
    source: Mapping[str, Any],
) -> None:
    """Draw and save every figure of the study.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.
    critical : dict
        Critical strains by subspace.
    folder : Path
        Where.
    source : mapping
        From `studies.output.provenance`.
    """
    for name, figure in all_figures(found, critical).items():
        save_figure(figure, folder, name, source)


def all_figures(found: PolygonPath, critical: dict[str, float | None]) -> dict[str, Figure]:
    """Every figure of the study by its name.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.
    critical : dict
        Critical strains by subspace.

    Returns
    -------
    dict of str to Figure
    """
    return {
        "loop": draw_loops(found),
        "stress_strain": figure_of(draw_stress_strain(found)),
        "eigenvalues": figure_of(draw_eigenvalues(found)),
        "polar": draw_polar_figure(found, critical["diagonal"]),
        "cone": figure_of(draw_cone(found)),
        "unstable_fraction": figure_of(draw_unstable_fraction(found)),
    }


@styled()
def draw_stress_strain(found: PolygonPath, ax: Axes | None = None) -> Axes:
    """Axial and lateral stress over the axial strain, with the peak.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax)
    path = found.path
    E1, s1 = path.H[:, 0], path.P[:, 0]
    slides = (path.regime == Regime.SLIDING).any(axis=1)
    opens = (path.regime == Regime.OPEN).any(axis=1) & (np.arange(len(path)) > 0)
    ax.plot(E1, path.P[:, 3], color=GREY, linewidth=0.9, label="$s_2$")
    for label, colour, rows in (
        ("$s_1$, elastic", BLUE, ~slides & ~opens),
        ("$s_1$, sliding contacts", VERMILION, slides & ~opens),
        ("$s_1$, open contacts", PURPLE, opens),
    ):
        if rows.any():
            ax.plot(E1, np.where(rows, s1, np.nan), color=colour, label=label)
    peak = axial_peak(found)
    if peak is not None:
        ax.plot(peak["E1"], peak["s1"], "o", color=BLACK, markerfacecolor="white", label="peak")
    _over_strain(found, ax, "stress over $k_n$ (–)")
    ax.margins(y=0.12)
    ax.legend(loc="best")
    return ax


@styled()
def draw_eigenvalues(found: PolygonPath, ax: Axes | None = None) -> Axes:
    """Eigenvalues of K (real parts) and of Ks in (11, 22) along the path.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax)
    path, E1 = found.path, broken(found, found.path.H[:, 0])
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    ax.plot(E1, broken(found, path.eigenvalues.real), color=BLUE, label=["$K$", None])
    symmetric = broken(found, path.symmetric_eigenvalues)
    ax.plot(E1, symmetric, color=ORANGE, dashes=(3, 2), label=["$K_s$", None])
    _over_strain(found, ax, "eigenvalues over $k_n$ (–)")
    ax.margins(y=0.1)
    ax.legend(loc="best")
    return ax


@styled()
def draw_cone(found: PolygonPath, ax: Axes | None = None) -> Axes:
    """Opening of the instability cone in the plane (11, 22) along the path.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax)
    opening = broken(found, path_table(found)["cone_opening_deg"])
    ax.plot(broken(found, found.path.H[:, 0]), opening, color=VERMILION)
    _over_strain(found, ax, "opening of the cone (degrees)")
    ax.set(ylim=(-3.0, 183.0), yticks=np.arange(0, 181, 45))
    return ax


@styled()
def draw_unstable_fraction(found: PolygonPath, ax: Axes | None = None) -> Axes:
    """Share of strain directions with negative second-order work, by subspace.

    Parameters
    ----------
    found : PolygonPath
        From `follow_polygon`.
    ax : Axes, optional
        Where to draw; a new figure if left out.

    Returns
    -------
    Axes
    """
    ax = axes_or_new(ax, 4.2, 2.8)
    table = path_table(found)
    E1 = broken(found, found.path.H[:, 0])
    for subspace, colour, style, label in SHARES:
        share = broken(found, 100.0 * table[f"unstable_fraction_{subspace}"])
        line: Any = style
        ax.plot(E1, share, color=colour, linestyle=line, label=label)
    _over_strain(found, ax, "unstable directions (%)")
    ax.set_ylim(bottom=-1.0)
    ax.legend(loc="best")
    return ax


def broken(found: PolygonPath, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values with a gap wherever the regimes change: operators jump there.

    Parameters
    ----------
    found : PolygonPath
        Its rows.
    values : (R, ...) array
        One a row, or several side by side.

    Returns
    -------
    (R + gaps, ...) array
    """
    regime = found.path.regime
    jumps = np.flatnonzero((regime[1:] != regime[:-1]).any(axis=1)) + 1
    return np.insert(values.astype(float), jumps, np.nan, axis=0)


def _over_strain(found: PolygonPath, ax: Axes, ylabel: str) -> None:
    """Titles of axes over the axial strain; a dashed line at A."""
    ax.set(xlabel=STRAIN, ylabel=ylabel, xlim=(0.0, None))
    if "A" in found.marks:
        E1 = found.path.H[found.marks["A"], 0]
        ax.axvline(E1, color=GREY, linewidth=0.7, linestyle=(0, (2, 2)), zorder=0)
        write_above(ax, E1, "A", fontweight="bold")
