"""`docs/sustaining.md`: its loads and limits against the table that its script writes."""

import numpy as np
import pandas as pd
import pytest

from tests.docs.pages import DOCS, NUMBER, page, says, section, tables
from tests.tools.sustaining import OF_STATE, figure_of_limits

ROWS = pd.read_csv(DOCS / "figures/sustaining.csv", dtype={"state": str})
FIRST, THIRD = tables(section(page("sustaining"), "## Against Yade"))


@pytest.mark.parametrize("told", [*FIRST, *({"state": "0.030 restarted", **row} for row in THIRD)])
def test_loads_and_limits_are_those_of_the_table(told):
    at = (ROWS["state"] == told["state"]) & (ROWS["degrees"] == float(told["degrees"]))
    (row,) = ROWS[at].itertuples()
    assert float(told["Yade held (N/m)"]) == row.held
    assert told["Yade moved (N/m)"] == ("none" if np.isnan(row.moved) else f"{row.moved:g}")
    if not np.isnan(row.first_instability) or told["path: first instability"] != "none":
        assert says(told["path: first instability"], row.first_instability)
    limits = NUMBER.findall(told["path: limit to failure"])
    assert says(limits[-1], row.failed_under if row.status == "failed" else row.limit)
    assert len(limits) == 1 or says(limits[0], row.limit)
    inside = row.status != "failed" or row.held <= row.limit <= row.moved
    assert (told["agree"] == "yes") == inside


def test_every_row_is_on_the_page_and_in_the_figure():
    assert len(ROWS) == len(FIRST) + len(THIRD)
    panels = figure_of_limits(ROWS).axes
    assert len(panels) == len(OF_STATE)
    for ax, state in zip(panels, OF_STATE, strict=True):
        assert len(ax.patches) == np.count_nonzero(ROWS["state"] == state)
