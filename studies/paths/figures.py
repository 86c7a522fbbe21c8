"""Figures of paths (stress, eigenvalues, cone, polar diagrams, loops), and the studies of paths."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from loops import GrainGraph, Regime, contact_forces
from loops.arrays import Floats, Regimes, true_runs
from patterns.diamond.states import isotropic_tangents
from stability import (
    COMPONENTS,
    RTOL,
    PolarDiagram,
    alpha_e,
    operator_norm,
    restrict,
    spectrum,
    symmetric_spectrum,
)
from studies.output import Columns
from studies.paths.diamond import FollowedDiamond, path_dependence_table
from studies.paths.followed import RADIUS, SUBSPACES, Followed, operator_diagram
from studies.paths.run import Compared
from studies.study import Drawings
from studies.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    ORANGE,
    PURPLE,
    SEQUENTIAL,
    SKY,
    TWO_COLUMNS,
    VERMILION,
    WHITE_EDGE,
    axes_or_new,
    figure_key,
    figure_of,
    key_columns,
    new_figure,
    new_panels,
    outer_legend,
    panel,
    styled,
)

# Degrees of 360, of the directions at a state.
SHARE_WORDS = {
    "unstable_deg": "$w_2 < 0$", "several_deg": "several solutions", "none_deg": "no solution"
}  # fmt: skip
HOLLOW: Any = {"markerfacecolor": "none", "markersize": 6}
# Marks around a point, above those of the named states.
RING: Any = {"markerfacecolor": "none", "zorder": 4}
SUBSPACE_MARKERS = {"diagonal": "o", "symmetric": "x", "full": "+"}
STRAIN_LABEL = r"axial strain $E_1$ (–)"
DASHED: Any = (0, (4, 3))
REGIME_COLOURS = {Regime.ELASTIC: BLUE, Regime.SLIDING: VERMILION, Regime.OPEN: LIGHT_GREY}
REGIME_NAMES = {Regime.ELASTIC: "sticking", Regime.SLIDING: "sliding", Regime.OPEN: "open"}
EVENT_MARKS = {"yield": ("v", 8, "contacts yield"), "opening": ("D", 6, "contacts open")}
# Width of the largest force (points).
FORCE_WIDTH = 4.0
# Length of its arrow, in diameters of a grain.
ARROW_LENGTH = 0.45
# Grains up to which forces are arrows.
MOST_WITH_ARROWS = 12
SUBSPACE_LOOKS: tuple[tuple[str, str, Any, str], ...] = (
    ("diagonal", BLUE, "-", "(11, 22)"),
    ("symmetric", VERMILION, (0, (4, 2)), r"(11, 22, (12+21)/$\sqrt{2}$)"),
    ("full", GREEN, (0, (1, 1)), "all four components"),
)
CONTACT_LOOKS = {
    "ignored": (VERMILION, DASHED, "opposite grains ignored"),
    "added": (BLUE, "-", "contact added"),
}


def path_figures(found: Followed) -> Drawings:
    """Figures of the operators along any path, with their names."""
    yield "determinant", lambda: draw_operators(found, "determinant")
    yield "eigenvalues", lambda: draw_operators(found, "eigenvalues")
    yield "split", lambda: draw_split(found)
    if (found.plane["cone_opening_deg"] > 0.0).any():
        yield "cone", lambda: draw_cone(found)
    if found.directions:
        yield "polar", lambda: draw_polar_figure(found)


def polygon_figures(found: Followed) -> Drawings:
    """Figures of one polygon with their names; none of a loop that takes no load."""
    if not found.loaded:
        return
    ends = [name for name in ("start", "A", "end") if name in found.marks]
    yield "loop", lambda: draw_loops(found, ends)
    yield "stress_strain", lambda: draw_stress(found)
    yield from path_figures(found)
    if any(found.subspaces[f"unstable_fraction_{subspace}"].any() for subspace in SUBSPACES):
        yield "unstable_fraction", lambda: draw_unstable_fraction(found)


def comparison_figures(compared: Compared) -> Drawings:
    """Figures of a comparison of orders with their names."""
    yield "critical_strain", lambda: draw_critical_strain(compared)
    yield "first_loss", lambda: draw_yield_and_peak(compared)
    yield "stress_strain", lambda: draw_stress_strain(compared)


@panel(height=3.0)
def draw_stress(found: Followed, ax: Axes) -> None:
    """Axial and lateral stress over the axial strain (Figs. 6 and 8), with the peak if any."""
    slides, opens, E1 = found.slides, found.opens, found.E1
    confined = np.isin(found.stage, ("isotropic", "confinement"))
    ax.plot(E1, found.s2, color=GREY, linewidth=0.9, label="lateral stress $s_2$")
    for label, colour, rows in (
        ("$s_1$, isotropic strain", BLACK, confined & ~opens),
        ("$s_1$, elastic", BLUE, ~confined & ~slides & ~opens),
        ("$s_1$, sliding contacts", VERMILION, ~confined & slides & ~opens),
        ("$s_1$, open contacts", PURPLE, opens),
    ):
        if rows.any():
            ax.plot(E1, np.where(rows, found.s1, np.nan), color=colour, label=label)
    peak = found.peak
    if peak is not None:
        ax.plot(peak["E1"], peak["s1"], "o", color=BLACK, label="peak", **RING | {"markersize": 11})
    if found.gaps is None:  # of the diamond B is the yield of all contacts
        for kind, (marker, size, label) in EVENT_MARKS.items():
            at = [event.index for event in found.path.events if event.kind == kind]
            if at:
                look = RING | {"markersize": size}
                ax.plot(E1[at], found.s1[at], marker, color=GREY, label=label, **look)
    over_strain(found, ax, found.s1, "stress over $k_n$ (–)", 0.16)
    outer_legend(ax, "lower left", (0.0, 1.0), 2.0, ncols=2)


@panel()
def draw_operators(found: Followed, of: str, ax: Axes) -> None:
    """Determinants (Figs. 7, 9) or eigenvalues (Fig. 10) of K, and dashed of Ks, in (11, 22)."""
    curves, marked, name = (found.det_K, found.det_Ks), found.det_K, r"$\det {}$"
    if of == "eigenvalues":
        curves = spectrum(found.K).real, symmetric_spectrum(found.K)
        marked, name = curves[1][:, 0], "${}$"
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    looks = zip(curves, ("K", "K_s"), (BLUE, ORANGE), ("-", DASHED), strict=True)
    for values, operator, colour, style in looks:
        look: Any = {"color": colour, "linestyle": style}
        lines = ax.plot(found.broken(found.E1), found.broken(values), **look)
        lines[0].set_label(name.format(operator))
    units = {"determinant": "determinant", "eigenvalues": "eigenvalues over $k_n$"}
    over_strain(found, ax, marked, f"{units[of]} in (11, 22) (–)", 0.1)
    ax.legend(loc="best")


@panel(4.2, 2.8)
def draw_cone(found: Followed, ax: Axes) -> None:
    """Instability cone in (11, 22) along the path, with the path's own direction (Fig. 12)."""
    E1, half = found.E1, 0.5 * found.plane["cone_opening_deg"]
    half = np.where(half > 0.0, half, np.nan)
    # The paper's alphaE counts from E2 towards E1.
    axis = np.mod(90.0 - found.plane["cone_axis_deg"], 180.0)
    for k, (a, b) in enumerate(pairwise([0, *found.jumps.tolist(), len(found.path)])):
        ax.fill_between(
            E1[a:b], (axis - half)[a:b], (axis + half)[a:b], facecolor="none",
            edgecolor=VERMILION, hatch="////", linewidth=0.8, label="_" * k + "instability cone",
        )  # fmt: skip
    direction = np.degrees(alpha_e(np.arctan2(found.direction[:, 1], found.direction[:, 0])))
    ax.plot(E1, direction, color=BLUE, label="loading direction")
    for name, row in found.marks.items():
        if name not in ("start", "end"):
            ax.axvline(E1[row], color=GREY, linewidth=0.7, linestyle=(0, (2, 2)), zorder=0)
            write_above(ax, E1[row], name, fontweight="bold")
    ax.set(xlabel=STRAIN_LABEL, ylabel=r"$\alpha_E$ (degrees)", xlim=(0.0, None), ylim=(0.0, 180.0))
    ax.set_yticks(np.arange(0, 181, 45))
    outer_legend(ax, "lower center", (0.5, 1.0), 2.0, ncols=2)


