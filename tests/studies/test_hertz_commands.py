"""`--law hertz` on the command line, from a file of spheres to tables: between walls, at rest."""

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from grainloops import hold, replay
from loops import HertzMindlin, Scene
from patterns import Snapshot, WallContacts, read_snapshot, write_snapshot
from stability import Stage, follow, programmes
from tests.command import run
from tests.packings import start_state
from tests.stability.packing.walled_packings import JAMMED, SMOOTH, between, jammed_in_box, split

LAW = HertzMindlin(20.0, 0.2, 0.5, "radii")
READ = ("--law", "hertz", "--young", 20, "--poisson", 0.2, "--mu", 0.5,
        "--shear-increment", "radii")  # fmt: skip
STRAIN = np.diag([2e-5, -1e-5])


def written(path, graph, planes, force):
    """A snapshot whose file has forces, and springs at walls alone."""
    regime, ids = np.ones(graph.contact_count, dtype=np.int8), np.arange(graph.grain_count)
    walls = WallContacts(planes.grain, force, -planes.branch, planes.kn, planes.kt)
    write_snapshot(path, Snapshot(graph, LAW, regime, ids, len(force), (), walls))
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Twenty-four grains at rest under the law, and strained a little."""
    folder = tmp_path_factory.mktemp("spheres")
    graph, planes, force = jammed_in_box(*JAMMED[1])
    volume = float(np.linalg.det(start_state(graph, between(planes, force)).cell))
    boundary = between(planes, force, volume=volume)
    held = hold(Scene(graph, LAW, boundary), unbalanced=1e-9)
    walls = held.boundary.walls
    first = written(folder / "grains_0.parquet", held.graph, walls, walls.force)
    end = replay(Scene(held.graph, LAW, held.boundary), STRAIN, inertial_number=2e-7).state
    return first, written(folder / "grains_1.parquet", *split(end, SMOOTH))


def run_hertz(*words):
    """Exit status of the command, which draws nothing."""
    return run(*words, *READ, "--no-figures", "--force")


def read(path):
    how = {"law": "hertz", "young": 20.0, "poisson": 0.2, "mu": 0.5}
    return read_snapshot(path, shear_increment="radii", **how)


def test_the_table_of_loops_is_that_of_the_law(tmp_path, files):
    assert run_hertz("snapshot", files[0], "--in-packing", "whole", "--out", tmp_path) == 0
    table, one = pd.read_parquet(tmp_path / "loops.parquet"), read(files[0])
    assert isinstance(one.law, HertzMindlin) and len(table) == 11
    np.testing.assert_allclose(
        table["traction_lambda_min"], gl.loop_table(one)["traction_lambda_min"]
    )
    assert np.isfinite(table["packing_lambda_min"]).any()


def test_rates_are_those_of_the_law(tmp_path, files):
    assert run_hertz("probe", files[0], "--directions", 4, "--out", tmp_path) == 0
    table, found = pd.read_parquet(tmp_path / "probe.parquet"), gl.probe(read(files[0]), 4)
    rates = table[["P11", "P12", "P21", "P22"]].to_numpy()
    np.testing.assert_allclose(rates, found.stress_rate.reshape(4, 4), rtol=1e-9, atol=1e-12)


def test_a_path_is_that_of_the_law(tmp_path, files):
    ways = ("--to", 2e-3, "--rows", 2, "--interval", 2e-5)
    assert run_hertz("evolve", files[0], *ways, "--out", tmp_path) == 0
    one, table = read(files[0]), pd.read_parquet(tmp_path / "path.parquet")
    boundary = one.boundary_and_notes[0]
    stage = Stage(programmes.drained_biaxial(), "H11", 2e-3)
    path = follow(Scene(one.graph, LAW, boundary), stage, closure="packing", rows=2, interval=2e-5)
    assert len(path.events) > 1
    np.testing.assert_allclose(table[["H11", "H22", "P11", "P22"]].iloc[-1],
                               [*path.H[-1][[0, 3]], *path.P[-1][[0, 3]]], rtol=1e-7)  # fmt: skip
    kinds = pd.read_parquet(tmp_path / "events.parquet")["kind"].tolist()
    assert kinds == [event.kind for event in path.events]


@pytest.mark.slow
def test_loads_are_sustained_between_walls(tmp_path, files):
    """Brought to rest and loaded in two directions, as in Python."""
    ways = ("--directions", 2, "--largest", 1e-3, "--workers", 1)
    assert run_hertz("sustain", files[0], *ways, "--out", tmp_path) == 0
    table = pd.read_parquet(tmp_path / "sustain.parquet")
    found = gl.sustain(read(files[0]), 2, largest=1e-3)
    assert table["status"].tolist() == found.status.tolist()
    np.testing.assert_allclose(table["limit"], found.limit, rtol=1e-6)
    assert (table["balance_error"] < 1e-9).all()


def test_a_series_is_predicted_by_paths_and_replays(tmp_path, files):
    """The strain between the two is small and slow: both come to the work that was done."""
    ways = ("--in-packing", "events", "--inertial-number", 2e-7, "--workers", 1)
    assert run_hertz("series", *files, *ways, "--out", tmp_path) == 0
    found = pd.read_parquet(next((tmp_path / "packing").glob("*.parquet"))).set_index("loop")
    made = pd.read_parquet(next((tmp_path / "increments").glob("*.parquet")))
    made = made.set_index("loop_before")["w2"]
    for name in ("path_w2", "replay_w2"):
        assert np.corrcoef(found[name][made.index], made)[0, 1] > 0.999
