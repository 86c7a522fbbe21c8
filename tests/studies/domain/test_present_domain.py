"""Domain of one loop in its present state: programmes in all directions, by closed forms."""

import json

import matplotlib.figure
import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from studies.present_domain import ENDS
from tests.studies.snapshot.test_run import run

KAPPA, START = 0.2, 0.3


@pytest.fixture(scope="module")
def pentagon():
    """A compressed regular pentagon without shear forces, every programme ended by itself."""
    scene = gl.Scene(gl.regular_polygon(5, strain=START), gl.LinearFrictional(1.0, KAPPA, 0.4))
    return gl.loop_domain(scene, "affine", directions=72)


def row_at(found, degrees):
    angle = found.rows["programme_deg"].to_numpy()
    k = np.argmin(np.abs((angle - degrees + 180.0) % 360.0 - 180.0))
    assert angle[k] % 360.0 == pytest.approx(degrees)
    return found.rows.iloc[k]


def test_isotropic_extension_opens_all_contacts_where_they_part(pentagon):
    row = row_at(pentagon, 225.0)
    # Branches of 1 - START grow to 1.
    assert row["kind"] == "opening"
    assert row["E1"] == pytest.approx(1.0 - 1.0 / (1.0 - START), rel=1e-9)
    assert row["s1"] == pytest.approx(0.0, abs=1e-12)


def test_isotropic_compression_loses_stability_where_the_paper_has_it(pentagon):
    row = row_at(pentagon, 45.0)
    critical = (1.0 + KAPPA) / (2.0 + KAPPA)
    assert row["kind"] == "det_Ks_zero"
    assert (1.0 - row["E1"]) * (1.0 - START) == pytest.approx(1.0 - critical, rel=1e-8)


def test_every_programme_ends_once_and_is_counted(pentagon):
    rows = pentagon.rows
    assert len(rows) == 72 and set(rows["kind"]) <= set(ENDS)
    assert np.isfinite(rows[["E1", "E2", "s1", "s2"]]).all(axis=None)
    angle = np.degrees(np.arctan2(rows["E2"], rows["E1"]))
    apart = (angle - rows["programme_deg"] + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(apart, 0.0, atol=1e-6)
    assert pentagon.table().equals(rows) and "present state: stable" in repr(pentagon)


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_the_boundary_is_closed_and_its_line_says_what_ended_it(pentagon, plane):
    ax = gl.plot.domain(pentagon, plane=plane, ax=matplotlib.figure.Figure().add_subplot())
    pieces = [path for drawn in ax.collections[1:] for path in drawn.get_paths()]
    assert len(pieces) == 72
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    shares = [float(word.split("(")[1].split(" ")[0]) for word in words if "%" in word]
    assert sum(shares) == pytest.approx(100.0, abs=1.5)
    origin = np.zeros(2) if plane == "strain" else pentagon.start
    np.testing.assert_array_equal(np.ravel(ax.lines[-1].get_xydata()), origin)


def test_what_is_no_loop_or_has_no_closure_is_refused():
    snapshot = gl.read_snapshot(gl.sample_path())
    with pytest.raises(gl.InputError, match=r"one loop. Cut one out: gl\.loop"):
        gl.loop_domain(snapshot, "traction")
    with pytest.raises(gl.InputError, match="closure: got none"):
        gl.loop_domain(gl.loop(snapshot, 62))


def test_the_command_writes_the_boundary(monkeypatch, capsys, tmp_path):
    out = tmp_path / "out"
    asked = ("domain", "--snapshot", gl.sample_path(), "--loop", 62, "--directions", 9)
    assert run(monkeypatch, *asked, "--closure", "traction", "--out", out) == 0
    rows = pd.read_parquet(out / "boundary.parquet")
    (loop,) = json.loads((out / "summary.json").read_text())["loops"]
    assert loop["ended_by"] == rows["kind"].value_counts().to_dict()
    assert loop["present_state"] == "stable" and "present state stable" in capsys.readouterr().out
    found = gl.loop_domain(
        gl.loop(gl.read_snapshot(gl.sample_path()), 62), "traction", directions=9
    )
    assert rows["kind"].tolist() == found.rows["kind"].tolist()
    np.testing.assert_allclose(rows["E1"], found.rows["E1"], rtol=1e-6, atol=1e-12)
