"""Figures of a snapshot hold the numbers they claim; runs with and without them."""

from dataclasses import replace

import numpy as np
import pytest

from patterns import read_snapshot, sample_cell, sample_path
from studies.snapshot import figures
from studies.snapshot.figures import (
    draw_rose,
    eigenvalue_distribution,
    loop_drawer,
    loop_map,
    order_bars,
    snapshot_figures,
    unstable_rose,
)
from studies.snapshot.summary import (
    fabric_table,
    judges,
    snapshot_summary,
    unstable_loops,
)
from studies.snapshot.table import GROUPS, group_rows, loop_columns
from studies.study import Results

PERIODIC = sample_path("grains_periodic.parquet")


@pytest.fixture(scope="module")
def sample():
    snapshot = read_snapshot(PERIODIC, cell=sample_cell())
    table = loop_columns(snapshot)
    return snapshot, table, snapshot_summary(snapshot, table)


def judged(table):
    """Flags of the unstable loops by judge."""
    return {judge: unstable_loops(table, judge) for judge in judges(table)}


def bars(ax, container=0):
    """Angle, height and width of each bar."""
    return np.array(
        [
            (b.get_x() + b.get_width() / 2, b.get_height(), b.get_width())
            for b in ax.containers[container]
        ]
    ).T


def test_rose_of_contacts_is_a_density_and_its_second_harmonic(sample):
    snapshot, _, summary = sample
    numbers = fabric_table(snapshot.graph, summary)
    ax = draw_rose(snapshot)
    angle, height, width = bars(ax)
    assert np.sum(height * width) == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(height[: len(height) // 2], height[len(height) // 2 :])
    (curve,) = (line.get_xydata() for line in ax.lines if "second" in str(line.get_label()))
    assert np.trapezoid(curve[:, 1], curve[:, 0]) == pytest.approx(1.0, rel=1e-12)
    # The bars' own second harmonic, up to their width: sinc(width) of it is left.
    harmonic = 2 * np.sum(height * width * np.exp(2j * angle)) / np.sinc(width[0] / np.pi)
    drawn = np.sum(curve[:-1, 1] * np.exp(2j * curve[:-1, 0])) * 2 * (2 * np.pi / 360)
    assert abs(harmonic - drawn) < 0.01
    assert numbers["count"].sum() == snapshot.graph.contact_count
    np.testing.assert_allclose(numbers["density"], height[: len(height) // 2])
    at = np.interp(np.radians(numbers["angle"]), curve[:, 0], curve[:, 1])
    np.testing.assert_allclose(numbers["second_order"], at, rtol=1e-4)


@pytest.fixture
def few(monkeypatch):
    """Let a few loops have a rose."""
    monkeypatch.setattr(figures, "LEAST_AXES", 1)


def test_fewer_than_fifty_loops_have_no_rose(sample):
    snapshot, table, summary = sample
    unstable = judged(table)
    assert [np.count_nonzero(unstable[judge]) for judge in ("affine", "traction")] == [0, 7]
    assert "directions" not in dict(snapshot_figures(snapshot, table, summary))
    unstable["affine"][:50] = True
    assert figures.rose_judges(table, unstable) == ["affine"]
    unstable["affine"][:50] = False
    assert figures.rose_judges(table, unstable) == []


def test_rose_of_unstable_loops(sample, few):
    _, table, summary = sample
    soft, long = unstable_rose(table, judged(table), summary).axes
    for ax in (soft, long):
        # No loop is unstable under the affine closure.
        (label,) = (text.get_text() for text in ax.get_legend().get_texts())
        assert label == "traction, spins blocked, 7 loops"
        _, height, width = bars(ax, 0)
        assert np.sum(height * width) == pytest.approx(1.0, rel=1e-12)
    # The mean axis ends at its resultant of the outer circle, either way.
    block = summary["soft_loops"]["traction"]["soft_angle"]
    angle, reach = soft.lines[0].get_xydata().T
    assert np.degrees(angle[0]) == pytest.approx(block["direction"])
    np.testing.assert_allclose(reach, block["resultant"] * soft.get_ylim()[1])


@pytest.mark.parametrize("most", [500, 7])
def test_distributions_hold_every_loop(sample, monkeypatch, most):
    """The line of an order passes the share of its loops below each value, zero among them."""
    monkeypatch.setattr(figures, "MOST_STEPS_DRAWN", most)
    _, table, _ = sample
    figure = eigenvalue_distribution(table, group_rows(table["order"]))
    pooled = np.minimum(table["order"], 8)
    for ax, judge in zip(figure.axes, judges(table), strict=True):
        smallest = table[f"{judge}_lambda_min"]
        known = np.isfinite(smallest)
        assert len(ax.lines) == len(np.unique(pooled[known]))
        for order, line in zip(np.unique(pooled[known]), ax.lines, strict=True):
            own = np.sort(smallest[known & (pooled == order)])
            x, y = line.get_data()
            assert (x[0], y[0], x[-1], y[-1]) == (own[0], 0.0, own[-1], 1.0)
            np.testing.assert_allclose(y[1:], np.searchsorted(own, x[1:], "right") / len(own))
            assert most < 500 or len(x) == len(own) + 1
        lost = f"{np.count_nonzero(unstable_loops(table, judge))} of {known.sum()} unstable"
        assert lost in ax.get_title()
    counts = np.bincount(pooled, minlength=9)[3:]
    key = [text.get_text() for text in figure.legends[0].get_texts()]
    assert key == [f"order {name} ({n})" for name, n in zip(GROUPS, counts, strict=True)]


def test_one_scale_for_both_signs(sample):
    snapshot, table, _ = sample
    figure = loop_map(snapshot, table, loop_drawer(snapshot))
    scale = figure.axes[1].collections[0].norm
    assert scale.vmin == -scale.vmax and 0 < scale.linthresh < scale.vmax / 3
    assert scale(0.0) == 0.5
    (said,) = figure.axes[1].get_legend().get_texts()
    lost = np.count_nonzero(table["traction_lambda_min"] < 0)
    assert said.get_text() == f"unstable (traction, spins blocked): {lost} of {len(table['loop'])}"


def test_roses_of_few_loops_have_errors(sample, few):
    """Of n axes in a bin the density is uncertain by one over the root of n."""
    _, table, summary = sample
    ax = unstable_rose(table, judged(table), summary).axes[0]
    bars_drawn = ax.containers[1].lines[2][0].get_segments()
    assert len(bars_drawn) == 18
    _, height, width = bars(ax, 0)
    for (low, high), density in zip(bars_drawn, height, strict=True):
        count = density * 7 * 2 * width[0]
        assert high[1] - low[1] == pytest.approx(2 * density / max(count, 1) ** 0.5, abs=1e-12)


def test_bars_of_orders(sample):
    _, table, summary = sample
    ax = order_bars(summary)
    for container in (0, 1):
        assert bars(ax, container)[1].sum() == pytest.approx(1.0, rel=1e-12)
    assert bars(ax, 2)[1].sum() == pytest.approx(7 / len(table["loop"]), rel=1e-12)


def test_without_forces_only_the_geometry_is_drawn(sample, tmp_path):
    snapshot, *_ = sample
    bare = replace(snapshot, law=None, regime=None)
    table = loop_columns(bare)
    summary = snapshot_summary(bare, table)
    results = Results(tmp_path, {"command": "grainloops snapshot"})
    saved = results.save_figures(snapshot_figures(bare, table, summary))
    assert [one.name for one in saved] == ["map", "orders", "fabric"]
    drawn = {path.name for path in tmp_path.iterdir()}
    assert drawn == {"map.png", "orders.png", "fabric.png"}
