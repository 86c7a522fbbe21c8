"""The bench: its oracles against each other, its methods, a quick run."""

import json

import numpy as np
import pytest

from loops import InputError, affine_tangent, traction_tangent
from tests.benchmarks import options
from tests.benchmarks.methods import (
    METHOD_GROUPS,
    Rows,
    direction_methods,
)
from tests.benchmarks.run import GROUPS, SECONDS, chosen_groups, run_bench
from tests.command import run
from tests.oracles.hard_cases import hard_case
from tests.oracles.loop_balls import exact_tangent


@pytest.mark.parametrize("order", [3, 4, 5])
@pytest.mark.parametrize("closure", [affine_tangent, traction_tangent])
def test_oracle_of_freely_rolling_rings(order, closure):
    """Against the least-squares solve in double precision, which shares nothing with it."""
    scene = hard_case("gear-mode").build(order)
    name = closure.__name__.removesuffix("_tangent")
    exact = exact_tangent(scene.graph, scene.law, scene.regime, name, "free")
    found = closure(scene.graph, scene.law, spins="free").matrix
    np.testing.assert_allclose(found, exact, atol=1e-13)


def test_sampled_directions_converge_and_the_cone_is_exact():
    rows = direction_methods(quick=True)
    sampled = [row.error for row in rows if row.method == "sampled: fraction"]
    assert sampled[1] < 0.2 * sampled[0]
    assert max(row.error for row in rows if row.default) < 1e-15


def test_a_row_counts_time_per_item_and_memory():
    rows = Rows("g", "o", quick=True)
    rows.add("m", "s", lambda: np.ones(125_000), 0.0, items=10)
    (row,) = rows
    assert 0.0 < row.seconds_per_item < 1.0
    assert 1.0e6 <= row.peak_bytes < 1.1e6


def test_groups_are_chosen_by_name():
    own = {"options", "hard-cases", "smallest-model"}
    assert set(chosen_groups(None)) == {*METHOD_GROUPS, *own}
    with pytest.raises(InputError, match="hard-cases"):
        chosen_groups("paths,nothing")


def test_a_run_tells_how_long_it_takes_and_each_part_that_is_finished(
    monkeypatch, capsys, tmp_path
):
    for name in ("paths", "options"):
        monkeypatch.setitem(GROUPS, name, lambda quick: [])
    asked = ["bench", "--only", "options,paths", "--out", tmp_path]
    assert run(*asked) == 0
    told = capsys.readouterr().err.splitlines()
    assert told == [
        "grainloops bench: 2 parts (options, paths) take about 2.9 minutes",
        "grainloops bench: options finished in 0 s",
        "grainloops bench: paths finished in 0 s",
    ]
    assert set(SECONDS) == set(chosen_groups(None))
    for more in (["--quick"], ["--quiet"]):
        assert run(*asked, "--force", *more) == 0
        assert capsys.readouterr().err == ""


def test_the_command_refuses_unknown_groups(tmp_path, capsys):
    out = tmp_path / "o"
    assert run("bench", "--out", out, "--only", "speed") == 2
    assert "speed" in capsys.readouterr().err
    assert not out.exists()
    assert run("bench", "--out", out, "--quick", "--only", "closures") == 0
    assert "closures, n = 6" in capsys.readouterr().out
    closures = json.loads((tmp_path / "o" / "summary.json").read_text())["groups"]
    assert closures["closures, n = 6"]["defaults"][0]["method"] == "numpy"


def test_outside_a_checkout_the_command_says_so_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("studies.commands.loops.__file__", str(tmp_path / "a" / "b" / "loops.py"))
    assert run("bench", "--out", tmp_path / "o") == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    assert "checkout of the project" in said.err
    assert not (tmp_path / "o").exists()


@pytest.mark.slow
def test_the_hard_cases_as_the_command_runs_them(tmp_path):
    summary = run_bench(tmp_path / "bench", quick=True, only="hard-cases")["hard_cases"]
    assert summary["unexpected"] == [] and summary["paths_missed"] == []
    assert summary["wrong_signs"] == summary["over_bound"] == 0
    assert (tmp_path / "bench" / "stiff.png").exists()


@pytest.mark.slow
def test_a_finer_option_errs_less():
    """Intervals, rates and steps; three of each, as of every option, make a curve."""
    for part in (options.intervals, options.rates, options.steps):
        errors = [row.error for row in part(quick=True)]
        assert len(errors) == 3
        assert errors == sorted(errors, reverse=True), part.__name__
        assert errors[-1] < 0.4 * errors[0], part.__name__
