"""`docs/performance.md` shows the measurement that is stored beside its figure, and no other."""

import shutil

from studies.scaling.methods import METHODS
from studies.scaling.page import BEGIN, END, measured_part, stored, update
from tests.docs.pages import DOCS, page, tables

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
    rows = [{**row, "seconds": 0.5 * row["before"]} for row in ROWS if row["before"]]
    new = {**rows[0], "what": "read", "how": "by size"}
    update(tmp_path, "Measured for a test.", [*rows, new])
    text = (tmp_path / "performance.md").read_text()
    assert text.split(BEGIN)[0] == page("performance").split(BEGIN)[0]
    assert text.split(END)[1] == page("performance").split(END)[1]
    found = tables(between(text))[0]
    assert {row["to before"] for row in found if row[""] != "reading, with all checks"} == {"0.50"}
    assert [row["to before"] for row in found if row[""] == "reading, with all checks"] == ["-"]
    assert "Measured for a test." in text and "times faster than shapely" in text
