"""Figures of a snapshot: the map of its loops, their orders, eigenvalues and directions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colorbar import Colorbar
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize, SymLogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from loops import ForceChains
from loops.arrays import Flags, Floats, Integers
from loops.errors import counted
from loops.fabric import direction_tensors, mean_tensor, principal
from patterns import Snapshot
from studies.output import Columns, Summary
from studies.snapshot.sample import axis_errors, strong_contacts
from studies.snapshot.summary import (
    FINE_BIN,
    JUDGE_TITLES,
    axes_density,
    judges,
    main_judge,
    second_order,
    surroundings_share,
    unstable_loops,
    verdicts,
)
from studies.snapshot.table import (
    CLOSURES,
    FREE,
    GROUPS,
    LAST_ORDER,
    PLACE,
    Groups,
    group_rows,
    loop_columns,
    loop_polygons,
)
from studies.study import Drawings
from studies.style import (
    BLACK,
    BLUE,
    DIVERGING,
    GREEN,
    GREY,
    LIGHT_GREY,
    ONE_COLUMN,
    ORANGE,
    ORDER_COLOURS,
    PURPLE,
    SEQUENTIAL,
    SKY,
    TWO_COLUMNS,
    VERMILION,
    WHITE_EDGE,
    figure_of,
    key_columns,
    new_panels,
    outer_legend,
    panel,
    panel_width,
    polar_grid,
    styled,
    tick_labels,
)

# A function (axes, values of the loops, colour map, scale) that draws the loops.
Drawer = Callable[..., Artist]
# More loops than these are pixels in the SVG too.
VECTOR_LIMIT = 20_000
# More loops than these are painted into one picture instead of drawn one by one.
PAINT_LIMIT = 100_000
# Pixels along the longer side of that picture: a panel on a page at 600 dpi.
PIXELS = 1600
# Every group of orders has its own colour.
ORDER_SCALE = BoundaryNorm(np.arange(2.5, LAST_ORDER + 1), len(ORDER_COLOURS))
GROUP_COLOURS = dict(zip(GROUPS, ORDER_COLOURS, strict=True))
# Steps that are drawn of a distribution, at most.
MOST_STEPS_DRAWN = 500
STRENGTH_COLOURS = {"strong": VERMILION, "weak": GREY}
ROSE_TITLES = {"contacts": "contact normals", "branches": "branch vectors by length",
               "loops": "long axes of loops by area"}  # fmt: skip
# Of places in a sample: beside force chains and elsewhere, or regions.
PLACE_COLOURS = (VERMILION, BLUE, GREEN, PURPLE, ORANGE)
CLOSURE_COLOURS = {"affine": BLUE, "traction": VERMILION, PLACE: BLUE}
# Whole numbers up to which each has its own colour.
MOST_STEPS = 12
# Axes below which there is no rose, or one with coarse bins.
LEAST_AXES, FEW_AXES = 50, 200
# Width of these bins (degrees); it divides 180.
COARSE_BIN = 20.0
# Number of segments that are joined to one line with gaps.
JOINED = 200


@styled()
def loop_map(snapshot: Snapshot, table: Columns, draw: Drawer) -> Figure:
    """Loops by order and, with forces, by the smallest eigenvalue of Ks; if many, painted."""
    extent = np.ptp(snapshot.graph.x, axis=0)
    # A panel is as wide as half the page less its colour bar and labels.
    ratio = extent[1] / extent[0] if extent[0] > 0 else 1.0
    height = float(np.clip((panel_width(2) - 0.95) * ratio + 0.5, 2.0, 9.0))
    panels = 2 if snapshot.mechanical else 1
    figure, (axes,) = new_panels(1, panels, height, TWO_COLUMNS * panels / 2, sharey=True)
    draw_orders(draw, axes[0], table["order"])
    if snapshot.mechanical:
        judge = main_judge(table)
        smallest = verdicts(table, judge)
        label = r"smallest eigenvalue of $K_s$ / mean $k_n$"
        draw_values(draw, axes[1], smallest, label, signed=True)
        axes[1].label_outer()
        unstable = np.flatnonzero(smallest < 0)
        # Some unstable loops are too soft to show by their colour: a line goes around them.
        if len(unstable) <= VECTOR_LIMIT:
            outlines = polygons_of_loops(snapshot, unstable)
            look: Any = {"facecolors": "none", "edgecolors": VERMILION, "autolim": False}
            draw_polygons(axes[1], outlines, len(smallest), 0.8, **look)
            unknown = int(np.count_nonzero(~np.isfinite(smallest)))
            name = f"unstable ({JUDGE_TITLES[judge]}): {len(unstable)} of {len(smallest)}" + (
                f"; white: {unknown} without a verdict" if unknown else ""
            )
            key: Any = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
            axes[1].legend(handles=[Line2D([], [], color=VERMILION, label=name)], **key)
    return figure


def draw_orders(draw: Drawer, ax: Axes, order: Integers) -> None:
    """Loops coloured by order."""
    draw(ax, np.minimum(order, LAST_ORDER), ListedColormap(ORDER_COLOURS), ORDER_SCALE)
    order_bar(ax)


def order_bar(ax: Axes) -> None:
    """Draw the colour bar of the orders beside a map."""
    colours = ScalarMappable(ORDER_SCALE, ListedColormap(ORDER_COLOURS))
    bar = figure_of(ax).colorbar(colours, ax=ax, ticks=range(3, LAST_ORDER + 1), shrink=0.75)
    bar.ax.set_yticklabels(GROUPS)
    bar.set_label("loop order (grains)")


def draw_values(
    draw: Drawer, ax: Axes, values: Floats, label: str, *, signed: bool = False
) -> None:
    """Loops coloured by a value of each; zero in the middle if `signed` or if any is negative.

    Each of a few whole numbers has its own colour.
    """
    if values.dtype.kind in "biu" and len(values) and np.ptp(values.astype(int)) <= MOST_STEPS:
        steps = np.arange(values.min(), values.max() + 1)
        edges = BoundaryNorm(np.append(steps, steps[-1] + 1) - 0.5, len(steps))
        colours = mpl.colormaps[SEQUENTIAL].resampled(len(steps))
        draw_scaled(draw, ax, values, colours, edges, label=label, ticks=steps)
        return
    known = values[np.isfinite(values)]
    unit, top = linear_part(known)
    low = -top if signed or (known < 0).any() else float(known.min(initial=top))
    scale = SymLogNorm(unit, vmin=low, vmax=top) if signed else Normalize(low, top)
    colours = mpl.colormaps[DIVERGING if low < 0 else SEQUENTIAL]
    bar = draw_scaled(draw, ax, values, colours, scale, label=label, extend="both")
    if signed:
        decades = unit * 10.0 ** np.arange(np.log10(top / unit) + 1e-9)
        ticks = [*-decades[::-1], 0.0, *decades]
        bar.set_ticks(ticks, labels=tick_labels(ticks))
        bar.ax.minorticks_off()


def draw_scaled(
    draw: Drawer, ax: Axes, values: Floats, colours: Colormap, scale: Normalize, **bar: Any
) -> Colorbar:
    """Loops coloured on a scale, and its colour bar beside them, which is returned."""
    draw(ax, values, colours, scale)
    how = {"shrink": 0.75} | bar
    return figure_of(ax).colorbar(ScalarMappable(scale, colours), ax=ax, **how)


def loop_drawer(snapshot: Snapshot) -> Drawer:
    """Prepare the loops of a snapshot for drawing, once for all panels."""
    return (_painter if len(snapshot.faces.loops) > PAINT_LIMIT else _polygon_drawer)(snapshot)


def _polygon_drawer(snapshot: Snapshot) -> Drawer:
    """Return a function that draws every loop as a polygon."""
    polygons = polygons_of_loops(snapshot)

    def draw(ax: Axes, values: NDArray[Any], colours: Colormap, scale: Normalize) -> Artist:
        look: Any = {"array": values, "cmap": colours, "norm": scale, "edgecolors": "white"}
        drawn = draw_polygons(ax, polygons, len(polygons), 0.4, **look)
        _label(ax)
        ax.margins(0.01)
        ax.autoscale_view()
        return drawn

    return draw


def draw_polygons(
    ax: Axes, polygons: list[Floats], of: int, width: float, *, autolim: bool = True, **look: Any
) -> Artist:
    """Draw some `of` the loops of a sample: the more it has, the thinner the lines; then pixels."""
    lines: Any = {"linewidths": width * _line_width(of), "rasterized": of > VECTOR_LIMIT}
    return ax.add_collection(PolyCollection(polygons, **lines, **look), autolim=autolim)


def _painter(snapshot: Snapshot) -> Drawer:
    """Return a function that shows the loops as pixels."""
    from studies.snapshot.paint import paint_loops

    painting = paint_loops(snapshot.graph, snapshot.faces, PIXELS)

    def draw(ax: Axes, values: NDArray[Any], colours: Colormap, scale: Normalize) -> Artist:
        # A pixel outside all loops is -1, which finds the last value. Colours are computed for
        # each loop, not for each pixel: there are more pixels than loops.
        known = np.ma.masked_invalid(np.append(values, np.nan))
        shades = ScalarMappable(scale, colours).to_rgba(known, bytes=True)
        image = ax.imshow(
            shades[painting.loop],
            origin="lower",
            extent=painting.extent,
            interpolation="none",
            rasterized=True,
        )
        _label(ax)
        return image

    return draw


def _label(ax: Axes) -> None:
    unit = "(length unit of the input)"
    ax.set(aspect="equal", xlabel=rf"$x_1$ {unit}", ylabel=rf"$x_2$ {unit}")


def _line_width(loops: int) -> float:
    return float(np.clip(60.0 / max(loops, 1) ** 0.5, 0.25, 1.0))


def polygons_of_loops(snapshot: Snapshot, picked: Integers | slice = slice(None)) -> list[Floats]:
    """Corners of each loop, or of those picked."""
    offsets, corners, _ = loop_polygons(snapshot.graph, snapshot.faces, picked)
    return [corners[a:b] for a, b in pairwise(offsets.tolist())]


# ---- all figures of a snapshot


def snapshot_figures(
    snapshot: Snapshot,
    table: Columns,
    summary: Summary,
    links: Floats | None = None,
) -> Drawings:
    """Every figure of a snapshot by name; `links (L, 2, 2)` are those of force chains."""
    draw, groups = loop_drawer(snapshot), group_rows(table["order"])
    unstable = {judge: unstable_loops(table, judge) for judge in judges(table)}
    yield "map", lambda: loop_map(snapshot, table, draw)
    if summary["loops"]:
        yield "orders", lambda: order_bars(summary)
    yield "fabric", lambda: draw_rose(snapshot)
    if links is not None and summary["loops"]:
        yield "chains", lambda: places_figure(table, draw, links)
    if snapshot.mechanical and summary["loops"]:
        yield "eigenvalues", lambda: eigenvalue_distribution(table, groups)
        if "region" in table:
            yield "regions", lambda: places_figure(table, draw)
        if rose_judges(table, unstable):
            yield "directions", lambda: unstable_rose(table, unstable, summary)
        if "in_packing" in summary and np.isfinite(share := surroundings_share(table)).any():
            at_rest = summary["packing_at_rest"]
            yield "in_packing", lambda: in_packing(table, groups, share, at_rest)


@panel()
def order_bars(summary: Summary, ax: Axes) -> None:
    """Share of the loops by order: in number, in area, and of unstable and unjudged ones."""
    orders = np.array([int(n) for n in summary["orders"]])
    number = np.array(list(summary["orders"].values())) / summary["loops"]
    area = np.array(list(summary["orders_area"].values()))
    bars_by_order(ax, orders, {"in number": (SKY, number), "in area": (ORANGE, area / area.sum())})
    if "unstable_loops" in summary:
        judge = PLACE if summary.get("packing_at_rest", {}).get("judged") else "traction"
        unstable, unknown = (
            np.nan_to_num(np.array(list(summary[kind][judge].values()), dtype=float))
            for kind in ("unstable_loops", "undetermined_loops")
        )
        lost = number * unstable * (1 - unknown)
        count = round(float(np.sum(lost)) * summary["loops"])
        label = f"unstable: {count}\n({JUDGE_TITLES[judge]})"
        ax.bar(orders - 0.2, lost, 0.4, color=VERMILION, label=label)
        if unknown.any():
            ax.bar(orders - 0.2, number * unknown, 0.4, bottom=lost, color="none", hatch="/////",
                   edgecolor=GREY, linewidth=0.4, label="without a verdict")  # fmt: skip
    mean = summary["mean_order"]
    ax.axvline(mean, color=GREY, linewidth=0.8, linestyle="--", label=f"mean order {mean:.2f}")
    ax.set_ylabel("share of the loops (–)")
    ax.xaxis.set_major_locator(MaxNLocator(12, integer=True))
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)


def bars_by_order(ax: Axes, orders: Any, parts: Mapping[str, tuple[str, Any]]) -> None:
    """Bars of quantities beside one another over the order of the loops, by their labels."""
    width = 0.8 / len(parts)
    for k, (label, (colour, values)) in enumerate(parts.items()):
        place = orders + width * (k - 0.5 * (len(parts) - 1))
        ax.bar(place, values, width, color=colour, label=label)
    ax.set_xlabel("loop order (number of grains)")


@styled()
def eigenvalue_distribution(table: Columns, groups: Groups) -> Figure:
    """Share of the loops below each smallest eigenvalue of Ks: a panel a judge, a line an order."""
    present = judges(table)
    figure, (axes,) = new_panels(1, len(present), 2.7, sharex=True, sharey=True)
    smallest = {judge: verdicts(table, judge) for judge in present}
    withheld = [judge for judge in present if not np.isfinite(smallest[judge]).any()]
    smallest |= {judge: table[f"{judge}_lambda_min"] for judge in withheld}
    low = both_signs(axes[0], "x", np.concatenate([*smallest.values()]))
    for ax, judge in zip(axes, present, strict=True):
        known = np.isfinite(smallest[judge])
        for group in GROUPS:
            rows = groups[group]
            own = np.sort(smallest[judge][rows][known[rows]])
            if len(own):
                # Of many loops some; the first and the last are among them.
                kept = np.linspace(0, len(own) - 1, min(len(own), MOST_STEPS_DRAWN)).astype(int)
                x, y = np.append(own[0], own[kept]), np.append(0, kept + 1) / len(own)
                ax.step(x, y, where="post", color=GROUP_COLOURS[group], linewidth=1.0)
        state = "" if judge != PLACE else ", as written" if judge in withheld else ", at rest"
        lost = np.count_nonzero(unstable_loops(table, judge))
        counted = f"{lost} of {np.count_nonzero(known)} unstable"
        unsure = "" if known.all() else f"\n{np.count_nonzero(~known)} without a verdict"
        told = "verdicts withheld" if judge in withheld else counted + unsure
        ax.set_title(f"{JUDGE_TITLES[judge]}{state}\n{told}")
        ax.set_xlabel(r"$\lambda_{\min}(K_s)$ / mean $k_n$")
        ax.axvspan(low, 0.0, color=LIGHT_GREY, alpha=0.5, linewidth=0, zorder=0)
    axes[0].set(ylim=(0, 1), ylabel="share of the loops below (–)")
    order_key(figure, table["order"])
    return figure


def linear_part(values: Floats) -> tuple[float, float]:
    """Bounds of the linear part and of the whole of a logarithmic scale of both signs."""
    size = np.abs(values[np.isfinite(values) & (values != 0)])
    if not len(size):
        return 0.1, 1.0
    quarter, top = np.percentile(size, [25, 98]).tolist()
    return 10.0 ** float(np.floor(np.log10(max(quarter, 1e-3 * top)))), top


def both_signs(ax: Axes, axis: str, values: Floats) -> float:
    """Make an axis, x or y, logarithmic but for its middle, with few ticks; return its low end."""
    unit, _ = linear_part(values)
    low, high = 2.0 * np.nanmin(values, initial=0.0), 2.0 * np.nanmax(values, initial=unit)
    powers = np.arange(1 + np.log10(max(-low, high) / unit))
    decades = unit * 10.0 ** powers[slice(None) if len(powers) < 4 else slice(1, None, 2)]
    ticks = [tick for tick in (*-decades[::-1], 0.0, *decades) if low <= tick <= high]
    getattr(ax, f"set_{axis}scale")("symlog", linthresh=unit)
    getattr(ax, f"set_{axis}ticks")(ticks, labels=tick_labels(ticks))
    getattr(ax, f"set_{axis}lim")(low, high)
    return float(low)


def order_key(figure: Figure, order: Integers, **look: Any) -> None:
    """Key of the groups of orders that there are, with the number of their loops."""
    counts = np.bincount(np.minimum(order, LAST_ORDER), minlength=LAST_ORDER + 1)[3:].tolist()
    handles = [
        Line2D([], [], color=GROUP_COLOURS[name], label=f"order {name} ({count})", **look)
        for name, count in zip(GROUPS, counts, strict=True)
        if count
    ]
    beside = key_columns(figure, len(GROUPS))
    figure.legend(handles=handles, loc="outside lower center", ncols=beside)


def chain_segments(snapshot: Snapshot, chains: ForceChains) -> Floats:
    """(L, 2, 2) ends of every link; links across a border begin at their first grain."""
    start = snapshot.graph.x[snapshot.graph.contacts[chains.links, 0]]
    return np.stack([start, start + snapshot.graph.branches[chains.links]], axis=1)


@styled()
def places_figure(table: Columns, draw: Drawer, links: Floats | None = None) -> Figure:
    """Loops by their region, or force chains over them; unstable loops of each place."""
    figure, ((left, right),) = new_panels(1, 2, 3.3, width_ratios=(1.1, 1))
    if links is None:
        names, number = np.unique(table["region"], return_inverse=True)
        places = {str(name): number == k for k, name in enumerate(names)}
        colours = [PLACE_COLOURS[k % len(PLACE_COLOURS)] for k in range(len(names))]
        draw(left, number, ListedColormap(colours), Normalize(-0.5, len(names) - 0.5))
    else:
        near, many = table["chain_contacts"] > 0, len(links) > VECTOR_LIMIT
        places = {"beside chains": near, "elsewhere": ~near}
        draw(left, np.zeros(len(near)), ListedColormap([LIGHT_GREY]), Normalize(0.0, 1.0))
        width = 1.2 * float(np.clip(60.0 / max(len(near), 1) ** 0.5, 0.3, 2.0))
        look: Any = {"capstyle": "round", "rasterized": many, "colors": PLACE_COLOURS[0]}
        lines = LineCollection(_joined(links) if many else list(links), linewidths=width, **look)
        left.add_collection(lines, autolim=False)
    left.set_title("regions" if links is None else "force chains")
    compare_places(right, table, places)
    return figure


def compare_places(ax: Axes, table: Columns, places: Mapping[str, Flags]) -> None:
    """Smallest eigenvalue by order, median and quartiles of the loops at each place."""
    judge, place, step = main_judge(table), np.arange(len(GROUPS)), 0.24
    smallest, unstable = verdicts(table, judge), unstable_loops(table, judge)
    groups = group_rows(table["order"])
    for k, (name, here) in enumerate(places.items()):
        known = here & np.isfinite(smallest)
        parts = [smallest[groups[group]][known[groups[group]]] for group in GROUPS]
        quartiles = [np.quantile(v, (0.25, 0.5, 0.75)) if len(v) else [np.nan] * 3 for v in parts]
        low, middle, high = np.array(quartiles).T
        percent = 100.0 * np.mean(unstable[known]) if known.any() else np.nan
        of = "" if known[here].all() else f" of {np.count_nonzero(known)}"
        ax.errorbar(
            place + step * (k - 0.5 * (len(places) - 1)), middle, (middle - low, high - middle),
            fmt="osD^v"[k % 5], color=PLACE_COLOURS[k % len(PLACE_COLOURS)], markersize=4,
            elinewidth=0.8,
            label=f"{name}: {counted(here.sum(), 'loop')}, {percent:.3g} %{of} unstable",
        )  # fmt: skip
    ax.axhline(0.0, color=GREY, linewidth=0.6)
    ax.set_xticks(place, labels=GROUPS)
    ax.set(xlabel="loop order (number of grains)")
    ax.set_ylabel(f"smallest eigenvalue of $K_s$ / mean $k_n$\n({JUDGE_TITLES[judge]})")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))


def _joined(segments: Floats) -> list[Floats]:
    """Join (n, 2, 2) segments to fewer lines with gaps, which are drawn much faster.

    Neighbours go to different lines: overlapping parts of one line would not cover one another.
    """
    gaps = np.full((len(segments), 1, 2), np.nan)
    ended, lines = np.concatenate([segments, gaps], axis=1), len(segments) // JOINED
    return [ended[first::lines].reshape(-1, 2) for first in range(lines)]


@panel(ONE_COLUMN + 0.2, 4.9, "polar")
def draw_rose(snapshot: Snapshot, of: str = "contacts", *, ax: PolarAxes) -> None:
    """Directions of contacts, branches or loops, their Fourier series of second order."""
    d = snapshot.graph.branches
    axes, weights = np.degrees(np.arctan2(d[:, 1], d[:, 0])), np.ones(len(d))
    if of == "branches":
        weights = np.hypot(*d.T)
    if of == "loops":
        table = loop_columns(snapshot)
        axes, weights = table["orientation"], table["area"]
    found = axes_density(axes, FINE_BIN, weights)
    draw_bars(ax, found["density"], SKY, f"all {of}: {len(axes)}", filled=True)
    draw_errors(ax, found, fmt="none", ecolor=BLUE)
    if of == "contacts" and snapshot.has_forces:
        strong = strong_contacts(snapshot)
        for rows, look, kind in ((strong, "o", "strong"), (~strong, "s", "weak")):
            colour, label = STRENGTH_COLOURS[kind], f"{kind}: {np.count_nonzero(rows)}"
            some = axes_density(axes[rows], FINE_BIN)
            draw_errors(ax, some, fmt=look, color=colour, markersize=3, label=label)
    turn, theta = np.radians(axes), np.linspace(0.0, 2.0 * np.pi, 361)
    tensors = direction_tensors(np.stack([np.cos(turn), np.sin(turn)], axis=-1))
    anisotropy, direction = principal(mean_tensor(tensors, weights).mean)
    a, doubt = 2.0 * anisotropy, 2.0 * axis_errors(tensors, weights, float(direction))[0]
    fabric = {"fourier_amplitude": a, "direction": np.degrees(direction)}
    label = f"second order: a = {a:.3f} ± {doubt:.3f}, {fabric['direction']:.1f}°"
    ax.plot(theta, second_order(theta, fabric), color=BLACK, linewidth=1.0, label=label)
    finish_rose(ax, ROSE_TITLES[of], "probability density (1/rad)")


def draw_errors(ax: Axes, found: Columns, **look: Any) -> None:
    """Draw densities of axes with their errors, in both directions of each."""
    angle = np.radians(found["angle"])
    both = [*angle, *(angle + np.pi)]
    density, error = ([*found[name]] * 2 for name in ("density", "error"))
    ax.errorbar(both, density, error, elinewidth=0.7, **look)


def rose_judges(table: Columns, unstable: dict[str, Flags]) -> list[str]:
    """Judges whose unstable loops have a rose: the packing at rest, else closures; if not few."""
    judges = (PLACE,) if main_judge(table) == PLACE else CLOSURES
    return [judge for judge in judges if np.count_nonzero(unstable[judge]) >= LEAST_AXES]


@styled()
def unstable_rose(table: Columns, judged: dict[str, Flags], summary: Summary) -> Figure:
    """Directions of the unstable loops: axis of compression of the softest mode, long axis."""
    figure, (axes,) = new_panels(1, 2, 4.2, subplot_kw={"projection": "polar"})
    unstable = {judge: judged[judge] for judge in rose_judges(table, judged)}
    compression = "softest compression", "{}_soft_angle", "soft_angle"
    parts = compression, ("long axis", "orientation", "long_axis")
    for ax, (title, column, key) in zip(axes, parts, strict=True):
        for closure, rows in unstable.items():
            angles = table[column.format(closure)][rows]
            angles = angles[np.isfinite(angles)]
            width = FINE_BIN if len(angles) >= FEW_AXES else COARSE_BIN
            label = f"{JUDGE_TITLES[closure]}, {counted(len(angles), 'loop')}"
            found, colour = axes_density(angles, width), CLOSURE_COLOURS[closure]
            draw_bars(ax, found["density"], colour, label, filled=False)
            draw_errors(ax, found, fmt="none", ecolor=colour)
        for closure in unstable:
            mean, colour = summary["soft_loops"][closure][key], CLOSURE_COLOURS[closure]
            if mean["count"]:
                highest = ax.get_ylim()[1]
                ax.set_ylim(0.0, highest)
                angle, reach = np.radians(mean["direction"]), mean["resultant"] * highest
                both, reaches = [angle, angle + np.pi], [reach, reach]
                ax.plot(both, reaches, "o", color=colour, markersize=3)
                ax.plot(both, reaches, color=colour, linewidth=2.2)
        finish_rose(ax, f"{title} of the unstable loops", "probability density (1/rad)")
    return figure


@styled()
def in_packing(table: Columns, groups: Groups, share: Floats, at_rest: Summary) -> Figure:
    """Unstable loops by band, if known; loops cut out against in place; surroundings' share."""
    shares = [one for one in (at_rest["stuck"], *at_rest["bands"]) if one and one["count"]]
    figure, (axes,) = new_panels(1, 3 if shares else 2, 2.9)
    left, right = axes[-2:]
    if shares:
        unstable_by_band(axes[0], shares)
    alone, inside = table[f"{FREE}_lambda_min"], verdicts(table, PLACE)
    where = "in its packing, at rest"
    if not at_rest["judged"]:
        inside, where = table[f"{PLACE}_lambda_min"], "in its packing, as written"
    for name in GROUPS:
        rows = groups[name]
        left.plot(alone[rows], inside[rows], ".", color=GROUP_COLOURS[name], markersize=2.5,
                  rasterized=len(alone) > FEW_AXES**2)  # fmt: skip
    both_signs(left, "x", alone)
    both_signs(left, "y", inside)
    for line in (left.axhline, left.axvline):
        line(0.0, color=GREY, linewidth=0.6)
    left.set(xlabel="cut out, spins free", ylabel=where)
    left.set_title(r"smallest eigenvalue of $K_s$ / mean $k_n$")
    order, drawn = table["order"], np.isfinite(alone) & np.isfinite(inside)
    order_key(figure, order[drawn], marker="o", markersize=3, linestyle="none")
    orders = [n for n in np.unique(order) if np.isfinite(share[order == n]).any()]
    right.boxplot(
        [share[(order == n) & np.isfinite(share)] for n in orders],
        positions=orders, whis=(5, 95), showfliers=False, manage_ticks=False,
        medianprops={"color": VERMILION},
    )  # fmt: skip
    right.axhline(1.0, color=GREY, linewidth=0.6)
    right.set(xlabel="loop order (number of grains)", ylabel="share of the surroundings (–)")
    right.xaxis.set_major_locator(MaxNLocator(12, integer=True))
    right.set_title(r"$1 - \mathrm{tr}\,A_\mathrm{loop} / \mathrm{tr}\,A_\mathrm{in}$")
    return figure


