"""The studies behind `grainloops diamond` and `polygon`, and the figures of the diamond alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from loops.arrays import Floats
from stability import symmetric_spectrum
from studies.output import UNITS_OF_A_LOOP
from studies.paths.diamond import FollowedDiamond, follow_diamond
from studies.paths.diamond_tables import diamond_summary, diamond_tables, isotropic_eigenvalues
from studies.paths.figures import (
    DASHED,
    STRAIN_LABEL,
    comparison_figures,
    draw_cone,
    draw_eigenvalues,
    draw_loops,
    draw_polar_figure,
    draw_stress,
    over_strain,
    polygon_figures,
)
from studies.paths.followed import operator_diagram
from studies.paths.options import ComparisonOptions, DiamondOptions, PolygonOptions
from studies.paths.polygon import (
    compare_orders,
    follow_polygon,
    polygon_summary,
    polygon_table,
)
from studies.study import study
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
    new_panels,
    styled,
)


def run_diamond(
    options: DiamondOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a diamond and write `summary.json`, tables and figures; return the summary.

    Tables `path`, `polar`, `path_dependence`; the loop at A as a plain snapshot, `grains_A` and
    `contacts_A`; with contacts added, `added_contact`.
    """
    made = ("diamond", out, options.described(), UNITS_OF_A_LOOP)
    with study(*made, force=force, csv=csv) as results:
        found, ignored = follow_diamond(options), None
        if options.contact_on_touch == "add":
            ignored = follow_diamond(replace(options, contact_on_touch="ignore"))
        tables = diamond_tables(found, ignored)
        results.write_tables(tables)
        summary = results.write_summary(diamond_summary(found))
        results.save_figures(diamond_figures(found, ignored, tables["path_dependence"]))
    return summary


