"""`grainloops sustain`: its tables against the numerics, restarts, processes, what it refuses."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from loops import InputError, Regime
from patterns import Snapshot, WallContacts, read_snapshot, sample_path, write_snapshot
from stability.packing import sustain as sustain_packing
from studies import sustain as study_module
from studies.commands.packing import _sustain_lines
from tests.command import run, run_sustain
from tests.docs.test_columns_page import files_say
from tests.packings import LAW, jammed, start_state
from tests.stability.packing.walled_packings import JAMMED, between, jammed_in_box
from tests.unsaved import leave_files_empty

HOW = {"directions": 4, "largest": 0.0022, "interval": 2e-4, "shear_increment": "radii"}
TABLES = ("sustain", "motions", "paths", "orders", "loops")
FIGURES = [f"{name}.png" for name in ("limits", "work", "paths", "orders", "map")]


@pytest.fixture(scope="module")
def state(tmp_path_factory):
    """A jammed packing of 24 grains as tables."""
    graph = jammed(24, 3, LAW)
    count = graph.contact_count
    law = gl.LinearFrictional(np.ones(count), np.full(count, 0.5), np.full(count, 0.5), "radii")
    regime = np.full(count, Regime.ELASTIC, dtype=np.int8)
    snapshot = Snapshot(graph, law, regime, np.arange(24), 0, ())
    path = tmp_path_factory.mktemp("state") / "grains.parquet"
    write_snapshot(path, snapshot)
    return path


@pytest.fixture(scope="module")
def results(state, tmp_path_factory):
    """The command, run once in this process; its figures are not saved."""
    out = tmp_path_factory.mktemp("results") / "sustain"
    with pytest.MonkeyPatch.context() as patch:
        leave_files_empty(patch)
        status = run(
            "sustain", state, "--directions", "4", "--largest", "0.0022",
            "--interval", "2e-4", "--shear-increment", "radii", "--workers", "1", "--out", out,
        )  # fmt: skip
    assert status == 0
    return out


def test_files_of_the_contract(results):
    files = {path.name for path in results.iterdir()}
    tables = {f"{name}.parquet" for name in TABLES}
    assert files == {*tables, *FIGURES, "summary.json", "report.html"}
    files_say("sustain", results, 70)
    assert not (results.parent / ".sustain.directions").exists()


def test_printed_lines_of_large_motions_and_of_lost_equilibria(results):
    summary = json.loads((results / "summary.json").read_text())
    weakest = summary["weakest"]
    first, second, *_ = _sustain_lines(summary)
    assert first.startswith("4 directions of the stress rate (diagonal), load up to 0.0022: ")
    for status, count in summary["statuses"].items():
        assert f"{count} {status}" in first
    assert f"at an added load of {weakest['first_large_load']:.4g}" in second
    assert f"equilibrium in this direction: {weakest['limit']:.4g}" in _sustain_lines(summary)[2]
    own, more = summary["seconds"], summary["spread_seconds"]
    said = f"processor time a direction: {own / 4:.2g} s, {more / 4:.2g} s more for its spreads"
    assert own > 0 and more > 0 and said in _sustain_lines(summary)
    unstable = summary | {"weakest": weakest | {"first_large_load": None}}
    assert f"{weakest['limit']:.4g}, at" in _sustain_lines(unstable)[1]
    coarse = summary | {"weakest": weakest | {"limit_converged": False}}
    assert _sustain_lines(coarse)[2].endswith("(not converged)")
    assert "lost in no direction" in _sustain_lines(summary | {"weakest": None})[1]


def test_tables_are_the_numerics(results, state):
    read = read_snapshot(state, shear_increment="radii")
    held = gl.hold(gl.Scene(read.graph, read.law))
    found = sustain_packing(gl.Scene(held.graph, held.law), 4, largest=0.0022, interval=2e-4)
    table = pd.read_parquet(results / "sustain.parquet")
    assert table["status"].tolist() == found.status.tolist()
    assert "held" in found.status and any("large" in one for one in found.status)
    for name in ("limit", "limit_spread", "first_large_load", "first_large_spread"):
        np.testing.assert_array_equal(table[name], [getattr(path, name) for path in found.paths])
    np.testing.assert_array_equal(table[["n11", "n22"]], found.directions)
    assert table["balance_error"].max() < 1e-10
    modes = [path.mode for path in found.paths]
    grains = [0 if mode is None else len(mode.grains) for mode in modes]
    assert table["mode_grains"].tolist() == grains
    motions = pd.read_parquet(results / "motions.parquet")
    assert len(motions) == sum(len(path.motions) for path in found.paths)
    assert (motions["load"] >= motions["lost"]).all()
    weakest = json.loads((results / "summary.json").read_text())["weakest"]
    assert weakest["first_large_load"] == table["first_large_load"].min()
    loops = pd.read_parquet(results / "loops.parquet")
    mode = modes[int(table["first_large_load"].argmin())]
    np.testing.assert_array_equal(loops["W2"], mode.loop_work)
    orders = pd.read_parquet(results / "orders.parquet")
    own = orders[orders["theta_deg"] == weakest["theta_deg"]]
    assert own["W2"].sum() == pytest.approx(mode.loop_work.sum(), rel=1e-12)
    assert own["negative_share"].sum() == pytest.approx(1.0)


@pytest.mark.slow
def test_an_interrupted_run_goes_on(results, state, tmp_path, monkeypatch):
    """Two directions are finished, then Ctrl-C: the second run does the others."""
    done, load_path = [], study_module.load_path

    def broken(*how):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(0)
        return load_path(*how)

    out = tmp_path / "out"
    monkeypatch.setattr(study_module, "load_path", broken)
    with pytest.raises(KeyboardInterrupt):
        run_sustain(state, out, **HOW, workers=1, figures=False)
    parts = tmp_path / ".out.directions"
    assert len(list(parts.glob("*.pickle"))) == 2 and not out.exists()
    monkeypatch.setattr(study_module, "load_path", lambda *how: done.append(0) or load_path(*how))
    run_sustain(state, out, **HOW, workers=1, figures=False)
    assert len(done) == 4 and not parts.exists()
    for name in TABLES:
        pd.testing.assert_frame_equal(
            pd.read_parquet(out / f"{name}.parquet"),
            pd.read_parquet(results / f"{name}.parquet"),
            check_exact=True,
        )


@pytest.mark.slow
def test_any_number_of_processes_writes_the_same(results, state, tmp_path):
    run_sustain(state, tmp_path / "two", **HOW, workers=2, figures=False)
    for name in TABLES:
        file = f"{name}.parquet"
        assert (tmp_path / "two" / file).read_bytes() == (results / file).read_bytes()


@pytest.mark.slow
def test_a_sample_between_walls_is_loaded_with_its_walls(tmp_path):
    """The tables are the numerics of the held packing with its planes and their forces."""
    out = tmp_path / "out"
    run_sustain(sample_path(), out, directions=2, largest=2.0, workers=1, figures=False)
    table = pd.read_parquet(out / "sustain.parquet")
    found = gl.sustain(read_snapshot(sample_path()), 2, largest=2.0)
    statuses = ["held", "large motion, at rest again"]
    assert table["status"].tolist() == found.status.tolist() == statuses
    np.testing.assert_allclose(table["limit"], found.limit, rtol=1e-12)
    # The stored energy is a hundred times the work, and overlaps are rounded by their diameters.
    snapshot = read_snapshot(sample_path())
    overlap = snapshot.graph.normal_force.mean() / snapshot.mean_kn
    rounding = 2 * np.finfo(float).eps * 2 * snapshot.graph.radii.mean() / overlap
    for path, error in zip(found.paths, table["balance_error"], strict=True):
        assert error < 1e-10 + rounding * path.energy[0] / np.abs(path.work[:, 0]).max()
    summary = json.loads((out / "summary.json").read_text())
    np.testing.assert_array_equal(summary["stress"], found.stress)


@pytest.mark.slow
def test_a_sample_between_rough_walls_is_loaded_with_their_friction(tmp_path):
    """The tables are the numerics of the stored packing with the springs of its walls."""
    graph, planes, force = jammed_in_box(*JAMMED[4])
    count, grains = graph.contact_count, graph.grain_count
    law = gl.LinearFrictional(np.ones(count), np.full(count, 0.5), np.full(count, 0.5), "radii")
    regime = np.full(count, Regime.ELASTIC, dtype=np.int8)
    walls = WallContacts(planes.grain, force, -planes.branch, planes.kn, planes.kt, planes.mu)
    path = tmp_path / "grains.parquet"
    write_snapshot(path, Snapshot(graph, law, regime, np.arange(grains), len(force), (), walls))
    start = start_state(graph, between(planes, force))
    how = {"largest": 0.25 * np.trace(start.stress), "interval": 1e-4}
    run_sustain(
        path, tmp_path / "out", directions=2, workers=1, figures=False, shear_increment="radii",
        **how,
    )  # fmt: skip
    table = pd.read_parquet(tmp_path / "out" / "sustain.parquet")
    limits = []
    for mu in (planes.mu, 0.5 * planes.mu):
        rough = replace(planes, mu=mu)
        boundary = between(rough, force, volume=np.linalg.det(start.cell))
        held = gl.hold(gl.Scene(graph, law, boundary))
        limits.append(sustain_packing(gl.Scene(held.graph, law, held.boundary), 2, **how))
    found, other = limits
    assert table["status"].tolist() == found.status.tolist()
    assert np.isfinite(found.first_large_load).all()
    # Held by another call, whose box is rounded otherwise: motions raise that to 3e-7 of a limit.
    np.testing.assert_allclose(table["limit"], found.limit, rtol=1e-5)
    # With half of the walls' friction it holds less: the walls were read with theirs.
    assert (other.limit < 0.6 * found.limit).all()


def test_refusals(state, tmp_path, capsys):
    with pytest.raises(InputError, match="diagonal"):
        run_sustain(sample_path(), tmp_path / "walls", subspace="symmetric", figures=False)
    with pytest.raises(InputError, match="between walls"):
        run_sustain(sample_path(), tmp_path / "walls", hold_stress=True, figures=False)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="largest"):
        run_sustain(state, tmp_path / "a", largest=0.0, shear_increment="radii", figures=False)
    with pytest.raises(InputError, match="subspace"):
        run_sustain(state, tmp_path / "b", subspace="full", shear_increment="radii", figures=False)
    assert run("sustain", state, "--directions", "0", "--out", tmp_path / "c") == 2
    assert "directions" in capsys.readouterr().err and list(tmp_path.iterdir()) == []