def unstable_by_band(ax: Axes, shares: list[Summary]) -> None:
    """Share of unstable loops at rest by the contacts that slide, and of confirmed ones."""
    names = [f"{1 - one['band']:.2g}" if "band" in one else "none" for one in shares]
    unstable, error = (
        100 * np.array([one[key] for one in shares]) for key in ("mean", "std_error")
    )
    confirmed = [100 * (one.get("confirmed") or 0) / one["count"] for one in shares]
    at = np.arange(len(shares))
    ax.bar(at, unstable, 0.6, yerr=error, color=SKY, ecolor=GREY, label="if all of them slide")
    ax.bar(at, confirmed, 0.6, color=VERMILION, label="confirmed")
    ax.set_xticks(at, names)
    ax.set(xlabel="contacts within this share\nof their limit", ylabel="unstable loops at rest (%)")
    ax.set_ylim(bottom=0)
    outer_legend(ax, "lower left", (0.0, 1.0), 0.3)


def draw_bars(ax: Axes, density: Floats, colour: str, label: str, *, filled: bool) -> None:
    """Density of axes over the full circle; both directions of an axis count alike."""
    width = np.pi / len(density)
    centre = width * np.arange(2 * len(density))
    look: Any = {"color": "none", "edgecolor": colour, "linewidth": 1.1}
    if filled:
        look = {"color": colour, "edgecolor": "white", "linewidth": 0.4}
    ax.bar(centre, np.tile(density, 2), width, label=label, **look)


def finish_rose(ax: PolarAxes, title: str, unit: str) -> None:
    """Angles, rings with their values, title and key of a rose."""
    polar_grid(ax, MaxNLocator(3).tick_values(0.0, ax.get_ylim()[1])[1:-1])
    ax.tick_params(axis="y", labelsize=6, labelcolor=BLACK)
    # The grid is drawn above the bars, which would hide the numbers.
    ax.set_axisbelow(False)
    for label in ax.get_yticklabels():
        label.set_path_effects(WHITE_EDGE)
    ax.set_title(f"{title}\n{unit}")
    outer_legend(ax, "upper center", (0.5, 0.0), 2.5)
