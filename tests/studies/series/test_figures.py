"""Figures and animation of a series: what they show is what the tables say."""

from itertools import pairwise

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

from loops import Fate, LinearFrictional, Regime, exchange_counts, polygon_area
from loops.tracking import ExchangeCounts
from patterns import Snapshot, synthetic_network
from studies.output import provenance
from studies.series.evolution import (
    evolution_row,
    interval_row,
    loop_increments,
    track_loops,
)
from studies.series.figures import (
    MOST_SCENES,
    MappedInterval,
    exchange_heatmap,
    fates_over_strain,
    largest_strain,
    orders_over_strain,
    picked_snapshots,
    stress_strain,
    work_map,
)
from studies.series.run import evolution_table
from studies.snapshot.table import GROUPS
from studies.study import Results

SOURCE = provenance("series", {}, "as the input's")


def state(graph, *, mechanical=True):
    count = graph.contact_count
    snapshot = Snapshot(
        graph=graph,
        law=LinearFrictional(np.ones(count), np.full(count, 0.4), np.full(count, 0.5))
        if mechanical
        else None,
        regime=np.full(count, Regime.ELASTIC, dtype=np.int8) if mechanical else None,
        ids=np.arange(graph.grain_count),
        wall_contacts=0,
        notes=(),
    )
    return snapshot


def plain_table(tracked):
    loops = tracked.faces.loops
    smallest = np.linspace(-0.1, 1.0, len(loops))
    return {
        "order": tracked.faces.order[loops],
        "area": tracked.faces.area[loops],
        "affine_lambda_min": smallest,
        "traction_lambda_min": smallest,
        "traction_free_lambda_min": smallest,
    }


class Series:
    """Four snapshots of a network that is sheared at random and loses contacts."""

    def __init__(self, *, mechanical=True):
        rng = np.random.default_rng(4)
        graph = synthetic_network(150, seed=6, periodic=True, coordination=4.6)
        self.states = [state(graph, mechanical=mechanical)]
        for _ in range(3):
            keep = rng.random(graph.contact_count) > 0.05
            x = graph.x * [1.01, 0.99] + 1e-3 * rng.standard_normal(graph.x.shape)
            cell = graph.cell * [[1.01], [0.99]]
            force = graph.normal_force[keep] * rng.uniform(0.8, 1.2, np.count_nonzero(keep))
            graph = graph.replace(
                x=x,
                x0=x,
                cell=cell,
                cell0=cell,
                contacts=graph.contacts[keep],
                images=graph.images[keep],
                normal_force=force,
                shear_force=graph.shear_force[keep],
            )
            self.states.append(state(graph, mechanical=mechanical))
        pairs = list(pairwise(self.states))
        self.fates = [track_loops(*pair) for pair in pairs]
        self.tables = [loop_increments(*p, f) for p, f in zip(pairs, self.fates, strict=True)]
        self.evolution = evolution_table(
            [
                {"snapshot": k} | evolution_row(one, plain_table(one))
                for k, one in enumerate(self.states)
            ],
            [
                interval_row(*p, f, t)
                for p, f, t in zip(pairs, self.fates, self.tables, strict=True)
            ],
        )
        parts = zip(*map(exchange_counts, self.fates), strict=True)
        self.exchange = ExchangeCounts(*map(np.concatenate, parts))
        self.mapped = MappedInterval(self.states[0], self.fates[0], self.tables[0], {})


@pytest.fixture(scope="module")
def series():
    return Series()


def test_orders_and_stress_lines(series):
    left, right = orders_over_strain(series.evolution).axes
    for ax, kind in ((left, "share"), (right, "area_share")):
        assert len(ax.lines) == len(GROUPS)
        for order, line in enumerate(ax.lines, start=3):
            np.testing.assert_array_equal(line.get_xdata(), series.evolution["H22"])
            np.testing.assert_array_equal(line.get_ydata(), series.evolution[f"{kind}_{order}"])
        low, high = ax.get_ylim()
        assert low == 0 and ax.get_xlabel() == "strain $H_{22}$ (–)"
        assert max(line.get_ydata().max() for line in ax.lines) < high
    stress, ratio, shares = stress_strain(series.evolution).axes
    np.testing.assert_array_equal(ratio.lines[0].get_ydata(), series.evolution["q_over_p"])
    np.testing.assert_array_equal(stress.lines[1].get_ydata(), series.evolution["S22"])
    worked = shares.lines[-1].get_ydata()
    assert np.isnan(worked[0])
    assert worked[2] == np.mean(series.tables[1]["W2"] < 0)