@panel(4.2, 2.8)
def draw_unstable_fraction(found: Followed, ax: Axes) -> None:
    """Share of strain directions with negative work under the operator of the path, by subspace."""
    table, E1 = found.subspaces, found.broken(found.E1)
    for subspace, colour, style, label in SUBSPACE_LOOKS:
        share = found.broken(100.0 * table[f"unstable_fraction_{subspace}"])
        ax.plot(E1, share, color=colour, linestyle=style, label=label)
    over_strain(found, ax, None, "unstable directions of $K$ (%)")
    ax.set_ylim(bottom=-0.03 * ax.get_ylim()[1])
    ax.legend(loc="best")


def over_strain(
    found: Followed, ax: Axes, marked: Floats | None, ylabel: str, margin: float = 0.05
) -> None:
    """Label the axes, mark the named states on one curve, shade where opposite grains overlap."""
    for name, row in found.marks.items():
        at = found.E1[row]
        if marked is None or name in ("start", "end"):
            continue
        ax.plot(at, marked[row], "o", color=BLACK, zorder=3)
        ax.annotate(
            name, (at, marked[row]), (0, 5), textcoords="offset points", fontweight="bold",
            ha="center", va="bottom", path_effects=WHITE_EDGE,
        )  # fmt: skip
    parts = [] if found.gaps is None else overlaps(found.E1, np.minimum(*found.gaps))
    for first, last in parts:
        ax.axvspan(first, last, color=LIGHT_GREY, alpha=0.45, linewidth=0.0, zorder=0)
    if parts:
        said = "share a contact" if found.options.contact_on_touch == "add" else "overlap"
        middle = 0.5 * (parts[0][0] + parts[-1][1])
        write_above(ax, middle, f"opposite grains {said}", color=GREY, fontsize=7)
    ax.set(xlabel=STRAIN_LABEL, ylabel=ylabel, xlim=(0.0, None))
    ax.margins(y=margin)


