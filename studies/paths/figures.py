"""Figures of paths: stress, eigenvalues, cone, polar diagrams, the loop; orders side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from loops import Regime, contact_state, macroscopic_tangent
from loops.arrays import Flags, Floats, Integers, Regimes
from patterns.diamond import opposite_gaps
from stability import PolarDiagram, alpha_e, restrict, spectrum, symmetric_spectrum
from studies.paths.diamond import FollowedDiamond
from studies.paths.followed import RADIUS, Followed, operator_diagram
from studies.paths.options import PolygonOptions
from studies.paths.polygon import (
    Compared,
    axial_peak,
)
from studies.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    ORANGE,
    PURPLE,
    SEQUENTIAL,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    figure_of,
    key_columns,
    new_panels,
    say_empty,
    styled,
    write_above,
)

SUBSPACE_MARKERS = {"diagonal": "o", "symmetric": "x", "full": "+"}
STRAIN_LABEL = r"axial strain $E_1$ (–)"
DASHED: Any = (0, (4, 3))
REGIME_COLOURS = {Regime.ELASTIC: BLUE, Regime.SLIDING: VERMILION, Regime.OPEN: LIGHT_GREY}
REGIME_NAMES = {Regime.ELASTIC: "sticking", Regime.SLIDING: "sliding", Regime.OPEN: "open"}
EVENT_MARKS = {"yield": ("v", "contacts yield"), "opening": ("D", "contacts open")}
# Width of the largest force in points, its arrow in diameters, and the most grains with arrows.
WIDEST, ARROW, MOST_WITH_ARROWS = 4.0, 0.45, 12
SUBSPACE_LOOKS: tuple[tuple[str, str, Any, str], ...] = (
    ("diagonal", BLUE, "-", "(11, 22)"),
    ("symmetric", VERMILION, (0, (4, 2)), r"(11, 22, (12+21)/$\sqrt{2}$)"),
    ("full", GREEN, (0, (1, 1)), "all four components"),
)


def polygon_figures(found: Followed, critical: float | None) -> Iterator[tuple[str, Figure]]:
    """Figures of one polygon with their names; `critical` is its strain in (11, 22)."""
    yield "loop", draw_loops(found, list(found.marks))
    yield "stress_strain", figure_of(draw_stress(found))
    yield "eigenvalues", figure_of(draw_eigenvalues(found))
    yield "polar", draw_polar_figure(polygon_diagrams(found, critical))
    yield "cone", figure_of(draw_cone(found))
    yield "unstable_fraction", figure_of(draw_unstable_fraction(found))


def comparison_figures(compared: Compared) -> Iterator[tuple[str, Figure]]:
    """Figures of a comparison of orders with their names."""
    yield "critical_strain", figure_of(draw_critical_strain(compared))
    yield "first_loss", draw_yield_and_peak(compared)
    yield "stress_strain", figure_of(draw_stress_strain(compared))


@styled()
def draw_stress(found: Followed, ax: Axes | None = None) -> Axes:
    """Axial and lateral stress over the axial strain (Figs. 6 and 8), with the peak if any."""
    diamond = isinstance(found, FollowedDiamond)
    ax = axes_or_new(ax, height=2.5 if diamond else 3.0)
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
    peak = axial_peak(found)
    if peak is not None:
        ax.plot(peak["E1"], peak["s1"], "o", color=BLACK, markerfacecolor="white", label="peak")
    if not diamond:  # whose B is the yield of all contacts
        for kind, (marker, label) in EVENT_MARKS.items():
            at = [event.index for event in found.path.events if event.kind == kind]
            if at:
                ax.plot(E1[at], found.s1[at], marker, color=GREY, markersize=3.5, label=label)
    over_strain(found, ax, found.s1, "stress over $k_n$ (–)", 0.16)
    above: Any = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": 2}
    ax.legend(**({"loc": "best"} if diamond else above))
    return ax


@styled()
def draw_eigenvalues(found: Followed, ax: Axes | None = None) -> Axes:
    """Eigenvalues of K (real parts) and of Ks in (11, 22) along the path, as Fig. 10."""
    ax = axes_or_new(ax)
    values, symmetric = spectrum(found.K).real, symmetric_spectrum(found.K)
    E1 = found.broken(found.E1)
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    ax.plot(E1, found.broken(values), color=BLUE, label=["$K$", None])
    ax.plot(E1, found.broken(symmetric), color=ORANGE, linestyle=DASHED, label=["$K_s$", None])
    over_strain(found, ax, symmetric[:, 0], "eigenvalues over $k_n$ (–)", 0.1)
    ax.legend(loc="best")
    return ax


@styled()
def draw_cone(found: Followed, ax: Axes | None = None) -> Axes:
    """Instability cone in (11, 22) along the path, with the path's own direction (Fig. 12)."""
    ax = axes_or_new(ax, 4.2, 2.8)
    E1, first = found.E1, True
    half = 0.5 * found.plane["cone_opening_deg"].to_numpy()
    half = np.where(half > 0.0, half, np.nan)
    # The paper's alphaE counts from E2 towards E1.
    axis = np.mod(90.0 - found.plane["cone_axis_deg"].to_numpy(), 180.0)
    bounds = [0, *found.jumps.tolist(), len(found.path)]
    for part in (slice(a, b) for a, b in pairwise(bounds)):
        ax.fill_between(
            E1[part], (axis - half)[part], (axis + half)[part], facecolor="none",
            edgecolor=VERMILION, hatch="////", linewidth=0.8,
            label="instability cone" if first and np.isfinite(half).any() else None,
        )  # fmt: skip
        first = False
    if not np.isfinite(half).any():
        ax.plot([], [], " ", label="no instability cone on this path")
    direction = np.degrees(alpha_e(np.arctan2(found.direction[:, 1], found.direction[:, 0])))
    ax.plot(E1, direction, color=BLUE, label="loading direction")
    for name, row in found.marks.items():
        if name != "end":
            ax.axvline(E1[row], color=GREY, linewidth=0.7, linestyle=(0, (2, 2)), zorder=0)
            write_above(ax, E1[row], name, fontweight="bold")
    ax.set(xlabel=STRAIN_LABEL, ylabel=r"$\alpha_E$ (degrees)", xlim=(0.0, None), ylim=(0.0, 180.0))
    ax.set_yticks(np.arange(0, 181, 45))
    ax.legend(loc="lower left")
    return ax


