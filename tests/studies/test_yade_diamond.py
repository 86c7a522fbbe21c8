"""The diamond computed with Yade against the closed forms and the platform."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from loops import InputError
from patterns import sample_path
from studies.yade_diamond.__main__ import main
from studies.yade_diamond.comparison import compare, platform_check
from studies.yade_diamond.convergence import convergence_rows
from studies.yade_diamond.probes import read_probes

SAMPLE = sample_path("yade_diamond")
# Yade's own first-order error at its step of 1e-5 in strain: one shear increment too many.
YADE = {"error_F1": 3e-5, "error_F2": 3e-5, "error_T": 4e-4}


@pytest.fixture(scope="module")
def probes():
    return read_probes(SAMPLE)


@pytest.fixture(scope="module")
def rows(probes):
    return pd.DataFrame([compare(probe) for probe in probes])


def test_sample_holds_every_kind(rows):
    kinds = set(rows.groupby(["increment", "contacts"]).groups)
    assert kinds == {(i, c) for i in ("branch", "radii") for c in ("sticking", "sliding")}
    assert sum(path.stat().st_size for path in SAMPLE.iterdir()) < 300_000


def test_forces_agree_to_yades_step(rows):
    for name, bound in YADE.items():
        assert rows[name].max() < bound
        assert rows[name].max() > bound / 100  # the comparison is not with itself
    # N is a function of the geometry: no step in it, only Yade's rounding over 38,000 steps.
    assert rows.error_N.max() < 1e-11


def test_yades_rule_at_yades_step_gives_yades_forces(rows):
    assert rows.replay_T.max() < 2e-12


def test_the_other_increment_does_not_agree(probes):
    for probe in probes:
        other = "radii" if probe.increment == "branch" else "branch"
        if probe.confinement == 0.3 and not probe.slides:
            assert compare(replace(probe, increment=other))["error_T"] > 0.2


def test_friction_decides(probes):
    sliding = [probe for probe in probes if probe.slides]
    assert len(sliding) == 6
    assert min(compare(replace(p, mu=1.1 * p.mu))["error_T"] for p in sliding) > 1e-3


def test_error_is_first_order_in_yades_step():
    rows = convergence_rows(SAMPLE)
    steps = np.log([row["steps"] for row in rows])
    for name in ("error_F1", "error_F2", "error_T"):
        orders = -np.diff(np.log([row[name] for row in rows])) / np.diff(steps)
        np.testing.assert_allclose(orders, 1.0, atol=1e-3)
    assert max(row["error_N"] for row in rows) < 1e-12
    # The strains of the record carry Yade's rounding of positions over up to 53,000 steps.
    assert max(row["replay_T"] for row in rows) < 1e-10


def test_operator_and_path_solver_agree_with_the_closed_form(probes):
    for probe in probes:
        found = platform_check(probe)
        assert found["rates"] < 5e-15
        assert found["path"] < 1e-12


def test_study_writes_its_results(tmp_path, capsys):
    main(tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        *(f"{table}.{end}" for table in ("probes", "convergence") for end in ("parquet", "csv")),
        *("summary.json", "yade_diamond.png", "yade_diamond.svg"),
    }
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert sum(kind["probes"] for kind in summary["worst"].values()) == 13
    assert "radii, sliding" in capsys.readouterr().out


def test_missing_tables_are_named(tmp_path):
    with pytest.raises(InputError, match=r"probes\.csv\.gz: got no such file"):
        read_probes(tmp_path)
