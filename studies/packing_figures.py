"""Figures of packings: probes in many directions, paths, sustained loads, forecasts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from loops.arrays import Flags, Floats
from loops.errors import counted
from patterns import Snapshot, planar
from stability import COMPONENTS
from stability.packing import Probe, Sustained
from studies.evolve import DROP, Evolution
from studies.forecast import Calibration, Forecast, calibration, spread_of
from studies.output import Summary
from studies.snapshot.figures import bars_by_order, draw_scaled, draw_values, loop_drawer
from studies.study import Drawings
from studies.style import (
    BLACK,
    BLUE,
    DIVERGING,
    GREEN,
    GREY,
    LIGHT_GREY,
    ORANGE,
    SEQUENTIAL,
    SKY,
    TWO_COLUMNS,
    VERMILION,
    edge_ticks,
    figure_of,
    new_panels,
    outer_legend,
    panel,
    polar_grid,
    shade_sectors,
    styled,
    write_animation,
)

# The circle of w2 = 0 of the polar diagram (Nicot et al. 2016, Fig. 11).
RADIUS = 2.0
# Directions from which on an envelope is a line without dots.
MOST_DOTS = 100
# Directions below which no line joins their points.
FEW_DIRECTIONS = 24
# Volumes that change by less than this share of what is driven are rounding.
ROUNDED_VOLUME = 1e-6
# Loads below this share of the largest load are drawn at the centre.
LOWEST_LOAD = 1e-5
LOAD_LOOKS = {
    "held": ("o", BLUE, "held"),
    "large motion, at rest again": ("s", ORANGE, "large motion, at rest again"),
    "large motion, no rest": ("X", VERMILION, "large motion, no rest"),
    "unfinished": ("d", GREY, "unfinished"),
}
FORECAST_LOOKS: dict[str, tuple[str, dict[str, Any]]] = {
    "dem": ("DEM", {"linestyle": "none", "marker": "o", "fillstyle": "none", "color": "black"}),
    "events": ("path by events", {"linestyle": "none", "marker": "x", "color": BLUE}),
    "replay": ("replay", {"linestyle": "none", "marker": "+", "color": VERMILION}),
    "persistence": ("stress of the start", {"linestyle": ":", "color": GREY}),
}
CHANGE_OF_AREA = r"change of area $H_{11} + H_{22}$ (–)"
STRESS_LOOKS = {"P11": (BLUE, "-"), "P22": (VERMILION, "--")}
SHEAR_LOOK = (GREEN, "-.")
KIND_WORDS = {"opens": "a contact opens", "lost": "loop lost", "unstable": "$W_2 < 0$"}
KIND_LOOKS = {"opens": ("s", BLUE), "lost": ("o", VERMILION), "unstable": ("^", GREEN)}
# Loops below which a share says nothing.
FEW = 10
WAY_LOOKS = {"events": ("path by events", BLUE, "-"), "replay": ("replay", VERMILION, "--")}


# ---- probes


def probe_figures(
    snapshot: Snapshot, found: Probe, tables: dict[str, pd.DataFrame], summary: Summary
) -> Drawings:
    """Every figure of a probe by name."""
    yield "envelope", lambda: response_envelope(found, summary["mean_kn"])
    yield "work", lambda: polar_work(found)
    if found.softest is not None:
        yield "orders", lambda: order_shares(summary["orders"])
        # Under stress control work is a compliance.
        factor = summary["mean_kn"] ** (1 if found.control == "stress" else -1)
        unit = "· mean $k_n$" if found.control == "stress" else "/ mean $k_n$"
        work = factor * tables["loops"]["additive_w"].to_numpy()
        yield "map", lambda: additive_work_map(snapshot, work, unit)


@panel(height=3.6)
def response_envelope(found: Probe, kn: float, ax: Axes) -> None:
    """Response to driven rates of unit length, and the elastic response."""
    if found.control == "strain":
        answers = found.stress_rate / kn, found.elastic_stress / kn
        labels = r"$P'_{11}$ / mean $k_n$", r"$P'_{22}$ / mean $k_n$"
    else:
        answers = found.strain_rate * kn, found.elastic_strain * kn
        labels = r"$H'_{11}$ · mean $k_n$", r"$H'_{22}$ · mean $k_n$"
    answer, elastic = (values[:, [0, 1], [0, 1]] for values in answers)
    if found.softest is not None:
        look: Any = {"color": VERMILION, "markersize": 5, "label": "softest direction"}
        ax.plot(*answer[found.softest], "D", **look)
    closed = [*range(len(answer)), 0] if found.subspace == "diagonal" else slice(None)
    shear = None if found.subspace == "diagonal" else found.directions[:, 2]
    unstable = found.normalised[closed] < 0.0
    draw_envelope(ax, elastic[closed], answer[closed], unstable, labels, shear)
    if unknown := int(np.count_nonzero(~found.determined)):
        legend: Any = ax.get_legend()
        legend.set_title(f"no answer in {unknown} of {counted(len(found.theta), 'direction')}")


def draw_envelope(
    ax: Axes,
    elastic: Floats,
    answer: Floats,
    unstable: Flags,
    labels: tuple[str, str],
    shear: Floats | None = None,
) -> None:
    """Draw responses in all directions, those where all contacts stick, and unstable ones.

    Directions on a circle make lines; others, on a sphere, are dots coloured by their shear part.
    """
    look: Any = {"color": GREY, "linewidth": 1.0, "label": "all contacts stick"}
    if shear is None:
        ax.plot(*elastic.T, "--", **look)
        look = {"marker": "o", "markersize": 2.2} if len(answer) < MOST_DOTS else {}
        sliding = "contacts slide as the direction requires"
        ax.plot(*answer.T, color=BLUE, label=sliding, **look)
        label = "negative second-order work" if unstable.any() else "_none"
        negative = np.where(unstable[:, None], answer, np.nan)
        ax.plot(*negative.T, color=VERMILION, linewidth=2.2, label=label, **look)
    else:
        ax.plot(*elastic.T, ".", **look | {"color": LIGHT_GREY})
        x, y = answer.T
        dots = ax.scatter(x, y, c=shear, s=6, cmap=SEQUENTIAL)
        figure_of(ax).colorbar(dots, ax=ax, shrink=0.7, label="shear part of the direction")
    ax.axhline(0.0, color=LIGHT_GREY, linewidth=0.7, zorder=0)
    ax.axvline(0.0, color=LIGHT_GREY, linewidth=0.7, zorder=0)
    ax.set(xlabel=labels[0], ylabel=labels[1])
    ax.set_aspect("equal", adjustable="datalim")
    ax.locator_params(nbins=4)
    outer_legend(ax, "lower left", (0.0, 1.0), 1.8)


@panel(height=3.5, projection="polar")
def polar_work(found: Probe, ax: PolarAxes) -> None:
    """Normalised second-order work over the directions, with the cones."""
    circle = np.linspace(0.0, 2.0 * np.pi, 361)
    ax.plot(circle, np.full(361, RADIUS), color=GREY, linewidth=0.8)
    shade_sectors(ax, found.cones, RADIUS + 1.0, 0.35)
    theta, radius = found.theta, RADIUS + found.normalised
    if found.subspace == "diagonal":
        order = np.append(np.argsort(theta), np.argmin(theta))
        line = "o" if len(theta) < FEW_DIRECTIONS else "o-"
        ax.plot(theta[order], radius[order], line, color=BLUE, markersize=2.2, linewidth=1.0)
    else:
        dots = ax.scatter(theta, radius, c=found.directions[:, 2], s=6, cmap=SEQUENTIAL)
        figure_of(ax).colorbar(
            dots, ax=ax, shrink=0.7, pad=0.12, label="shear part of the direction"
        )
    unknown = theta[~found.determined]
    ax.plot(unknown, np.full(len(unknown), RADIUS + 1.0), "x", color=GREY, markersize=3.5)
    driven = "H" if found.control == "strain" else "P"
    ax.set_ylim(0.0, RADIUS + 1.05)
    polar_grid(ax, [1.0, 2.0, 3.0], ["−1", "0", "1"], 112.5)
    note = f"\n×: {len(unknown)} of {len(theta)} undetermined" if len(unknown) else ""
    share = f"{100 * found.unstable_fraction:.3g} %" if found.determined.any() else "unknown share"
    ax.set_title(
        rf"$w_2$ along $({driven}'_{{11}}, {driven}'_{{22}})$ (degrees)"
        f"\n$w_2 < 0$ in {share} of directions{note}"
    )


@panel()
def order_shares(orders: dict[str, dict[str, float]], ax: Axes) -> None:
    """Shares of the loops by order in area, in W2 (over the sum of sizes), in its negative part."""
    # Contacts in no loop or in only one are drawn before the triangles.
    numbers, table = np.array([int(n) or 2 for n in orders]), pd.DataFrame(orders).T
    work = table["W2_share"] / table["W2_share"].abs().sum()
    parts = {
        "of the area": (SKY, table["area_share"]),
        r"of $W_2$, over the sum of sizes": (BLUE, work),
        "of its negative part": (VERMILION, table["negative_share"]),
    }
    bars_by_order(ax, numbers, parts)
    ax.axhline(0.0, color=GREY, linewidth=0.7)
    ax.set_ylabel("share of the loops of an order (–)")
    shown = numbers[:: len(numbers) // 13 + 1]
    ax.set_xticks(shown, labels=["none" if n == 2 else str(n) for n in shown])
    outer_legend(ax, "lower left", (0.0, 1.0), 0.3)


@panel(4.4, 4.0)
def additive_work_map(
    snapshot: Snapshot, work: Floats, unit: str = "/ mean $k_n$", *, ax: Axes
) -> None:
    """Loops coloured by their additive second-order work, in the unit that the label names."""
    label = r"additive $w = -\sum f' \cdot d' / (2 V_l)$ " + unit
    draw_values(loop_drawer(snapshot), ax, work, label, signed=True)


# ---- paths


def evolve_figures(
    snapshot: Snapshot, found: Any, tables: dict[str, pd.DataFrame], summary: Summary
) -> Drawings:
    """Every figure of a path by name."""
    yield "stress_strain", lambda: stress_and_volume(tables, summary["driven"])
    computed = tables.get("forecast", pd.DataFrame()).filter(regex="_(events|replay)$")
    if computed.notna().any(axis=None):
        yield "forecast", lambda: dem_comparison_figure(tables, summary["driven"])
    yield "map", lambda: work_maps(snapshot, tables["loops"], summary)
    if summary["opened"] and len(found.way.turns) > 1:
        yield "back", lambda: loops_that_come_back(snapshot, found, tables)


@styled()
def stress_and_volume(tables: dict[str, pd.DataFrame], driven: str) -> Figure:
    """Stresses and the volume along the path, with a replay's and the DEM's for comparison."""
    path, events = tables["path"], tables["events"]
    figure, ((stress, volume),) = new_panels(1, 2, 2.7)
    _draw_stresses(stress, path, driven)
    draw_cycle(volume, path["driven"], path["H11"] + path["H22"], color=BLUE, label="path")
    dots: dict[str, Any] = {"linestyle": "none", "marker": ".", "markersize": 4}
    ring: dict[str, Any] = {"linestyle": "none", "marker": "o", "fillstyle": "none"}
    for name, look in (("replay", dots), ("dem", ring)):
        other = tables.get(name)
        if other is None:
            continue
        label = "DEM" if name == "dem" else name
        at = other[driven] - (path[driven].iloc[0] if driven[0] == "P" else 0.0)
        for number, (quantity, (colour, _)) in enumerate(_stress_looks(driven).items()):
            change = other[quantity] - path[quantity].iloc[0]
            stress.plot(at, change, color=colour, label="_" * (number > 0) + label, **look)
        volume.plot(at, other["H11"] + other["H22"], color=BLUE, label=label, **look)
    edge_ticks(stress, events["driven"][events["kind"] == "instability"], "instabilities")
    over_driven(volume, driven, CHANGE_OF_AREA)
    reach = float(np.abs(path["driven"]).max())
    if np.ptp(path["H11"] + path["H22"]) < ROUNDED_VOLUME * reach:
        volume.set_ylim(-reach, reach)
    stress.legend()
    return figure


@styled()
def dem_comparison_figure(tables: dict[str, pd.DataFrame], driven: str) -> Figure:
    """Changes of the driven stress and the area: predicted at the snapshots of the DEM, its own."""
    table = tables["forecast"]
    figure, ((stress, volume),) = new_panels(1, 2, 2.7)
    start, at = table["stress_persistence"].iloc[0], np.append(0.0, table["driven"])
    for quantity, ax, first in (("stress", stress, start), ("volume", volume, 0.0)):
        for name, (label, look) in FORECAST_LOOKS.items():
            column = f"{quantity}_{name}"
            if column in table:
                ax.plot(at, np.append(0.0, table[column] - first), label=label, **look)
    for number, k in enumerate(np.flatnonzero(table["drop"])):
        look = {"color": GREY, "alpha": 0.25, "linewidth": 0}
        stress.axvspan(at[k], at[k + 1], label="_" * (number > 0) + "drop in the DEM", **look)
    stress_label = f"$P_{{{driven[1:]}}} - {start:.4g}$ (force/length)"
    for ax, label in ((stress, stress_label), (volume, CHANGE_OF_AREA)):
        over_driven(ax, driven, label, " from the start of the forecast")
    return figure


def _stress_looks(driven: str) -> dict[str, tuple[str, str]]:
    """Looks of both normal stresses, and of the shear stress that a programme drives."""
    own = f"P{driven[1:]}"
    return STRESS_LOOKS if own in STRESS_LOOKS else STRESS_LOOKS | {own: SHEAR_LOOK}


def _draw_stresses(ax: Axes, path: pd.DataFrame, driven: str) -> None:
    """Changes of both normal stresses along the path, and of a shear stress that is driven."""
    for name, (colour, style) in _stress_looks(driven).items():
        start = path[name].iloc[0]
        label = f"${name[0]}_{{{name[1:]}}}$, from {start:.4g}"
        draw_cycle(ax, path["driven"], path[name] - start, style, color=colour, label=label)
    over_driven(ax, driven, "change of nominal stress\n(force/length)")


def draw_cycle(ax: Axes, driven: Any, values: Any, style: str = "-", **look: Any) -> None:
    """Draw a quantity over the driven one: dots where a cycle turns, arrows along its legs."""
    x, y = np.asarray(driven), np.asarray(values)
    ax.plot(x, y, style, **look)
    turns = 1 + np.flatnonzero(np.diff(np.sign(np.diff(x))))
    if len(turns):
        ax.plot(x[turns], y[turns], "o", color=look["color"], markersize=3.5)
    for leg in np.split(np.arange(len(x)), turns) if len(turns) else ():
        at, to = leg[len(leg) // 2 + np.array([-1, 0])]
        arrow = {"arrowstyle": "-|>", "color": look["color"], "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", (x[to], y[to]), (x[at], y[at]), arrowprops=arrow)


def over_driven(ax: Axes, driven: str, label: str, since: str = "") -> None:
    """Label axes over the driven component, with a key if there are several curves."""
    ax.set(xlabel=driven_change(driven) + since, ylabel=label)
    ax.locator_params(axis="x", nbins=5)
    if len(ax.get_legend_handles_labels()[0]) > 1:
        ax.legend()


def driven_change(driven: str) -> str:
    """Change of the driven component, with its unit."""
    unit = "–" if driven[0] == "H" else "force/length"
    return f"$\\Delta {driven[0]}_{{{driven[1:]}}}$ ({unit})"


@styled()
def animate_path(
    snapshot: Snapshot, works: Floats, path: pd.DataFrame, summary: Summary, folder: Path
) -> list[Path]:
    """Animate the loops' normalised work since the start, (rows, loops), beside the stresses."""
    figure, ((left, right),) = new_panels(1, 2, 3.4)
    draw, colours = loop_drawer(snapshot), (mpl.colormaps[DIVERGING], Normalize(-1.0, 1.0))
    loops: Any = draw(left, works[0], *colours)
    label = "normalised $W_2$ since the start (–)"
    figure.colorbar(ScalarMappable(*colours[::-1]), ax=left, shrink=0.75, label=label)
    _draw_stresses(right, path, summary["driven"])
    looks = _stress_looks(summary["driven"])
    ring: dict[str, Any] = {"markeredgecolor": BLACK, "markersize": 7, "zorder": 3}
    rings = [right.plot([0.0], [0.0], "o", color=look[0], **ring)[0] for look in looks.values()]
    rings[0].set_label("state of the map")
    right.legend()

    def show(row: int) -> None:
        # A picture of many loops has the colours of its pixels: it is drawn again.
        nonlocal loops
        loops.remove()
        loops = draw(left, works[row], *colours)
        for ring, name in zip(rings, looks, strict=True):
            ring.set_data([path["driven"][row]], [path[name][row] - path[name].iloc[0]])

    return write_animation(folder, figure, map(show, range(1, len(works))), summary["provenance"])


