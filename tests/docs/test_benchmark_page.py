"""`docs/benchmark.md`: its numbers are those of the study, its recipe prints what it says."""

import io
import re
from contextlib import redirect_stdout

import pandas as pd
import pytest

from stability.packing.indicators import EXPECTED
from studies.examples.indicators import COMPARED, STRUCTURAL, winners
from tests.docs.pages import DOCS, page, says, section, tables

TEXT = page("benchmark")
(DEFINED,) = tables(section(TEXT, "## Definitions"))
TITLES = {"W2 < 0": "W2_negative", "least affine tenth": "nonaffine"}
TITLES |= {"contact lost": "contact_lost", "topology changed": "topology"}
NAMES = {"rate problem": "packing", "path": "packing_path", "own motion": "own_motion"}


def measured():
    """What `studies.examples.indicators` wrote, kept beside its figure."""
    return pd.read_csv(DOCS / "figures/benchmark.csv")


def agrees(token, value):
    assert token == "-" if pd.isna(value) else says(token, value), (token, value)


def test_every_indicator_is_defined_with_its_sign():
    signs = {}
    for row in DEFINED:
        for name in re.findall(r"`(\w+)`", row["indicator"]):
            signs[name] = {"+": 1, "-": -1}[row["sign"]]
            assert row["source"]
    assert signs.keys() == set(STRUCTURAL)
    assert {name: signs[name] for name in EXPECTED} == EXPECTED


def test_winners_are_those_of_the_study():
    (rows, *_) = tables(section(TEXT, "## Which one wins"))
    best = {(one["target"], one["step"]): one for one in winners(measured())}
    assert len(rows) == len(best) > 8
    for told in rows:
        one = best[TITLES[told["target"]], float(told["step"])]
        assert told["best indicator"].strip("`") == one["best"]
        auc, low, high = re.match(r"(\S+)(?: \((\S+) to (\S+)\))?", told["AUC"]).groups()
        agrees(auc, one["auc"])
        if low is None:
            assert pd.isna(one["low"])
        else:
            agrees(low, one["low"])
            agrees(high, one["high"])
        for title in ("rate problem", "path", "replay", "own motion", "persistence"):
            agrees(told[title], one[NAMES.get(title, title)])
        agrees(told["base rate"], one["base"])
        assert told["packings"] == str(one["packings"])


def test_all_predictors_stand_on_the_page():
    rows = measured().set_index(["target", "predictor", "step"]).auc
    (table,) = tables(section(TEXT, "## All predictors"))
    assert {told["predictor"].strip("`") for told in table} <= set(COMPARED)
    steps = [title for title in table[0] if title != "predictor"]
    for told in table:
        for title in steps:
            target, step = title.split(", ")
            auc = rows.get((TITLES[target], told["predictor"].strip("`"), float(step)))
            agrees(told[title], auc)


@pytest.mark.slow
def test_the_recipe_prints_what_stands_below_it():
    code, text = re.search(r"```python\n(.*?)```\n```text\n(.*?)```", TEXT, re.DOTALL).groups()
    said = io.StringIO()
    with redirect_stdout(said):
        exec(code, {})
    assert said.getvalue().rstrip() == text.rstrip()
