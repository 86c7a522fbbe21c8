"""Python and commands give equal bits, whatever number of threads linear algebra has."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import grainloops as gl
from loops.arrays import one_blas_thread
from loops.scene import of_scene
from stability.packing import packing_increment, probe, sustain
from tests.packings import LAW, jammed, loops_in_place

ROOT = Path(__file__).parents[2]


def threads():
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


def test_a_question_of_a_scene_has_one_thread_and_sets_it_back():
    seen = []

    @of_scene
    def question(scene):
        seen.append(threads())
        if scene.graph.grain_count > 3:
            question(gl.Scene(gl.regular_polygon(3), LAW))
            seen.append(threads())

    with threadpool_limits(2, user_api="blas"):
        question(gl.Scene(jammed(16, 2), LAW))
        assert threads() == {2}
    assert seen == [{1}] * 3


def test_blocks_beside_one_another_set_it_back_when_the_last_one_ends():
    """The first to begin ends first: the other goes on with one thread."""
    inside, done, seen = threading.Event(), threading.Event(), []

    def other():
        with one_blas_thread():
            inside.set()
            done.wait(10)
            seen.append(threads())

    with threadpool_limits(2, user_api="blas"):
        with one_blas_thread():
            thread = threading.Thread(target=other)
            thread.start()
            inside.wait(10)
        assert threads() == {1}
        done.set()
        thread.join()
        assert threads() == {2} and seen == [{1}]


def test_every_question_of_a_scene_is_such_a_one():
    asked = (gl.follow, gl.rates_at, gl.hold, gl.replay, gl.indicators)
    asked += (loops_in_place, packing_increment, probe, sustain)
    for question in asked:
        assert question.__wrapped__.__code__.co_varnames[0] in ("scene", "subject"), question


@pytest.mark.parametrize("order", [8, 40])
@pytest.mark.parametrize("spins", ["affine", "free"])
def test_tangents_of_long_loops(order, spins):
    """With two threads left alone 40 grains with free spins had other last digits."""
    loop, found = gl.random_loop(order, 1, strain=0.02), []
    for number in (1, 2, 4):
        with threadpool_limits(number, user_api="blas"):
            found.append(gl.traction_tangent(loop, LAW, spins=spins).matrix)
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])


ASK = """
import sys
import numpy as np
import pandas as pd
import grainloops as gl

path, cells, out = sys.argv[1:]
row = pd.read_csv(cells).set_index("snap").loc[10]
cell = row[["h_xx", "h_xy", "h_yx", "h_yy"]].to_numpy().reshape(2, 2)
sample = gl.read_snapshot(path, cell=cell, shear_increment="radii")
loops = gl.loop_table(sample, in_packing=True)
found = {name: loops[name].to_numpy() for name in loops if loops[name].dtype.kind in "fi"}
rates = gl.rates_at(sample, "biaxial")
held = gl.hold(sample, unbalanced=2e-3)
found |= gl.indicators(sample) | {"rates": rates.force_rate, "held": held.graph.normal_force}
np.savez(out, **found)
"""


@pytest.mark.slow
def test_python_and_the_command_with_the_variable_unset(tmp_path):
    """Before: 97 % of the eigenvalues in place differed, by 3e-14; criticalities by 2e-13."""
    path, cells = gl.sample_path("slow/grains_10.parquet"), gl.sample_path("slow/cells.csv")
    free = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    free["PYTHONPATH"] = str(ROOT)

    def ran(name, environment):
        out = tmp_path / f"{name}.npz"
        subprocess.run([sys.executable, "-c", ASK, path, cells, out], env=environment, check=True)
        return np.load(out)

    unset, one = ran("unset", free), ran("one", free | {"OPENBLAS_NUM_THREADS": "1"})
    assert {*unset} == {*one} and len(unset.files) > 40
    for name in unset:
        np.testing.assert_array_equal(unset[name], one[name], err_msg=name)
    out = tmp_path / "out"
    subprocess.run([sys.executable, "-m", "studies.cli", "snapshot", path, "--cells", cells,
                    "--shear-increment", "radii", "--in-packing", "auto", "--no-figures", "--out",
                    out], env=free, check=True, capture_output=True)  # fmt: skip
    written = pd.read_parquet(out / "loops.parquet")
    for name in (name for name in written if name in unset.files):
        np.testing.assert_array_equal(written[name], unset[name], err_msg=name)
    assert "packing_lambda_min" in unset.files
