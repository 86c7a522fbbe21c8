"""Figures of a snapshot hold the numbers they claim; runs with and without them."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from patterns import read_snapshot, sample_cell, sample_path
from studies.snapshot import run_snapshot
from studies.snapshot.figures import (
    eigenvalue_distribution,
    fabric_rose,
    order_bars,
    snapshot_figures,
    unstable_rose,
)
from studies.snapshot.summary import (
    fabric_table,
    group_rows,
    judges,
    snapshot_summary,
    unstable_loops,
)
from studies.snapshot.table import EIGENVALUES, loop_columns
from studies.study import Results

PERIODIC = sample_path("grains_periodic.parquet")
CELL = tuple(sample_cell().ravel().tolist())


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
    ax = fabric_rose(numbers, summary).axes[0]
    angle, height, width = bars(ax)
    assert np.sum(height * width) == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_allclose(height[: len(height) // 2], height[len(height) // 2 :])
    curve = ax.lines[0].get_xydata()
    assert np.trapezoid(curve[:, 1], curve[:, 0]) == pytest.approx(1.0, rel=1e-12)
    # The bars' own second harmonic, up to their width: sinc(width) of it is left.
    harmonic = 2 * np.sum(height * width * np.exp(2j * angle)) / np.sinc(width[0] / np.pi)
    drawn = np.sum(curve[:-1, 1] * np.exp(2j * curve[:-1, 0])) * 2 * (2 * np.pi / 720)
    assert abs(harmonic - drawn) < 0.01
    assert numbers["count"].sum() == snapshot.graph.contact_count
    np.testing.assert_allclose(numbers["density"], height[: len(height) // 2])
    at = np.interp(np.radians(numbers["angle"]), curve[:, 0], curve[:, 1])
    np.testing.assert_allclose(numbers["second_order"], at, rtol=1e-4)


def test_rose_of_unstable_loops(sample):
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


def test_histograms_hold_every_loop(sample):
    _, table, _ = sample
    figure = eigenvalue_distribution(table, group_rows(table["order"]), judged(table))
    pooled = np.minimum(table["order"], 8)
    names = [f"{judge}_{name}" for judge in judges(table) for name in EIGENVALUES]
    for ax, name in zip(figure.axes, names, strict=True):
        shares = [
            patch.get_data().values.sum() for patch in ax.patches if hasattr(patch, "get_data")
        ]
        np.testing.assert_allclose(shares, 1.0, rtol=1e-12)
        assert len(shares) == len(np.unique(pooled[np.isfinite(table[name])]))
    legend = [text.get_text() for text in figure.axes[5].get_legend().get_texts()]
    shares = ("3: 0", "4: 0.49", "5: 0.51", "6: 0.55", "7: 2.6", "8+: 0.81")
    assert legend == [f"order {share} %" for share in shares]


def test_bars_of_orders(sample):
    _, table, summary = sample
    ax = order_bars(summary)
    for container in (0, 1):
        assert bars(ax, container)[1].sum() == pytest.approx(1.0, rel=1e-12)
    assert bars(ax, 2)[1].sum() == pytest.approx(7 / len(table["loop"]), rel=1e-12)


def test_stable_and_untrusted_loops_are_drawn_too(sample):
    snapshot, table, _ = sample
    stable = dict(table)
    for closure in ("affine", "traction"):
        values = np.abs(table[f"{closure}_lambda_min"])
        stable[f"{closure}_lambda_min"] = np.where(table["order"] == 5, np.nan, values)
    summary = snapshot_summary(snapshot, stable)
    fabric = fabric_table(snapshot.graph, summary)
    names = [name for name, _ in snapshot_figures(snapshot, stable, fabric, summary)]
    assert "eigenvalues" in names and "directions" not in names
    groups = group_rows(stable["order"])
    eigenvalue_distribution(stable, groups, judged(stable)).draw_without_rendering()


def test_without_forces_only_the_geometry_is_drawn(sample, tmp_path):
    snapshot, *_ = sample
    bare = replace(snapshot, law=None, regime=None)
    table = loop_columns(bare)
    summary = snapshot_summary(bare, table)
    results = Results(tmp_path, {"command": "grainloops snapshot"})
    fabric = fabric_table(bare.graph, summary)
    saved = results.save_figures(snapshot_figures(bare, table, fabric, summary))
    assert [one.name for one in saved] == ["map", "orders", "fabric"]
    drawn = {path.name for path in tmp_path.iterdir()}
    assert drawn == {"map.png", "orders.png", "fabric.png"}


def test_a_run_without_figures_but_for_paraview(tmp_path):
    pytest.importorskip("vtkmodules")
    summary = run_snapshot(PERIODIC, tmp_path / "out", cell=CELL, figures=False, paraview=True)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        *("chains.parquet", "loops.parquet", "orders.parquet", "summary.json"),
        *("loops.vtp", "contacts.vtp"),
    }
    orders = pd.read_parquet(tmp_path / "out" / "orders.parquet")
    assert orders["loops"].sum() == summary["loops"]
    assert orders["area"].sum() == pytest.approx(summary["area_sum"], rel=1e-12)