@pytest.mark.parametrize(
    ("end", "axis"),
    [
        ({"11": -8e-5, "22": 6e-5}, "22"),
        ({"11": 2e-5, "22": -1e-5}, "11"),
        ({"11": -3e-4, "22": 1e-5}, "11"),
        ({"11": 1e-6, "12": 2e-3}, "12"),
        ({}, "11"),
    ],
)
def test_strain_is_that_of_the_axis_of_compression(end, axis):
    """Of an extension and of a shear the largest component."""
    columns = {f"H{ij}": [0.0, np.nan, end.get(ij, 0.0)] for ij in ("11", "12", "21", "22")}
    strain, label = largest_strain(pd.DataFrame(columns))
    np.testing.assert_array_equal(strain, columns[f"H{axis}"])
    assert f"H_{{{axis}}}" in label


def test_fates_stack_up_to_one(series):
    ax = fates_over_strain(series.evolution)
    heights = np.array([[bar.get_height() for bar in bars] for bars in ax.containers])
    split = [100 * np.mean(fates.before == Fate.SPLIT) for fates in series.fates]
    np.testing.assert_allclose(heights[0], split, rtol=1e-14)
    survived = [100 * np.mean(fates.before == Fate.SURVIVED) for fates in series.fates]
    np.testing.assert_allclose(heights.sum(axis=0) + survived, 100, rtol=1e-14)


def test_exchange_numbers(series):
    ax = exchange_heatmap(series.exchange)
    written = sum(int(text.get_text()) for text in ax.texts)
    assert written == series.exchange.loops.sum()
    shares = np.asarray(ax.images[0].get_array())
    filled = shares.sum(axis=1) > 0
    np.testing.assert_allclose(shares.sum(axis=1)[filled], 1, rtol=1e-14)
    triangles = series.exchange.order_before == 3
    stayed = series.exchange.loops[triangles & (series.exchange.order_after == 3)].sum()
    assert shares[0, 0] == stayed / series.exchange.loops[triangles].sum()


def test_work_is_drawn_where_it_was_done(series):
    ax = work_map(series.mapped)
    (drawn,) = ax.collections
    loops = series.mapped.before.faces
    areas = [float(polygon_area(path.vertices[:-1])) for path in drawn.get_paths()]
    work = np.full(len(loops.loops), np.nan)
    work[series.tables[0]["loop_before"]] = series.tables[0]["w2"]
    assert np.count_nonzero(np.isnan(work)) == np.count_nonzero(
        series.fates[0].before != Fate.SURVIVED
    )
    # Polygons come order by order: compared loop by loop through their areas.
    values = np.ma.filled(drawn.get_array(), np.nan)
    found, expected = np.argsort(areas), np.argsort(loops.area[loops.loops])
    np.testing.assert_array_equal(values[found], work[expected])
    np.testing.assert_allclose(np.sort(areas), np.sort(loops.area[loops.loops]), rtol=1e-9)


def test_long_series_show_few_frames():
    picked = picked_snapshots(1000)
    assert len(picked) == MOST_SCENES
    assert (picked[0], picked[-1]) == (0, 999)
    assert len(set(np.diff(picked))) <= 2
    assert picked_snapshots(1) == [0]
    assert picked_snapshots(MOST_SCENES) == list(range(MOST_SCENES))


def test_callers_settings_are_left_alone(series):
    before = dict(mpl.rcParams)
    work_map(series.mapped)
    exchange_heatmap(series.exchange)
    assert dict(mpl.rcParams) == before


def test_the_report_counts_all_loops(tmp_path, series):
    """Not those of the snapshot on the map."""
    summary = {"loops": 12345, "snapshots": 4}
    largest = len(series.mapped.before.faces.loops)
    Results(tmp_path, SOURCE).write_report("Loops of 4 snapshots", summary, [], [], largest)
    page = (tmp_path / "report.html").read_text()
    assert "<td>loops</td><td>12345</td>" in page
    assert "loops are more than" not in page
