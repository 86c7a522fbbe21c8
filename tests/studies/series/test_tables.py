"""Two snapshots, or several, in one call: against the files of the command and the cells."""

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from tests.command import run

CELLS = gl.sample_path("slow/cells.csv")
PATHS = [gl.sample_path(f"slow/grains_{k}.parquet") for k in (10, 11, 12)]


@pytest.fixture(scope="module")
def states():
    cells = pd.read_csv(CELLS)[["h_xx", "h_xy", "h_yx", "h_yy"]].to_numpy()
    return [
        gl.read_snapshot(path, cell=cell.reshape(2, 2), shear_increment="radii")
        for path, cell in zip(PATHS, cells[:3], strict=True)
    ]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Folder of the command on the same snapshots."""
    out = tmp_path_factory.mktemp("series") / "out"
    how = ("--cells", CELLS, "--shear-increment", "radii", "--no-figures", "--workers", 1)
    assert run("series", *PATHS, "--out", out, *how) == 0
    return out


def rows_of(folder, name, **of):
    table = pd.read_parquet(folder / name)
    for column, value in of.items():
        table = table[table[column] == value].drop(columns=column)
    return table.reset_index(drop=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fates", "increments"])
def test_an_interval_is_that_of_the_series(states, written, name):
    for k in (0, 1):
        found = getattr(gl, name)(states[k], states[k + 1])
        file = rows_of(written, name, snapshot_before=k, snapshot_after=k + 1)
        for column in found.columns.intersection(file.columns):
            mine, yours = found[column], file[column]
            if column == "successors":
                assert [list(one) for one in mine] == [list(one) for one in yours]
            elif mine.dtype.kind == "f":
                np.testing.assert_array_equal(mine, yours, column)
            else:
                assert (mine == yours).all(), column
        assert len(found.columns.intersection(file.columns)) >= 5
        assert found.attrs["units"]


def test_a_series_is_one_table_with_the_strain_between(states):
    table = gl.series(PATHS, cells=CELLS, shear_increment="radii")
    again = gl.series(states)
    pd.testing.assert_frame_equal(table, again, check_exact=True)
    for k, state in enumerate(states):
        own = table[table["snapshot"] == k].reset_index(drop=True)
        loops = gl.loop_table(state)
        pd.testing.assert_frame_equal(own[list(loops)], loops, check_exact=True)
        # Rectangular cells: H = 1 - h/h0, since the first and since the one before.
        first, last = states[0].graph.cell, states[max(k - 1, 0)].graph.cell
        for ij, axis in (("11", 0), ("22", 1)):
            since = 1.0 - state.graph.cell[axis, axis] / first[axis, axis]
            np.testing.assert_allclose(own[f"sample_H{ij}"], since, rtol=0, atol=1e-15)
            step = 1.0 - state.graph.cell[axis, axis] / last[axis, axis] if k else np.nan
            np.testing.assert_allclose(own[f"sample_dH{ij}"], step, rtol=0, atol=1e-15)


def test_files_and_snapshots_may_be_mixed_and_nothing_is_refused(states):
    mixed = gl.series([PATHS[0], states[1]], cells=CELLS, shear_increment="radii")
    whole = gl.series(states[:2])
    pd.testing.assert_frame_equal(mixed, whole, check_exact=True)
    with pytest.raises(gl.InputError, match="snapshots: got none"):
        gl.series([])
    with pytest.raises(gl.InputError, match="no such file"):
        gl.series(["nothing.csv"])