@styled()
def work_maps(snapshot: Snapshot, loops: pd.DataFrame, summary: Summary) -> Figure:
    """Loops by their second-order work, and by the driven value where it is first negative."""
    figure, ((work, first),) = new_panels(1, 2, 3.0)
    draw = loop_drawer(snapshot)
    label = r"$W_2$ / mean $k_n$"
    draw_values(draw, work, loops["W2"].to_numpy() / summary["mean_kn"], label, signed=True)
    driven = summary["driven"]
    begun = loops["negative_from"].to_numpy()
    label = f"{driven_change(driven)} where $W_2$ is first negative"
    known = begun[np.isfinite(begun)]
    scale = Normalize(*((known.min(), known.max()) if len(known) else ()))
    draw_scaled(draw, first, begun, mpl.colormaps[SEQUENTIAL], scale, label=label)
    return figure


@styled()
def loops_that_come_back(snapshot: Snapshot, found: Any, tables: dict[str, pd.DataFrame]) -> Figure:
    """Loops that lose a contact in a cycle, some to have it again; their share along the cycle."""
    figure, ((left, right),) = new_panels(1, 2, 3.0)
    loops, share = tables["loops"], 100.0 * found.open_loops(found.way).mean(axis=1)
    number = np.select([loops["back"], loops["open_from"].notna()], [1, 2], 0)
    colours = ListedColormap([LIGHT_GREY, GREEN, VERMILION])
    bar = draw_scaled(loop_drawer(snapshot), left, number, colours, Normalize(-0.5, 2.5))
    kinds = ("closed\nthroughout", "opened,\nclosed again", "open\nat the end")
    counts = np.bincount(number, minlength=3)
    bar.set_ticks(range(3), labels=[f"{k}: {n}" for k, n in zip(kinds, counts, strict=True)])
    draw_cycle(right, tables["path"]["driven"], share, color=BLUE)
    over_driven(right, found.driven, "loops with an open contact (%)")
    right.set_ylim(bottom=0.0)
    return figure


