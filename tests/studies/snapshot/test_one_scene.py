"""The table of loops in their packing is the same from Python and from the command."""

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from studies.snapshot import run_snapshot
from tests.docs.pages import page
from tests.stability.packing.walled_packings import small_sample

LAW = gl.LinearFrictional(1.0, 0.5, 0.5)


def written(ends, folder):
    """Return the path of a small sample that ends so."""
    path, one = folder / "grains_small.csv", small_sample(ends, LAW)
    gl.write_snapshot(path, one)
    return path, one.graph.cell


@pytest.mark.parametrize("ends", ["cell", "walls", "outline"])
def test_the_command_and_the_table_give_the_same_bits(ends, tmp_path):
    path, cell = written(ends, tmp_path)
    snapshot = gl.read_snapshot(path, cell=cell)
    assert snapshot.scene.boundary.kind == ends
    run_snapshot(path, tmp_path / "out", in_packing="auto", figures=False, cell=cell)
    command = pd.read_parquet(tmp_path / "out" / "loops.parquet")
    table = gl.loop_table(snapshot, in_packing=True)
    names = [name for name in command if name.startswith(("packing_", "surroundings_"))]
    assert len(names) > 3 and np.isfinite(command["packing_lambda_min"]).any()
    for name in [*names, "traction_lambda_min", "area"]:
        np.testing.assert_array_equal(command[name], table[name])


def test_the_first_block_of_the_page_runs_between_walls():
    code = page("packing").split("```python\n", 1)[1].split("```", 1)[0]
    given = {}
    exec(code, given)
    assert given["scene"].boundary.kind == "walls"
    assert np.isfinite(given["place"].matrix).any() and given["response"].status != "none"
