"""Figures of the diamond study over the axial strain, and the list of all figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stability import spectrum, symmetric_spectrum
from studies.diamond.comparisons import draw_added_contact, draw_sliding_rules
from studies.diamond.directions import draw_cone, draw_polar_figure
from studies.diamond.marking import (
    DASHED,
    STRAIN,
    broken,
    mark_overlap,
    mark_states,
    smooth_rows,
)
from studies.diamond.path import DiamondPath
from studies.diamond.scenes import draw_loop, draw_path_dependence
from studies.style import (
    BLACK,
    BLUE,
    GREY,
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
    for name, figure in all_figures(path).items():
        save_figure(figure, folder, name, source)


def all_figures(path: DiamondPath) -> dict[str, Figure]:
    """Every figure of the study by its name.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    dict of str to Figure
        Those of named states only where the path reaches them, `sliding_rules` only where the
        printed rule differs, `added_contact` only with contacts added.
    """
    figures = {
        "path_dependence": draw_path_dependence(path),
        "axial_stress": figure_of(draw_axial_stress(path)),
        "determinant": figure_of(draw_determinant(path)),
        "eigenvalues": figure_of(draw_eigenvalues(path)),
        "split": draw_split(path),
        "cone": figure_of(draw_cone(path)),
    }
    if path.marks:
        figures["polar"] = draw_polar_figure(path)
    if "A" in path.marks:
        figures["loop_A"] = figure_of(draw_loop(path, "A"))
    rules = draw_sliding_rules(path.parameters)
    if rules is not None:
        figures["sliding_rules"] = rules
    if path.parameters.contact_on_touch == "add":
        figures["added_contact"] = draw_added_contact(path)
    return figures


@styled()
def draw_axial_stress(path: DiamondPath, ax: Axes | None = None) -> Axes:
    """Axial stress against axial strain, as the paper's Figs. 6 and 8.

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
    states = path.states
    ax.plot(states.E1, states.s2, color=GREY, linewidth=0.9, label="lateral stress $s_2$")
    for label, colour, rows in (
        ("$s_1$, isotropic strain", BLACK, states.stage == "isotropic"),
        ("$s_1$, drained, elastic", BLUE, (states.stage == "drained") & (states.slip == 0.0)),
        ("$s_1$, drained, sliding", VERMILION, states.slip != 0.0),
    ):
        if rows.any():
            ax.plot(states.E1, np.where(rows, states.s1, np.nan), color=colour, label=label)
    _over_strain(path, ax, states.s1, "stress over $k_n$ (–)", 0.16)
    ax.legend(loc="lower right")
    return ax


@styled()
def draw_determinant(path: DiamondPath, ax: Axes | None = None) -> Axes:
    """Determinants of K and of Ks along the path, as the paper's Figs. 7 and 9.

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
    E1, found = broken(path, path.states.E1), path.operators
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    ax.plot(E1, broken(path, found.det_K), color=BLUE, label=r"$\det K$")
    ax.plot(E1, broken(path, found.det_Ks), color=ORANGE, linestyle=DASHED, label=r"$\det K_s$")
    _over_strain(path, ax, found.det_K, "determinant (–)", 0.1)
    ax.legend(loc="best")
    return ax


@styled()
def draw_eigenvalues(path: DiamondPath, ax: Axes | None = None) -> Axes:
    """Eigenvalues of K (real parts) and of Ks along the path, as the paper's Fig. 10.

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
    E1 = broken(path, path.states.E1)
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    ax.plot(E1, broken(path, values), color=BLUE, label=["$K$", None])
    ax.plot(E1, broken(path, symmetric), color=ORANGE, linestyle=DASHED, label=["$K_s$", None])
    _over_strain(path, ax, symmetric[:, 0], "eigenvalues (–)", 0.1)
    ax.legend(loc="center left", bbox_to_anchor=(0.0, 0.62))
    return ax


@styled()
def draw_split(path: DiamondPath) -> Figure:
    """Material and geometric part of every entry of K, and both sources of its nonsymmetry.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    Figure
    """
    fig = new_figure(TWO_COLUMNS, 3.6)
    axes = fig.subplot_mosaic([["11", "12", "n"], ["21", "22", "n"]], width_ratios=[1, 1, 1.5])
    E1, found = broken(path, path.states.E1), path.operators
    parts = (
        ("$K$", BLACK, found.K),
        (r"$K_\mathrm{mat}$", BLUE, found.material),
        (r"$K_\mathrm{geo}$", VERMILION, found.geometric),
    )
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        ax = axes[f"{i + 1}{j + 1}"]
        ax.axhline(0.0, color=GREY, linewidth=0.6)
        for label, colour, part in parts:
            ax.plot(E1, broken(path, part[:, i, j]), color=colour, label=label)
        ax.set(title=f"entry {i + 1}{j + 1} (–)", xlim=(0.0, None))
        ax.set(xlabel=STRAIN if i == 1 else "")
    handles = axes["11"].get_legend_handles_labels()
    fig.legend(*handles, loc="outside lower left", ncols=3)
    _draw_nonsymmetry(path, axes["n"])
    return fig


def _over_strain(
    path: DiamondPath, ax: Axes, marked: NDArray[np.float64], ylabel: str, margin: float
) -> None:
    """Axes over the axial strain: named states on one curve, opposite grains, titles."""
    mark_states(path, ax, marked)
    mark_overlap(path, ax)
    ax.set(xlabel=STRAIN, ylabel=ylabel, xlim=(0.0, None))
    ax.margins(y=margin)


def _draw_nonsymmetry(path: DiamondPath, ax: Axes) -> None:
    """`K12 - K21` and its two sources, (29) and (30), (31)."""
    E1, found = broken(path, path.states.E1), path.operators
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    for label, colour, style, part in (
        ("$K$", BLACK, "-", found.K),
        (r"$K_\mathrm{mat}$: $s\mu$ where sliding", BLUE, DASHED, found.material),
        (r"$K_\mathrm{geo}$: $-T/(k_n l)$", VERMILION, DASHED, found.geometric),
    ):
        skew = part[:, 0, 1] - part[:, 1, 0]
        ax.plot(E1, broken(path, skew), color=colour, linestyle=style, label=label)
    for rows in smooth_rows(path):
        ax.axvline(path.states.E1[rows][0], color=SKY, linewidth=0.6, zorder=0)
    ax.set(title="nonsymmetry $K_{12} - K_{21}$ (–)", xlabel=STRAIN, xlim=(0.0, None))
    ax.margins(y=0.25)
    ax.legend(loc="best")