def overlaps(E1: Floats, gap: Floats) -> list[tuple[float, float]]:
    """Strains between which a gap is negative: zeros between rows are linear."""
    found = []
    for part in true_runs(gap < 0.0):
        before, after = max(part.start - 1, 0), min(part.stop, len(gap) - 1)
        ends = [part.start, before], [part.stop - 1, after]
        first, last = (float(np.interp(0.0, gap[rows], E1[rows])) for rows in ends)
        found.append((first, last))
    return found


def write_above(ax: Axes, x: float, text: str, **look: Any) -> None:
    """Write a text above axes, centred on a position along the first axis."""
    ax.annotate(
        text, (x, 1.0), (0, 2), xycoords=("data", "axes fraction"), textcoords="offset points",
        ha="center", va="bottom", **look,
    )  # fmt: skip


# ---- polar diagrams


@styled()
def draw_polar_figure(found: Followed) -> Figure:
    """Polar diagrams of w2 in (11, 22) at the named states, in the regimes of each direction.

    Dashed the operator in which all contacts at yield slide, whatever the direction.
    """
    dashed, panels_of = list[Any](), dict[int, list[str]]()
    for name in found.directions:
        panels_of.setdefault(found.marks[name], []).append(name)
    count = len(panels_of)
    columns = 2 if count == 4 else min(count, 3)
    rows, width = -(-count // columns), 0.5 + columns * (TWO_COLUMNS - 0.5) / 3.0
    fig, panels = new_panels(rows, columns, 2.55 * rows + 0.2, width, sharex=True, sharey=True)
    for ax, names in zip(panels.ravel(), panels_of.values(), strict=True):
        draw_polar(found.directions[names[0]].diagram, ax=ax, name=", ".join(names))
        slides, degrees = found.sliding(names[0]), found.degrees(names[0]) or {}
        if slides is not None:
            points = operator_diagram(restrict(found.tangents(slides), "diagonal")).points
            closed, style = np.concatenate([points, points[:1]]), (0, (3, 2))
            dashed += ax.plot(*closed.T, color=ORANGE, linewidth=0.9, linestyle=style)
        told = [f"{words}: {degrees[kind]:.1f}°" for kind, words in SHARE_WORDS.items()
                if kind == "unstable_deg" or degrees[kind] > 0.0]  # fmt: skip
        look: Any = {"ha": "center", "va": "top", "color": BLACK, "fontsize": 6}
        ax.text(0.0, -0.2 * RADIUS, "\n".join(told), path_effects=WHITE_EDGE, **look)
        ax.label_outer()
    if dashed:
        words = "regimes that the direction activates", "contacts at yield slide in every direction"
        lines = [Line2D([], [], color=BLUE), dashed[0]]
        fig.legend(lines, words, loc="outside lower center")
    return fig


@panel(2.5, 2.5)
def draw_polar(diagram: PolarDiagram, ax: Axes, name: str = "") -> None:
    """One polar diagram, as Fig. 11: inside the circle of radius 2 `w2` is negative.

    The curve is `(2 + w2) (cos alphaE, sin alphaE)`, `tan(alphaE) = E1'/E2'`.
    """
    closed = np.concatenate([diagram.points, diagram.points[:1]])
    angle = np.append(diagram.angle, 2.0 * np.pi)
    circle = RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for part in true_runs(np.append(diagram.work, diagram.work[0]) < 0.0):
        # Up to the neighbouring points, where the curves meet.
        part = slice(max(part.start - 1, 0), part.stop + 1)
        outline = np.concatenate([closed[part], circle[part][::-1]])
        ax.fill(*outline.T, facecolor=VERMILION, alpha=0.35, linewidth=0.0)
    ax.plot(*circle.T, color=GREY, linewidth=0.8, linestyle=(0, (3, 2)))
    ax.plot(*closed.T, color=BLUE)
    look: Any = {"ha": "center", "va": "center", "path_effects": WHITE_EDGE}
    ax.text(0.0, 0.0, name, fontweight="bold", color=BLACK, **look)
    ax.text(0.0, -0.93 * RADIUS, "$w_2 = 0$", color=GREY, fontsize=6, **look)
    ax.set(xlim=(-3.15, 3.15), ylim=(-3.15, 3.15), aspect="equal")
    ax.set(xticks=[-2, 0, 2], yticks=[-2, 0, 2])
    ax.set(xlabel=r"$(2 + w_2)\,\cos\alpha_E$ (–)", ylabel=r"$(2 + w_2)\,\sin\alpha_E$ (–)")


# ---- the loop


@styled()
def draw_loops(found: Followed, names: Sequence[str]) -> Figure:
    """The loop at named states with its contact forces, and for few grains the external ones."""
    count, rows = len(names), [found.marks[name] for name in names]
    fig, (axes,) = new_panels(1, count, 3.6, count * TWO_COLUMNS / 2, sharex=True, sharey=True)
    loops = [found.graph_at(row) for row in rows]
    largest = max(float(np.hypot(one.normal_force, one.shear_force).max()) for one in loops)
    grains = loops[0].grain_count
    reach = max(float(np.abs(one.x).max()) for one in loops)
    reach += 1.4 if grains <= MOST_WITH_ARROWS else 0.6
    for ax, name, row, loop in zip(axes, names, rows, loops, strict=True):
        draw_grains(ax, loop, largest)
        E1, E2 = (round(float(E[row]), 4) + 0.0 for E in (found.E1, found.E2))
        ax.set_title(f"{name}: $E_1 = {E1:.4f}$, $E_2 = {E2:.4f}$")
        ax.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach))
        ax.set(xlabel=r"$x_1 / l_0$ (–)", ylabel=r"$x_2 / l_0$ (–)")
        ax.locator_params(nbins=6)
        ax.label_outer()
    key = forces_key(largest, r"$k_n l_0$", found.path.regime[rows], grains)
    beside = count if fig.get_figwidth() > TWO_COLUMNS - 0.1 else 1
    fig.legend(handles=key, loc="outside lower center", ncols=beside)
    return fig


