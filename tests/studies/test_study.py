"""The frame of a study: what it writes is what it is given, and a failed study leaves nothing."""

import json

import pandas as pd
import pyarrow.parquet
import pytest

from studies.output import words
from studies.study import study
from studies.style import new_figure


def frame():
    """Whole numbers with one missing, words, and a number that is nan."""
    loops = pd.array([7, None], dtype="int64[pyarrow]")
    return pd.DataFrame({"order": [3, 4], "loops": loops, "name": ["a", "b"], "x": [0.5, None]})


def test_tables_keep_their_types_and_the_summary_its_provenance(tmp_path):
    out = tmp_path / "out"
    with study("snapshot", out, {"path": "p"}, "as told", csv=True) as results:
        results.write_tables({"orders": frame()})
        summary = results.write_summary({"loops": 7})
    table = pyarrow.parquet.read_table(out / "orders.parquet")
    types = {field.name: str(field.type) for field in table.schema}
    assert types == {"order": "int64", "loops": "int64", "name": "string", "x": "double"}
    assert table["loops"].to_pylist() == [7, None]
    assert json.loads(table.schema.metadata[b"grainloops"])["configuration"] == {"path": "p"}
    assert pd.read_csv(out / "orders.csv")["name"].tolist() == ["a", "b"]
    assert summary["provenance"]["units"] == "as told"
    written = json.loads((out / "summary.json").read_text())
    assert written["provenance"]["command"] == "grainloops snapshot" and written["loops"] == 7
    assert written["files"] == ["orders.csv", "orders.parquet"]


def test_figures_stand_under_their_captions_with_numbers_of_the_summary(tmp_path, unsaved):
    with study("probe", tmp_path / "out", {}, "") as results:
        summary = results.write_summary({"softest_theta_deg": 12.34, "loops": 0})
        drawn = ((name, new_figure()) for name in ("orders", "map"))
        results.write_report("Title", summary, drawn, [])
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("Softest direction, 12.3 degrees") == 4  # captions, and texts for the blind
    assert page.index("<b>Orders.</b>") < page.index("<b>Loops.</b>")


def test_a_study_that_fails_leaves_nothing(tmp_path):
    with (
        pytest.raises(ZeroDivisionError),
        study("snapshot", tmp_path / "out", {}, "") as results,
    ):
        results.write_tables({"orders": frame()})
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", words("captions"))
def test_captions_are_sentences(command):
    for title, said in words("captions")[command].values():
        assert title[0].isupper() and not title.endswith(".")
        assert said[0].isupper() and said.endswith(".")
