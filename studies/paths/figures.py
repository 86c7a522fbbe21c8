"""Figures that every path has: stress, eigenvalues, cone, polar diagrams, the loop itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
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
from studies.paths.followed import Followed
from studies.paths.options import PolygonOptions
from studies.paths.polar import RADIUS, beyond_diagram, operator_diagram, state_diagram
from studies.paths.polygon import axial_peak
from studies.paths.tables import plane_columns, subspace_columns
from studies.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT_GREY,
    ORANGE,
    PURPLE,
    TWO_COLUMNS,
    VERMILION,
    axes_or_new,
    figure_of,
    new_panels,
    say_empty,
    styled,
    write_above,
)

STRAIN = r"axial strain $E_1$ (–)"
DASHED: Any = (0, (4, 3))
COLOURS = {Regime.ELASTIC: BLUE, Regime.SLIDING: VERMILION, Regime.OPEN: LIGHT_GREY}
REGIMES = {Regime.ELASTIC: "sticking", Regime.SLIDING: "sliding", Regime.OPEN: "open"}
EVENTS = {"yield": ("v", "contacts yield"), "opening": ("D", "contacts open")}
# Line and arrow of the largest force, in points and in diameters; the most grains with arrows.
WIDEST, ARROW, FEW = 4.0, 0.45, 12
SHARES: tuple[tuple[str, str, Any, str], ...] = (
    ("diagonal", BLUE, "-", "(11, 22)"),
    ("symmetric", VERMILION, (0, (4, 2)), r"(11, 22, (12+21)/$\sqrt{2}$)"),
    ("full", GREEN, (0, (1, 1)), "all four components"),
)


def polygon_figures(found: Followed, critical: dict[str, float | None]) -> dict[str, Figure]:
    """Every figure of one polygon by its name."""
    return {
        "loop": draw_loops(found, list(found.marks)),
        "stress_strain": figure_of(draw_stress(found)),
        "eigenvalues": figure_of(draw_eigenvalues(found)),
        "polar": draw_polar_figure(found, critical["diagonal"]),
        "cone": figure_of(draw_cone(found)),
        "unstable_fraction": figure_of(draw_unstable_fraction(found)),
    }


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
        for kind, (marker, label) in EVENTS.items():
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
    plane, E1, first = plane_columns(found.K, found.det_K, found.det_Ks), found.E1, True
    half = 0.5 * plane["cone_opening_deg"]
    half = np.where(half > 0.0, half, np.nan)
    # The paper's alphaE counts from E2 towards E1.
    axis = np.mod(90.0 - plane["cone_axis_deg"], 180.0)
    for part in found.smooth():
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
    ax.set(xlabel=STRAIN, ylabel=r"$\alpha_E$ (degrees)", xlim=(0.0, None), ylim=(0.0, 180.0))
    ax.set_yticks(np.arange(0, 181, 45))
    ax.legend(loc="lower left")
    return ax


@styled()
def draw_unstable_fraction(found: Followed, ax: Axes | None = None) -> Axes:
    """Share of strain directions with negative second-order work, by subspace."""
    ax = axes_or_new(ax, 4.2, 2.8)
    table, E1 = subspace_columns(found), found.broken(found.E1)
    for subspace, colour, style, label in SHARES:
        share = found.broken(100.0 * table[f"unstable_fraction_{subspace}"])
        ax.plot(E1, share, color=colour, linestyle=style, label=label)
    over_strain(found, ax, None, "unstable directions (%)")
    if not any(np.any(table[f"unstable_fraction_{name}"] > 0.0) for name, *_ in SHARES):
        say_empty(ax, "no unstable direction on this path")
        ax.set_ylim(top=10.0)
    ax.set_ylim(bottom=-1.0)
    ax.legend(loc="best")
    return ax


def over_strain(
    found: Followed, ax: Axes, marked: Floats | None, ylabel: str, margin: float = 0.05
) -> None:
    """Axes over the axial strain: named states on one curve, opposite grains, titles."""
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
    ax.set(xlabel=STRAIN, ylabel=ylabel, xlim=(0.0, None))
    ax.margins(y=margin)


def _shade_overlap(found: FollowedDiamond, ax: Axes) -> None:
    """Shade where opposite grains overlap; say so above the axes, where no curve runs."""
    overlap = np.minimum(*opposite_gaps(found.E1, found.E2, found.loop.alpha0)) < 0.0
    parts, E1 = runs(overlap), found.E1
    for part in parts:
        ax.axvspan(E1[part][0], E1[part][-1], color=LIGHT_GREY, alpha=0.45, linewidth=0.0, zorder=0)
    if parts:
        said = "share a contact" if found.states.added.any() else "overlap"
        middle = 0.5 * (E1[parts[0]][0] + E1[parts[-1]][-1])
        write_above(ax, middle, f"opposite grains {said}", color=GREY, fontsize=7)


def runs(where: Flags) -> list[slice]:
    """Runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], where.astype(np.int64), [0]])))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


# ---- polar diagrams


