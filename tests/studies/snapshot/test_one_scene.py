"""The table of loops in their packing is the same from Python and from the command."""

import re

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from stability import symmetric_modes
from tests.command import run_snapshot
from tests.docs.pages import page
from tests.packings import loops_in_place
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


@pytest.mark.parametrize("ends", ["cell", "walls", "outline"])
def test_the_blocks_of_the_page_run_on_every_kind_of_sample(ends, tmp_path, monkeypatch, capsys):
    path, cell = written(ends, tmp_path)
    snapshot = gl.read_snapshot(path, cell=cell)
    monkeypatch.setattr(gl, "read_snapshot", lambda _: snapshot)
    blocks = re.findall(r"```python\n(.*?)```", page("packing"), re.DOTALL)
    given = {}
    for block in blocks:
        exec(block, given)
    assert len(blocks) == 4 and given["scene"].boundary.kind == ends
    assert np.isfinite(given["place"].matrix).any() and given["response"].status != "none"
    table, names = given["table"], [f"packing_lambda_{name}" for name in ("min", "mid", "max")]
    known = table[names].notna().to_numpy()
    assert known.any()
    np.testing.assert_array_equal(given["eigenvalues"][known], table[names].to_numpy()[known])
    assert capsys.readouterr().out.count("\n") >= 4


def test_cones_and_soft_angles_in_place_are_those_of_the_operators():
    snapshot = gl.read_snapshot(gl.sample_path())
    place, table = loops_in_place(snapshot.scene), gl.loop_table(snapshot, in_packing=True)
    found = gl.plane_cone(gl.restrict(place.matrix, "diagonal"))
    opening = table["packing_cone_opening"]
    known = opening.notna().to_numpy()
    np.testing.assert_allclose(opening[known], np.degrees(found.opening[known]), rtol=1e-12)
    assert (opening > 0).sum() > 10 and opening.isna().equals(table["packing_lambda_min"].isna())
    # The strain of the softest mode, from its axis: no work is smaller.
    soft = np.radians(table["packing_soft_angle"].to_numpy())
    for row in np.flatnonzero(known)[::40]:
        _, modes = symmetric_modes(gl.restrict(place.matrix[row], "symmetric"))
        e1, e2, shear = modes[:, 0] * (1.0 if modes[0, 0] + modes[1, 0] >= 0 else -1.0)
        axis = 0.5 * np.arctan2(np.sqrt(2.0) * shear, e1 - e2)
        assert np.cos(2 * (axis - soft[row])) > 1 - 1e-9