@styled()
def draw_unstable_fraction(found: Followed, ax: Axes | None = None) -> Axes:
    """Share of strain directions with negative second-order work, by subspace."""
    ax = axes_or_new(ax, 4.2, 2.8)
    table, E1 = found.subspaces, found.broken(found.E1)
    for subspace, colour, style, label in SUBSPACE_LOOKS:
        share = found.broken(100.0 * table[f"unstable_fraction_{subspace}"].to_numpy())
        ax.plot(E1, share, color=colour, linestyle=style, label=label)
    over_strain(found, ax, None, "unstable directions (%)")
    if not any(np.any(table[f"unstable_fraction_{name}"] > 0.0) for name, *_ in SUBSPACE_LOOKS):
        say_empty(ax, "no unstable direction on this path")
        ax.set_ylim(top=10.0)
    ax.set_ylim(bottom=-1.0)
    ax.legend(loc="best")
    return ax


def over_strain(
    found: Followed, ax: Axes, marked: Floats | None, ylabel: str, margin: float = 0.05
) -> None:
    """Label the axes, mark the named states on one curve, shade where opposite grains overlap."""
    for name, row in found.marks.items():
        at = found.E1[row]
        if marked is None or name == "end":
            continue
        ax.plot(at, marked[row], "o", color=BLACK, zorder=3)
        text = ax.annotate(
            name, (at, marked[row]), (0, 5), textcoords="offset points", fontweight="bold",
            ha="center", va="bottom",
        )  # fmt: skip
        text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
    if isinstance(found, FollowedDiamond):
        _shade_overlap(found, ax)
    ax.set(xlabel=STRAIN_LABEL, ylabel=ylabel, xlim=(0.0, None))
    ax.margins(y=margin)


def _shade_overlap(found: FollowedDiamond, ax: Axes) -> None:
    """Shade the strains at which opposite grains overlap, with a note above the axes."""
    overlap = np.minimum(*opposite_gaps(found.E1, found.E2, found.loop.alpha0)) < 0.0
    parts, E1 = true_runs(overlap), found.E1
    for part in parts:
        ax.axvspan(E1[part][0], E1[part][-1], color=LIGHT_GREY, alpha=0.45, linewidth=0.0, zorder=0)
    if parts:
        said = "share a contact" if found.states.added.any() else "overlap"
        middle = 0.5 * (E1[parts[0]][0] + E1[parts[-1]][-1])
        write_above(ax, middle, f"opposite grains {said}", color=GREY, fontsize=7)


