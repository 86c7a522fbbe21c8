"""`docs/performance.md` shows the measurement that is stored beside its figure, and no other."""

import shutil

import pytest

from tests.docs.pages import DOCS, page, tables
from tests.tools.scaling.methods import METHODS
from tests.tools.scaling.page import BEGIN, END, measured_part, stored, update

ROWS = stored(DOCS)["rows"]


def between(text):
    return text.split(BEGIN)[1].split(END)[0]


def test_the_page_shows_what_is_stored():
    shown = between(page("performance"))
    assert shown == measured_part(DOCS)
    assert len(tables(shown)[0]) == len(ROWS)
    faces = {(how, n) for (what, how) in METHODS if what == "faces" for n in (1_000, 10_000)}
    assert faces <= {(row["how"], row["grains"]) for row in ROWS}


def test_a_new_measurement_takes_the_place_of_the_old(tmp_path):
    (tmp_path / "figures").mkdir()
    for file in ("performance.md", "figures/scaling.json"):
        shutil.copy(DOCS / file, tmp_path / file)
    rows = [{**row, "seconds": 0.5 * row["seconds"]} for row in ROWS]
    update(tmp_path, "Measured for a test.", rows)
    text = (tmp_path / "performance.md").read_text()
    assert text.split(BEGIN)[0] == page("performance").split(BEGIN)[0]
    assert text.split(END)[1] == page("performance").split(END)[1]
    found, before = (tables(between(one))[0] for one in (text, page("performance")))
    for new, old in zip(found, before, strict=True):
        assert float(new["time (s)"]) == pytest.approx(0.5 * float(old["time (s)"]), rel=0.01)
    assert "Measured for a test." in text and "times faster than shapely" in text


@pytest.mark.parametrize("name", ["performance", "accuracy"])
def test_the_pages_speak_of_today(name):
    """No column and no sentence compares with an earlier version or another machine."""
    told = page(name).lower()
    for word in ("before |", "page before", "another machine", "to before", "wrong before"):
        assert word not in told