def sustain_figures(
    snapshot: Snapshot, found: Sustained, tables: dict[str, pd.DataFrame], summary: Summary
) -> Drawings:
    """Every figure by name."""
    yield "limits", lambda: limit_surface(found)
    yield "work", lambda: polar_work(found.rates)
    yield "paths", lambda: load_curves(found, tables["paths"])
    if summary["weakest"] is not None:
        yield "orders", lambda: order_shares(summary["orders"])
        work = tables["loops"]["additive_w"].to_numpy() / summary["mean_kn"]
        yield "map", lambda: additive_work_map(snapshot, work)


@panel(height=4.4, projection="polar")
def limit_surface(found: Sustained, ax: PolarAxes) -> None:
    """Loads of the first event, loss of equilibrium and large motion over the stress direction."""
    largest, theta = found.largest, found.theta
    table = {
        name: np.array([getattr(path, name) for path in found.paths])
        for name in ("first_event", "limit", "first_large_load")
    }
    shade_sectors(ax, found.rates.cones, 1.1, 0.25)
    radius = {
        name: _radius(np.where(np.isnan(loads), largest, loads) / largest)
        for name, loads in table.items()
    }
    looks = {"first_event": ("x", SKY, "first event"), "limit": ("D", BLACK, "equilibrium lost")}
    for name, (marker, colour, label) in looks.items():
        met, place = ~np.isnan(table[name]), radius[name]
        ax.plot(theta[met], place[met], marker, color=colour, fillstyle="none", label=label)
    for status, (marker, colour, label) in LOAD_LOOKS.items():
        own = found.status == status
        if own.any():
            ax.plot(
                theta[own], radius["first_large_load"][own], marker, color=colour, markersize=5,
                linestyle="none", label=label,
            )  # fmt: skip
    ax.set_ylim(0.0, 1.1)
    decades = np.arange(np.ceil(np.log10(LOWEST_LOAD * largest)), np.log10(largest) + 1e-9)
    loads = 10.0**decades
    polar_grid(ax, _radius(loads / largest), [f"{load:g}" for load in loads])
    ax.set_title("load (force/length, logarithmic)\nalong $(P'_{11}, P'_{22})$")
    outer_legend(ax, "upper center", (0.5, 0.0), 2.5, ncols=2)


