"""Skill of the packing's rate problem on real series, held to what it was measured to be."""

import json
import os
from pathlib import Path

import pytest

from studies.examples import packing_skill
from studies.series import run_series

FOLDER = Path(os.environ.get("GRAINLOOPS_DEM", "")) / "yade-slow"


def test_packing_skill_of_the_sample_series(tmp_path):
    """From the script as from the command; its numbers are held beside the command's."""
    numbers = packing_skill.main(tmp_path / "out")
    written = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert written["skill"] == numbers["skill"]
    assert 0.965 < numbers["skill"]["packing"]["auc"] < 0.975
    assert numbers["packing"]["solved"] == numbers["packing"]["intervals"] == 3


@pytest.mark.slow
@pytest.mark.skipif(not (FOLDER / "macro.csv").exists(), reason="no collection of samples")
@pytest.mark.parametrize(
    "first, last, auc, rank, nonaffine, solved",
    [(2, 22, 0.95, 0.90, 0.98, 20), (22, 32, 0.88, 0.77, 0.93, 8), (32, 36, 0.73, 0.53, 0.84, 3)],
    ids=["steps of 2e-5", "steps of 1e-4", "steps of 1e-3"],
)
def test_skill_of_the_slow_series(tmp_path, first, last, auc, rank, nonaffine, solved):
    """The bounds that were asked for, and all intervals solved at 2e-5; measured at 1e-3."""
    paths = [FOLDER / f"grains_{k:02d}.parquet" for k in range(first, last + 1)]
    how = {"cells": FOLDER / "macro.csv", "workers": 1, "figures": False, "in_packing": True}
    summary = run_series(paths, tmp_path / "out", **how)
    skill, others = summary["skill"], summary["skill_of_targets"]
    assert summary["packing"]["solved"] >= solved
    assert summary["packing"]["worst disagreeing"] <= 2
    assert skill["packing"]["auc"] >= auc
    assert skill["packing"]["rank_correlation"] >= rank
    assert others["nonaffine"]["packing"]["auc"] >= nonaffine
    assert skill["persistence"]["auc"] < skill["packing"]["auc"] < skill["own_motion"]["auc"]
