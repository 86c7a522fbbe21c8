"""`--regions`: loops inside a threshold or polygons beside all others, counted once more."""

import json

import numpy as np
import pandas as pd
import pytest

from loops import InputError
from patterns import Snapshot, sample_path
from studies.frames import loop_table
from studies.snapshot.regions import loop_regions
from tests.command import run_evolve, run_series, run_snapshot
from tests.packings import LAW, jammed
from tests.studies.series.test_run import write_series
from tests.studies.snapshot.test_paraview import read_back

GRAINS = sample_path("grains_biaxial.csv.gz")
SQUARE = {"order": np.array([3, 4, 5, 6]), "area": np.array([1.0, 2, 3, 4]),
          "x": np.array([0.5, 1.5, 2.5, 0.5]), "y": np.array([0.5, 0.5, 0.5, 5.0])}  # fmt: skip


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    out = tmp_path_factory.mktemp("regions") / "out"
    run_snapshot(GRAINS, out, regions="deviator>150", figures=False)
    names = ("loops", "regions")
    summary = json.loads((out / "summary.json").read_text())
    return summary, *(pd.read_parquet(out / f"{name}.parquet") for name in names)


def test_shares_are_those_of_the_loops(judged):
    summary, loops, regions = judged
    inside = loops["deviator"] > 150.0
    assert loops["region"].tolist() == np.where(inside, "deviator>150", "elsewhere").tolist()
    groups = np.where(loops["order"] >= 8, "8+", loops["order"].astype(str))
    for row in regions.itertuples():
        part = loops[
            (loops["region"] == row.place) & ((groups == row.orders) | (row.orders == "all"))
        ]
        known = part["traction_free_lambda_min"].dropna()
        assert row.loops == len(part)
        assert row.mean_order == pytest.approx(part["order"].mean(), rel=1e-14, nan_ok=True)
        share = (known < -1e-9).mean() if len(known) else np.nan
        assert row.traction_free_unstable == pytest.approx(share, rel=1e-14, nan_ok=True)
        error = np.sqrt(share * (1 - share) / len(known)) if len(known) else np.nan
        assert row.traction_free_unstable_error == pytest.approx(error, rel=1e-12, nan_ok=True)
        middle = known.median() if len(known) else np.nan
        assert row.traction_free_lambda_min == pytest.approx(middle, rel=1e-14, nan_ok=True)
    areas = [part["area_share"] for part in summary["regions"].values()]
    assert sum(areas) == pytest.approx(1.0, rel=1e-14)
    assert areas[0] == pytest.approx(loops["area"][inside].sum() / loops["area"].sum(), rel=1e-14)


def test_polygons_take_loops_by_their_centroids(tmp_path):
    corners = tmp_path / "corners.csv"
    corners.write_text("# two that overlap\nx,y,region\n0,0,a\n1,0,a\n1,1,a\n0,1,a\n"
                       "2,1,b\n2,0,b\n0,0,b\n0,1,b\n")  # fmt: skip
    place, names = loop_regions(SQUARE, str(corners))
    assert names[place].tolist() == ["a", "b", "elsewhere", "elsewhere"]
    corners.write_text("x,y\n0,0\n3,0\n3,1\n0,1\n")
    place, names = loop_regions(SQUARE, str(corners))
    assert names[place].tolist() == ["inside"] * 3 + ["elsewhere"]


def test_a_band_of_a_path(tmp_path):
    out = tmp_path / "out"
    summary = run_evolve([GRAINS], out, to=1e-5, rows=1, regions="shear>2e-5", figures=False)
    loops, regions = (pd.read_parquet(out / f"{name}.parquet") for name in ("loops", "regions"))
    H = loops[["H11", "H12", "H21", "H22"]].to_numpy().reshape(-1, 2, 2)
    e = np.linalg.eigvalsh(0.5 * (H + np.swapaxes(H, 1, 2)))
    np.testing.assert_allclose(loops["shear"], 0.5 * (e[:, 1] - e[:, 0]), rtol=1e-9, atol=1e-18)
    for place, part in loops.groupby("region"):
        row = regions[(regions["place"] == place) & (regions["orders"] == "all")].iloc[0]
        assert row["negative"] == pytest.approx((part["W2"].dropna() < 0).mean(), rel=1e-14)
        assert row["opened"] == pytest.approx(part["open_from"].notna().mean(), rel=1e-14)
        assert summary["regions"][place]["loops"] == len(part) > 0


