"""Figures of what the paper leaves open: the printed sliding rule and opposite grains."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from stability import symmetric_spectrum
from studies.diamond.added_contact import ignored_and_added, isotropic_eigenvalues
from studies.diamond.marking import DASHED, STRAIN, broken
from studies.diamond.parameters import DiamondParameters
from studies.diamond.path import DiamondPath
from studies.diamond.sliding_rules import both_rules, shear_ratio
from studies.style import (
    BLACK,
    BLUE,
    GREY,
    LIGHT_GREY,
    TWO_COLUMNS,
    VERMILION,
    new_figure,
    styled,
)

LOOKS = {
    "coulomb": (BLUE, "-", r"$\dot T = s\mu\dot N$, $s = \mathrm{sign}\,T$"),
    "printed": (VERMILION, DASHED, "(8c) as printed"),
}
OPPOSITE = {
    "ignored": (VERMILION, DASHED, "opposite grains ignored"),
    "added": (BLUE, "-", "contact added"),
}


@styled()
def draw_sliding_rules(parameters: DiamondParameters) -> Figure | None:
    """Use of friction and axial stress under Coulomb's law and under (8c) as printed.

    Parameters
    ----------
    parameters : DiamondParameters
        What was asked.

    Returns
    -------
    Figure or None
        None where the rules do not differ.
    """
    paths = both_rules(parameters)
    if paths is None:
        return None
    fig = new_figure(TWO_COLUMNS, 2.6)
    use, stress = fig.subplots(1, 2)
    use.axhspan(1.0, 3.0, color=LIGHT_GREY, alpha=0.45, linewidth=0.0, zorder=0)
    highest = 1.0
    for rule, path in paths.items():
        colour, style, label = LOOKS[rule]
        beyond = slice(path.marks["A"], None)
        ratio, E1 = shear_ratio(path), path.states.E1
        highest = max(highest, float(np.nanmax(ratio)))
        use.plot(E1[beyond], ratio[beyond], color=colour, linestyle=style, label=label)
        stress.plot(E1[beyond], path.states.s1[beyond], color=colour, linestyle=style, label=label)
    use.set(xlabel=STRAIN, ylabel=r"$|T|/(\mu N)$ (–)", ylim=(0.0, 1.08 * highest))
    use.text(
        0.03, 0.97, "outside Coulomb's cone", transform=use.transAxes, va="top", color=GREY,
        fontsize=7,
    )  # fmt: skip
    stress.set(xlabel=STRAIN, ylabel="axial stress $s_1$ (–)")
    path = paths["coulomb"]
    for ax, values in ((use, shear_ratio(path)), (stress, path.states.s1)):
        for name in ("A", "B"):
            at = path.states.E1[path.marks[name]], values[path.marks[name]]
            ax.plot(*at, "o", color=BLACK, zorder=3)
            ax.annotate(name, at, (5, 4), textcoords="offset points", fontweight="bold")
    use.legend(loc="lower right")
    return fig


@styled()
def draw_added_contact(path: DiamondPath) -> Figure:
    """Smallest eigenvalue of Ks and axial stress without and with added contacts.

    Parameters
    ----------
    path : DiamondPath
        With contacts added.

    Returns
    -------
    Figure
        Under isotropic strain on beyond A; along the programme; the axial stress.
    """
    fig = new_figure(TWO_COLUMNS, 2.7)
    isotropic, along, stress = fig.subplots(1, 3)
    for added, name in ((False, "ignored"), (True, "added")):
        colour, style, label = OPPOSITE[name]
        E, eigenvalues = isotropic_eigenvalues(path.loop, added=added)
        isotropic.plot(E, eigenvalues[:, 0], color=colour, linestyle=style, label=label)
    for name, one in ignored_and_added(path).items():
        colour, style, label = OPPOSITE[name]
        lowest = symmetric_spectrum(one.operators.K)[:, 0]
        along.plot(
            broken(one, one.states.E1), broken(one, lowest), color=colour, linestyle=style,
            label=label,
        )  # fmt: skip
        stress.plot(one.states.E1, one.states.s1, color=colour, linestyle=style)
        _mark(one, along, lowest, "AB")
        # Both paths reach A at nearly one stress: it is named once.
        _mark(one, stress, one.states.s1, "AB" if name == "added" else "B")
    isotropic.set(title="isotropic strain", xlabel="strain $E$ (–)")
    along.set(title="isotropic to A, then drained", xlabel=STRAIN)
    for ax in (isotropic, along):
        ax.axhline(0.0, color=GREY, linewidth=0.6)
        ax.set(ylabel=r"$\lambda_\min(K_s)$ (–)", xlim=(0.0, None))
    stress.set(title="axial stress", xlabel=STRAIN, ylabel="$s_1$ (–)", xlim=(0.0, None))
    fig.legend(*isotropic.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return fig


def _mark(path: DiamondPath, ax: Axes, values: NDArray[np.float64], names: str) -> None:
    for name in names:
        if name in path.marks:
            at = path.states.E1[path.marks[name]], values[path.marks[name]]
            ax.plot(*at, "o", color=BLACK, zorder=3)
            ax.annotate(name, at, (4, 4), textcoords="offset points", fontweight="bold")
