"""Figures, maps and animation of a series, drawn from its finished parts.

Orders, fates, stress, probes, exchange of orders, survival, kinetics.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
import pyarrow.parquet
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from loops.arrays import Floats
from loops.errors import counted
from loops.tracking import ExchangeCounts, LoopFates, exchange_matrix
from patterns import Snapshot
from stability import COMPONENTS
from studies.output import Summary
from studies.series.evolution import PLACES, PREDICTIONS, chain_summary
from studies.series.skill import (
    ALL,
    PREDICTORS,
    TARGETS,
    VERDICTS,
    part_columns,
    pooled,
)
from studies.series.tasks import PartTask, Series, tracked
from studies.snapshot.figures import (
    ORDER_SCALE,
    PLACE_COLOURS,
    draw_scaled,
    loop_drawer,
    order_bar,
)
from studies.snapshot.summary import JUDGE_TITLES
from studies.snapshot.table import GROUPS, LAST_ORDER, loops_for_map
from studies.study import MOST_LOOPS, Drawings, LoopsForMap
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
    edge_ticks,
    figure_key,
    figure_of,
    key_columns,
    new_figure,
    new_panels,
    panel,
    styled,
    tick_labels,
    write_animation,
)

ORDER_MARKERS = "os^DvP"
FATE_COLOURS = {
    "split": BLUE,
    "merged": ORANGE,
    "changed": PURPLE,
    "died": BLACK,
}
VERDICT_LOOKS = dict(zip(VERDICTS, ((BLUE, "o"), (VERMILION, "s"), (GREY, "^")), strict=True))
# Largest order in the figure of kinetics, and colours of the merged loops by order.
LAST_DRAWN = 12
MERGED = dict(zip(range(4, 9), (SKY, BLUE, GREEN, ORANGE, VERMILION), strict=True))
# Columns of a map by the dataset of the interval that follows the snapshot.
MAPPED_COLUMNS = {
    "fates": ("fate", "successor", "order_after"),
    "increments": ("W2", "w2", *PREDICTIONS, "nonaffinity"),
    "packing": ("packing_w2", "packing_nonaffinity", "packing_opening", "packing_closing"),
}
SMALLEST = "traction_lambda_min"
# Maps on a page, at most.
MOST_MAPS = 20
# Frames of an animation, at most.
MOST_SCENES = 60
# Width of a panel of the animation, inches.
PANEL_INCHES = 4.6


@styled()
def orders_over_strain(evolution: pd.DataFrame) -> Figure:
    """Shares of the loops by order along the series, in number and in area."""
    figure, (axes,) = new_panels(1, 2, 2.6, sharey=True)
    strain, strain_label = largest_strain(evolution)
    kinds = {"share": "in number", "area_share": "in area"}
    for ax, (kind, title) in zip(axes, kinds.items(), strict=True):
        for n, (group, colour, marker) in enumerate(
            zip(GROUPS, ORDER_COLOURS, ORDER_MARKERS, strict=True)
        ):
            values = _column(evolution, f"{kind}_{3 + n}")
            ax.plot(strain, values, marker=marker, color=colour, label=f"order {group}")
        ax.set(xlabel=strain_label, title=title)
        ax.locator_params(axis="x", nbins=6)
    figure.axes[0].set(ylabel="share of the loops (–)", ylim=(0, None))
    figure_key(figure, at="upper center", ncols=3)
    return figure


@panel(TWO_COLUMNS, 2.6)
def fates_over_strain(evolution: pd.DataFrame, ax: Axes) -> None:
    """Shares of the loops of each interval that did not survive it, by fate, stacked."""
    counts = {name: _column(evolution, name)[1:] for name in FATE_COLOURS}
    total = np.maximum(_column(evolution, "survived")[1:] + sum(counts.values()), 1)
    place, bottom = _column(evolution, "snapshot")[1:], np.zeros(len(total))
    for name, colour in FATE_COLOURS.items():
        share = 100 * counts[name] / total
        ax.bar(place, share, 0.6, bottom=bottom, color=colour, label=name)
        bottom = bottom + share
    born = 100 * _column(evolution, "born")[1:] / total
    ax.plot(place, born, "x", color=VERMILION, clip_on=False, zorder=3, label="born")
    # Fewer than four bars keep the width of four.
    wide = max(4 - np.ptp(place), 1) / 2
    ax.set(xlim=(place[0] - wide, place[-1] + wide), ylim=(0, None))
    ax.set_xticks(place[:: len(place) // 12 + 1])
    ax.set(xlabel="interval, by its later snapshot", ylabel="share of the earlier loops (%)")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


@panel(4.6, 3.9)
def exchange_heatmap(exchange: ExchangeCounts, ax: Axes) -> None:
    """Exchange matrix between orders: counts as numbers, shares of each row as colours."""
    matrix = exchange_matrix(exchange, LAST_ORDER)
    orders = [*range(3, LAST_ORDER + 1), 0]
    counts = matrix[np.ix_(orders, orders)]
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    palette = mpl.colormaps[SEQUENTIAL].with_extremes(bad="white")
    # Few loops change their order: the colours must show one in a thousand.
    image = ax.imshow(np.ma.masked_equal(share, 0), cmap=palette, norm=LogNorm(1e-3, 1))
    for (row, column), number in np.ndenumerate(counts):
        if number:
            colour = "white" if share[row, column] < 0.04 else BLACK
            ax.text(column, row, f"{number}", ha="center", va="center", color=colour, fontsize=6)
    ax.set_xticks(range(len(orders)), labels=[*GROUPS, "died"])
    ax.set_yticks(range(len(orders)), labels=[*GROUPS, "born"])
    ax.set(xlabel="order of the successor", ylabel="order before")
    ax.spines[:].set_visible(False)
    ax.tick_params(length=0)
    figure_of(ax).colorbar(image, ax=ax, label="share of the row", shrink=0.8, extend="min")


@styled()
def stress_strain(evolution: pd.DataFrame) -> Figure:
    """Stress of the sample along the series, its ratio q/p, and unstable and sliding shares."""
    figure, ((left, middle, right),) = new_panels(1, 3, 3.0)
    strain, strain_label = largest_strain(evolution)
    for name, colour, marker in (("11", BLUE, "o"), ("22", VERMILION, "s")):
        values = _column(evolution, f"S{name}")
        left.plot(strain, values, marker=marker, color=colour, label=rf"$\sigma_{{{name}}}$")
    shear = 0.5 * (_column(evolution, "S12") + _column(evolution, "S21"))
    left.plot(strain, shear, marker="^", color=GREY, label=r"$(\sigma_{12} + \sigma_{21})/2$")
    left.axhline(0, color=LIGHT_GREY, linewidth=0.7, zorder=0)
    left.set(xlabel=strain_label, ylabel="stress (force/length)")
    left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
    if "q_over_p" in evolution:
        ratio, error = _column(evolution, "q_over_p"), _column(evolution, "q_over_p_error")
        middle.errorbar(strain, ratio, error, fmt="o-", color=BLACK, capsize=2.0)
    middle.set(xlabel=strain_label, ylabel="$q/p$ of the whole sample (–)")
    judged = (("packing", GREEN, "D"), ("traction", VERMILION, "s"), ("traction_free", ORANGE, "v"))
    for judge, colour, marker in judged:
        if f"{judge}_unstable" in evolution:
            unknown = _column(evolution, f"{judge}_undetermined")
            unstable = _column(evolution, f"{judge}_unstable") * (1 - unknown)
            some = ";\nband: no verdict" if np.nanmax(unknown, initial=0) > 0 else ""
            label = f"unstable, {JUDGE_TITLES[judge]}{some}"
            right.plot(strain, unstable, f"{marker}-", color=colour, label=label)
            right.fill_between(
                strain, unstable, unstable + unknown, color=colour, alpha=0.2, linewidth=0
            )
    sliding = _column(evolution, "sliding_fraction")
    right.plot(strain, sliding, "^-", color=GREY, label="contacts sliding")
    if "negative_W2" in evolution:
        with np.errstate(invalid="ignore"):
            worked = _column(evolution, "negative_W2") / _column(evolution, "survived")
        label = r"survived with $W_2 < 0$"
        right.plot(strain, worked, "o-", color=BLUE, label=label)
    right.set(xlabel=strain_label, ylabel="share (–)", ylim=(0, None))
    right.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return figure


@styled()
def probes_over_strain(evolution: pd.DataFrame) -> Figure:
    """Smallest second-order work and the share of unstable directions over the strain.

    Hollow where directions are undetermined, with their number; a tick below where all are.
    """
    figure, ((left, right),) = new_panels(1, 2, 2.9)
    strain, strain_label = largest_strain(evolution)
    undetermined = _column(evolution, "probe_undetermined")
    for ax, name, scale, look, colour in (
        (left, "probe_w2", 1, "o", BLUE),
        (right, "probe_unstable_fraction", 100, "s", VERMILION),
    ):
        values = scale * _column(evolution, name)
        ax.plot(strain, values, f"{look}-", color=colour)
        some = (undetermined > 0) & np.isfinite(values)
        if some.any():
            hollow = {"color": colour, "markerfacecolor": "white", "zorder": 3}
            label = "with this number of undetermined directions"
            ax.plot(strain[some], values[some], look, label=label, **hollow)
            for at, value, count in zip(
                strain[some], values[some], undetermined[some], strict=True
            ):
                ax.annotate(
                    f"{count:.0f}", (at, value), (0, 4), textcoords="offset points",
                    ha="center", va="bottom", fontsize=7,
                )  # fmt: skip
        none = (undetermined > 0) & ~np.isfinite(values)
        edge_ticks(ax, strain[none], "all directions undetermined")
        if some.any() or none.any():
            ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
        ax.set(xlabel=strain_label)
        ax.margins(y=0.12)
    left.axhline(0, color=LIGHT_GREY, linewidth=0.7, zorder=0)
    left.set(ylabel=r"smallest $w_2$ of the sample")
    # None is a line at the foot of an axis that could show some.
    highest = max(right.get_ylim()[1], 10.0)
    right.set(ylabel=r"directions with $W_2 < 0$ (%)", ylim=(0, highest))
    return figure


def largest_strain(evolution: pd.DataFrame) -> tuple[Floats, str]:
    """Strain of the sample since the start along the axis of compression, and its label.

    Without compression to speak of, the component that is largest.
    """
    strains = {ij: np.nan_to_num(_column(evolution, f"H{ij}")) for ij in COMPONENTS}
    pressed = {ij: strains[ij].max() for ij in ("11", "22")}
    largest = {ij: np.abs(strain).max() for ij, strain in strains.items()}
    axis = max(pressed, key=lambda ij: pressed[ij])
    if pressed[axis] < 0.1 * max(largest.values()):
        axis = max(largest, key=lambda ij: largest[ij])
    return _column(evolution, f"H{axis}"), f"strain $H_{{{axis}}}$ (–)"


def _column(evolution: pd.DataFrame, name: str) -> Floats:
    """A column as numbers, nan where it is missing."""
    return evolution[name].to_numpy(dtype=float, na_value=np.nan)


@styled()
def survival_by_verdict(table: pd.DataFrame) -> Figure:
    """Share of the loops that survive, by judge, interval and order; 95 % intervals (Wilson)."""
    present = table["judge"].unique()
    figure, panels = new_panels(len(present), 2, 0.6 + 1.5 * len(present), sharey=True)
    orders = range(3, 3 + len(GROUPS))
    for judge, (left, right) in zip(present, panels, strict=True):
        for shift, (verdict, look) in zip((-0.12, 0.12, 0.0), VERDICT_LOOKS.items(), strict=True):
            own = table[(table["judge"] == judge) & (table["verdict"] == verdict)]
            whole = own[own["order"] == ALL]
            _draw_shares(left, whole["snapshot_after"] + shift, whole, look, verdict)
            found = {n: pooled(table, judge, verdict, n) for n in orders}
            shares = pd.DataFrame({n: one for n, one in found.items() if one is not None}).T
            _draw_shares(right, shares.index + shift, shares, look, verdict)
        left.xaxis.set_major_locator(MaxNLocator(12, integer=True))
        right.set_xticks(orders, labels=GROUPS)
        right.set_xlim(2.5, 2.5 + len(GROUPS))
        left.set_ylabel(f"{JUDGE_TITLES[judge]}\nshare that survives")
    figure_key(figure, at="upper center", ncols=3)
    low = table["share_low"].min()
    figure.axes[0].set_ylim(low - 0.05 * (1.0 - low), 1.0 + 0.05 * (1.0 - low))
    left.set_xlabel("interval, by its later snapshot")
    right.set_xlabel("order before, all intervals together")
    return figure


def _draw_shares(
    ax: Axes, place: Any, rows: pd.DataFrame, look: tuple[str, str], name: str
) -> None:
    """Draw the shares of survived loops with their intervals."""
    if rows.empty:
        return
    share, low, high = (
        rows[key].to_numpy(dtype=float) for key in ("share", "share_low", "share_high")
    )
    colour, marker = look
    ax.errorbar(
        place, share, (share - low, high - share), fmt=marker,
        color=colour, markersize=3.5, elinewidth=0.9, label=name,
    )  # fmt: skip


@styled()
def kinetics_figure(tables: Mapping[str, pd.DataFrame]) -> Figure:
    """Openings against closings of every pair of orders; their steady state, if it is known."""
    orders = tables["kinetics_orders"]
    steady = np.isfinite(orders["steady_share"]).any()
    figure, (axes,) = new_panels(1, 1 + steady, 3.4, TWO_COLUMNS if steady else ONE_COLUMN)
    left, right = axes[0], axes[-1]
    _balance(left, tables["kinetics"])
    figure_key(figure, left, title="merged loop", ncols=key_columns(figure, 6))
    if not steady:
        return figure
    orders = orders[orders["order"] <= LAST_DRAWN]
    order, observed, share = (orders[k] for k in ("order", "observed_share", "steady_share"))
    right.plot(order, observed, "o", color=BLUE, label="observed, mean")
    right.errorbar(
        order + 0.15, share, orders["steady_error"], fmt="s", color=VERMILION,
        markersize=3.5, elinewidth=0.8, capsize=2.0, label="steady state of the rates",
    )  # fmt: skip
    right.set(yscale="log", xlabel="loop order (number of grains)", ylabel="share of the loops")
    right.set_ylim(0.3 * observed[observed > 0].min(), 1.0)
    right.legend()
    return figure


def _balance(ax: Axes, table: pd.DataFrame) -> None:
    """Draw openings against closings, a colour for each order of the merged loop."""
    opened, closed = table["openings"], table["closings"]
    last = max(MERGED)
    merged = np.minimum(table["order_merged"], last)
    top = 2.0 * max(opened.max(), closed.max(), 1)
    ax.plot([0, top], [0, top], color=GREY, linewidth=0.8, label="balance")
    for order, colour in MERGED.items():
        rows = merged == order
        x, y = closed[rows], opened[rows]
        if len(x):
            # Below zero there are no counts.
            dy, dx = ([np.minimum(np.sqrt(n), n), np.sqrt(n)] for n in (y, x))
            ax.errorbar(
                x, y, dy, dx, fmt="o", color=colour, markersize=3.5, elinewidth=0.6,
                label=f"order {order}{'+' if order == last else ''}",
            )  # fmt: skip
    for m, n, x, y, p in zip(
        table["order_1"], table["order_2"], closed, opened, table["balance_p"], strict=True
    ):
        if p < 0.01 and x > 0 and y > 0:
            ax.annotate(f"{m}+{n}", (x, y), (3, 3), textcoords="offset points", color=BLACK,
                        fontsize=6)  # fmt: skip
    # Whole points at zero, where the scale is linear.
    limits = -0.3, top
    ax.set(xscale="symlog", yscale="symlog", xlim=limits, ylim=limits, aspect="equal")
    ticks = [0] + [k for k in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 10000) if k <= top]
    ticks = ticks if len(ticks) < 9 else [0, *(10**k for k in range(5) if 10**k <= top)]
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_ticks(ticks, labels=tick_labels(ticks))
    ax.set(xlabel="contacts that closed (splits)", ylabel="contacts that opened (mergers)")


def series_figures(
    tables: Mapping[str, pd.DataFrame],
    mapped: MappedInterval | None,
) -> Drawings:
    """Every figure of a series by name."""
    evolution = tables["evolution"]
    yield "orders_over_strain", lambda: orders_over_strain(evolution)
    if "S11" in evolution:
        yield "stress_strain", lambda: stress_strain(evolution)
    if "probe_w2" in evolution:
        yield "probes", lambda: probes_over_strain(evolution)
    if evolution[[*FATE_COLOURS, "born"]].iloc[1:].any(axis=None):
        yield "fates", lambda: fates_over_strain(evolution)
    if "survival" in tables:
        yield "survival", lambda: survival_by_verdict(tables["survival"])
    if len(evolution) > 1:
        exchange = [tables["exchange"][name].to_numpy() for name in ExchangeCounts._fields]
        yield "exchange", lambda: exchange_heatmap(ExchangeCounts(*exchange))
    if "kinetics" in tables:
        yield "kinetics", lambda: kinetics_figure(tables)
    if "segments" in evolution and evolution["segments"].sum() > 0:
        yield "buckling", lambda: buckling(chain_summary(evolution.iloc[1:].to_dict("records")))
    if "regions" in tables and {"survived", "negative"} & {*tables["regions"]}:
        yield "regions", lambda: regions_over_intervals(tables["regions"])
    if "skill" in tables and tables["skill"]["auc"].notna().any():
        yield "skill_by_predictor", lambda: skill_by_predictor(tables["skill"])
    if mapped is not None:
        if np.isfinite(mapped.predicted.get("packing_nonaffinity", np.nan)).any():
            yield "nonaffinity_map", lambda: nonaffinity_map(mapped)
        if "W2" in mapped.increments:
            yield "work_map", lambda: work_map(mapped)


@panel()
def buckling(found: Summary, ax: Axes) -> None:
    """Shares of lost loops and of negative work beside chains that buckle, others, elsewhere."""
    places = [place for place in PLACES if found[place]["loops"]]
    at = np.arange(len(places))
    looks = {"lost": ("o", VERMILION, "lost"), "negative_W2": ("s", BLUE, "survive with $W_2 < 0$")}
    for k, (name, (marker, colour, label)) in enumerate(looks.items()):
        shares = [found[place][name] for place in places]
        mean, error = np.array([[one["mean"], one["std_error"]] for one in shares], float).T * 100
        mean[np.isnan(error)] = np.nan  # of one loop
        ax.errorbar(at + 0.16 * k - 0.08, mean, error, fmt=marker, color=colour, label=label)
    named = [f"{place}\n{{loops}} loops,\nmean order {{mean_order:.2f}}".format(**found[place])
             for place in places]  # fmt: skip
    ax.set_xticks(at, labels=named)
    ax.set(ylabel="share of the loops (%)", xlim=(-0.5, len(places) - 0.5))
    ax.legend()


@styled()
def regions_over_intervals(table: pd.DataFrame) -> Figure:
    """Shares of the loops lost, and of the others with negative work, by interval and region."""
    shares = {"survived": "lost (%)", "negative": "survive with $W_2 < 0$ (%)"}
    shown = [name for name in shares if name in table]
    figure, (panels,) = new_panels(1, len(shown), 2.7, ONE_COLUMN * len(shown))
    every = table[table["orders"] == "all"]
    for k, (place, rows) in enumerate(every.groupby("place", sort=False)):
        for ax, name in zip(panels, shown, strict=True):
            if rows[name].isna().all():
                continue
            share = 1.0 - rows[name] if name == "survived" else rows[name]
            at = rows["snapshot_after"] + 0.12 * (k - 0.5)
            colour, marker = PLACE_COLOURS[k % len(PLACE_COLOURS)], "osD^v"[k % 5]
            label = f"{place}: {counted(rows['loops'].sum(), 'loop')}"
            ax.errorbar(at, 100.0 * share, 100.0 * rows[f"{name}_error"],
                        fmt=marker, color=colour, markersize=4, label=label)  # fmt: skip
            ax.set(xlabel="interval, by its later snapshot", ylabel=shares[name])
            ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    figure_key(figure, at="upper center", ncols=3)
    return figure


def map_data(task: PartTask) -> MappedInterval:
    """Snapshot, fates, increments and predictions of one interval."""
    before, _, fates = tracked(task)
    predicted = part_columns(task.parts["packing"]) if "packing" in task.parts else {}
    return MappedInterval(before, fates, pd.read_parquet(task.parts["increments"]), predicted)


def picked_snapshots(count: int, most: int = MOST_SCENES) -> list[int]:
    """Numbers of the snapshots to show: all of a short series, evenly spread ones of a long one."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round()).astype(int).tolist()