@pytest.mark.parametrize(
    ("regions", "said"),
    [
        ("width>1", "column width"),
        ("ordre>1", "Did you mean order"),
        ("order>many", "a column and a number"),
        ("order>nan", "a column and a number"),
        ("nowhere.csv", "No such file"),
    ],
)
def test_regions_that_are_refused(regions, said):
    with pytest.raises(InputError, match=said):
        loop_regions(SQUARE, regions)


@pytest.mark.parametrize(
    ("text", "said"),
    [("x,radius\n0,1\n", "'y'"), ("x,y\n0,0\n1,0\n", "three finite corners"), ("x,y\n0,a\n", "a")],
)
def test_corners_that_are_refused(tmp_path, text, said):
    corners = tmp_path / "corners.csv"
    corners.write_text(text)
    with pytest.raises(InputError, match=said):
        loop_regions(SQUARE, str(corners))


def test_loops_without_places_have_no_polygons(tmp_path):
    corners = tmp_path / "corners.csv"
    corners.write_text("x,y\n0,0\n3,0\n3,1\n")
    with pytest.raises(InputError, match="no places"):
        loop_regions({"order": SQUARE["order"]}, str(corners))


def test_loops_without_a_number_are_in_no_region():
    # A time to an event is infinite where there is none.
    table = SQUARE | {"opening": np.array([np.nan, -1.0, np.inf, np.nan])}
    place, names = loop_regions(table, "opening<0")
    assert names[place].tolist() == ["unknown", "opening<0", "elsewhere", "unknown"]


def table_of_series(out):
    """Earlier loops of all intervals, with their fates, increments and columns."""
    fates = pd.read_parquet(out / "fates.parquet")
    increments, loops = (
        pd.concat(map(pd.read_parquet, sorted((out / name).glob("*"))))
        for name in ("increments", "loops")
    )
    pair = ["snapshot_before", "snapshot_after", "loop_before"]
    table = fates[fates["loop_before"] >= 0].merge(increments, "left", pair)
    names = {"snapshot": "snapshot_before", "loop": "loop_before"}
    return table.merge(loops.rename(columns=names), "left", [*names.values()], suffixes=("", "_"))


def assert_counted(regions, summary, table, share, flags):
    """Rows of the table of regions and of the summary by what `flags` are of the loops."""
    groups = np.where(table["order_before"] >= 8, "8+", table["order_before"].astype(str))
    assert {*table["place"]} == {*regions["place"]} == {*summary}
    assert len(regions) == 2 * 7 * len(summary)
    for row in regions.to_dict("records"):
        part = flags[(table["snapshot_before"] == row["snapshot_before"])
                     & (table["place"] == row["place"])
                     & ((groups == row["orders"]) | (row["orders"] == "all"))]  # fmt: skip
        assert row["loops"] == len(part)
        assert row[share] == pytest.approx(part.dropna().mean(), rel=1e-14, nan_ok=True)
    for place, found in summary.items():
        part = flags[table["place"] == place].dropna()
        assert found["loops"] == (table["place"] == place).sum() > 10
        assert found[share] == (pytest.approx(part.mean(), rel=1e-14) if len(part) else None)


