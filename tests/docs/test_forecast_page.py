"""The page on forecasts: its numbers are those of the scores, which the tool wrote."""

import re

import pandas as pd

from studies.forecast import PARTS, calibration
from tests.docs.pages import DOCS, page, tables
from tests.docs.test_how_to import words

SCORES = pd.read_csv(DOCS / "figures/forecast.csv")


def test_the_how_to_is_short():
    assert words(page("forecast")) < 600
    for name in re.findall(r"\(figures/(.*?)\)", page("forecast")):
        assert (DOCS / "figures" / name).is_file()


def test_rows_of_the_tables_are_the_scores():
    head, *kinds, _ = tables(page("evidence/forecast"))
    assert len(kinds) == SCORES["kind"].nunique()
    assert sum(int(row["intervals"]) for row in head) == sum(
        calibration().provenance["series"].values()
    )
    for rows, (_, own) in zip(kinds, SCORES.groupby("kind", sort=False), strict=True):
        told = [row for row in own.itertuples() if row.predictor != "base rate"]
        assert len(rows) == len(told)
        for row, score in zip(rows, told, strict=True):
            assert row["predictor"] == score.predictor
            assert float(row["AUC"]) == round(score.auc, 3)
            assert float(row["Brier skill"]) == round(score.brier_skill, 3)
            assert float(row["base rate"]) == round(score.base, 4)
            assert int(row["loops"]) == score.loops


def test_counts_of_all_series_are_those_that_are_stored():
    counts = calibration().shares("lost", "both").groupby("cell")[["true", "loops"]].sum()
    both, one, none = counts[:PARTS], counts[PARTS : 2 * PARTS].sum(), counts.iloc[-1]
    told = [f"{row.true} of {row.loops}" for row in (*both.itertuples(), one, none)]
    (line,) = (one for one in page("evidence/forecast").splitlines() if "fourth quarter" in one)
    assert re.findall(r"\d+ of \d+", line) == told
