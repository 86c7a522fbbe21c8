"""The page of a run: whole, self-contained, and its map the table's numbers."""

import base64
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from loops import find_faces, polygon_area
from patterns import Snapshot, read_snapshot, sample_cell, sample_path, synthetic_network
from studies.output import provenance
from studies.snapshot.table import loop_columns, loops_for_map
from studies.study import (
    MOST_LOOPS,
    LoopsForMap,
    Picture,
    encoded,
    mapping_table,
    summary_tables,
    value_text,
    write_report,
)
from tests.unsaved import PIXEL

MADE = provenance("snapshot", {"path": "a <b>.csv", "columns": {"x": "px"}}, "as the input's")
KINDS = {"f4": "<f4", "f8": "<f8", "i4": "<i4"}
VOID = {"meta", "img", "input", "br", "wbr", "link"}


class Strict(HTMLParser):
    """Every element is closed in turn; ids are unique; text by element."""

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.links, self.cells = [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []
        assert len(set(self.ids)) == len(self.ids)

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            self.open.append(tag)
        given = dict(attrs)
        self.ids += [given["id"]] if "id" in given else []
        self.links += [given[k] for k in ("href", "src") if k in given]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.cells.append(data)


def map_data(text):
    """The arrays in a page, decoded."""
    content = json.loads(re.search(r'id="map-data-0">(.*?)</script>', text, re.S).group(1))

    def decoded(array):
        return np.frombuffer(base64.b64decode(array["data"]), KINDS[array["type"]])

    for name in ("offsets", "corners", "grains"):
        content[name] = decoded(content[name])
    content["columns"] = {name: decoded(array) for name, array in content["columns"].items()}
    return content


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    snapshot = read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell())
    table = loop_columns(snapshot)
    figure = Picture("pixel", "image/png", PIXEL)
    summary = {
        "grains": 2000,
        "stress": np.eye(2),
        "missing": float("nan"),
        "orders": {str(n): n for n in range(3, 15)},
        "eigenvalues": {"affine": {"3": {"mean": 0.123456789, "count": 2}, "all": {"mean": None}}},
        "notes": ["1 < 2 & so on"],
        "definitions": {"grains": "all <grains>"},
    }
    loops = loops_for_map(snapshot, table)
    path = write_report(
        folder, "Loops & more", summary, [("One", "a <pixel>", figure)], loops, MADE
    )
    return path, table


def test_page_is_whole_and_self_contained(page):
    text = page[0].read_text(encoding="utf-8")
    parsed = Strict(text)
    assert not re.search(r"https?:|url\(|@import|fetch\(", text)
    assert all(link.startswith(("#", "data:")) for link in parsed.links)
    assert {link[1:] for link in parsed.links if link[0] == "#"} <= set(parsed.ids)
    assert "default-src 'none'" in text
    assert base64.b64encode(PIXEL).decode() in text
    assert "<title>Loops &amp; more</title>" in text
    assert "a <b>" not in text
    for cell in ("2000", "–", "0.123457", "all <grains>", "a <b>.csv", "x=px"):
        assert cell in parsed.cells, cell
    assert "<p>1 &lt; 2 &amp; so on.</p>" in text


def test_map_holds_the_table(page):
    path, table = page
    data = map_data(path.read_text(encoding="utf-8"))
    assert data["count"] == len(table["loop"])
    assert set(data["columns"]) == set(table) - {"grains"}
    for name, values in data["columns"].items():
        given = np.asarray(table[name])
        if np.issubdtype(given.dtype, np.floating):
            np.testing.assert_array_equal(values, given.astype(np.float32))
        else:
            np.testing.assert_array_equal(values, given)
    ids = np.split(data["grains"], data["offsets"][1:-1])
    assert [row.tolist() for row in ids] == table["grains"].to_pylist()
    corners = data["corners"].astype(float).reshape(-1, 2)
    areas = [polygon_area(part) for part in np.split(corners, data["offsets"][1:-1])]
    np.testing.assert_allclose(areas, table["area"], rtol=1e-3, atol=1e-3 * table["area"].mean())
    assert data["colour_by"][:2] == ["order", "traction_lambda_min"]
    assert "loop" not in data["colour_by"]


