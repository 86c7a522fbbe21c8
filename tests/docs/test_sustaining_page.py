"""`docs/evidence/sustaining.md`: its loads and limits against the tables behind its figures."""

import numpy as np
import pandas as pd
import pytest

from tests.docs.pages import DOCS, page, says, section, tables
from tests.stability.packing.yade_rest import bracket, yade_rest

LOADS = pd.read_csv(DOCS / "figures/sustaining.csv")
# Largest load over the one under which the sample of Yade moved.
BEYOND = 1.5
(BESIDE,) = tables(section(page("evidence/sustaining"), "## Against Yade"))


@pytest.mark.parametrize("told", BESIDE, ids=lambda told: f"{told['state']} {told['degrees']}")
def test_loads_are_those_of_the_table_and_of_yade(told):
    at = (LOADS["state"] == told["state"]) & (LOADS["degrees"] == float(told["degrees"]))
    (row,) = LOADS[at].itertuples()
    levels = yade_rest(row.state)[2][row.degrees]
    np.testing.assert_allclose([row.held, row.moved], bracket(levels), rtol=1e-5)
    assert says(told["Yade held (N/m)"], row.held) and says(told["Yade moved (N/m)"], row.moved)
    limit = told["limit (N/m)"].removesuffix(" (not converged)")
    assert says(limit, row.limit)
    assert (limit != told["limit (N/m)"]) == np.isinf(row.limit_spread)
    assert says(told["its spread"], row.limit_spread)
    large = told["first large motion (N/m), strain"]
    if np.isnan(row.first_large_load):
        largest = BEYOND * row.moved
        assert row.status == "held" and says(large.removeprefix("none up to "), largest)
    else:
        load, strain = large.split(", ")
        assert says(load, row.first_large_load) and says(strain, row.first_large_strain)


def test_counts_of_the_page():
    known = LOADS[["limit", "first_large_load"]].to_numpy()
    low, high = LOADS[["held"]].to_numpy(), LOADS[["moved"]].to_numpy()
    inside = ((low <= known) & (known <= high)).any(axis=1)
    near = ((low <= 1.03 * known) & (known <= 1.03 * high)).any(axis=1)
    off = LOADS["limit"] * LOADS["limit_spread"]
    reached = (LOADS["limit"] - off <= LOADS["moved"]) & (LOADS["held"] <= LOADS["limit"] + off)
    within, count = inside | reached, len(LOADS)
    counts = f"{within.sum()} of {count}, and within 3 % in {near.sum()} of {count}"
    for name, of in (("evidence/sustaining", ""), ("sustaining", " of three states")):
        told = " ".join(page(name).split())
        assert (
            f"in {inside.sum()} of {count} directions{of}, within `limit_spread` in {counts}"
            in told
        )
