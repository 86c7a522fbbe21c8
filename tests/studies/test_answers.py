"""Answers that could mislead: shares state of what, units are named, no hidden closure."""

import json
import re

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from stability import branch_fraction
from studies.commands.snapshot import _snapshot_lines
from studies.series.run import LONG_STEP, long_steps
from studies.snapshot.summary import main_judge, verdict_shares
from tests.command import run, run_snapshot
from tests.docs.pages import page

SAMPLE = gl.sample_path()


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """Folder, summary and table of the walled sample, its loops judged in place too."""
    out = tmp_path_factory.mktemp("judged") / "out"
    summary = run_snapshot(SAMPLE, out, in_packing="auto", figures=False)
    return out, json.loads((out / "summary.json").read_text()), summary


def test_every_share_states_the_loops_that_it_counts(judged):
    out, summary, whole = judged
    table = pd.read_parquet(out / "loops.parquet")
    orders = pd.read_parquet(out / "orders.parquet").set_index("order")
    four = table[table["order"] == 4]
    unknown = four["traction_free_lambda_min"].isna()
    assert 0 < unknown.sum() < len(four)
    judged_loops = summary["unstable_by_order"]["traction_free"]["4"]
    every = summary["undetermined_by_order"]["traction_free"]["4"]
    assert (judged_loops["count"], every["count"]) == ((~unknown).sum(), len(four))
    assert every["mean"] == pytest.approx(unknown.mean())
    assert orders.loc[4, "traction_free_undetermined_loops"] == pytest.approx(unknown.mean())
    line = next(line for line in _snapshot_lines(whole) if "traction, spins free" in line)
    assert f"4: 100 % ({(~unknown).sum()} of {len(four)})" in line
    assert re.search(r"3: 0 %  4", line), "no brackets where every loop is judged"


def test_loops_of_four_are_undetermined_where_all_contacts_stick_and_never_in_place(judged):
    table = pd.read_parquet(judged[0] / "loops.parquet")
    four = table[table["order"] == 4]
    assert (four["traction_free_lambda_min"].isna() == (four["sliding_contacts"] == 0)).all()
    assert four["packing_lambda_min"].notna().all()


def test_the_packing_comes_first_where_it_is_solved(judged):
    summary = judged[2]
    assert next(iter(summary["unstable_by_order"])) == "packing"
    lines = _snapshot_lines(summary)
    start = next(k for k, line in enumerate(lines) if line.startswith("unstable loops"))
    assert lines[start + 1].lstrip().startswith("in its packing")
    one, none = np.array([0.1]), np.array([np.nan])
    table = {"packing_lambda_min": one, "traction_lambda_min": one}
    assert main_judge({"traction_lambda_min": one}) == "traction"
    assert main_judge(table | {"packing_lambda_min_held": one}) == "packing"
    # Withheld: the state moves.
    assert main_judge(table | {"packing_lambda_min_held": none}) == "traction"


@pytest.mark.parametrize(
    ("smallest", "unstable", "undetermined"),
    [
        ([-1.0, 1.0, np.nan, np.nan], 0.5, 0.5),
        ([np.nan, np.nan], np.nan, 1.0),
        ([-1e-14, 1.0], 0.0, 0.0),
        ([], np.nan, np.nan),
    ],
)
def test_shares_of_verdicts(smallest, unstable, undetermined):
    found = verdict_shares(np.array(smallest))
    np.testing.assert_array_equal(found, (unstable, undetermined))


def test_steps_too_long_for_rates_are_named():
    steps = [np.nan, 2e-5, 0.039, LONG_STEP]
    table = pd.DataFrame({"snapshot": [3, 4, 5, 7], "step_strain": steps})
    (told,) = long_steps(table)
    assert "more than 1e-4 from snapshot 4 to 5 by 0.039: rates" in told
    assert not long_steps(table.drop(index=2))