def two_maps(folder):
    """A page with a map of each of two snapshots, one column of words."""
    maps = []
    for k, periods in enumerate((20, 30)):
        graph = synthetic_network(periods, seed=k, periodic=True)
        snapshot = Snapshot(graph, None, None, np.arange(graph.grain_count), 0, ())
        faces = find_faces(graph)
        loop = np.arange(len(faces.loops))
        columns = {"loop": loop, "order": faces.order[faces.loops]}
        columns["fate"] = np.where(loop % 3 == 0, "split", "died")
        of_series = {"name": f"{k + 4} (<b>{k})", "number": k + 4, "first": k == 1}
        maps += loops_for_map(snapshot, columns, **of_series)
    return write_report(folder, "t", {}, [], maps, MADE), maps


def test_a_page_has_a_map_of_each_snapshot(tmp_path):
    path, maps = two_maps(tmp_path)
    text = path.read_text(encoding="utf-8")
    ids = Strict(text).ids
    assert [name for name in ids if name.startswith("map-data")] == ["map-data-0", "map-data-1"]
    assert '<option value="1" data-number="5" selected>5 (&lt;b&gt;1)</option>' in text
    assert map_data(text)["count"] == len(maps[0])
    # Nothing to choose from on a page with one map.
    one = write_report(tmp_path, "t", {}, [], maps[:1], MADE).read_text(encoding="utf-8")
    assert "<label hidden>snapshot" in one and "<label hidden>snapshot" not in text


LOOK_UP = """
const fs = require("fs"), m = {exports: {}};
const [script, page] = [process.argv[1], process.argv[2]].map((f) => fs.readFileSync(f, "utf8"));
new Function("module", script)(m);
const loops = m.exports.readLoops(page.match(/id="map-data-1">(.*?)<\\/script>/s)[1]);
console.log(JSON.stringify({
  fate: m.exports.colouring(loops, "fate"), row: m.exports.rowOf(loops, 1),
  found: ["7", "99999", "x", ""].map((text) => m.exports.rowOfNumber(loops, text)),
  linked: ["#snapshot=5&loop=7", "#loop=7", "#map"].map(m.exports.linked),
}));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="no node to run the script with")
def test_a_loop_that_there_is_not_is_told(tmp_path):
    path, maps = two_maps(tmp_path)
    script = Path(__file__).parents[2] / "studies" / "report.js"
    done = subprocess.run(
        ["node", "-e", LOOK_UP, str(script), str(path)], capture_output=True, text=True, check=True
    )
    result = json.loads(done.stdout)
    last = len(maps[1]) - 1
    said = "in snapshot 5 (<b>1): they are numbered 0 to"
    assert result["found"] == [
        [7, ""], *([-1, f'No loop "{text}" {said} {last}.'] for text in ("99999", "x", "")),
    ]  # fmt: skip
    assert result["linked"] == [
        {"snapshot": "5", "loop": "7"}, {"snapshot": None, "loop": "7"},
        {"snapshot": None, "loop": None},
    ]  # fmt: skip
    # Words have a colour and a name each.
    assert [word for word, _ in result["fate"]["named"]] == ["died", "split"]
    assert dict(result["row"])["fate"] == "died"


def test_large_ids_are_not_cut_off():
    assert encoded(np.array([2**40, 1]))["type"] == "f8"
    assert encoded(np.array([2**53 + 1, 1]))["type"] == "i8"
    assert encoded(np.array([2**31 - 1]))["type"] == "i4"
    assert encoded(np.empty(0, dtype=int)) == {"type": "i4", "data": ""}


def test_a_sentence_instead_of_too_many_loops(tmp_path):
    many = LoopsForMap(np.arange(MOST_LOOPS + 2), np.zeros((0, 2)), np.zeros(0, dtype=int))
    for summary, loops in (({}, [many]), ({"loops": MOST_LOOPS + 1}, [])):
        text = write_report(tmp_path, "t", summary, [], loops, MADE).read_text()
        Strict(text)
        assert f"{MOST_LOOPS + 1} loops are more than the {MOST_LOOPS}" in text
        assert "<canvas" not in text
    text = write_report(tmp_path, "t", {"loops": 5}, [], [], MADE).read_text()
    assert "<canvas" not in text
    assert "more than" not in text


def test_a_page_of_fifty_thousand_loops_stays_small(tmp_path):
    graph = synthetic_network(58_000, seed=1, periodic=True)
    snapshot = Snapshot(graph, None, None, np.arange(graph.grain_count) + 10**6, 0, ())
    faces = find_faces(graph)
    assert 0.98 * MOST_LOOPS < len(faces.loops) <= MOST_LOOPS
    columns = {"order": faces.order[faces.loops]}
    columns |= {f"c{k}": faces.area[faces.loops] for k in range(30)}
    loops = loops_for_map(snapshot, columns)
    path = write_report(tmp_path, "t", {"a": 1}, [], loops, MADE)
    assert path.stat().st_size < 15e6


def test_tables_of_nested_numbers():
    text = mapping_table({"affine": {"3": {"mean": 1.5}, "all": {"mean": 2.0, "count": 7}}})
    assert Strict(text).cells == ["mean", "count", "affine", "3", "1.5", "affine", "all", "2", "7"]
    text = summary_tables({"b": {"x": 1}, "a": True, "notes": ["hidden"]})
    assert Strict(text).cells == ["a", "yes", "x", "1"]
    assert mapping_table({"affine": {}}) == "<p>–</p>"
    assert value_text(np.array([1e-7, np.inf])) == "[1e-07, –]"


def test_a_matrix_is_set_by_rows():
    """A 4 x 4 matrix on one line would push the other values off the screen."""
    text = summary_tables({"tangent": np.arange(4.0).reshape(2, 2), "vector": [1, 2], "cone": []})
    assert text.count('<table class="matrix">') == 1
    rows = re.findall(r"<tr>((?:<td>\d</td>)+)</tr>", text)
    assert [re.findall(r"\d", row) for row in rows] == [["0", "1"], ["2", "3"]]
    assert Strict(text).cells == ["cone", "[]", "tangent", "0", "1", "2", "3", "vector", "[1, 2]"]
    ragged = summary_tables({"cones": [[1, 2], None]})
    assert Strict(ragged).cells == ["cones", "1", "2", "–"]


def test_long_text_may_be_broken_into_lines():
    text = summary_tables({"files": ["report.html"] * 9, "status": "at rest"})
    assert re.findall(r'<td class="long">\[report', text) and "<td>at rest</td>" in text


def test_a_table_wider_than_high_is_turned():
    values = {key: {f"c{k}": k for k in range(12)} for key in ("first", "last")}
    cells = Strict(mapping_table(values)).cells
    assert cells[:5] == ["first", "last", "c0", "0", "0"]
    values |= {f"k{n}": {"c1": n} for n in range(12)}
    assert Strict(mapping_table(values)).cells[:12] == [f"c{k}" for k in range(12)]


NODE = shutil.which("node")
PROBE = """
const fs = require("fs"), m = {exports: {}};
const [script, page] = [process.argv[1], process.argv[2]].map((f) => fs.readFileSync(f, "utf8"));
new Function("module", script)(m);
const loops = m.exports.readLoops(page.match(/id="map-data-0">(.*?)<\\/script>/s)[1]);
const found = [], mean = (k, axis) => {
  const at = loops.corners.slice(2 * loops.offsets[k], 2 * loops.offsets[k + 1]);
  return at.filter((_, j) => j % 2 === axis).reduce((a, b) => a + b) / (at.length / 2);
};
for (let k = 0; k < loops.count; k++)
  found.push(m.exports.loopAt(loops, mean(k, 0), mean(k, 1)));
