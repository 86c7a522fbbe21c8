"""`grainloops evolve`: its tables against the numerics and the DEM, and what it refuses."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from loops import InputError, Scene, contact_forces, find_faces
from patterns import Snapshot, read_snapshot, sample_path, write_snapshot
from patterns.snapshots.walls import box_sides
from stability import Stage, follow, programmes
from studies.evolve import dem_comparison_summary, stage_of
from studies.reading import plan_series, read_planar, reading
from tests.command import run, run_evolve
from tests.packings import BRANCH, LAW, jammed, loop_changes
from tests.studies.probe.test_run import plain
from tests.unsaved import leave_files_empty

CELLS = sample_path("slow/cells.csv")
SLOW = [sample_path(f"slow/grains_{number}.parquet") for number in (10, 11)]
FIGURES = {"stress_strain.png", "forecast.png", "map.png"}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The command on one step of the slow sample, as it was driven; its figures are not saved."""
    out = tmp_path_factory.mktemp("results") / "path"
    with pytest.MonkeyPatch.context() as patch:
        leave_files_empty(patch)
        status = run("evolve", *SLOW, "--cells", CELLS, "--shear-increment", "radii",
                     "--axis", "2", "--to", "2e-5", "--rows", "2", "--out", out)  # fmt: skip
    assert status == 0
    return out


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A jammed packing of discs in files of its own, and as it is read."""
    grains = tmp_path_factory.mktemp("small") / "grains_1.parquet"
    graph = jammed(16, 2)
    ids = 100 + 3 * np.arange(graph.grain_count)
    regime = np.ones(graph.contact_count, dtype=np.int8)
    write_snapshot(grains, Snapshot(graph, LAW, regime, ids, 0, ()))
    return grains, read_snapshot(grains)


def tables(out):
    return [pd.read_parquet(out / f"{name}.parquet") for name in ("path", "events", "loops")]


def test_files_and_the_dems_next_state(results):
    names = ("path", "events", "loops", "grains", "dem", "forecast")
    files = {f"{name}.parquet" for name in names}
    assert {path.name for path in results.iterdir()} == {
        *files, *FIGURES, "summary.json", "report.html",
    }  # fmt: skip
    path, _, loops = tables(results)
    dem, summary = (
        pd.read_parquet(results / "dem.parquet"),
        json.loads((results / "summary.json").read_text()),
    )
    cells = pd.read_csv(CELLS)
    assert dem["H22"][0] == pytest.approx(1 - cells["h_yy"][1] / cells["h_yy"][0], rel=1e-9)
    # Here the ratio differs by 0.3 %, stresses by 3e-5; up to 4.6 % in packing-paths.md.
    ratio = path["H11"].iloc[-1] / path["H22"].iloc[-1]
    assert ratio == pytest.approx(dem["H11"][0] / dem["H22"][0], rel=0.01)
    assert dem["P11"][0] == pytest.approx(path["P11"].iloc[-1], rel=1e-4)
    assert dem["P22"][0] == pytest.approx(path["P22"].iloc[-1], rel=1e-4)
    assert summary["status"] == "finished" and summary["reached"] == pytest.approx(2e-5)
    assert summary["negative_loops"] == np.mean(loops["W2"] < 0)


def test_a_path_tells_how_far_it_is(small):
    _, snapshot = small
    reached = []
    law, _ = snapshot.mechanics()
    stage = Stage(programmes.isotropic_strain(), "parameter", 1e-4)
    options = {"rows": 1, "interval": 2e-5, "progress": reached.append}
    path = follow(Scene(snapshot.graph, law), stage, closure="packing", **options)
    assert len(reached) == path.intervals
    assert reached == sorted(reached)
    assert reached[-1] == path.parameter[-1]


@pytest.mark.slow
def test_a_path_past_instabilities_says_how_far_another_way_is(tmp_path, capsys):
    grains, out, graph = tmp_path / "grains.parquet", tmp_path / "out", jammed(36, 5, BRANCH)
    regime = np.ones(graph.contact_count, dtype=np.int8)
    ids = np.arange(graph.grain_count)
    write_snapshot(grains, Snapshot(graph, BRANCH, regime, ids, 0, ()))
    asked = ["--axis", "2", "--to", "-0.0152", "--interval", "1e-4", "--shear-increment", "branch"]
    asked += ["--no-figures", "--out", out]
    assert run("evolve", grains, *asked) == 0
    said = "spread of the stress after the first instability: "
    assert said + "not computed (use --spread)" in capsys.readouterr().out
    assert json.loads((out / "summary.json").read_text())["stress_spread"] is None
    assert run("evolve", grains, *asked, "--spread", "--force") == 0
    summary = json.loads((out / "summary.json").read_text())
    stage = Stage(programmes.drained_biaxial(2, -1.0), "parameter", 0.0152)
    how = {"rows": 20, "interval": 1e-4, "spread": True}
    found = follow(Scene(graph, BRANCH), stage, closure="packing", **how)
    assert found.stress_spread > 0
    assert summary["stress_spread"] == pytest.approx(found.stress_spread, rel=1e-6)
    percent = f"{100 * summary['stress_spread']:.3g}"
    assert f"{said}{percent} % of its change" in capsys.readouterr().out


def test_tables_are_the_numerics(small, tmp_path):
    grains, snapshot = small
    out = tmp_path / "out"
    summary = run_evolve([grains], out, to=-3e-3, axis=2, rows=4,
                         interval=2e-5, csv=True, figures=False)  # fmt: skip
    stage = Stage(programmes.drained_biaxial(2, -1.0), "parameter", 3e-3)
    how = {"rows": 4, "interval": 2e-5}
    found = follow(Scene(snapshot.graph, snapshot.law), stage, closure="packing", **how)
    path, events, loops = tables(out)
    assert np.array_equal(path[["P11", "P12", "P21", "P22"]], found.P) and len(found) == 5
    assert np.allclose(path["driven"], path["H22"], rtol=0, atol=1e-12) and path["H22"].min() < 0
    assert path["events"].iloc[-1] == len(events) == len(found.events) > 10
    assert np.array_equal(events["driven"], [-event.parameter for event in found.events])
    assert events["kind"].tolist() == [event.kind for event in found.events]
    # An event is named by the grains of its contact.
    contacts = found.states[-1].contacts[events["contact"]]
    assert np.array_equal(events[["id1", "id2"]], snapshot.ids[contacts])
    assert summary["events"] == events["kind"].value_counts().to_dict()
    # Every contact lies between two loops: they share its work.
    end, count = found.states[-1], snapshot.graph.contact_count
    force = end.forces[:count] - found.states[0].forces[:count]
    branch = end.branches[:count] - found.states[0].branches[:count]
    work = np.sum(loops["additive_w"] * loops["area"])
    assert work == pytest.approx(-np.sum(force * branch), rel=1e-9)
    faces = find_faces(snapshot.graph)
    works = [
        loop_changes(snapshot.graph, state, faces).second_order_work for state in found.states[1:]
    ]
    assert np.array_equal(loops["W2"], works[-1])
    for row, before in zip(loops["negative_row"], np.transpose(works) < 0, strict=True):
        assert before.tolist().index(True) + 1 == row if before.any() else row == -1
    negative = loops["negative_row"] > 0
    assert 0 < negative.sum() < len(loops)
    rows = loops["negative_row"][negative]
    assert np.array_equal(loops["negative_from"][negative], path["driven"].to_numpy()[rows])


@pytest.mark.slow
def test_grains_and_loops_keep_the_ids_of_the_file(small, tmp_path):
    path, snapshot = small
    run_evolve([path], tmp_path / "out", to=1e-3, rows=2, figures=False)
    grains, loops = (
        pd.read_parquet(tmp_path / "out" / f"{n}.parquet") for n in ("grains", "loops")
    )
    stage = stage_of("drained", 1, 1e-3)
    end = follow(snapshot, stage, closure="packing", rows=2).states[-1]
    np.testing.assert_array_equal(grains["id"], snapshot.ids)
    np.testing.assert_allclose(grains[["x", "y"]], end.x[: len(grains)], rtol=1e-12)
    np.testing.assert_allclose(grains["theta_z"], end.angle[: len(grains)], rtol=1e-12)
    assert grains["contacts"].sum() == 2 * end.closed.sum()
    still = grains["x"] - grains["dx"], grains["y"] - grains["dy"]
    np.testing.assert_allclose(np.stack(still, axis=1), snapshot.graph.x, atol=1e-12)
    faces = snapshot.faces
    for row, ids in enumerate(loops["grains"]):
        a, b = faces.offsets[faces.loops[row] + np.arange(2)]
        assert list(ids) == snapshot.ids[faces.grains[a:b]].tolist()


def test_where_and_why_a_path_ends_is_one_sentence(small, tmp_path, capsys):
    out = tmp_path / "out"
    status = run("evolve", small[0], "--to", "0.2", "--interval", "1e-3", "--out", out)
    assert status == 0
    _, first, *_ = capsys.readouterr().out.splitlines()
    summary = json.loads((out / "summary.json").read_text())
    assert summary["status"] != "finished" and abs(summary["reached"]) < 0.2
    assert first == (
        f"{summary['status']} at H11 = {summary['reached']:.4g} of 0.2: {summary['message']}"
    )


@pytest.mark.parametrize(
    "many",
    [pytest.param(100_000, id="drawn"), pytest.param(1, id="painted", marks=pytest.mark.slow)],
)
def test_an_animation_has_a_frame_a_row(small, tmp_path, monkeypatch, many):
    """A small file of its own; the frames differ."""
    monkeypatch.setattr("studies.snapshot.figures.PAINT_LIMIT", many)
    out = tmp_path / "out"
    how = {"to": 1e-3, "rows": 3, "interval": 5e-5, "figures": False, "animation": True}
    run_evolve([small[0]], out, **how)
    with Image.open(out / "animation.gif") as gif:
        assert gif.n_frames == 4
        frames = [gif.seek(k) or np.array(gif.convert("RGB")) for k in range(4)]
    assert all((one != other).any() for one, other in itertools.pairwise(frames))
    assert (out / "animation.gif").stat().st_size < 3e5


def test_a_path_whose_intervals_run_out_keeps_its_rows_and_the_last_state(
    small, tmp_path, monkeypatch
):
    """Two intervals of 2e-5; a row does not cut them."""
    monkeypatch.setattr("studies.evolve.INTERVALS", 2)
    monkeypatch.setattr("studies.evolve.require_reach", lambda *_: None)
    how = {"to": 5e-5, "rows": 2, "interval": 2e-5, "programme": "oedometric", "figures": False}
    summary = run_evolve([small[0]], tmp_path / "out", **how)
    path = pd.read_parquet(tmp_path / "out/path.parquet")
    assert summary["status"] == "lost"
    assert summary["message"] == "2 intervals were not enough"
    # Intervals are strains of the current cell.
    np.testing.assert_allclose(path["driven"], [0.0, 2.5e-5, 4e-5], rtol=1e-4)


def test_both_ways_from_one_snapshot_have_their_numbers(small, tmp_path):
    """Those of either way alone, and how far their forces are apart."""
    how = {"to": 1e-3, "rows": 4, "interval": 2e-5, "figures": False, "damping": 0.5}
    both, one, two = (
        run_evolve([small[0]], tmp_path / by, by=by, inertial_number=1e-5, **how)
        for by in ("both", "events", "replay")
    )
    tables = {
        by: {path.stem: pd.read_parquet(path) for path in (tmp_path / by).glob("*.parquet")}
        for by in ("both", "events", "replay")
    }
    for name in ("path", "loops", "events"):
        pd.testing.assert_frame_equal(tables["both"][name], tables["events"][name])
    own = tables["replay"]["path"].drop(columns="events")
    pd.testing.assert_frame_equal(tables["both"]["replay"], own)
    pd.testing.assert_frame_equal(tables["both"]["replay_loops"], tables["replay"]["loops"])
    told = both["replay"]
    assert both["end"] == one["end"] and told["end"] == two["end"]
    assert told["negative_loops"] == two["negative_loops"]
    assert 0 < told["path_from_replay"] < 0.05
    assert "end" not in two["replay"] and one["replay"] is None
    # Another damping is another replay.
    other = run_evolve([small[0]], tmp_path / "o", by="replay", inertial_number=1e-5,
                       **how | {"damping": 0.1})  # fmt: skip
    assert other["end"] != two["end"] and other["damping"] == 0.1


def test_without_rows_the_end_of_both_ways_is_kept(small, tmp_path):
    how = {"to": 1e-4, "by": "both", "inertial_number": 1e-5, "figures": False}
    none, one = (run_evolve([small[0]], tmp_path / str(k), rows=k, **how) for k in (0, 1))
    assert none["end"] == one["end"] and none["replay"]["end"] == one["replay"]["end"]


NUMBERS = {"proportional-strain": {"strain_ratio": -0.5}, "fluid": {"fluid_bulk_modulus": 0.3}}


@pytest.mark.parametrize(
    "programme",
    ["drained", "cauchy-drained", "isotropic", "isotropic-stress", "undrained", "fluid",
     "proportional-strain"],
)  # fmt: skip
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_programmes_drive_what_they_say(programme, sense, small):
    snapshot = small[1]
    name = "undrained" if programme == "fluid" else programme
    stage = stage_of(name, 1, sense * 1e-5, **NUMBERS.get(programme, {}))
    path = follow(Scene(snapshot.graph, snapshot.law), stage, closure="packing")
    held = {"drained": ("P", 3), "isotropic-stress": ("P", 3), "isotropic": ("H", 3)}
    driven = path.P[:, 0] if programme == "isotropic-stress" else path.H[:, 0]
    assert driven[-1] - driven[0] == pytest.approx(sense * 1e-5, rel=1e-3)
    if programme == "undrained":
        area = np.linalg.det(np.eye(2) - path.H[-1].reshape(2, 2))
        assert area == pytest.approx(1.0, abs=1e-10)
    elif programme in ("cauchy-drained", "fluid"):
        ends = [stage.programme.values(path.H[row], path.P[row])[3] for row in (0, -1)]
        # To the square of the interval; the nominal stress is off by 1e-5.
        assert ends[1] == pytest.approx(ends[0], rel=1e-8)
    elif programme == "proportional-strain":
        assert path.H[-1] == pytest.approx([sense * 1e-5, 0, 0, -sense * 5e-6], rel=1e-6, abs=1e-15)
    else:
        name, k = held[programme]
        values = getattr(path, name)[:, k]
        expected = 0.0 if programme == "drained" else sense * 1e-5
        assert values[-1] - values[0] == pytest.approx(expected, rel=1e-3, abs=1e-8)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--to", "0"], "--to: got 0, expected a finite number other than zero"),
        (["--to", "1e-5", "--programme", "odd"], "--programme: got 'odd', expected drained"),
        (
            ["--to", "1"],
            "--to: got a strain of 1, expected less than 1: there the cell has no length",
        ),
        (["--to", "1e9"], "--to: got a strain of 1e+09, expected less than 1"),
        (["--to", "-0.2"], "--to: got a strain of -0.2, expected at most 0.1: 20000 intervals of"),
        (["--to", "1e-5", "--axis", "3"], "--axis: got 3, expected 1 or 2"),
        (["--to", "1e-5", "--rows", "-1"], "rows: got -1, expected a whole number, 0 or more"),
        (["--to", "1e-5", "--interval", "0"], "interval: got 0"),
        (["--to", "1e-5", "--instabilities", "0"], "instabilities: got 0"),
        (["--to", "1e-5", "--past", "on"], "past: got 'on'"),
        ([], "Missing option '--to'"),
    ],
)
def test_bad_options_are_one_clear_line(small, capsys, tmp_path, arguments, said):
    out = tmp_path / "out"
    assert run("evolve", small[0], "--out", out, *arguments) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and not out.exists()


@pytest.mark.parametrize(("share", "flows"), [(0.9, False), (-1.0, True)])
def test_a_state_out_of_balance_is_said_and_one_that_flows_refused(small, tmp_path, share, flows):
    """The rule: said from a thousandth of the mean contact force on, followed up to a tenth."""
    snapshot, grains = small[1], tmp_path / "grains_1.parquet"
    graph = snapshot.graph.replace(shear_force=share * snapshot.graph.shear_force)
    write_snapshot(grains, replace(snapshot, graph=graph))
    left, force = np.zeros((graph.grain_count, 2)), contact_forces(graph)
    for (i, j), f in zip(graph.contacts, force, strict=True):
        left[i], left[j] = left[i] - f, left[j] + f
    unbalanced = np.linalg.norm(left, axis=1).mean() / np.linalg.norm(force, axis=1).mean()
    how = {"to": 1e-4, "rows": 1, "interval": 5e-5, "figures": False}
    told = f"an unbalanced force of {unbalanced:.2g} of the mean contact force"
    if flows:
        with pytest.raises(InputError, match=f"snapshot: got {told}, expected 0.1 at most"):
            run_evolve([grains], tmp_path / "out", **how)
        return
    summary = run_evolve([grains], tmp_path / "out", **how)
    assert summary["status"] == "finished" and 1e-3 < unbalanced < 0.1
    assert sum(note.startswith(told) for note in summary["notes"]) == 1


def test_no_forces_and_no_cell_are_refused(tmp_path):
    with pytest.raises(InputError, match="no forces"):
        run_evolve([plain(tmp_path / "a", forces=False)], tmp_path / "out", to=1e-5)
    with pytest.raises(InputError, match="packing: got no cell and no walls, expected either"):
        run_evolve([plain(tmp_path / "b", walls=False)], tmp_path / "out", to=1e-5)
    assert not (tmp_path / "out").exists()


def test_a_sample_between_walls_is_followed_beside_its_later_states(tmp_path):
    first = plain(tmp_path / "a")
    out = tmp_path / "out"
    how = {"to": 1e-5, "rows": 2, "hold": True, "figures": False, "instabilities": 1000}
    summary = run_evolve([first, plain(tmp_path / "b")], out, **how)
    assert summary["status"] == "finished" and summary["dem"] == 1
    path, dem = (pd.read_parquet(out / f"{name}.parquet") for name in ("path", "dem"))
    left = path["work"] - path[["slip_work", "shear_work", "released"]].sum(axis=1)
    np.testing.assert_allclose(left, path["energy"] - path["energy"][0], rtol=1e-9, atol=1e-14)
    # The stress of the file is that of its walls: force over length.
    snapshot = read_snapshot(first)
    walls = snapshot.walls
    width, height = box_sides(snapshot.graph.x, walls)
    upright = np.abs(walls.branch[:, 0]) > np.abs(walls.branch[:, 1])
    right, top = upright & (walls.branch[:, 0] < 0), ~upright & (walls.branch[:, 1] < 0)
    pressed = -walls.force[right, 0].sum() / height, -walls.force[top, 1].sum() / width
    np.testing.assert_allclose(dem[["P11", "P22"]].to_numpy()[0], pressed, rtol=0.03)
    np.testing.assert_allclose(dem[["H11", "H22"]], 0.0, atol=1e-15)
    events = pd.read_parquet(out / "events.parquet")
    assert (events[["id1", "id2"]].to_numpy()[:, 0] >= 0).all()


@pytest.mark.parametrize("kind", ["files", "folder"])
def test_companions_stand_beside_the_path_as_given(small, tmp_path, kind):
    """Links of other names in another folder, or a link to the folder: not beside their targets.

    `evolve` and `series` read as planned, `snapshot` and `probe` by `read_planar`.
    """
    grains, snapshot = small
    links, target = tmp_path / "links", tmp_path / "target"
    target.mkdir()
    if kind == "folder":
        links.symlink_to(target, target_is_directory=True)
    for name in ("grains_1.parquet", "contacts_1.parquet", "cell_1.json"):
        kept = target / (name if kind == "folder" else f"blob-{name[::-1]}")
        kept.write_bytes((grains.parent / name).read_bytes())
        if kind == "files":
            links.mkdir(exist_ok=True)
            (links / name).symlink_to(kept)
    given = links / "grains_1.parquet"
    (planned,) = plan_series([given], None, reading())
    for path, how in ((planned.path, planned.how), (given, {})):
        read = read_planar(path, **how)
        assert np.array_equal(read.graph.normal_force, snapshot.graph.normal_force)
    assert run("check", given) == 0
    # The digest that a series goes on by knows all three files.
    before = planned.fingerprint
    (target if kind == "folder" else links).joinpath("cell_1.json").unlink()
    assert plan_series([given], None, reading())[0].fingerprint != before


def test_drops_and_reach_of_a_forecast():
    table = pd.DataFrame(
        {
            "driven": [1.0, 2.0, 3.0, 4.0],
            "stress_dem": [101.0, 99.0, 102.0, 90.0],
            "stress_persistence": 100.0,
            "stress_events": [101.0, 99.0, 98.0, 120.0],
            "drop": [False, True, False, True],
        }
    )
    told = dem_comparison_summary(table, ["events"])["events"]
    assert (told["drops"], told["drops_predicted"], told["drops_missed"]) == (2, 1, 1)
    assert told["drops_false"] == 1 and told["lead"] == 2.0 and told["holds_to"] == 2.0
    assert told["error"] == pytest.approx(np.sqrt((4.0**2 + 30.0**2) / 4))
    assert told["persistence_error"] == pytest.approx(np.sqrt((1 + 1 + 4 + 100) / 4))


@pytest.mark.parametrize(
    ("programme", "numbers", "word"),
    [
        ("drained", {"fluid_bulk_modulus": 1.0}, "fluid-bulk-modulus"),
        ("undrained", {"fluid_bulk_modulus": -1.0}, "fluid-bulk-modulus"),
        ("undrained", {"fluid_bulk_modulus": np.nan}, "fluid-bulk-modulus"),
        ("undrained", {"strain_ratio": 1.0}, "strain-ratio"),
        ("proportional-strain", {}, "strain-ratio"),
        ("proportional-strain", {"strain_ratio": np.inf}, "strain-ratio"),
    ],
)
def test_numbers_of_programmes_are_checked(programme, numbers, word):
    with pytest.raises(InputError, match=word):
        stage_of(programme, 1, 1e-5, **numbers)


def test_pathologies_of_every_row(tmp_path, small):
    paths = [small[0]]
    how = {"to": 2e-5, "rows": 3, "figures": False}
    run_evolve(paths, tmp_path / "p", pathologies=True, **how)
    run_evolve(paths, tmp_path / "q", **how)
    told, plain = (pd.read_parquet(tmp_path / f / "path.parquet") for f in "pq")
    assert told[plain.columns].equals(plain)
    assert set(told.columns) - set(plain.columns) == {
        "candidates", "asymmetry", "symmetric", "definite", "p_matrix", "solutions", "proved",
        "path_w2", "withheld", "instabilities",
    }  # fmt: skip
    assert (told["solutions"] == 1).all() and (told["withheld"] == "").all()
    with pytest.raises(InputError, match="--pathologies"):
        run_evolve(paths, tmp_path / "r", pathologies=True, by="replay", **how)