def draw_grains(ax: Axes, graph: GrainGraph, largest: float) -> None:
    """Draw the grains of a graph with regimes, and the force of every contact along its branch.

    Widths and arrows are in proportion to forces; the force `largest` is the widest.
    """
    x, pairs, size, regime = graph.x, graph.contacts, 2.0 * graph.radii, np.asarray(graph.regime)
    ax.add_collection(
        EllipseCollection(
            size, size, 0.0 * size, units="xy", offsets=x, offset_transform=ax.transData,
            facecolors="none", edgecolors=GREY, linewidths=0.7,
        )
    )  # fmt: skip
    drawn = (regime != Regime.OPEN) | (np.arange(len(pairs)) < len(x))
    ax.add_collection(LineCollection(list(x[pairs[drawn]]), colors=LIGHT_GREY, linewidths=0.6))
    largest = max(largest, np.finfo(float).tiny)
    colours = [REGIME_COLOURS[Regime(int(each))] for each in regime]
    width = FORCE_WIDTH * np.hypot(graph.normal_force, graph.shear_force) / largest
    ax.add_collection(LineCollection(list(x[pairs]), colors=colours, linewidths=width))
    ax.plot(*x.T, "o", color=BLACK, markersize=1.5)
    if len(x) > MOST_WITH_ARROWS:
        return
    force, external = contact_forces(graph), np.zeros_like(x)
    np.add.at(external, pairs[:, 0], force)
    np.add.at(external, pairs[:, 1], -force)
    pull = np.linalg.norm(external, axis=1)
    here = pull > 1e-12 * largest
    along = external[here] / pull[here, None]
    ax.quiver(
        *(x[here] - 0.5 * size[here, None] * along).T, *(external[here] / largest).T, angles="xy",
        scale_units="xy", scale=1.0 / (ARROW_LENGTH * size.mean()), pivot="tip", width=0.006,
    )  # fmt: skip


