"""Figures, maps and animation of a series, drawn from its finished parts."""

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
from matplotlib.colors import ListedColormap, Normalize, TwoSlopeNorm
from matplotlib.figure import Figure

from loops.arrays import Floats
from loops.tracking import ExchangeCounts
from patterns import Snapshot
from studies.columns import Columns
from studies.series.figures import (
    exchange_heatmap,
    fates_over_strain,
    kinetics_figure,
    orders_over_strain,
    probes_over_strain,
    stress_strain,
    survival_by_verdict,
)
from studies.series.increments import PREDICTIONS
from studies.series.skill import part_columns
from studies.series.skill_figures import (
    MappedInterval,
    nonaffinity_map,
    skill_by_interval,
    skill_by_predictor,
    work_map,
    work_signs,
)
from studies.series.tasks import PartTask, Series, tracked
from studies.snapshot.loop_map import ORDER_SCALE, loop_drawer, order_bar
from studies.snapshot.polygons import MOST_LOOPS, LoopsForMap, loops_for_map
from studies.snapshot.statistics import LAST_ORDER
from studies.style import (
    DIVERGING,
    ORDER_COLOURS,
    figure_of,
    new_figure,
    styled,
    write_animation,
)

WORK_COLUMNS = ("W2", "w2", *PREDICTIONS)
PACKING_COLUMNS = ("packing_w2", "packing_nonaffinity", "packing_opening", "packing_closing")
SMALLEST = "traction_lambda_min"
# Most maps on a page, and frames of an animation.
MOST_MAPS, MOST_SCENES = 20, 60
# Width of a panel of the animation, inches.
PANEL_INCHES = 4.6


def series_figures(
    tables: Mapping[str, pd.DataFrame],
    increments: Mapping[str, Any],
    mapped: MappedInterval | None,
) -> Iterator[tuple[str, Figure]]:
    """Every figure of a series by name; `increments` are those of all intervals together."""
    evolution = tables["evolution"]
    yield "orders_over_strain", orders_over_strain(evolution)
    if "S11" in evolution:
        yield "stress_strain", stress_strain(evolution)
    if "probe_w2" in evolution:
        yield "probes", probes_over_strain(evolution)
    if len(evolution) > 1:
        yield "fates", figure_of(fates_over_strain(evolution))
    if "survival" in tables:
        yield "survival", survival_by_verdict(tables["survival"])
    if len(evolution) > 1:
        exchange = [tables["exchange"][name].to_numpy() for name in ExchangeCounts._fields]
        yield "exchange", figure_of(exchange_heatmap(ExchangeCounts(*exchange)))
    if "kinetics" in tables:
        yield "kinetics", kinetics_figure(tables)
    if len(increments.get("W2", ())):
        yield "work_signs", work_signs(increments)
    packed = "skill" in tables and "packing" in set(tables["skill"]["predictor"])
    if packed:
        yield "skill_by_predictor", skill_by_predictor(tables["skill"])
        yield "skill_by_interval", skill_by_interval(tables["skill"])
    if mapped is not None:
        if packed and np.isfinite(mapped.predicted["packing_nonaffinity"]).any():
            yield "nonaffinity_map", nonaffinity_map(mapped)
        if "W2" in mapped.increments:
            yield "work_map", figure_of(work_map(mapped))


def joined_increments(series: Series) -> Columns:
    """Actual and predicted work of all intervals."""
    parts = [task.part for task in series.intervals]
    if not parts:
        return {}
    there = set(pyarrow.parquet.read_schema(parts[0]).names)
    names = [name for name in WORK_COLUMNS if name in there]
    tables = [pyarrow.parquet.read_table(part, columns=names) for part in parts]
    table = pyarrow.concat_tables(tables)
    return {name: table.column(name).to_numpy() for name in names}


def map_data(task: PartTask) -> MappedInterval:
    """Snapshot, fates, increments and predictions of one interval."""
    before, _, fates = tracked(task)
    predicted = part_columns(task.packing_part) if task.packing_part.is_file() else {}
    return MappedInterval(before, fates, pd.read_parquet(task.part), predicted)


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
        one, table = planned[k], pd.read_parquet(series.snapshots[k].part)
        table = table.drop(columns=["grains", "snapshot", "step"])
        if k < len(intervals):
            task = intervals[k]
            fates = pd.read_parquet(task.fates_part)[: len(table)]
            table = table.join(fates[["fate", "successor", "order_after"]])
            own = pd.read_parquet(task.part).set_index("loop_before")
            table = table.join(
                own[[name for name in (*WORK_COLUMNS, "nonaffinity") if name in own]]
            )
            if task.packing_part.is_file():
                predicted = pd.read_parquet(task.packing_part)
                table = table.join(predicted[[n for n in PACKING_COLUMNS if n in predicted]])
        name = f"{one.number} ({one.name})"
        place: Any = {"name": name, "number": one.number, "first": k == first, "about": about}
        maps += loops_for_map(one.read(), table, **place)
    return maps


class Scene(NamedTuple):
    """One frame of an animation."""

    state: Snapshot
    title: str
    smallest: Floats | None = None


def animation_frames(series: Series, evolution: pd.DataFrame) -> Iterator[Scene]:
    """Frames of the animation of a series, one snapshot in memory at a time."""
    for k in picked_snapshots(len(series.planned)):
        one, part = series.planned[k], series.snapshots[k].part
        title = f"snapshot {one.number}, shear strain {evolution['shear_strain'][k]:.4f}"
        smallest = None
        if SMALLEST in pyarrow.parquet.read_schema(part).names:
            table = pyarrow.parquet.read_table(part, columns=[SMALLEST])
            smallest = table.column(SMALLEST).to_numpy()
        yield Scene(one.read(), title, smallest)


@styled()
def animate_series(folder: Path, frames: Iterable[Scene], source: Mapping[str, Any]) -> list[Path]:
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

    def show(frame: Scene) -> None:
        for artist in drawn:
            artist.remove()
        faces, draw = frame.state.faces, loop_drawer(frame.state)
        values: list[Any] = [np.minimum(faces.order[faces.loops], LAST_ORDER), frame.smallest]
        panels = zip(axes, values, palettes, scales, strict=False)
        drawn[:] = [draw(ax, value, palette, scale) for ax, value, palette, scale in panels]
        figure.suptitle(frame.title)

    show(first)
    order_bar(ScalarMappable(ORDER_SCALE, palettes[0]), axes[0])
    if first.smallest is not None:
        colours = ScalarMappable(scales[1], palettes[1])
        bar = figure.colorbar(colours, ax=axes[1], shrink=0.75, extend="both")
        low, high = colours.get_clim()
        ticks = [low, 0.0, 0.5 * high, high]
        bar.set_ticks(ticks, labels=[f"{tick:.2g}" for tick in ticks])
        bar.set_label(r"smallest eigenvalue of $K_s$ / mean $k_n$")
    return write_animation(folder, figure, map(show, rest), source)