@styled()
def draw_polar_figure(found: Followed, critical: float | None = None) -> Figure:
    """Polar diagrams of w2 in (11, 22) at the named states, and at the critical strain.

    At the diamond's B every direction has the regime it activates; a dashed curve shows sliding
    contacts in all directions, the operator of the path beyond B.
    """
    diagrams: dict[str, PolarDiagram] = {}
    if isinstance(found, FollowedDiamond):
        diagrams = {name: state_diagram(found, name)[0] for name in found.marks}
    else:
        known = {name: found.K[row] for name, row in found.marks.items()}
        if critical:
            known = {"critical": isotropic_operator(found.options, critical), **known}  # type: ignore[arg-type]
        finite = {name: K for name, K in known.items() if np.isfinite(K).all()}
        diagrams = {name: operator_diagram(K) for name, K in finite.items()}
    count = max(len(diagrams), 1)
    width = 0.5 + count * (TWO_COLUMNS - 0.5) / 3.0
    fig, (axes,) = new_panels(1, count, 2.75, width, sharey=True)
    for ax, (name, diagram) in zip(axes, diagrams.items(), strict=False):
        draw_polar(diagram, ax, name)
        beyond = (
            beyond_diagram(found) if isinstance(found, FollowedDiamond) and name == "B" else None
        )
        if beyond is not None:
            closed = np.concatenate([beyond.points, beyond.points[:1]])
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
    for part in runs(np.append(diagram.work, diagram.work[0]) < 0.0):
        # One point beyond either end, where the curves meet.
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


def isotropic_operator(options: PolygonOptions, strain: float) -> Floats:
    """(2, 2) tangent in (11, 22) of a regular loop under isotropic strain."""
    loop, law = options.graph(strain), options.law()
    loop = loop.replace(normal_force=law.normal_force(contact_state(loop)))
    tangent = macroscopic_tangent(loop, law, options.closure, spins=options.spins)
    return restrict(tangent.matrix, "diagonal")


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
    reach = float(np.abs(x).max()) + (1.4 if len(size) <= FEW else 0.6)
    for ax, name, row, at, both in zip(axes, names, rows, x, forces, strict=True):
        draw_grains(ax, at, size, path.contacts, *both, path.regime[row], largest)
        ax.set_title(f"{name}: $E_1 = {found.E1[row]:.4f}$, $E_2 = {found.E2[row]:.4f}$")
        ax.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach))
        ax.set(xlabel=r"$x_1 / l_0$ (–)", ylabel=r"$x_2 / l_0$ (–)")
        ax.locator_params(nbins=6)
        ax.label_outer()
    regimes = {Regime(int(each)) for each in np.unique(path.regime[rows])}
    key = forces_key(largest, r"$k_n l_0$", regimes, arrows=len(size) <= FEW)
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
    """Grains of the diameters `size`, the force of every contact as a line along it.

    Its width is in proportion, the widest of the force `largest`; for few grains arrows show the
    forces from outside that hold the contacts in balance, in proportion as well.
    """
    closed = regime != Regime.OPEN
    ax.add_collection(
        EllipseCollection(
            size, size, 0.0 * size, units="xy", offsets=x, offset_transform=ax.transData,
            facecolors="none", edgecolors=GREY, linewidths=0.7,
        )
    )  # fmt: skip
    drawn = closed | (np.arange(len(pairs)) < len(x))
    ax.add_collection(LineCollection(list(x[pairs[drawn]]), colors=LIGHT_GREY, linewidths=0.6))
    force, largest = _forces(N, T, x[pairs]), max(largest, np.finfo(float).tiny)
    strength = np.linalg.norm(force, axis=1)
    branch = np.linalg.norm(x[pairs[:, 1]] - x[pairs[:, 0]], axis=1)
    half = 0.5 * force * (branch / np.where(strength > 0.0, strength, 1.0))[:, None]
    first = size[pairs[:, :1]] / size[pairs].sum(axis=1, keepdims=True)
    contact = x[pairs[:, 0]] + first * (x[pairs[:, 1]] - x[pairs[:, 0]])
    lines = np.stack([contact - half, contact + half], axis=1)
    colours = [COLOURS[Regime(int(each))] for each in regime]
    width = WIDEST * strength / largest
    ax.add_collection(LineCollection(list(lines), colors=colours, linewidths=width))
    ax.plot(*x.T, "o", color=BLACK, markersize=1.5)
    if len(x) > FEW:
        return
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
    """What is drawn of the forces of a loop, and how large the widest line is."""
    key = [
        Line2D([], [], color=COLOURS[regime], linewidth=0.5 * WIDEST, label=f"{name} contact")
        for regime, name in REGIMES.items()
        if regime in regimes
    ]
    width = f"contact force, widest: {largest:.3g} {unit}"
    key.append(Line2D([], [], color=BLACK, linewidth=WIDEST, label=width))
    if arrows:
        length = f"external force, {ARROW:g} diameters long: as large"
        key.append(
            Line2D([], [], color=BLACK, linewidth=0.0, marker=r"$\rightarrow$", label=length)
        )
    return key


def _forces(N: Floats, T: Floats, ends: Floats) -> Floats:
    """(C, 2) forces on the second grain of every contact."""
    d = ends[:, 1] - ends[:, 0]
    n = d / np.linalg.norm(d, axis=1, keepdims=True)
    return N[:, None] * n + T[:, None] * np.stack([-n[:, 1], n[:, 0]], axis=1)