def forces_key(largest: float, unit: str, regime: Regimes, grains: int) -> list[Line2D]:
    """Handles of the legend: regimes, the force of the widest line, and of the arrows if any."""
    present = {Regime(int(each)) for each in np.unique(regime)}
    key = [
        Line2D([], [], color=REGIME_COLOURS[one], lw=0.5 * FORCE_WIDTH, label=f"{name} contact")
        for one, name in REGIME_NAMES.items()
        if one in present
    ]
    width = f"contact force, widest: {largest:.3g} {unit}"
    key.append(Line2D([], [], color=BLACK, linewidth=FORCE_WIDTH, label=width))
    if grains <= MOST_WITH_ARROWS:
        length = f"external force, {ARROW_LENGTH:g} diameters long: {largest:.3g} {unit}"
        key.append(
            Line2D([], [], color=BLACK, linewidth=0.0, marker=r"$\rightarrow$", label=length)
        )
    return key


# ---- orders side by side


@panel(4.2, 2.8)
def draw_critical_strain(compared: Compared, ax: Axes) -> None:
    """Critical isotropic strain over the order, by subspace, with the two thresholds."""
    kappa = compared.options.shared.kappa
    for label, level in (
        (r"$\kappa/(1+\kappa)$", kappa / (1 + kappa)),
        (r"$(1+\kappa)/(2+\kappa)$", (1 + kappa) / (2 + kappa)),
    ):
        ax.axhline(level, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)), zorder=0)
        ax.annotate(
            label, (1.0, level), (2, 0), xycoords=("axes fraction", "data"),
            textcoords="offset points", va="center", color=GREY,
        )  # fmt: skip
    looks = {f"critical_strain_{name}": (SUBSPACE_MARKERS[name], colour, label)
             for name, colour, _, label in SUBSPACE_LOOKS}  # fmt: skip
    over_order(compared, ax, looks, "critical isotropic strain (–)")
    ax.set_ylim(bottom=-0.02)
    beside = key_columns(figure_of(ax), 3)
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=beside, columnspacing=1.0)