def _radius(share: Any) -> Any:
    """Logarithmic radius of a load over the largest one."""
    return 1.0 - np.log10(np.clip(share, LOWEST_LOAD, 1.0)) / np.log10(LOWEST_LOAD)


@panel(TWO_COLUMNS, 2.9)
def load_curves(found: Sustained, paths: pd.DataFrame, ax: Axes) -> None:
    """Load over the size of the strain along every direction."""
    size = np.sqrt(sum(paths[f"H{ij}"] ** 2 for ij in ("11", "12", "21", "22")))
    # The start is at minus infinity: a line from there would look like a snap.
    size = size.where(size > 0)
    shown, ends = set(), []
    for angle, status in zip(np.degrees(found.theta), found.status, strict=True):
        own = paths["theta_deg"] == angle
        marker, colour, label = LOAD_LOOKS[status]
        ax.plot(
            size[own], paths["load"][own], ".-", color=colour, linewidth=0.9, markersize=2.5,
            label=None if status in shown else label,
        )  # fmt: skip
        shown.add(status)
        end = size[own].iloc[-1], paths["load"][own].iloc[-1]
        ax.plot(*end, marker, color=colour, markersize=4)
        ends.append((*end, f"{angle:.0f}°", status == "held"))
    # Names stand above ends at the largest load, others on the right, apart from one another.
    height = -np.inf
    for strain, load, name, held in sorted(ends, key=lambda end: end[1]):
        height = load if held else max(load, height + 0.045 * found.largest)
        look: Any = {"ha": "center", "va": "bottom"} if held else {"ha": "left", "va": "center"}
        place = (strain, load + 0.03 * found.largest) if held else (1.1 * strain, height)
        ax.text(*place, name, fontsize=6, **look)
    ax.set(xlabel=r"strain $|H|$ (–)", ylabel="load (force/length)", xscale="log")
    ax.legend()


