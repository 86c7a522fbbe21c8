"""`docs/benchmark.md`: its numbers are those of the study, its recipe prints what it says."""

import io
import re
from contextlib import redirect_stdout

import numpy as np
import pandas as pd
import pytest

from stability.packing.loop_quantities import EXPECTED
from studies.examples.indicators import COMPARED, STRUCTURAL, winners
from tests.docs.pages import DOCS, page, says, section, tables

TEXT = page("benchmark")
(DEFINED,) = tables(section(TEXT, "## Definitions"))
TITLES = {"W2 < 0": "W2_negative", "least affine tenth": "nonaffine"}
TITLES |= {"contact lost": "contact_lost", "topology changed": "topology"}
NAMES = {"rate problem": "packing", "path": "packing_path", "own motion": "own_motion"}


def measured():
    """What `studies.examples.indicators` wrote, without the large steps of LAMMPS' sample."""
    found = pd.read_csv(DOCS / "figures/benchmark.csv")
    return found[found.step < 0.01]


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


def test_means_of_packings_are_those_behind_the_table():
    """Their intervals stand on the page, their means are the table's."""
    own = pd.read_csv(DOCS / "figures/benchmark-packings.csv")
    (rows,) = tables(section(TEXT, "## Data"))
    for told in rows:
        name = re.findall(r"`([\w-]+)`", told["packing"])[0]
        for step in ("2e-5", "1e-4", "1e-3"):
            kept = own[(own.packing == name) & (own.step == float(step))]
            counts = {str(n) for n in kept[kept.predictor == "order"].intervals} or {"-"}
            assert counts == {told[f"steps of {step}"]}
    single = own.groupby(["step", "target", "predictor"]).auc.mean()
    for row in measured().itertuples():
        if not pd.isna(row.auc):
            mean = single[row.step, row.target, row.predictor]
            assert row.auc == pytest.approx(mean, abs=1e-12)
    followed = own[(own.predictor == "replay") & (own.target == "W2_negative")]
    assert dict(followed.groupby("step").size()) == {2e-5: 8, 1e-4: 8, 1e-3: 4}


def test_the_sample_of_lammps():
    """Its AUCs in the words, means over the intervals; its steps are its own."""
    every = pd.read_csv(DOCS / "figures/benchmark.csv")
    own = every[every.step > 0.01]
    assert (own.packings <= 1).all() and own[own.predictor == "order"].intervals.sum() == 3 * 4
    words = r"LAMMPS'.*?rate problem is at (\S+) .*?grains \((\S+)\).*?eigenvalue \((\S+)\)"
    said = re.search(words, TEXT, re.DOTALL).groups()
    for token, name in zip(said, ("packing", "order", "packing_lambda_min"), strict=True):
        row = own[(own.target == "W2_negative") & (own.predictor == name)]
        agrees(token, np.average(row.auc, weights=row.intervals))
    lost = own[(own.target == "contact_lost") & own.auc.notna()]
    means = [np.average(r.auc, weights=r.intervals) for _, r in lost.groupby("predictor")]
    assert max(means) < 0.62


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


def test_the_recipe_prints_what_stands_below_it():
    code, text = re.search(r"```python\n(.*?)```\n```text\n(.*?)```", TEXT, re.DOTALL).groups()
    said = io.StringIO()
    with redirect_stdout(said):
        exec(code, {})
    assert said.getvalue().rstrip() == text.rstrip()
