"""The sweep of drained paths: errors, statuses and what it writes."""

import json

import numpy as np
import pyarrow.parquet
import pytest
from mpmath import mp

from patterns.diamond import TABLE_1, TABLE_2, drained_end
from studies.sweep.__main__ import main
from studies.sweep.methods import EXACT, PER_PATH, compare
from studies.sweep.point_b import RANGES, exact_point_b, point_b_by_steps, random_diamonds
from tests.oracles import diamond_mpmath as oracle

# Values at B, E1, E2, s1, of the theory note (section 5), and the branch angle there.
POINT_B = {
    TABLE_1: (0.40973434897033423289, 0.164934999828385506, 0.25400990008305293503),
    TABLE_2: (0.41619122318013548716, -0.072382919123994869769, 0.31215593602737202138),
}


def row(table):
    return table.alpha0, table.kappa, table.phi, table.confinement


def angle(table, B):
    return float(np.arctan(np.tan(table.alpha0) * (1.0 - B[1]) / (1.0 - B[0])))


@pytest.fixture(scope="module")
def compared():
    return compare(random_diamonds(2_000, seed=3), checked=20, paths=25, seed=3, repeats=1)


@pytest.mark.parametrize("table", POINT_B, ids=["Table 1", "Table 2"])
def test_point_b_of_the_tables(table):
    B = POINT_B[table]
    assert exact_point_b(row(table), angle(table, B), 1) == pytest.approx(B, abs=2e-16)
    assert point_b_by_steps(row(table), "DOP853", 1e-12) == pytest.approx(B, abs=1e-12)


def test_quadrature_agrees_with_the_tests_own():
    falling = (0.4, 0.5, 0.01, 0.65)
    end = drained_end(*falling)
    assert int(end.direction) == -1
    with mp.workdps(25):
        alpha, E1, E2, s1, *_ = oracle.yield_state(*falling, float(end.state.alpha), -1)
    assert exact_point_b(falling, 1.0001 * float(alpha), -1) == pytest.approx(
        [float(E1), float(E2), float(s1)], abs=1e-15
    )


def test_a_looser_tolerance_errs_more():
    tight, loose = (point_b_by_steps(row(TABLE_1), "DOP853", rtol) for rtol in (1e-12, 1e-4))
    assert 1e-9 < np.abs(np.subtract(tight, loose)).max() < 1e-3


def test_a_path_without_yield_is_said():
    assert point_b_by_steps((1.4, 0.05, 0.6, 0.5), "RK45", 1e-6) is None


def test_errors_of_the_methods(compared):
    _, rows = compared
    assert [item["method"] for item in rows] == [EXACT, *PER_PATH]
    exact, default, _, tight = rows
    assert exact["error_max"] < 1e-13
    assert tight["error_max"] < 1e-9 < default["error_max"]
    assert [item["paths"] for item in rows] == [2_000, 25, 25, 25]


def test_draw_stays_in_its_ranges():
    drawn = random_diamonds(5_000, seed=4)
    drawn[:, [0, 2]] = np.degrees(drawn[:, [0, 2]])
    low, high = np.array(list(RANGES.values())).T
    assert np.all((drawn >= low) & (drawn <= high))
    np.testing.assert_allclose(drawn.mean(axis=0), 0.5 * (low + high), rtol=0.05)


def test_study_writes_its_results(tmp_path, capsys):
    main(tmp_path / "out", diamonds=500, checked=5, paths=5, seed=5, repeats=1)
    out = tmp_path / "out"
    names = {path.name for path in out.iterdir()}
    assert names == {
        *("sweep.parquet", "methods.parquet", "methods.csv", "summary.json"),
        *("sweep.png", "sweep.svg"),
    }
    summary = json.loads((out / "summary.json").read_text())
    assert sum(summary["status"].values()) == summary["diamonds"] == 500
    table = pyarrow.parquet.read_table(out / "sweep.parquet").to_pandas()
    friction = np.tan(np.radians(table.phi_deg)) * table.N
    yields = table.status == "yield"
    np.testing.assert_allclose(np.abs(table["T"])[yields], friction[yields], rtol=1e-9)
    assert table.E1.isna().equals(table.status == "none")
    assert "500 diamonds" in capsys.readouterr().out