# ---- forecasts


def forecast_figures(snapshot: Snapshot, found: Forecast, tables: Any, summary: Any) -> Drawings:
    """Every figure of a forecast by name."""
    yield "forecast", lambda: forecast_figure(found)


@styled()
def forecast_figure(found: Forecast) -> Figure:
    """Sample with the loops by their probability to be lost; reliability; the next events."""
    figure, (axes,) = new_panels(1, 3, 3.2, width_ratios=(1.3, 1.0, 1.0))
    probability_map(found, ax=axes[0])
    reliability(calibration(), ax=axes[1])
    next_events(found, ax=axes[2])
    return figure


@panel(height=3.8)
def probability_map(found: Forecast, ax: Axes) -> None:
    """Draw the loops of the sample by the probability that they are lost."""
    values = found.loops["lost_probability"].to_numpy()
    driven, to = found.evolution.driven, found.evolution.to
    name = f"{driven[0]}_{{{driven[1:]}}}"
    label = f"probability that a loop is lost\nup to $\\Delta {name}$ = {to:g}"
    draw, colours = loop_drawer(planar(found.evolution.scene)), mpl.colormaps[SEQUENTIAL]
    scale, shown = Normalize(0.0, 1.0), {"location": "bottom", "label": label}
    draw_scaled(draw, ax, values, colours, scale, **shown)
    if not np.isfinite(values).any():
        ax.set_title("no probabilities: see the notes")


