"""One loop on one page: the same numbers as the tables, the path and the domain by themselves."""

import json

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from tests.command import run

NUMBER = 62


@pytest.fixture(scope="module")
def snapshot():
    return gl.read_snapshot(gl.sample_path())


@pytest.fixture(scope="module")
def found(snapshot):
    return gl.study(snapshot, NUMBER)


def test_closures_are_those_of_the_table_of_loops(snapshot, found):
    row = gl.loop_table(snapshot, in_packing=True).loc[NUMBER]
    closures = found.closures.set_index("closure")
    assert [*closures.index] == ["affine", "traction", "traction_free", "packing"]
    for closure, own in closures.iterrows():
        for name in own.index.drop("verdict"):
            known = row.get(f"{closure}_{name}", np.nan)
            np.testing.assert_equal(own[name], known, err_msg=f"{closure}_{name}")
        assert own["verdict"] == ("stable" if own["lambda_min"] > 0 else "unstable")
    assert [*closures["verdict"]] == ["stable", "stable", "unstable", "stable"]


def test_a_loop_cut_out_has_the_same_closures_and_no_packing(snapshot, found):
    alone = gl.study(gl.loop(snapshot, NUMBER))
    assert [*alone.closures["closure"]] == ["affine", "traction", "traction_free"]
    # Eigenvalues are over the mean kn of the loop's own contacts.
    ratio = snapshot.mean_kn / np.mean(gl.loop(snapshot, NUMBER).law.kn)
    names = ["lambda_min", "lambda_mid", "lambda_max"]
    np.testing.assert_allclose(alone.closures[names], ratio * found.closures[names][:3], rtol=1e-8)
    assert np.array_equal(alone.path.P, found.path.P)


@pytest.mark.slow
def test_the_command_writes_the_page(tmp_path, found):
    out = tmp_path / "loop"
    assert run("loop", gl.sample_path(), "--id", NUMBER, "--out", out) == 0
    asked = ("--loop", NUMBER, "--closure", "traction", "--figures", "determinant")
    words = ("polygon", "--snapshot", gl.sample_path(), *asked, "--out", tmp_path / "p")
    assert run(*words) == 0
    for table in ("path", "polar"):
        of_polygon = pd.read_parquet(tmp_path / "p" / f"{table}.parquet")
        pd.testing.assert_frame_equal(pd.read_parquet(out / f"{table}.parquet"), of_polygon)
    pd.testing.assert_frame_equal(pd.read_parquet(out / "closures.parquet"), found.closures)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["domain"]["present_state"] == "stable"
    page = (out / "report.html").read_text()
    for title in ("Closures", "Loop", "Domain of strains", "Domain of stresses"):
        assert f"{title}.</b>" in page, title


@pytest.mark.parametrize(("words", "said"), [
    (("--id", 10**6), "loop: got 1000000, expected a number from 0 to 308"),
    (("--id", NUMBER, "--programme", "none"), "--programme: got 'none', expected drained"),
    # The figures are named once the loop is done.
    pytest.param(("--id", NUMBER, "--figures", "rose"),
                 "--figures: got 'rose', expected none, closures", marks=pytest.mark.slow),
    ((), "--id"),
])  # fmt: skip
def test_bad_input_is_told_in_one_line(tmp_path, capsys, words, said):
    out = tmp_path / "loop"
    assert run("loop", gl.sample_path(), *words, "--out", out) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") == 1
    assert not out.exists()


def test_a_snapshot_without_a_number_names_it(snapshot):
    with pytest.raises(gl.InputError, match="loop: got none, expected a number from 0 to 308"):
        gl.study(snapshot)


def test_what_has_no_answer_is_left_out_and_told(snapshot, tmp_path, capsys):
    """Contacts of spheres: their closures, no path, and no domain of forces that do not fit."""
    law = ("--law", "hertz", "--young", 7e7, "--poisson", 0.2)
    out = tmp_path / "loop"
    assert run("loop", gl.sample_path(), "--id", NUMBER, *law, "--out", out) == 0
    said = capsys.readouterr().out
    assert "note: no path of this loop: --law: got HertzMindlin, expected linear springs" in said
    assert "note: no domain of this loop: normal force of contact 0: got" in said
    how = {"law": "hertz", "young": 7e7, "poisson": 0.2}
    row = gl.loop_table(gl.read_snapshot(gl.sample_path(), **how, strict=False)).loc[NUMBER]
    closures = pd.read_parquet(out / "closures.parquet").set_index("closure")
    for name in ("affine", "traction", "traction_free"):
        assert closures.loc[name, "lambda_min"] == row[f"{name}_lambda_min"]
    assert closures.loc["packing", "verdict"] == "stable"
    assert {path.name for path in out.iterdir()} == {
        "closures.parquet", "closures.png", "report.html", "summary.json"
    }  # fmt: skip