def maps_of(series: Series, counts: Sequence[int], first: int) -> list[LoopsForMap]:
    """Maps of all snapshots, or of as many evenly spread ones as a page can handle.

    The columns include the fates and the work of the interval that follows each snapshot.
    """
    planned, intervals, about = series.planned, series.intervals, ""
    number = min(MOST_MAPS, MOST_LOOPS // max(*counts, 1))
    places = sorted({*picked_snapshots(len(planned), number), first}) if number else []
    if len(places) < len(planned):
        about = f"{len(places)} of {len(planned)} snapshots are shown, a page can't hold more. "
    maps = []
    for k in places:
        one, table = planned[k], pd.read_parquet(series.parts["loops"][k])
        table = table.drop(columns=["grains", "snapshot", "step"])
        parts = intervals[k].parts if k < len(intervals) else {}
        for dataset in (one for one in MAPPED_COLUMNS if one in parts):
            own = pd.read_parquet(parts[dataset])
            own = own.set_index("loop_before" if "loop_before" in own else "loop")
            own = own[own.index >= 0]
            table = table.join(own[[n for n in MAPPED_COLUMNS[dataset] if n in own]])
        name = f"{one.number} ({one.name})"
        place: Any = {"name": name, "number": one.number, "first": k == first, "about": about}
        maps += loops_for_map(one.read(), table, **place)
    return maps


class AnimationFrame(NamedTuple):
    """One frame of an animation."""

    state: Snapshot
    title: str
    smallest: Floats | None = None


def animation_frames(series: Series, evolution: pd.DataFrame) -> Iterator[AnimationFrame]:
    """Frames of the animation of a series, one snapshot in memory at a time."""
    for k in picked_snapshots(len(series.planned)):
        one, part = series.planned[k], series.parts["loops"][k]
        title = f"snapshot {one.number}, shear strain {evolution['shear_strain'][k]:.4f}"
        smallest = None
        if SMALLEST in pyarrow.parquet.read_schema(part).names:
            table = pyarrow.parquet.read_table(part, columns=[SMALLEST])
            smallest = table.column(SMALLEST).to_numpy()
        yield AnimationFrame(one.read(), title, smallest)


@styled()
def animate_series(
    folder: Path, frames: Iterable[AnimationFrame], source: Mapping[str, Any]
) -> list[Path]:
    """Write the animation of a series: loops by order and, with forces, smallest eigenvalue.

    Colours keep their meaning; the scale of the eigenvalues is that of the first frame.
    """
    rest = iter(frames)
    first = next(rest)
    scales: list[Normalize] = [ORDER_SCALE]
    if first.smallest is not None:
        known = first.smallest[np.isfinite(first.smallest) & (first.smallest > 0)]
        high = float(np.percentile(known, 95)) if len(known) else 1.0
        # The negative side has few loops, at first often none: it reaches a quarter as far.
        scales.append(TwoSlopeNorm(0.0, vmin=-0.25 * high, vmax=high))
    palettes = ListedColormap(ORDER_COLOURS), mpl.colormaps[DIVERGING]
    extent = np.ptp(first.state.graph.x, axis=0)
    # A panel less its colour bar, with room for the title.
    height = float(
        np.clip((PANEL_INCHES - 1.2) * extent[1] / extent[0] + 0.9, 2.0, 1.5 * PANEL_INCHES)
    )
    figure = new_figure(PANEL_INCHES * len(scales), height)
    axes: list[Axes] = list(figure.subplots(1, len(scales), squeeze=False)[0])
    drawn: list[Any] = []

    def show(frame: AnimationFrame) -> None:
        for artist in drawn:
            artist.remove()
        faces, draw = frame.state.faces, loop_drawer(frame.state)
        values: list[Any] = [np.minimum(faces.order[faces.loops], LAST_ORDER), frame.smallest]
        panels = zip(axes, values, palettes, scales, strict=False)
        drawn[:] = [draw(ax, value, palette, scale) for ax, value, palette, scale in panels]
        figure.suptitle(frame.title)

    show(first)
    order_bar(axes[0])
    if first.smallest is not None:
        colours = ScalarMappable(scales[1], palettes[1])
        bar = figure.colorbar(colours, ax=axes[1], shrink=0.75, extend="both")
        low, high = colours.get_clim()
        ticks = [low, 0.0, 0.5 * high, high]
        bar.set_ticks(ticks, labels=tick_labels(ticks))
        bar.set_label(r"smallest eigenvalue of $K_s$ / mean $k_n$")
    return write_animation(folder, figure, map(show, rest), source)


class MappedInterval(NamedTuple):
    """An interval to draw maps of; the packing's predictions are for all earlier loops."""

    before: Snapshot
    fates: LoopFates
    increments: Mapping[str, Any]
    predicted: Mapping[str, Any]


@panel(4.6, 4.0)
def work_map(mapped: MappedInterval, ax: Axes) -> None:
    """Loops of the earlier snapshot by their normalised actual second-order work."""
    before, fates, increments, _ = mapped
    work = np.full(len(fates.before), np.nan)
    work[increments["loop_before"]] = increments["w2"]
    palette = mpl.colormaps[DIVERGING].with_extremes(bad=LIGHT_GREY)
    shown: Any = {"label": r"actual $w_2 = dP:dH/(|dP||dH|)$, corotated", "shrink": 0.8}
    draw_scaled(loop_drawer(before), ax, work, palette, Normalize(-1.0, 1.0), **shown)
    handle = Patch(color=LIGHT_GREY, label="did not survive the interval")
    ax.legend(handles=[handle], loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.1)


@styled()
def skill_by_predictor(table: pd.DataFrame) -> Figure:
    """AUC of every predictor, a dot an interval in its colour and the mean, for each target."""
    names = [name for name in PREDICTORS if name in {*table["predictor"]}]
    targets = [target for target in TARGETS if target in {*table["target"]}]
    shape = -(-len(targets) // 2), min(len(targets), 2)
    height = 0.8 + (0.13 * max(len(names), 8) + 0.4) * shape[0]
    figure, axes = new_panels(*shape, height, sharex=True, sharey=True)
    axes, after = axes.ravel(), table["snapshot_after"]
    colours = ScalarMappable(Normalize(after.min(), after.max()), SEQUENTIAL)
    for ax, target in zip(axes, targets, strict=True):
        for place, name in enumerate(names):
            auc = _of_predictor(table, "auc", target, name)
            shade = colours.to_rgba(_of_predictor(table, "snapshot_after", target, name))
            ax.scatter(auc, np.full(len(auc), place), s=8, color=shade, alpha=0.8)
            if np.isfinite(auc).any():
                mean = np.nanmean(auc)
                ax.plot(mean, place, "|", color=VERMILION, markersize=9, markeredgewidth=1.6)
            else:
                ax.annotate(
                    "not applicable", (0.03, place), xycoords=("axes fraction", "data"),
                    va="center", color=GREY, fontsize=6,
                )  # fmt: skip
        past = _of_predictor(table, "auc", target, "persistence")
        if np.isfinite(past).any():
            ax.axvline(np.nanmean(past), color=VERMILION, linestyle="--", linewidth=0.9, zorder=0)
        ax.axvline(0.5, color=LIGHT_GREY, linewidth=0.9, zorder=0)
        base = _of_predictor(table, "base", target, "order")
        base = base[np.isfinite(base)]
        shown = f"{base.mean():.3f} ({base.min():.3f} to {base.max():.3f})" if len(base) else "-"
        ax.set_title(f"{TARGETS[target]}\nbase rate {shown}")
    axes[0].set_yticks(range(len(names)), labels=[PREDICTORS[name] for name in names])
    axes[0].invert_yaxis()
    for ax in axes[-2:]:
        ax.set_xlabel("AUC (bar: mean; dashed: persistence)")
    how: Any = {"label": "interval, by its later snapshot", "ticks": MaxNLocator(integer=True)}
    figure.colorbar(colours, ax=list(axes), shrink=0.5, **how)
    return figure


def _of_predictor(table: pd.DataFrame, column: str, target: str, name: str) -> Floats:
    rows = (table["target"] == target) & (table["predictor"] == name)
    return table.loc[rows, column].to_numpy(dtype=float)


@styled()
def nonaffinity_map(mapped: MappedInterval) -> Figure:
    """Non-affinity of every loop: predicted by the packing, and actual."""
    before, fates, increments, predicted = mapped
    actual = np.full(len(fates.before), np.nan)
    actual[increments["loop_before"]] = increments["nonaffinity"]
    figure, (axes,) = new_panels(1, 2, 3.6)
    known = actual[np.isfinite(actual) & (actual > 0)]
    low, high = np.percentile(known, [2, 98]) if len(known) else (0.1, 10.0)
    high = max(high, 1.01 * low)
    scale = LogNorm(low, high)
    palette = mpl.colormaps[SEQUENTIAL].with_extremes(bad=LIGHT_GREY)
    draw = loop_drawer(before)
    panels = {"predicted by the packing": predicted["packing_nonaffinity"], "actual": actual}
    for ax, (title, values) in zip(axes, panels.items(), strict=True):
        draw(ax, values, palette, scale)
        ax.set_title(title)
        ax.label_outer()
    ticks = [tick for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50) if low < tick < high]
    label = r"non-affinity, $|\varepsilon_l - \varepsilon|\,/\,|\varepsilon|$"
    how: Any = {"ticks": ticks, "format": "{x:g}", "label": label, "extend": "both"}
    figure.colorbar(ScalarMappable(scale, palette), ax=axes, shrink=0.75, **how).minorticks_off()
    handle = Patch(color=LIGHT_GREY, label="carries no force; did not survive the interval")
    figure.legend(handles=[handle], loc="outside lower center")
    return figure