def true_runs(where: Flags) -> list[slice]:
    """Slices of consecutive True values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(np.int64), [0]])))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


# ---- polar diagrams


def polygon_diagrams(found: Followed, critical: float | None) -> dict[str, PolarDiagram]:
    """Polar diagrams at the critical strain, if there is one, and at the named states."""
    operators = {name: found.K[row] for name, row in found.marks.items()}
    if critical:
        o: PolygonOptions = found.options  # type: ignore[assignment]
        loop, law = o.graph(critical), o.law()
        loop = loop.replace(normal_force=law.normal_force(contact_state(loop)))
        A = macroscopic_tangent(loop, law, o.closure, spins=o.spins).matrix
        operators = {"critical": restrict(A, "diagonal"), **operators}
    finite = {name: K for name, K in operators.items() if np.isfinite(K).all()}
    return {name: operator_diagram(K) for name, K in finite.items()}


@styled()
def draw_polar_figure(
    diagrams: dict[str, PolarDiagram], beyond: dict[str, PolarDiagram] | None = None
) -> Figure:
    """Polar diagrams of w2 in (11, 22) by name; dashed those of sliding contacts, `beyond`."""
    count = max(len(diagrams), 1)
    width = 0.5 + count * (TWO_COLUMNS - 0.5) / 3.0
    fig, (axes,) = new_panels(1, count, 2.75, width, sharey=True)
    for ax, (name, diagram) in zip(axes, diagrams.items(), strict=False):
        draw_polar(diagram, ax, name)
        sliding = (beyond or {}).get(name)
        if sliding is not None:
            closed = np.concatenate([sliding.points, sliding.points[:1]])
            label = "all directions sliding"
            ax.plot(*closed.T, color=ORANGE, linewidth=0.9, linestyle=(0, (3, 2)), label=label)
            ax.legend(loc="lower center", bbox_to_anchor=(0.5, 0.98), borderaxespad=0.0)
        ax.label_outer()
    return fig


@styled()
def draw_polar(diagram: PolarDiagram, ax: Axes | None = None, name: str = "") -> Axes:
    """One polar diagram, as Fig. 11: inside the circle of radius 2 `w2` is negative.

    The curve is `(2 + w2) (cos alphaE, sin alphaE)`, `tan(alphaE) = E1'/E2'`.
    """
    ax = axes_or_new(ax, 2.5, 2.5)
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
    ax.text(0.0, 0.0, name, ha="center", va="center", fontweight="bold", color=BLACK)
    ax.set(xlim=(-3.15, 3.15), ylim=(-3.15, 3.15), aspect="equal")
    ax.set(xticks=[-2, 0, 2], yticks=[-2, 0, 2])
    ax.set(xlabel=r"$(2 + w_2)\,\cos\alpha_E$ (–)", ylabel=r"$(2 + w_2)\,\sin\alpha_E$ (–)")
    return ax


# ---- the loop


@styled()
def draw_loops(found: Followed, names: Sequence[str]) -> Figure:
    """The loop at named states with its contact forces, and for few grains the external ones."""
    count = len(names)
    fig, (axes,) = new_panels(1, count, 3.6, count * TWO_COLUMNS / 2, sharex=True, sharey=True)
    path, rows = found.path, [found.marks[name] for name in names]
    x, size = path.x[rows], 2.0 * found.options.graph().radii
    forces = [(path.normal_force[row], path.shear_force[row]) for row in rows]
    largest = max(float(np.hypot(*both).max()) for both in forces)
    reach = float(np.abs(x).max()) + (1.4 if len(size) <= MOST_WITH_ARROWS else 0.6)
    for ax, name, row, at, both in zip(axes, names, rows, x, forces, strict=True):
        draw_grains(ax, at, size, path.contacts, *both, path.regime[row], largest)
        ax.set_title(f"{name}: $E_1 = {found.E1[row]:.4f}$, $E_2 = {found.E2[row]:.4f}$")
        ax.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach))
        ax.set(xlabel=r"$x_1 / l_0$ (–)", ylabel=r"$x_2 / l_0$ (–)")
        ax.locator_params(nbins=6)
        ax.label_outer()
    regimes = {Regime(int(each)) for each in np.unique(path.regime[rows])}
    key = forces_key(largest, r"$k_n l_0$", regimes, arrows=len(size) <= MOST_WITH_ARROWS)
    fig.legend(
        handles=key,
        loc="outside lower center",
        ncols=count if fig.get_figwidth() > TWO_COLUMNS - 0.1 else 1,
    )
    return fig


def draw_grains(
    ax: Axes,
    x: Floats,
    size: Floats,
    pairs: Integers,
    N: Floats,
    T: Floats,
    regime: Regimes,
    largest: float,
) -> None:
    """Draw grains of the diameters `size`, and the force of every contact along its branch.

    Its width is in proportion, the widest of the force `largest`; for few grains arrows show the
    forces from outside that hold the contacts in balance, in proportion as well.
    """
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
    width = WIDEST * np.hypot(N, T) / largest
    ax.add_collection(LineCollection(list(x[pairs]), colors=colours, linewidths=width))
    ax.plot(*x.T, "o", color=BLACK, markersize=1.5)
    if len(x) > MOST_WITH_ARROWS:
        return
    d = x[pairs[:, 1]] - x[pairs[:, 0]]
    n = d / np.linalg.norm(d, axis=1, keepdims=True)
    # Forces on the second grain of every contact.
    force = N[:, None] * n + T[:, None] * np.stack([-n[:, 1], n[:, 0]], axis=1)
    external = np.zeros_like(x)
    np.add.at(external, pairs[:, 0], force)
    np.add.at(external, pairs[:, 1], -force)
    pull = np.linalg.norm(external, axis=1)
    here = pull > 1e-12 * largest
    along = external[here] / pull[here, None]
    ax.quiver(
        *(x[here] - 0.5 * size[here, None] * along).T, *(external[here] / largest).T, angles="xy",
        scale_units="xy", scale=1.0 / (ARROW * size.mean()), pivot="tip", width=0.006,
    )  # fmt: skip


def forces_key(largest: float, unit: str, regimes: set[Regime], *, arrows: bool) -> list[Line2D]:
    """Handles of the legend: regimes, the force of the widest line, and of the arrows."""
    key = [
        Line2D(
            [], [], color=REGIME_COLOURS[regime], linewidth=0.5 * WIDEST, label=f"{name} contact"
        )
        for regime, name in REGIME_NAMES.items()
        if regime in regimes
    ]
    width = f"contact force, widest: {largest:.3g} {unit}"
    key.append(Line2D([], [], color=BLACK, linewidth=WIDEST, label=width))
    if arrows:
        length = f"external force, {ARROW:g} diameters long: {largest:.3g} {unit}"
        key.append(
            Line2D([], [], color=BLACK, linewidth=0.0, marker=r"$\rightarrow$", label=length)
        )
    return key


# ---- orders side by side


@styled()
def draw_critical_strain(compared: Compared, ax: Axes | None = None) -> Axes:
    """Critical isotropic strain over the order, by subspace, with the two thresholds."""
    ax = axes_or_new(ax, 4.2, 2.8)
    table, kappa = compared.table, compared.options.shared.kappa
    for label, level in (
        (r"$\kappa/(1+\kappa)$", kappa / (1 + kappa)),
        (r"$(1+\kappa)/(2+\kappa)$", (1 + kappa) / (2 + kappa)),
    ):
        ax.axhline(level, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)), zorder=0)
        ax.annotate(
            label, (1.0, level), (2, 0), xycoords=("axes fraction", "data"),
            textcoords="offset points", va="center", color=GREY,
        )  # fmt: skip
    for subspace, colour, _, label in SUBSPACE_LOOKS:
        ax.plot(
            table["order"], table[f"critical_strain_{subspace}"], SUBSPACE_MARKERS[subspace],
            color=colour, markerfacecolor="none", markersize=6, label=label,
        )  # fmt: skip
    _order_axis(ax, table["order"])
    ax.set(ylabel="critical isotropic strain (–)", ylim=(-0.02, None))
    beside = key_columns(figure_of(ax), 3)
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=beside, columnspacing=1.0)
    return ax


@styled()
def draw_yield_and_peak(compared: Compared) -> Figure:
    """First yield and peak of the axial stress over the order: strain and stress."""
    fig, (axes,) = new_panels(1, 2, 2.6)
    table = compared.table
    for ax, key, label in zip(
        axes, ("E1", "s1"), ("axial strain (–)", "axial stress (–)"), strict=True
    ):
        for name, mark, colour, said in (
            ("first_yield", "o", BLUE, "first yield"),
            ("peak", "x", VERMILION, "peak of $s_1$"),
        ):
            ax.plot(
                table["order"], table[f"{name}_{key}"], mark, color=colour, label=said,
                markerfacecolor="none", markersize=6,
            )  # fmt: skip
        _order_axis(ax, table["order"])
        ax.set(ylabel=label)
        ax.margins(y=0.15)
    ax.legend(loc="best")
    return fig


@styled()
def draw_stress_strain(compared: Compared, ax: Axes | None = None) -> Axes:
    """Axial stress over axial strain, one curve per order; a ring where a path ends early."""
    ax = axes_or_new(ax, 4.6, 3.0)
    shades = colormaps[SEQUENTIAL](np.linspace(0.0, 0.92, len(compared.found)))
    for order, found, shade in zip(compared.options.orders, compared.found, shades, strict=True):
        ax.plot(found.E1, found.s1, color=shade, linewidth=1.1, label=f"{order}")
        if found.path.status != "finished":
            ax.plot(found.E1[-1], found.s1[-1], "o", color=shade, markerfacecolor="white")
    ax.set(xlabel="axial strain $E_1$ (–)", ylabel="axial stress $s_1$ (–)", xlim=(0.0, None))
    ax.legend(title="order", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return ax


def _order_axis(ax: Axes, orders: pd.Series) -> None:
    ax.set(xlabel="order of the loop, $n$", xticks=orders.to_numpy()[:: max(len(orders) // 10, 1)])