def test_regions_of_a_series_are_those_of_its_fates_and_increments(tmp_path):
    out, paths = tmp_path / "out", write_series(tmp_path / "in", 3)
    # Compression by .001 and .002 of the present lengths: shear is .0015 and then .0015015.
    run_series(paths, out, workers=1, figures=False)
    parts = {path: path.stat().st_mtime_ns for path in out.glob("*/part-*")}
    summary = run_series(paths, out, workers=1, figures=False, regions="shear>1.5008e-3")
    # Nothing is computed anew.
    assert parts == {path: path.stat().st_mtime_ns for path in out.glob("*/part-*")}
    regions, table = pd.read_parquet(out / "regions.parquet"), table_of_series(out)
    H = table[["H11", "H12", "H21", "H22"]].to_numpy().reshape(-1, 2, 2)
    known = np.isfinite(H).all(axis=(1, 2))
    e = np.linalg.eigvalsh(0.5 * (H + np.swapaxes(H, 1, 2))[known])
    inside = e[:, 1] - e[:, 0] > 3.0016e-3
    table["place"] = "unknown"
    table.loc[known, "place"] = np.where(inside, "shear>1.5008e-3", "elsewhere")
    negative = (table["W2"] < 0).astype(float).where(table["W2"].notna())
    assert_counted(regions, summary["regions"], table, "negative", negative)
    # The strain of a loop that was lost is not known: nothing is said of survival.
    assert "survived" not in regions and "survived" not in summary["regions"]["elsewhere"]

    # Loops of one interval on both sides of a threshold on an increment.
    least = float(table["W2"].median())
    summary = run_series(paths, out, workers=1, figures=False, regions=f"W2<{least!r}")
    regions, table = pd.read_parquet(out / "regions.parquet"), table_of_series(out)
    inside = np.where(table["W2"] < least, f"W2<{least!r}", "elsewhere")
    table["place"] = np.where(table["W2"].notna(), inside, "unknown")
    negative = (table["W2"] < 0).astype(float).where(table["W2"].notna())
    assert_counted(regions, summary["regions"], table, "negative", negative)

    summary = run_series(paths, out, workers=1, figures=False, regions="deviator>150")
    regions, table = pd.read_parquet(out / "regions.parquet"), table_of_series(out)
    table["place"] = np.where(table["deviator"] > 150.0, "deviator>150", "elsewhere")
    survived = (table["fate"] == "survived").astype(float)
    assert 0.0 < survived.mean() < 1.0
    assert_counted(regions, summary["regions"], table, "survived", survived)


@pytest.mark.parametrize(
    ("count", "regions", "said"),
    [
        (2, "nowhere.csv", "No such file"),
        (2, "bogus>1", "column bogus"),
        (1, "order>5", "one snapshot"),
    ],
)
def test_regions_of_a_series_are_refused_before_it_starts(tmp_path, count, regions, said):
    paths = write_series(tmp_path / "in", count)
    with pytest.raises(InputError, match=said):
        run_series(paths, tmp_path / "out", workers=1, figures=False, regions=regions)
    assert not (tmp_path / "out").exists()


def test_regions_are_numbers_in_files_for_paraview(tmp_path):
    run_snapshot(GRAINS, tmp_path / "out", regions="order>4", paraview=True, figures=False)
    loops = pd.read_parquet(tmp_path / "out" / "loops.parquet")
    _, _, cells, _ = read_back(tmp_path / "out" / "loops.vtp")
    assert np.array_equal(cells["region"], np.unique(loops["region"], return_inverse=True)[1])


@pytest.mark.parametrize("periodic", ["xy", "x"])
def test_centroids_lie_in_the_cell_whichever_images_a_file_has(periodic):
    graph, ids = jammed(24, 3), np.arange(24)
    away = np.random.default_rng(1).integers(-2, 3, (24, 2)) * [1, periodic == "xy"]
    i, j = graph.contacts.T
    moved = graph.replace(
        x=graph.x + away @ graph.cell.T, images=graph.images - away[j] + away[i], x0=None
    )
    along = True, periodic == "xy"
    one, two = (
        loop_table(Snapshot(g, LAW, g.contacts[:, 0] * 0 + 1, ids, 0, (), periodic=along))
        for g in (graph, moved)
    )
    place = np.linalg.solve(graph.cell, two[["x", "y"]].T)
    assert (place[0] >= 0.0).all() and (place[0] < 1.0).all()
    np.testing.assert_allclose(two[["x", "y"]], one[["x", "y"]], rtol=0.0, atol=1e-12)
