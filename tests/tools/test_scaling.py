"""The scaling study on tiny sizes: the same loops each way, and rows for the page."""

import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet
import pytest

from loops import find_faces
from patterns import synthetic_network
from tests.tools.scaling import __main__ as study
from tests.tools.scaling.methods import METHODS, synthetic_snapshot


def turned(cycle):
    """A cycle from its smallest grain on."""
    at = cycle.index(min(cycle))
    return (*cycle[at:], *cycle[:at])


def test_the_other_tools_find_the_same_faces():
    """In a dense network: of dangling chains networkx makes part of the faces around them."""
    graph = synthetic_network(300, seed=1, coordination=5.5)
    snapshot = replace(synthetic_snapshot(300), graph=graph, law=None, regime=None)
    faces = find_faces(graph)
    bounds = faces.offsets[faces.loops], faces.offsets[faces.loops + 1]
    loops = {turned(faces.grains[a:b].tolist()) for a, b in zip(*bounds, strict=True)}
    for how in ("networkx", "shapely"):
        found = [list(cycle) for cycle in METHODS["faces", how][0](snapshot)()]
        either_way = {turned(cycle) for cycle in found} | {turned(cycle[::-1]) for cycle in found}
        assert loops <= either_way, how
        assert len(found) == len(loops) + (how == "networkx")  # the outside


@pytest.mark.slow
def test_a_run_on_tiny_sizes(tmp_path, monkeypatch):
    out = tmp_path / "out"
    monkeypatch.setattr(study, "COMMANDS", {})
    study.main(out, grains="200,400", repeats=1, slow_up_to=200)
    table = pyarrow.parquet.read_table(out / "scaling.parquet").to_pandas()
    ways = set(zip(table["what"], table["how"], table["grains"], strict=True))
    assert ("faces", "shapely", 200) in ways and ("faces", "shapely", 400) not in ways
    assert {(what, how) for what, how, _ in ways} == set(METHODS)
    assert (table["seconds"] > 0).all() and np.isfinite(table["bytes_per_grain"]).all()
    summary = json.loads((out / "summary.json").read_text())
    assert summary["bandwidth"] > 1e8
    floors = {row["what"]: row["floor"] for row in summary["rows"] if row["grains"] == 400}
    assert floors["table"] > floors["faces"] > 0 and floors["crossings"] is None
    assert floors["write"] == pytest.approx(2 * floors["summary"])
    rows = (out / "rows.md").read_text().splitlines()
    assert len(rows) == len(table)
    assert rows[0].startswith("| faces | 200 | compiled | ")
