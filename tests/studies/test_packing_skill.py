"""Skill of the packing's rate problem on real series, held to what it was measured to be."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from studies.examples import packing_skill

FOLDER = Path(os.environ.get("GRAINLOOPS_DEM", "")) / "yade-slow"


def test_packing_skill_of_the_sample_series(tmp_path):
    packing_skill.main(tmp_path / "out")
    numbers = json.loads((tmp_path / "out" / "summary.json").read_text())
    skill = numbers["skill"]
    assert all(row["status"] == "unique" for row in numbers["intervals"])
    assert max(row["residual"] for row in numbers["intervals"]) < 1e-12
    packing, past = skill["packing W2_negative"], skill["persistence W2_negative"]
    assert packing["auc"] > 0.96 and packing["rank_correlation"] > 0.92
    assert packing["auc"] > past["auc"] + 0.02
    assert packing["auc"] > skill["traction_free W2_negative"]["auc"] + 0.15
    assert skill["packing nonaffine"]["auc"] > 0.99 < skill["packing topology"]["auc"]
    assert 0.25 < packing["base"] < 0.31


@pytest.mark.slow
@pytest.mark.skipif(not (FOLDER / "macro.csv").exists(), reason="no collection of samples")
@pytest.mark.parametrize(
    "first, last, auc, rank, nonaffine, solved",
    [(2, 22, 0.95, 0.90, 0.98, 1.0), (22, 32, 0.88, 0.77, 0.93, 0.8)],
    ids=["steps of 2e-5", "steps of 1e-4"],
)
def test_skill_of_the_slow_series(first, last, auc, rank, nonaffine, solved):
    found = packing_skill.snapshots(FOLDER, FOLDER / "macro.csv")
    how, rows = packing_skill.series_skill(found[first : last + 1])
    own = [row for row in rows if row["predictor"] == "packing"]
    work = [row for row in own if row["target"] == "W2_negative"]
    assert np.mean([row["auc"] for row in work]) > auc
    assert np.mean([row["rank_correlation"] for row in work]) > rank
    assert np.mean([row["auc"] for row in own if row["target"] == "nonaffine"]) > nonaffine
    assert np.mean([row["status"] in ("unique", "several found") for row in how]) >= solved
    assert max(row["disagreeing"] for row in how) <= 2
