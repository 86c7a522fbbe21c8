"""`docs/evidence/probing.md`: its numbers are those that the example finds in the sample."""

import json

import numpy as np
import pandas as pd
import pytest

from studies.examples import probing
from tests.docs.pages import page, says, section, tables
from tests.unsaved import leave_files_empty

# Three states in 24 directions; one of Yade's probes is held to in tests/studies/probe.
pytestmark = pytest.mark.slow

TEXT = section(page("evidence/probing"), "## Held to Yade")
*ERRORS, ON_THE_WAY = tables(TEXT)
WORDS = " ".join(TEXT.split())


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    out = tmp_path_factory.mktemp("probing") / "out"
    with pytest.MonkeyPatch.context() as patch:
        leave_files_empty(patch)
        numbers = probing.main(out)
    assert len(json.loads((out / "summary.json").read_text())["errors"]) == 54
    return numbers, pd.read_parquet(out / "probing.parquet")


def error(found, state, band, amplitude):
    (row,) = [
        row
        for row in found[0]["errors"]
        if (row["state"], row["band"]) == (state, band)
        and np.isclose(row["amplitude"], float(amplitude))
    ]
    return row


@pytest.mark.parametrize(("state", "table"), list(zip(probing.STATES, ERRORS, strict=True)))
def test_errors_of_the_increments(found, state, table):
    assert len(table) == 6
    for line in table:
        amplitude = next(iter(line.values()))
        for column, band in (("band 0.999", "0.999"), ("band 0.99", "0.99"), ("elastic",) * 2):
            row = error(found, state, band, amplitude)
            quoted = line[column].split(" / ")
            for token, key in zip(quoted, ("median", "q90", "largest"), strict=True):
                assert says(token, row[key]), (amplitude, band, key, row[key])
        row = error(found, state, "0.999", amplitude)
        assert says(line["remainder, band 0.999"], row["of_state"])
        assert says(line["unbalanced force"], row["unbalanced"])


def test_small_amplitudes_agree_up_to_yades_own_unbalanced_force(found):
    for state in ("before", "after"):
        for amplitude in ("1e-6", "2e-6"):
            row = error(found, state, "0.999", amplitude)
            assert row["of_state"] < 1.1 * row["unbalanced"]
    drift = [error(found, "moving", "0.999", f"{a}e-6")["of_state"] for a in (1, 2, 5, 10)]
    assert np.allclose(drift, 1.1e-4, rtol=0.1)


def test_the_sign_of_the_work_agrees_in_every_direction(found):
    for row in found[0]["errors"]:
        drifts = row["state"] == "moving" and row["amplitude"] < 3e-6
        assert (row["signs"], row["negative"]) == ((23, 1) if drifts else (24, 0))
        if row["state"] == "before" or drifts:
            assert row["worst_theta_deg"] == 150


def test_what_happens_on_the_way(found):
    ways = found[0]["on_the_way"]
    for k, line in enumerate(ON_THE_WAY):
        for state in probing.STATES:
            assert np.isclose(ways[state]["amplitude"][k], float(line["amplitude"]))
            assert says(line[f"reach their strength, {state}"], ways[state]["reach_yield"][k])
            assert says(line[f"open, {state}"], ways[state]["open"][k])


def test_numbers_in_the_text(found):
    near, far = error(found, "before", "0.999", "2e-6"), error(found, "before", "0.99", "2e-5")
    told = f"{near['largest_of_largest']:.1f} % at 2e-6 (band 0.999) and "
    assert told + f"{far['largest_of_largest']:.1f} % at 2e-5" in WORDS
    rows = found[1]
    soft = rows[(rows["theta_deg"] == 150) & (rows["state"] == "before")]

    def work(column, band, amplitude):
        part = soft[(soft["band"] == band) & np.isclose(soft["amplitude"], amplitude)]
        return f"{part[column].item():.1e}".replace("e+0", "e")

    measured = (work("measured_W2", "0.99", a) for a in (2e-6, 5e-5))
    assert "falls from {} at 2e-6 to {} N/m at 5e-5".format(*measured) in WORDS
    predicted = (work("predicted_W2", band, 2e-6) for band in ("0.999", "0.99"))
    assert "against {} (0.999) and {} (0.99)".format(*predicted) in WORDS
    moving = rows[(rows["theta_deg"] == 150) & (rows["state"] == "moving")]
    held = work("predicted_W2", "0.999", 2e-6)
    soft = moving
    assert f"predicted as {held} N/m held and {work('predicted_W2', '0.999', 2e-6)} moving" in WORDS
    broken = rows[(rows["state"] == "after") & (rows["band"] == "0.99")]
    broken = broken[np.isclose(broken["amplitude"], 5e-5)]
    assert f"up to {broken['unbalanced'].max():.1e}".replace("e-0", "e-") in WORDS
    assert f"up to {100 * broken['error_of_largest'].max():.0f} % of the largest" in WORDS
    off = broken["theta_deg"][broken["error_of_largest"] > 0.1]
    assert f"at {off.min():.0f} to {off.max():.0f} degrees" in WORDS
