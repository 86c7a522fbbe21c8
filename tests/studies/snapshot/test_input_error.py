"""Verdicts with the errors of a file: its digits, a share of the forces; columns and shares."""

import json

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from studies.snapshot.input_error import half_unit
from tests.command import run


@pytest.fixture(scope="module")
def sample():
    return gl.read_snapshot(gl.sample_path())


def written(folder, sample, digits):
    """The sample as a table of so many digits, without the flags of sliding contacts."""
    tables, paths = sample.tables(), []
    for name in ("grains", "contacts"):
        columns = {k: v for k, v in tables[name].items() if k not in ("sliding", "mu", "kn", "ks")}
        paths.append(folder / f"{name}_{digits}.csv")
        pd.DataFrame(columns).to_csv(paths[-1], index=False, float_format=f"%.{digits}g")
    law = {name: float(np.ravel(getattr(sample.law, name))[0]) for name in ("kn", "kt", "mu")}
    return gl.read_snapshot(paths[0], contacts=paths[1], **law)


@pytest.mark.parametrize("digits", [5, 6, 8])
def test_a_file_of_few_digits_has_the_eigenvalues_within_its_errors(tmp_path, sample, digits):
    short, exact = (written(tmp_path, sample, each) for each in (digits, 17))
    assert half_unit(short.graph.x).max() == pytest.approx(
        0.5 * 10.0 ** (np.floor(np.log10(np.abs(short.graph.x).max())) - digits + 1)
    )
    table, known = gl.loop_table(short, input_error="digits"), gl.loop_table(exact)
    assert len(table) == len(known)
    for closure in ("affine", "traction"):
        # The mean kn is that of the command line.
        change = np.abs(table[f"{closure}_lambda_min"] - known[f"{closure}_lambda_min"])
        error = table[f"{closure}_input_error"]
        assert (error > 0.0).all() and (change <= error).mean() > 0.99
        assert (change <= error)[table["sliding_contacts"] == known["sliding_contacts"]].all()
    none = gl.loop_table(exact, input_error="digits")
    assert (none[["affine_input_error", "traction_input_error"]] == 0.0).to_numpy().all()


def test_digits_of_numbers():
    rng = np.random.default_rng(3)
    values = rng.uniform(-1, 1, 200) * 10.0 ** rng.integers(-3, 4, 200)
    rounded = np.array([float(f"{x:.6g}") for x in values])
    np.testing.assert_allclose(
        half_unit(rounded), 0.5 * 10.0 ** (np.floor(np.log10(np.abs(rounded))) - 5), rtol=1e-9
    )
    assert (np.abs(rounded - values) <= half_unit(rounded) * (1.0 + 1e-6)).all()
    fixed = np.round(values, 5)
    np.testing.assert_allclose(half_unit(fixed), 5e-6, rtol=1e-9)
    assert not half_unit(values).any() and not half_unit(np.zeros(4)).any()
    assert not half_unit([]).any()


@pytest.mark.slow
def test_the_command_has_columns_shares_and_a_figure(tmp_path, capsys, sample):
    out = tmp_path / "out"
    words = ("snapshot", gl.sample_path(), "--input-error", "0.1,0.05", "--out", out)
    assert run(*words, "--figures", "certain") == 0
    assert "certain sign, traction" in capsys.readouterr().out
    table, summary = (
        pd.read_parquet(out / "loops.parquet"),
        json.loads((out / "summary.json").read_text()),
    )
    own = gl.loop_table(sample, input_error=(0.1, 0.05))
    for closure in ("affine", "traction"):
        name = f"{closure}_input_error"
        assert np.array_equal(table[name], own[name])
        certain = table[f"{closure}_lambda_min"].abs() > table[f"{closure}_error"] + table[name]
        assert summary["certain_by_order"][closure]["all"]["mean"] == pytest.approx(certain.mean())
        assert certain[table["order"] == 3].all()
    shares = pd.read_parquet(out / "certain.parquet")
    whole = shares[(shares["closure"] == "traction") & (shares["orders"] == "all")]
    assert (np.diff(whole["certain_share"]) <= 1e-12).all()
    assert (out / "certain.png").is_file() and "Certain signs" in (out / "report.html").read_text()


@pytest.mark.parametrize("given", ["few", "-0.1", "0.1,0.2,0.3", "1.5", "0.1,x"])
def test_other_errors_are_refused_in_one_line(tmp_path, capsys, given):
    words = ("snapshot", gl.sample_path(), f"--input-error={given}", "--out", tmp_path / "out")
    assert run(*words) == 2
    told = capsys.readouterr().err
    assert told.startswith("grainloops") or "--input-error: got" in told
    assert "digits, or shares from 0 to 1" in told and told.count("\n") == 1
    assert not (tmp_path / "out").exists()
