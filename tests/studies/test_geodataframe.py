"""Loops as polygons of GeoPandas, by shapely's own measures."""

import sys

import numpy as np
import pandas as pd
import pytest

import grainloops as gl

SAMPLES = {
    "between walls": lambda: gl.read_snapshot(gl.sample_path()),
    "periodic": lambda: gl.read_snapshot(
        gl.sample_path("grains_periodic.parquet"), cell=gl.sample_cell()
    ),
}


@pytest.fixture(params=SAMPLES)
def sample(request):
    return SAMPLES[request.param]()


def test_polygons_have_the_table_s_shapes(sample):
    pytest.importorskip("geopandas")
    table, frame = gl.loop_table(sample), gl.to_geodataframe(sample)
    assert frame.geometry.is_valid.mean() > 0.99 and frame.crs is None
    assert (frame.geometry.exterior.count_coordinates() == table["order"] + 1).all()
    # Sums of products of coordinates of one cell's size, over polygons of a thousandth of it.
    np.testing.assert_allclose(frame.area, table["area"], rtol=1e-9)
    np.testing.assert_allclose(frame.length, table["perimeter"], rtol=1e-12)
    centre = frame.centroid
    size = np.sqrt(table["area"].to_numpy())
    apart = np.stack([centre.x - table["x"], centre.y - table["y"]])
    if (cell := sample.graph.cell) is not None:
        # Polygons are where the grains are, places of loops in the cell.
        apart -= cell @ np.round(np.linalg.solve(cell, apart))
    assert (np.hypot(*apart) < 1e-6 * size).all()
    assert frame.geometry.exterior.is_ccw.all()
    plain = table.drop(columns="grains")
    pd.testing.assert_frame_equal(pd.DataFrame(frame[list(plain)]), plain, check_exact=True)
    assert frame["grains"][0] == " ".join(map(str, table["grains"][0]))
    assert frame.attrs["units"]


def test_a_table_of_one_s_own_is_taken_and_another_is_refused():
    pytest.importorskip("geopandas")
    snapshot = SAMPLES["between walls"]()
    own = pd.DataFrame({"risk": np.arange(309.0)})
    assert gl.to_geodataframe(snapshot, own)["risk"].tolist() == own["risk"].tolist()
    with pytest.raises(gl.InputError, match="table: got 3 rows, expected one a loop, 309"):
        gl.to_geodataframe(snapshot, own[:3])


def test_without_the_library_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "geopandas", None)
    with pytest.raises(gl.InputError, match=r"pip install grainloops\[geo\]"):
        gl.to_geodataframe(SAMPLES["between walls"]())