@styled()
def draw_yield_and_peak(compared: Compared) -> Figure:
    """First yield and peak of the axial stress over the order: strain and stress."""
    fig, (axes,) = new_panels(1, 2, 2.6)
    for ax, key, label in zip(axes, ("E1", "s1"), ("strain", "stress"), strict=True):
        looks = {f"first_yield_{key}": ("o", BLUE, "first yield"),
                 f"peak_{key}": ("x", VERMILION, "peak of $s_1$")}  # fmt: skip
        over_order(compared, ax, looks, f"axial {label} (–)")
        ax.margins(y=0.15)
    ax.legend(loc="best")
    return fig


def over_order(
    compared: Compared, ax: Axes, looks: dict[str, tuple[str, str, str]], ylabel: str
) -> None:
    """Draw columns of the comparison over the order, each with its marker, colour and label."""
    orders = compared.table["order"]
    for column, (marker, colour, label) in looks.items():
        ax.plot(orders, compared.table[column], marker, color=colour, label=label, **HOLLOW)
    ticks = orders[:: max(len(orders) // 10, 1)]
    ax.set(xlabel="order of the loop, $n$", xticks=ticks, ylabel=ylabel)


@panel(4.6, 3.0)
def draw_stress_strain(compared: Compared, ax: Axes) -> None:
    """Axial stress over axial strain, one curve per order; a ring where a path ends early."""
    shades = colormaps[SEQUENTIAL](np.linspace(0.0, 0.92, len(compared.paths)))
    for order, found, shade in zip(compared.options.orders, compared.paths, shades, strict=True):
        ax.plot(found.E1, found.s1, color=shade, linewidth=1.1, label=f"{order}")
        if found.path.status != "finished":
            ax.plot(found.E1[-1], found.s1[-1], "o", color=shade, markerfacecolor="white")
    ax.set(xlabel="axial strain $E_1$ (–)", ylabel="axial stress $s_1$ (–)", xlim=(0.0, None))
    ax.legend(title="order", loc="center left", bbox_to_anchor=(1.0, 0.5))


# ---- the diamond alone


def diamond_figures(found: FollowedDiamond) -> Drawings:
    """Figures of the study with their names."""
    yield "path_dependence", lambda: draw_path_dependence(path_dependence_table(found.loop))
    yield "axial_stress", lambda: draw_stress(found, ax=axes_or_new(None))
    yield from path_figures(found)
    if "A" in found.marks:
        yield "loop_A", lambda: draw_loops(found, ["A"])
    if (ignored := found.ignored) is not None:
        yield "added_contact", lambda: draw_added_contact(found, ignored)


@styled()
def draw_split(found: Followed) -> Figure:
    """Material and geometric part of every entry of K, and both sources of its nonsymmetry."""
    fig = new_figure(TWO_COLUMNS, 3.6)
    wide = fig.get_figwidth() == TWO_COLUMNS
    fig.set_figheight(3.6 if wide else 6.0)
    named = fig.subplot_mosaic("ABN;CDN" if wide else "AB;CD;NN")
    axes = [named[name] for name in "ABCDN"]
    E1, (material, geometric) = found.broken(found.E1), found.split
    for label, colour, style, part in (
        ("$K$", BLACK, "-", found.K),
        (r"$K_\mathrm{mat}$, of the contacts", BLUE, DASHED, material),
        (r"$K_\mathrm{geo}$, of their forces", VERMILION, DASHED, geometric),
    ):
        # `K12 - K21` and its two sources, (29) and (30), (31).
        skew = part[:, 0, 1] - part[:, 1, 0]
        skew = np.where(np.abs(skew) <= RTOL * operator_norm(found.K), 0.0, skew)
        for ax, values in zip(axes, [*part.reshape(-1, 4).T, skew], strict=True):
            ax.plot(E1, found.broken(values), color=colour, linestyle=style, label=label)
    titles = *(f"entry {ij} (–)" for ij in COMPONENTS), "nonsymmetry $K_{12} - K_{21}$ (–)"
    for ax, title in zip(axes, titles, strict=True):
        ax.axhline(0.0, color=GREY, linewidth=0.6, zorder=0)
        for row in found.jumps:
            ax.axvline(found.E1[row], color=SKY, linewidth=0.6, zorder=0, label="regimes change")
        ax.set(title=title, xlim=(0.0, None))
    for ax in axes[2:]:
        ax.set_xlabel(STRAIN_LABEL)
    axes[4].margins(y=0.1)
    figure_key(fig, axes[4], ncols=key_columns(fig, 4))
    return fig


@styled()
def draw_added_contact(found: FollowedDiamond, ignored: FollowedDiamond) -> Figure:
    """Smallest eigenvalue of Ks and axial stress without and with added contacts.

    Under isotropic strain on beyond A; along the programme; the axial stress.
    """
    fig, ((isotropic, along, stress),) = new_panels(1, 3, 2.7)
    for name, one in (("ignored", ignored), ("added", found)):
        colour, style, label = CONTACT_LOOKS[name]
        E, K = isotropic_tangents(found.loop, added=name == "added")
        isotropic.plot(E, symmetric_spectrum(K)[:, 0], color=colour, linestyle=style, label=label)
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
def draw_path_dependence(table: Columns) -> Figure:
    """Two routes between the same two positions of a contact, and the work along each (Fig. 4).

    Lines are (9) and (10), points the integrated rate law.
    """
    fig, ((geometry, works),) = new_panels(1, 2, 2.8, width_ratios=[1.0, 1.25])
    # Routes of the centre of sphere 2 around sphere 1, distance and angle.
    compression = float(table["compression"][0])
    alpha, start = np.radians(40.0), np.radians(20.0)
    ends = {"A": (1.0, start), "B": (1.0, start + alpha)}
    ends |= {"D": (1.0 - compression, start), "C": (1.0 - compression, start + alpha)}
    at = {name: (float(r * np.cos(a)), float(r * np.sin(a))) for name, (r, a) in ends.items()}
    along = np.linspace(0.0, 2.0, 121)
    for route, colour in (("ABC", BLUE), ("ADC", VERMILION)):
        r, a = (np.interp(along, range(3), [ends[name][k] for name in route]) for k in (0, 1))
        geometry.plot(r * np.cos(a), r * np.sin(a), color=colour)
    for name in ("C", "D"):
        geometry.plot(*np.stack([np.zeros(2), at[name]]).T, color=GREY, linewidth=0.6, zorder=0)
    for centre, style in (((0.0, 0.0), "-"), (at["A"], "-"), (at["C"], "--")):
        circle = {"fill": False, "color": GREY, "linewidth": 0.8, "linestyle": style}
        geometry.add_patch(Circle(centre, 0.5, **circle))
    offsets = {"A": (6, -6), "B": (-1, 6), "C": (-11, 3), "D": (1, -11), "O": (-9, -9)}
    for name, offset in offsets.items():
        place = at.get(name, (0.0, 0.0))
        geometry.plot(*place, "o", color=BLACK)
        geometry.annotate(name, place, offset, textcoords="offset points", fontweight="bold")
    middle = start + 0.5 * alpha
    geometry.annotate(r"$\alpha$", (0.27 * np.cos(middle), 0.27 * np.sin(middle)), ha="center")
    geometry.set(aspect="equal", xlim=(-0.6, 1.55), ylim=(-0.6, 1.35))
    geometry.set_axis_off()
    points = slice(None, None, 5)
    for route, colour, label in (
        ("shear_then_compress", BLUE, r"$\mathcal{E}_1$ (9): A, B, C"),
        ("compress_then_shear", VERMILION, r"$\mathcal{E}_2$ (10): A, D, C"),
    ):
        works.plot(table["alpha_deg"], table[route], color=colour, label=label)
        works.plot(
            table["alpha_deg"][points], table[f"{route}_integrated"][points], "o",
            color=colour, markerfacecolor="white", markersize=3.5, clip_on=False,
        )  # fmt: skip
    works.plot([], [], "o", color=GREY, markerfacecolor="white", label="rate law integrated")
    works.set(xlabel=r"turn $\alpha$ (degrees)", ylabel=r"work over $k_n l^2$ (–)", xlim=(0, 45))
    works.set(ylim=(0.0, None))
    works.legend(loc="upper left")
    return fig