def run_polygon(
    options: PolygonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a polygon and write `summary.json`, the table `path` and figures."""
    made = ("polygon", out, options.described(), UNITS_OF_A_LOOP)
    with study(*made, force=force, csv=csv) as results:
        found = follow_polygon(options)
        results.write_tables({"path": polygon_table(found)})
        summary = results.write_summary(polygon_summary(found))
        results.save_figures(polygon_figures(found, summary["critical_strain"]["diagonal"]))
    return summary


def run_comparison(
    options: ComparisonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow loops of several orders and write `summary.json`, `compare`, `paths` and figures."""
    made = ("polygon --compare", out, options.described(), UNITS_OF_A_LOOP)
    with study(*made, force=force, csv=csv) as results:
        compared = compare_orders(options)
        results.write_tables({"compare": compared.table, "paths": compared.curves()})
        summary = results.write_summary(compared.summary())
        results.save_figures(comparison_figures(compared))
    return summary


CONTACT_LOOKS = {
    "ignored": (VERMILION, DASHED, "opposite grains ignored"),
    "added": (BLUE, "-", "contact added"),
}


def diamond_figures(
    found: FollowedDiamond, ignored: FollowedDiamond | None, path_dependence: pd.DataFrame
) -> Iterator[tuple[str, Figure]]:
    """Figures of the study with their names; `ignored` is the path without added contacts.

    `path_dependence` is the table of that name. Named states are drawn where the path reaches them,
    `added_contact` where contacts are added.
    """
    yield "path_dependence", draw_path_dependence(path_dependence)
    yield "axial_stress", figure_of(draw_stress(found))
    yield "determinant", figure_of(draw_determinant(found))
    yield "eigenvalues", figure_of(draw_eigenvalues(found))
    yield "split", draw_split(found)
    yield "cone", figure_of(draw_cone(found))
    if found.marks:
        # At B every direction has the regime that it activates; beyond B all contacts slide.
        diagrams = {name: diagram for name, (diagram, _) in found.diagrams.items()}
        beyond = {} if found.beyond is None else {"B": operator_diagram(found.beyond.K[0])}
        yield "polar", draw_polar_figure(diagrams, beyond)
    if "A" in found.marks:
        yield "loop_A", draw_loops(found, ["A"])
    if ignored is not None:
        yield "added_contact", draw_added_contact(found, ignored)


@styled()
def draw_determinant(found: FollowedDiamond, ax: Axes | None = None) -> Axes:
    """Determinants of K and of Ks along the path, as Figs. 7 and 9."""
    ax = axes_or_new(ax)
    E1 = found.broken(found.E1)
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    ax.plot(E1, found.broken(found.det_K), color=BLUE, label=r"$\det K$")
    ax.plot(E1, found.broken(found.det_Ks), color=ORANGE, linestyle=DASHED, label=r"$\det K_s$")
    over_strain(found, ax, found.det_K, "determinant (–)", 0.1)
    ax.legend(loc="best")
    return ax


@styled()
def draw_split(found: FollowedDiamond) -> Figure:
    """Material and geometric part of every entry of K, and both sources of its nonsymmetry."""
    fig = new_figure(TWO_COLUMNS, 3.6, fixed=True)
    axes = fig.subplot_mosaic([["11", "12", "n"], ["21", "22", "n"]], width_ratios=[1, 1, 1.5])
    E1, parts = found.broken(found.E1), found.states
    named = (
        ("$K$", BLACK, parts.K),
        (r"$K_\mathrm{mat}$", BLUE, parts.material),
        (r"$K_\mathrm{geo}$", VERMILION, parts.geometric),
    )
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        ax = axes[f"{i + 1}{j + 1}"]
        ax.axhline(0.0, color=GREY, linewidth=0.6)
        for label, colour, part in named:
            ax.plot(E1, found.broken(part[:, i, j]), color=colour, label=label)
        ax.set(title=f"entry {i + 1}{j + 1} (–)", xlim=(0.0, None))
        ax.set(xlabel=STRAIN_LABEL if i == 1 else "")
    fig.legend(*axes["11"].get_legend_handles_labels(), loc="outside lower left", ncols=3)
    _draw_nonsymmetry(found, axes["n"])
    return fig


def _draw_nonsymmetry(found: FollowedDiamond, ax: Axes) -> None:
    """`K12 - K21` and its two sources, (29) and (30), (31)."""
    E1, parts = found.broken(found.E1), found.states
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    for label, colour, style, part in (
        ("$K$", BLACK, "-", parts.K),
        (r"$K_\mathrm{mat}$: $s\mu$ where sliding", BLUE, DASHED, parts.material),
        (r"$K_\mathrm{geo}$: $-T/(k_n l)$", VERMILION, DASHED, parts.geometric),
    ):
        skew = part[:, 0, 1] - part[:, 1, 0]
        ax.plot(E1, found.broken(skew), color=colour, linestyle=style, label=label)
    for row in found.jumps:
        ax.axvline(found.E1[row], color=SKY, linewidth=0.6, zorder=0)
    ax.set(title="nonsymmetry $K_{12} - K_{21}$ (–)", xlabel=STRAIN_LABEL, xlim=(0.0, None))
    ax.margins(y=0.25)
    ax.legend(loc="best")


@styled()
def draw_added_contact(found: FollowedDiamond, ignored: FollowedDiamond) -> Figure:
    """Smallest eigenvalue of Ks and axial stress without and with added contacts.

    Under isotropic strain on beyond A; along the programme; the axial stress.
    """
    fig, ((isotropic, along, stress),) = new_panels(1, 3, 2.7)
    for name, one in (("ignored", ignored), ("added", found)):
        colour, style, label = CONTACT_LOOKS[name]
        E, eigenvalues = isotropic_eigenvalues(found.loop, added=name == "added")
        isotropic.plot(E, eigenvalues[:, 0], color=colour, linestyle=style, label=label)
        lowest = symmetric_spectrum(one.K)[:, 0]
        along.plot(
            one.broken(one.E1), one.broken(lowest), color=colour, linestyle=style, label=label
        )
        stress.plot(one.E1, one.s1, color=colour, linestyle=style)
        # Both paths reach A at nearly the same stress: one name is enough.
        twice = "AB" if one is found else "B"
        for ax, values, marks in ((along, lowest, "AB"), (stress, one.s1, twice)):
            for mark in (mark for mark in marks if mark in one.marks):
                at = one.E1[one.marks[mark]], values[one.marks[mark]]
                ax.plot(*at, "o", color=BLACK, zorder=3)
                ax.annotate(mark, at, (4, 4), textcoords="offset points", fontweight="bold")
    isotropic.set(title="isotropic strain", xlabel="strain $E$ (–)")
    along.set(title="isotropic to A, then drained", xlabel=STRAIN_LABEL)
    for ax in (isotropic, along):
        ax.axhline(0.0, color=GREY, linewidth=0.6)
        ax.set(ylabel=r"$\lambda_\min(K_s)$ (–)", xlim=(0.0, None))
    stress.set(title="axial stress", xlabel=STRAIN_LABEL, ylabel="$s_1$ (–)", xlim=(0.0, None))
    fig.legend(*isotropic.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return fig


@styled()
def draw_path_dependence(table: pd.DataFrame) -> Figure:
    """Two routes between the same two positions of a contact, and the work along each (Fig. 4).

    Lines are (9) and (10), points the integrated rate law.
    """
    fig, ((geometry, works),) = new_panels(1, 2, 2.8, width_ratios=[1.0, 1.25])
    _draw_routes(float(table["compression"].iloc[0]), geometry)
    points = slice(None, None, 5)
    for route, colour, label in (
        ("shear_then_compress", BLUE, r"$\mathcal{E}_1$ (9): A, B, C"),
        ("compress_then_shear", VERMILION, r"$\mathcal{E}_2$ (10): A, D, C"),
    ):
        works.plot(table["alpha_deg"], table[route], color=colour, label=label)
        works.plot(
            table["alpha_deg"].iloc[points], table[f"{route}_integrated"].iloc[points], "o",
            color=colour, markerfacecolor="white", markersize=3.5,
        )  # fmt: skip
    works.plot([], [], "o", color=GREY, markerfacecolor="white", label="rate law integrated")
    works.set(xlabel=r"turn $\alpha$ (degrees)", ylabel=r"work over $k_n l^2$ (–)", xlim=(0, 45))
    works.set(ylim=(0.0, None))
    works.legend(loc="upper left")
    return fig


def _draw_routes(compression: float, ax: Axes) -> None:
    """Draw both routes of the centre of sphere 2 around sphere 1: A, B, C and A, D, C."""
    alpha, start = np.radians(40.0), np.radians(20.0)
    arc: Floats = start + np.linspace(0.0, alpha, 60)
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
        circle = {"fill": False, "color": GREY, "linewidth": 0.8, "linestyle": style}
        ax.add_patch(Circle(centre, 0.5, **circle))
    ax.plot(0.0, 0.0, "o", color=BLACK)
    for name, offset in (("A", (6, -6)), ("B", (-1, 6)), ("C", (-11, 3)), ("D", (1, -11))):
        ax.plot(*at[name], "o", color=BLACK)
        ax.annotate(name, at[name], offset, textcoords="offset points", fontweight="bold")
    ax.annotate("O", (0, 0), (-9, -9), textcoords="offset points", fontweight="bold")
    for text, place in (
        ("sphere 1", (-0.05, -0.3)),
        ("sphere 2", (at["A"][0] + 0.12, at["A"][1] - 0.28)),
    ):
        ax.annotate(text, place, ha="center", color=GREY, fontsize=7)
    middle = start + 0.5 * alpha
    ax.annotate(r"$\alpha$", (0.27 * np.cos(middle), 0.27 * np.sin(middle)), ha="center")
    ax.set(aspect="equal", xlim=(-0.6, 1.55), ylim=(-0.6, 1.35))
    ax.set_axis_off()
