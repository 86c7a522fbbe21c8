"""Each example is imported, run small, and held to a number that it finds."""

import json
import runpy
import sys

import numpy as np
import pytest

from loops import LinearFrictional, affine_tangent
from patterns import regular_polygon
from stability import restrict, spectrum, symmetric_spectrum
from studies.examples import (
    destabilising_control,
    indicators,
    larger_loops,
    printed_rule,
)


def files(folder):
    return {path.name for path in folder.iterdir()}


def test_result_of_an_example(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["three_discs", str(tmp_path / "out")])
    monkeypatch.delitem(sys.modules, "studies.examples.three_discs", raising=False)
    runpy.run_module("studies.examples.three_discs", run_name="__main__")
    endings = ("png", "parquet", "csv")
    assert files(tmp_path / "out") == {"summary.json", *(f"three_discs.{e}" for e in endings)}
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["provenance"]["command"] == "grainloops example three_discs"
    assert json.loads(capsys.readouterr().out)["cases"] == summary["cases"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "example",
    [destabilising_control, indicators, larger_loops, printed_rule],
)
def test_every_example_runs_whole(tmp_path, example):
    numbers = example.main(tmp_path / "out")
    # Means by packing, and the table without them.
    assert numbers and len(files(tmp_path / "out")) == (6 if example is indicators else 4)


def test_an_example_without_a_folder_says_what_it_takes(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["printed_rule"])
    with pytest.raises(SystemExit, match=r"studies\.examples\.printed_rule RESULT_FOLDER"):
        from studies.examples import run_example

        run_example(printed_rule.main)


@pytest.mark.slow
def test_printed_rule_leaves_coulombs_cone():
    """Integrated from (8c) and the balance by hand: T = 2 mu N_B - mu N beyond B."""
    curves, numbers = printed_rule.compare_rules()
    found = {(row["table"], row["rule"]): row for row in numbers}
    for table, ratio in ((1, 1.1864284), (2, 1.2507328)):
        assert found[table, "coulomb"]["shear_ratio"] == pytest.approx(1.0, abs=1e-14)
        assert found[table, "printed"]["shear_ratio"] == pytest.approx(ratio, abs=1e-7)
        beyond = curves[(curves.table == table) & (curves.rule == "printed")].shear_ratio
        beyond = beyond[beyond > 1.0 + 1e-12].to_numpy()
        assert len(beyond) > 50 and (np.diff(beyond) > -1e-15).all()
    # T of every row against what the rules integrate to from B on, B against the exact path.
    assert max(row["error_of_T"] for row in numbers) < 2e-13
    assert all(row["E1_end"] == pytest.approx(0.6, abs=1e-15) for row in numbers)


@pytest.mark.slow
def test_controls_lose_strength():
    """Isotropic: no slope at the state. Inside the cone: falls in both senses, with slope W2."""
    for name in destabilising_control.LOOPS:
        rows = destabilising_control.responses(name)
        assert abs(rows[0]["slope"]) < 1e-14
        for row in rows[2:]:
            early = (row["strain"] > 0) & (row["strain"] < 0.01)
            slope = row["strength"][early] / row["strain"][early]
            assert row["slope"] < -1e-3 and (slope < 0).all()
            np.testing.assert_allclose(slope, row["slope"], rtol=0.3)
        assert any(row["strength"][-1] < 0 for row in rows[:2])


@pytest.mark.parametrize("order", [3, 5, 8])
def test_chiral_regular_loops_flutter_in_closed_form(order):
    # Shear alike in all contacts: lambda = (n l^2/4 V) (kn + kt - N/l +- i T/l), while W2 > 0.
    N, T, kt = 0.15, 0.06, 0.4
    graph = regular_polygon(order)
    graph = graph.replace(normal_force=np.full(order, N), shear_force=np.full(order, T))
    K = restrict(affine_tangent(graph, LinearFrictional(kn=1.0, kt=kt)).matrix, "symmetric")
    factor = np.tan(np.pi / order)
    pair = factor * (1 + kt - N + 1j * np.array([-T, T]))
    found = spectrum(K)
    np.testing.assert_allclose(
        np.sort_complex(found[np.abs(found.imag) > 1e-9]), np.sort_complex(pair), rtol=1e-12
    )
    assert (symmetric_spectrum(K) > 0.0).all()


def test_thresholds_of_other_laws_are_their_closed_forms():
    for nu in larger_loops.POISSON:
        law = larger_loops.HertzMindlin(young=1.0, poisson=nu)
        kappa = float(law.stiffness_ratio)
        assert larger_loops.threshold(6, law) == pytest.approx(kappa / (kappa + 2 / 3), abs=1e-13)
    law = larger_loops.RollingResistance(larger_loops.LINEAR, k_r=0.03)
    wanted = larger_loops.rolling_threshold(8, larger_loops.KAPPA, 0.03)
    # The hexagon's compliance sums eight contacts: some tens of roundings.
    assert larger_loops.threshold(8, law, "free") == pytest.approx(wanted, abs=1e-13)
    seconds = larger_loops.tangent_seconds((6, 12), 60)
    assert (seconds > 0).all()