@pytest.mark.parametrize("question", ["tangents", "work", "fraction", "envelope", "path", "rates"])
def test_one_loop_has_no_default_closure(question):
    ring, law = gl.regular_polygon(5, strain=0.1), gl.LinearFrictional(1.0, 0.2, 0.3)
    snapshot, scene = gl.read_snapshot(SAMPLE), gl.Scene(ring, law)
    ask = {
        "tangents": lambda: gl.loop_tangents(snapshot.graph, snapshot.law, snapshot.faces),
        "work": lambda: gl.directional_work(ring, law, [[1.0, 0.0]]),
        "fraction": lambda: branch_fraction(ring, law),
        "envelope": lambda: gl.plot.envelope(ring, law),
        "path": lambda: gl.follow(scene, gl.Stage("drained_biaxial", "H11", 0.2)),
        "rates": lambda: gl.rates_at(scene, "drained_biaxial"),
    }[question]
    with pytest.raises(gl.InputError, match="closure: got None, expected affine or traction"):
        ask()


def test_the_units_of_one_eigenvalue():
    """The three numbers of one loop, as the page has them, and named where they stand."""
    (block,) = re.findall(r"```python\n(.*?)```", page("questions"), re.DOTALL)
    given = {}
    exec(block, given)
    verdict, row = given["verdict"], given["row"]
    assert verdict.over_kn == pytest.approx(row, rel=1e-12)
    rows = re.findall(r"^\| `verdict\..*?\| (\S+) \|", page("questions"), re.MULTILINE)
    told = [round(verdict.lambda_min), round(row, 4), round(verdict.margin, 4)]
    assert [float(number) for number in rows] == told
    said = repr(verdict)
    for name in ("lambda_min (unit of K): ", "lambda_min/kn: ", "margin lambda_min/|K|: "):
        assert name in said
    assert "unit: force/length" in repr(gl.traction_tangent(given["loop"].graph, given["loop"].law))
    units = gl.loop_table(given["snapshot"]).attrs["column_units"]
    assert (units["traction_lambda_min"], units["pressure"]) == ("kn", "force/length")


def test_a_loop_read_as_linear_names_the_law_of_hertz():
    ring = gl.regular_polygon(5, strain=0.01)
    law = gl.LinearFrictional(1.0, 0.2, 0.3)
    overlap = gl.contact_state(ring).overlap
    wrong = ring.replace(normal_force=2 / 3 * law.kn * overlap)
    stage = gl.Stage("drained_biaxial", "H11", 0.2)
    with pytest.raises(gl.InputError, match="law='hertz'"):
        gl.follow(gl.Scene(wrong, law), stage, closure="affine")
    other = ring.replace(normal_force=0.5 * law.kn * overlap)
    with pytest.raises(gl.InputError, match=r"normal force of contact 0.*law\.normal_force"):
        gl.follow(gl.Scene(other, law), stage, closure="affine")


def test_a_series_says_that_it_wants_a_list(tmp_path):
    with pytest.raises(gl.InputError, match=r"one text.*sorted\(glob"):
        gl.series(str(tmp_path / "grains_*.csv"))
    table = gl.series(one for one in [gl.read_snapshot(SAMPLE)])
    assert len(table) == 309


@pytest.mark.parametrize("command", ["polygon", "domain"])
def test_a_law_is_listed_once_and_serves_both_kinds_of_loops(command, capsys):
    assert run(command, "--help") == 0
    assert len(re.findall(r"^.{0,4}--law\b", capsys.readouterr().out, re.MULTILINE)) == 1
    asked = (command, "--order", "5", "--law", "bonded", "--out", "none")
    assert run(*asked) == 2
    assert "--law: got 'bonded', expected linear or hertz" in capsys.readouterr().err


def test_sustain_takes_its_snapshot_by_place(capsys):
    assert run("sustain", "--help") == 0
    said = capsys.readouterr().out
    assert "--path" not in said and "PATH" in said
