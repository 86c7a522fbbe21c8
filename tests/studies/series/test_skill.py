"""Skill of predictions: against counting pairs one by one, and against what is known of it."""

import json
from itertools import product

import numpy as np
import pandas as pd
import pytest
from scipy.stats import spearmanr

from studies.series.skill import (
    SKILL_COLUMNS,
    actual_values,
    mean_skill,
    score_skill,
    skill_tables,
)


def test_by_hand():
    """Five loops moved; one has no score. Predicted: 1, 2, 3 of which 1, 2 came; 4 was missed."""
    w2 = np.array([-1.0, -0.5, 0.5, -0.2, 0.9, 0.0, -0.3])
    score = np.array([3.0, 1.0, 1.0, -1.0, -2.0, 9.0, np.nan])
    found = score_skill(score, w2, signed=True)
    assert (found["base"], found["coverage"]) == (4 / 6, 5 / 6)
    assert (found["precision"], found["recall"], found["agreement"]) == (2 / 3, 2 / 3, 3 / 5)
    assert found["loops"] == 5
    # Pairs (negative, positive): 3 > 1, 3 > -2, 1 = 1, 1 > -2, -1 < 1, -1 > -2.
    assert found["auc"] == (1 + 1 + 0.5 + 1 + 0 + 1) / 6


@pytest.mark.parametrize("seed", range(5))
def test_against_pairs_and_scipy(seed):
    rng = np.random.default_rng(seed)
    score, w2 = rng.integers(-4, 5, 80).astype(float), rng.normal(size=80)
    found = score_skill(score, w2, signed=False)
    pairs = list(product(score[w2 < 0], score[w2 > 0]))
    auc = np.mean([1.0 if a > b else 0.5 if a == b else 0.0 for a, b in pairs])
    # Sums of 80 ranks and of 1,600 pairs: exact halves, one division.
    assert found["auc"] == pytest.approx(auc, rel=1e-14)
    assert found["rank_correlation"] == pytest.approx(spearmanr(score, -w2)[0], abs=1e-13)
    assert np.isnan([found[key] for key in ("agreement", "precision", "recall")]).all()


def test_a_perfect_score_and_none():
    w2 = np.array([-1.0, 1.0, -2.0, 3.0])
    assert score_skill(-w2, w2, signed=True)["auc"] == 1.0
    assert score_skill(w2, w2, signed=True)["auc"] == 0.0
    assert score_skill(np.zeros(4), w2, signed=True)["auc"] == 0.5
    empty = score_skill(np.full(4, np.nan), w2, signed=True)
    assert (empty["loops"], empty["coverage"]) == (0, 0.0)
    assert np.isnan(empty["auc"])
    assert np.isnan(score_skill(np.zeros(0), np.zeros(0), signed=True)["base"])


def test_the_table_of_a_series(result):
    """One row an interval and predictor; rates as counted from the parts, persistence shifted."""
    table = pd.read_parquet(result / "skill.parquet")
    assert tuple(table.columns) == SKILL_COLUMNS
    assert len(table) == 4 * table.predictor.nunique() == 40
    work = [
        pd.read_parquet(result / "increments" / f"part-0000{k}-0000{k + 1}.parquet")
        for k in range(4)
    ]
    rows = table.set_index(["snapshot_before", "predictor"])
    for k, own in enumerate(work):
        moved = own[own.w2 != 0]
        assert rows.loc[(k, "affine"), "base"] == (moved.w2 < 0).mean()
        known = moved[moved.traction_free_W2.notna()]
        row = rows.loc[(k, "traction_free")]
        assert row.loops == len(known)
        assert row.agreement == ((known.w2 < 0) == (known.traction_free_W2 < 0)).mean()
    assert rows.loc[(0, "persistence"), "loops"] == 0
    joined = work[1].merge(work[0], left_on="loop_before", right_on="loop_after")
    joined = joined[joined.w2_x != 0]
    row = rows.loc[(1, "persistence")]
    assert row.loops == len(joined)
    assert row.recall == (joined.w2_y[joined.w2_x < 0] < 0).mean()


def test_the_summary_tells_base_rate_and_skill(result):
    summary = json.loads((result / "summary.json").read_text())
    table = pd.read_parquet(result / "skill.parquet")
    own = table[table.predictor == "traction_free"]
    mean = np.average(own.recall, weights=own.loops)
    assert summary["skill"]["traction_free"]["recall"] == pytest.approx(mean, rel=1e-14)
    assert summary["skill"]["order"]["precision"] is None
    assert "skill.parquet" in summary["files"]
    assert "persistence" in summary["definitions"]["skill"]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("unknown", [[np.inf, np.inf], [np.nan, np.inf], [np.inf] * 5])
def test_no_strain_between_two_snapshots(unknown):
    """The sample's strain is zero: non-affinity is infinite, or not a number where loops rest."""
    known = np.arange(1.0, 6.0 - len(unknown))
    moved = np.concatenate([unknown, known])
    own = {"loop_before": np.arange(5), "w2": np.zeros(5), "nonaffinity": moved}
    state = {"order": np.full(5, 4), "fate": np.full(5, "survived"), "contact_lost": np.zeros(5)}
    found = actual_values(own, state)["nonaffine"]
    np.testing.assert_array_equal(np.isnan(found), ~np.isfinite(moved))
    np.testing.assert_array_equal(np.flatnonzero(found < 0), [4] if len(known) else [])


def test_without_forces_there_is_nothing_to_predict():
    table, by_order = skill_tables([], [])
    assert mean_skill(table) == {}
    assert by_order.empty
