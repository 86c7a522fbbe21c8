"""Yade's slow biaxial compression, of the collection of samples that GRAINLOOPS_DEM names."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from patterns import read_snapshot
from studies.series.evolution import loop_increments, track_loops
from studies.series.skill import score_skill

COLLECTION = Path(os.environ.get("GRAINLOOPS_DEM") or "none") / "yade-slow"
in_collection = pytest.mark.collection


def slow(number):
    macro = pd.read_csv(COLLECTION / "macro.csv").set_index("snap").loc[number]
    return read_snapshot(
        COLLECTION / f"grains_{number:02d}.parquet",
        cell=macro[["h_xx", "h_xy", "h_yx", "h_yy"]].to_numpy(float).reshape(2, 2),
        shear_increment="radii",
    ), float(macro.time)


def strain_between(before, after):
    return np.eye(2) - after.graph.cell @ np.linalg.inv(before.graph.cell)


def predicted(before, after, changes):
    """AUC of the changes for what the loops did between two snapshots."""
    one, two = before, after
    table = loop_increments(one, two, track_loops(one, two))
    actual = np.full(len(one.faces.loops), np.nan)
    actual[table["loop_before"]] = table["w2"]
    return score_skill(-changes(one.faces).normalised_work, actual, signed=True)["auc"]