@panel()
def reliability(known: Calibration, ax: Axes) -> None:
    """Draw what was said of each series by all others against what happened in it.

    The bin that is farthest from what happened has its numbers beside it.
    """
    ax.plot([0, 1], [0, 1], color=LIGHT_GREY, linewidth=0.8, zorder=0)
    worst = 0.0, 0.0
    for kind, (mark, colour) in KIND_LOOKS.items():
        said, true, loops = reliability_bins(known, kind)
        # Of the share with one loop more of either kind: none or all of a few have an error too.
        share = (true * loops + 1) / (loops + 2)
        error = np.sqrt(share * (1 - share) / (loops + 3))
        ax.errorbar(said, true, error, fmt=mark, color=colour, markersize=3.5, linewidth=0.8,
                    label=KIND_WORDS[kind], clip_on=False)  # fmt: skip
        worst = max(worst, *zip(said, true, strict=True), key=lambda one: abs(one[1] - one[0]))
    look: Any = {"textcoords": "axes fraction", "fontsize": 6, "va": "top"}
    look["arrowprops"] = {"arrowstyle": "-", "color": GREY, "linewidth": 0.5}
    ax.annotate(f"{worst[0]:.2f}: {worst[1]:.2f}\ncame true", worst, (0.02, 0.98), **look)
    intervals = sum(known.provenance["series"].values())
    ax.set_title(f"{counted(intervals, 'interval')} of samples of Yade")
    ax.set(xlim=(0, 1), ylim=(0, 1), xlabel="forecast probability (–)", ylabel="observed share (–)")
    ax.legend(loc="lower right", handletextpad=0.2, borderaxespad=0.1)