const colours = Object.fromEntries(loops.colour_by.map((name) => {
  const c = m.exports.colouring(loops, name);
  return [name, [Math.min(...c.shade), Math.max(...c.shade), c.palette.length]];
}));
const outside = m.exports.loopAt(loops, 1e9, 0), row = m.exports.rowOf(loops, 7);
console.log(JSON.stringify({found, colours, outside, row}));
"""


@pytest.mark.skipif(NODE is None, reason="no node to run the script with")
def test_script_finds_the_loop_under_the_pointer(page):
    path, table = page
    script = Path(__file__).parents[2] / "studies" / "report.js"
    done = subprocess.run(
        [NODE, "-e", PROBE, str(script), str(path)], capture_output=True, text=True, check=True
    )
    result = json.loads(done.stdout)
    # The mean of a loop's corners may lie outside it where it is not convex.
    found = np.array(result["found"])
    hit = found == np.arange(len(found))
    assert hit[np.asarray(table["order"]) == 3].all()
    assert hit.mean() > 0.97
    assert result["outside"] == -1
    for low, high, size in result["colours"].values():
        assert -1 <= low <= high < size
    row = dict(result["row"])
    assert float(row["pressure"]) == pytest.approx(table["pressure"][7], rel=1e-5)
    assert row["grains"] == " ".join(map(str, table["grains"].to_pylist()[7]))