def reliability_bins(known: Calibration, kind: str, bins: int = 8) -> tuple[Floats, Floats, Floats]:
    """Return mean forecast probability, observed share and loops, in bins of probability.

    Each series is told by all others; bins of fewer than `FEW` loops are left out.
    """
    rows = known.left_out(kind)
    at = np.minimum((rows[:, 0] * bins).astype(int), bins - 1)
    loops, told, true = (
        np.bincount(at, weights, minlength=bins)
        for weights in (rows[:, 1], rows[:, 0] * rows[:, 1], rows[:, 2])
    )
    some = loops >= FEW
    count = loops[some].astype(float)
    return told[some] / count, true[some] / count, count


@panel()
def next_events(found: Forecast, ax: Axes) -> None:
    """Draw the driven stress on the way, instabilities, and the spread of the next drop."""
    draw_driven_stress(found.evolution, ax=ax)
    rows, drop = found.next, spread_of(found.next, "drop")
    low, high = drop["low"], drop["high"]
    if low is not None and high is not None:
        label = f"next drop, {drop['found']} of {drop['ways']} ways"
        ax.axvspan(low, high, color=ORANGE, alpha=0.35, linewidth=0)
        ax.plot(rows["drop"], np.full(len(rows), 0.05), "v", color=ORANGE, label=label,
                transform=ax.get_xaxis_transform())  # fmt: skip
    else:
        ax.set_title(f"no drop by {DROP:g}\nof the driven stress")
    ax.legend()


@panel(height=2.6)
def draw_driven_stress(found: Evolution, ax: Axes) -> None:
    """Draw the change of the driven stress on each way, and instabilities of the path."""
    at, driven = COMPONENTS.index(found.driven[1:]), found.driven
    for name, way in found.ways.items():
        label, colour, style = WAY_LOOKS[name]
        change = way.P[:, at] - way.P[0, at]
        ax.plot(found.sense * way.parameter, change, style, color=colour, label=label)
    lost = [found.sense * event.parameter for event in found.way.of_kind("instability")]
    edge_ticks(ax, lost, "instabilities")
    over_driven(ax, driven, f"change of $P_{{{driven[1:]}}}$\n(force/length)")
