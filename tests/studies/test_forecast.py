"""Forecasts: places against the paths themselves, probabilities in closed form, the command."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import grainloops as gl
from grainloops import evolve
from loops import Fate, find_faces, loop_fates, match_contacts
from patterns import Snapshot, read_snapshot, sample_path, write_snapshot
from patterns.snapshots.cells import rows_by_number
from studies.evolve import Evolution
from studies.forecast import (
    KINDS,
    NEVER,
    PARTS,
    WAYS,
    Calibration,
    calibration,
    forecast_reach,
    next_of,
    opening_places,
    parts_cells,
    parts_of,
    places,
    since,
    spread_of,
)
from studies.series.skill import score_skill
from tests.command import run
from tests.packings import LAW, jammed
from tests.unsaved import leave_files_empty
from tests.yade_slow import in_collection, slow, strain_between

DRIVEN = {"to": -3e-3, "axis": 2, "interval": 1e-4}


@pytest.fixture(scope="module")
def sample():
    """A jammed packing that loses a contact and gains one, with ids of its own."""
    graph = jammed(16, 2)
    ids = 100 + 3 * np.arange(graph.grain_count)
    regime = np.ones(graph.contact_count, dtype=np.int8)
    return Snapshot(graph, LAW, regime, ids, 0, ())


@pytest.fixture(scope="module")
def grains(sample, tmp_path_factory):
    path = tmp_path_factory.mktemp("small") / "grains_1.parquet"
    write_snapshot(path, sample)
    return path


@pytest.fixture(scope="module")
def found(sample):
    return gl.forecast(sample, **DRIVEN, inertial_number=1e-5)


def test_a_flag_counts_that_lasts_to_the_end():
    flags = np.array([[1, 0, 0, 1, 0], [0, 0, 1, 1, 1], [1, 0, 1, 1, 0]], dtype=bool)
    assert since(flags).tolist() == [2, 3, 1, 0, 3]


def test_the_first_contact_of_a_loop_to_open_for_good():
    """Four contacts around a loop: two open, one opens and closes again, one stays closed."""
    x = [[0, 0], [1, 0], [1, 1], [0, 1]]
    ring = gl.GrainGraph(x=x, radii=[0.5] * 4, contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    overlaps = np.array([[1, 2, 2, 1], [1, 2, -2, 1], [1, -4, -3, -1], [-1, -4, -3, 1.0]])
    law = SimpleNamespace(touching=np.full(4, 9.0))
    states = [SimpleNamespace(closed=row > 0, law=law, length=9.0 - row) for row in overlaps]
    place, contact = opening_places(SimpleNamespace(states=states), find_faces(ring), 4)
    assert contact.tolist() == [2] and place == pytest.approx([0.5 / 3])
    states[0].closed[2] = False
    place, contact = opening_places(SimpleNamespace(states=states), find_faces(ring), 4)
    assert contact.tolist() == [1] and place == pytest.approx([(1 + 1 / 3) / 3])


def test_a_contact_opens_where_the_path_has_its_event(found):
    way, scene = found.evolution.ways["events"], found.evolution.scene
    at = places(found.evolution, "events")
    end = way.states[-1]
    (event,) = [one for one in way.of_kind("opening") if not end.closed[one.contacts[0]]]
    contact = event.contacts[0]
    faces = scene.faces
    beside = [
        row
        for row, face in enumerate(faces.loops)
        if contact in faces.contacts[slice(*faces.offsets[face : face + 2])]
    ]
    assert np.flatnonzero(np.isfinite(at.opens)).tolist() == beside == [11, 13]
    assert set(at.contact[beside]) == {contact} and (np.delete(at.contact, beside) == -1).all()
    # To a row: once it is open its grains move apart faster.
    row = 1 / (len(way.states) - 1)
    np.testing.assert_allclose(at.opens[beside], event.parameter / 3e-3, atol=0.5 * row)
    # The next one closes before: one loop is lost there.
    closing = way.of_kind("closing")[0].parameter / 3e-3
    half = 0.5 / (len(way.states) - 1)
    assert at.lost[13] == pytest.approx(closing, abs=half) and closing < at.opens[13]
    assert at.lost[11] == pytest.approx(at.opens[11], abs=half)


def test_what_is_lost_at_the_end_is_what_tracking_says(found):
    scene, end = found.evolution.scene, found.evolution.way.states[-1].graph()
    ids = found.evolution.ids
    match = match_contacts(scene.graph, ids, end, ids)
    fates = loop_fates(match, scene.faces, find_faces(end)).before
    lost = fates != Fate.SURVIVED
    assert 0 < lost.sum() < len(lost)
    assert found.loops["path_lost_at"].notna().tolist() == lost.tolist()
    assert found.loops["path_fate"].tolist() == [Fate(k).name.lower() for k in fates]
    work = found.evolution.changes()[-1].normalised_work
    assert found.loops["path_unstable_at"].notna().tolist() == (work < 0).tolist()


def test_path_and_replay_agree_and_the_ids_are_those_of_the_file(found, sample):
    loops = found.table()
    for kind in KINDS:
        one, two = loops[f"path_{kind}_at"], loops[f"replay_{kind}_at"]
        assert one.notna().tolist() == two.notna().tolist()
        np.testing.assert_allclose(one.dropna(), two.dropna(), rtol=0.03)
    opens = loops[loops["path_opens_at"].notna()]
    for row in opens.itertuples():
        assert {row.path_id1, row.path_id2} <= set(row.grains) <= set(sample.ids)
    assert (loops[loops["path_opens_at"].isna()][["path_id1", "path_id2"]] == -1).all(axis=None)
    assert np.array_equal(loops["loop"], gl.loop_table(sample)["loop"])
    assert all(map(np.array_equal, loops["grains"], gl.loop_table(sample)["grains"]))


def test_the_numbering_of_the_grains_changes_nothing(found, sample):
    rng = np.random.default_rng(3)
    order = rng.permutation(sample.graph.grain_count)
    place = np.argsort(order)
    graph = sample.graph.replace(
        x=sample.graph.x[order], radii=sample.graph.radii[order],
        contacts=place[sample.graph.contacts],
    )  # fmt: skip
    other = Snapshot(graph, LAW, sample.regime, sample.ids[order], 0, ())
    again = gl.forecast(other, **DRIVEN, by="events", spread=False)
    keys = [frozenset(ids) for ids in found.loops["grains"]]
    rows = [keys.index(frozenset(ids)) for ids in again.loops["grains"]]
    for kind in KINDS:
        ours = found.loops[f"path_{kind}_at"].to_numpy()[rows]
        np.testing.assert_allclose(again.loops[f"path_{kind}_at"], ours, rtol=1e-6)


def test_results_say_what_they_are(found, sample):
    assert repr(found).startswith("Forecast(to: H22 = -0.003 (strain), events: finished, replay: ")
    assert "next drop: none in 4 of 4 ways" in found._repr_html_() or "next drop" in repr(found)
    evolved = gl.evolve(sample, **DRIVEN, rows=2)
    assert repr(evolved).startswith("Evolution(driven: H22 to -0.003 (strain), events: finished at")
    assert "<caption>Evolution</caption>" in evolved._repr_html_()
    assert evolved.table()["grains"].map(list).tolist() == found.loops["grains"].map(list).tolist()
    from matplotlib.figure import Figure

    for one in (evolved, found):
        ax = one.plot(ax=Figure().add_subplot())
        assert ax.get_xlabel()


def test_a_scene_without_ids_counts_its_grains_from_zero(sample):
    assert np.array_equal(sample.scene.ids, sample.ids)
    evolved = evolve(replace(sample.scene, ids=None), "drained", **DRIVEN, rows=1)
    assert isinstance(evolved, Evolution)
    ids = np.unique(np.concatenate(evolved.table()["grains"].tolist()))
    assert ids.min() >= 0 and ids.max() < sample.graph.grain_count


def test_units_change_no_probability(sample, found):
    """Lengths in other units, forces in others: the reach is the same."""
    reach = forecast_reach(sample.scene, 3e-3, "H22")
    assert found.reach == reach
    large = sample.graph.replace(
        x=7 * sample.graph.x, radii=7 * sample.graph.radii, cell=7 * sample.graph.cell,
        normal_force=14 * sample.graph.normal_force, shear_force=14 * sample.graph.shear_force,
    )  # fmt: skip
    law = gl.LinearFrictional(2.0, 1.0, 0.5, "radii")
    assert forecast_reach(gl.Scene(large, law), 3e-3, "H22") == pytest.approx(reach, rel=1e-12)


# ---- probabilities


COLUMNS = ["series", "level", "reach", "kind", "path", "replay", "loops", "true"]
ROWS = [
    ["a", 0, 0.1, "lost", 0, 0, 10, 9], ["a", 0, 0.1, "lost", 0, 4, 8, 4],
    ["a", 0, 0.1, "lost", 4, 4, 80, 2], ["b", 0, 0.1, "lost", 0, 0, 5, 5],
    ["b", 1, 1.0, "lost", 4, 4, 50, 5], ["b", 1, 1.0, "lost", 1, 0, 10, 5],
]  # fmt: skip
KNOWN = Calibration(pd.DataFrame(ROWS, columns=COLUMNS), {})


def test_parts_and_cells():
    assert parts_of(np.array([0.0, 0.26, 1.0, np.inf, np.nan])).tolist() == [0, 1, 3, NEVER, -1]
    every = np.arange(-1, PARTS + 1)
    path, again = (side.ravel() for side in np.meshgrid(every, every))
    cells = dict(
        zip(
            zip(path.tolist(), again.tolist(), strict=True),
            parts_cells(path, again),
            strict=True,
        )
    )
    assert cells[0, 2] == cells[2, 0] == cells[2, 2] == 2
    assert cells[1, NEVER] == cells[NEVER, 1] == PARTS + 1 and cells[NEVER, NEVER] == 2 * PARTS
    assert cells[-1, 1] == cells[1, -1] == 2 * PARTS + 2 and cells[-1, -1] == -1
    assert len(set(cells.values())) == 3 * PARTS + 3


def test_probabilities_are_frequencies_with_one_loop_of_the_base_rate():
    base = (9 + 4 + 2 + 5) / (10 + 8 + 80 + 5)
    early, never = np.array([0.1]), np.array([np.inf])
    p, rate = KNOWN.probability("lost", early, early, 0.1)
    assert rate[0] == pytest.approx(base) and p[0] == pytest.approx((14 + base) / 16)
    p, _ = KNOWN.probability("lost", early, never, 0.1)
    assert p[0] == pytest.approx((4 + base) / 9)
    # One way alone: whatever the other says.
    p, _ = KNOWN.probability("lost", early, np.array([np.nan]), 0.1)
    assert p[0] == pytest.approx((9 + 4 + 5 + base) / (10 + 8 + 5 + 1))
    # A cell without loops, and no answer at all.
    p, _ = KNOWN.probability("lost", np.array([0.9]), np.array([0.9]), 0.1)
    assert p[0] == pytest.approx(base)
    assert np.isnan(KNOWN.probability("lost", np.array([np.nan]), np.array([np.nan]), 0.1)[0])


def test_between_two_reaches_and_beyond():
    never = np.array([np.inf])
    ends = [KNOWN.probability("lost", never, never, reach)[0][0] for reach in (0.1, 1.0)]
    middle = KNOWN.probability("lost", never, never, 10**-0.5)[0][0]
    assert middle == pytest.approx(np.mean(ends)) and ends[0] != ends[1]
    assert np.isnan(KNOWN.probability("lost", never, never, 2.1)[0][0])
    assert np.isnan(KNOWN.probability("lost", never, never, 0.049)[0][0])


def test_a_series_is_told_by_the_others_alone():
    changed = KNOWN.table.assign(
        true=np.where(KNOWN.table["series"] == "a", 0, KNOWN.table["true"])
    )
    one, two = (known.without("a") for known in (KNOWN, Calibration(changed, {})))
    pd.testing.assert_frame_equal(one.table, two.table)
    # Of `b` level 1 is told by nobody else; level 0 by `a`.
    rows = KNOWN.left_out("lost")
    base = 15 / 98
    assert [9 + base, 10 + 1] == pytest.approx([rows[-1][0] * 11, 11])
    assert rows[-1][1:].tolist() == [5, 5]


@pytest.mark.parametrize("kind", KINDS)
def test_the_stored_table_is_better_than_the_base_rate_on_series_that_it_leaves_out(kind):
    stored = calibration()
    assert len(stored.provenance["series"]) >= 3
    own = stored.table[stored.table["kind"] == kind]
    assert (own["true"] <= own["loops"]).all()
    assert own["loops"].sum() <= stored.provenance["loops"]
    said, loops, true = stored.left_out(kind).T
    base = true.sum() / loops.sum()
    brier = np.sum(true * (1 - said) ** 2 + (loops - true) * said**2) / loops.sum()
    assert brier < 0.9 * base * (1 - base)
    # What both say comes true more often than what neither does.
    shares = stored.shares(kind, "both").groupby("cell")[["loops", "true"]].sum()
    rate = shares["true"] / shares["loops"]
    assert rate[0] > 5 * rate[2 * PARTS]


# ---- the next drop


def way_of(stress, lost=(), **more):
    stress = np.asarray(stress, dtype=float)
    P = np.zeros((len(stress), 4))
    P[:, 3] = stress
    events = [SimpleNamespace(parameter=at) for at in lost]
    return SimpleNamespace(
        P=P, parameter=np.arange(len(stress), dtype=float), status="finished", message="",
        of_kind=lambda kind: events if kind == "instability" else [],
        imbalance=np.array([0.0, 1e-5]),
        **{"steps": 0, "limit": np.nan, "limit_spread": np.nan} | more,
    )  # fmt: skip


def test_a_drop_begins_at_the_peak_and_ends_where_it_is_regained():
    told = next_of("path", way_of([100, 103, 102, 101.5, 104, 90], [1.5, 3.0]), "H22", 1.0)
    assert (told.drop, told.instability) == (1.0, 1.5)
    assert told.drop_size == pytest.approx(0.015) and told.residual == 1e-5
    # Less than 1e-4 is none, and in extension the stress falls by itself.
    assert np.isnan(next_of("path", way_of([100, 99.995, 101]), "H22", 1.0).drop)
    told = next_of("path", way_of([100, 99, 99.5, 98]), "H22", -1.0)
    assert told.drop == -1.0 and told.drop_size == pytest.approx(0.005)
    # 100 grains, rows of 100 steps: the first two rows are the start of a replay.
    moving = {"steps": 500, "velocity": np.zeros((100, 2))}
    told = next_of("replay", way_of([100, 105, 103, 103, 104, 103], **moving), "H22", 1.0)
    assert told.drop == 4.0
    rows = pd.DataFrame({"drop": [1.0, np.nan, 3.0]})
    assert spread_of(rows, "drop") == {"value": 1.0, "low": 1.0, "high": 3.0, "found": 2, "ways": 3}


# ---- the command


def test_the_command_writes_what_the_call_returns(grains, found, tmp_path, monkeypatch, capsys):
    leave_files_empty(monkeypatch)
    out = tmp_path / "out"
    asked = ["--to", "-3e-3", "--axis", "2", "--interval", "1e-4", "--inertial-number", "1e-5"]
    status = run("forecast", grains, *asked, "--shear-increment", "radii", "--csv",
                 "--out", out)  # fmt: skip
    assert status == 0
    said = capsys.readouterr().out
    names = {f"{name}.{kind}" for name in ("loops", "next") for kind in ("parquet", "csv")}
    names |= {"forecast.png", "summary.json", "report.html"}
    assert {path.name for path in out.iterdir()} == names
    loops, summary = (
        pd.read_parquet(out / "loops.parquet"),
        json.loads((out / "summary.json").read_text()),
    )
    for column in found.loops.select_dtypes("number"):
        # The file keeps its digits, but a chain of contacts in motion doubles what they round.
        np.testing.assert_allclose(loops[column], found.loops[column], rtol=1e-4, err_msg=column)
    assert "path: finished at H22 = -0.003" in said and " of 15 loops expected, " in said
    told = summary["kinds"]["lost"]
    assert told["path"] == 2 and told["expected"] == pytest.approx(loops["lost_probability"].sum())
    assert summary["ways"]["path, interval halved"]["residual"] < 1e-5
    assert summary["calibration"] == calibration().provenance
    assert {"to", "programme", "reach", "provenance", "definitions"} <= summary.keys()


def test_a_lost_path_says_so_and_gives_no_numbers(sample, grains, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("studies.evolve.INTERVALS", 2)
    monkeypatch.setattr("studies.evolve.require_reach", lambda *_: None)
    asked = ["--to", "1e-3", "--interval", "2e-5", "--no-spread", "--no-figures", "--rows", "4"]
    asked += ["--inertial-number", "1e-4", "--out"]
    assert run("forecast", grains, *asked, tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "note: path lost at 3.93e-05: 2 intervals were not enough" in said
    assert "by the path no answer, by the replay " in said
    loops = pd.read_parquet(tmp_path / "out/loops.parquet")
    assert loops.filter(regex="path_.*_at").isna().all(axis=None)
    assert set(loops["path_fate"]) == {"unknown"}
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert summary["kinds"]["lost"]["path"] is None and summary["kinds"]["lost"]["replay"] >= 0
    # The replay alone: its own frequencies.
    known, reach = calibration(), forecast_reach(sample.scene, 1e-3, "H11")
    place = np.where(loops["replay_lost_at"].notna(), loops["replay_lost_at"] / 1e-3, np.inf)
    expected, _ = known.probability("lost", np.full(len(place), np.nan), place, reach)
    np.testing.assert_allclose(loops["lost_probability"], expected)
    only = gl.forecast(sample, to=1e-3, interval=2e-5, by="events", spread=False, rows=4)
    assert not only.answered and only.loops["lost_probability"].isna().all()


def test_a_limit_of_the_control_is_told_with_its_spread():
    way = way_of([100, 101], limit=0.8, limit_spread=0.004)
    told = next_of("path", way, "P11", -1.0)
    assert (told.limit, told.limit_spread) == (-0.8, 0.004) and np.isnan(told.drop)


def test_farther_than_was_counted_there_are_no_probabilities(sample):
    found = gl.forecast(
        sample, "isotropic", to=1e-7, interval=1e-7, spread=False, by="events", rows=2
    )
    assert found.answered and found.loops["lost_probability"].isna().all()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--to", "0"], "--to: got 0, expected a finite number other than zero"),
        (["--to", "1e-5", "--programme", "odd"], "--programme: got 'odd', expected drained"),
        (["--to", "1e-5", "--axis", "3"], "--axis: got 3, expected 1 or 2"),
        (["--to", "1e-5", "--rows", "0"], "--rows: got 0, expected a whole number, 1 or more"),
        (["--to", "1e-5", "--inertial-number", "0"], "inertial_number: got 0"),
        ([], "Missing option '--to'"),
    ],
)
def test_bad_options_are_one_clear_line(grains, capsys, tmp_path, arguments, said):
    out = tmp_path / "out"
    assert run("forecast", grains, "--out", out, *arguments) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and not out.exists()


def test_what_is_no_sample_or_no_option_is_refused(sample, tmp_path):
    with pytest.raises(gl.InputError, match="got 'up', expected one of axis, by"):
        gl.forecast(sample, to=1e-5, direction="up")
    with pytest.raises(gl.InputError, match="a Scene or a Snapshot"):
        gl.evolve(sample.graph, to=1e-5)
    with pytest.raises(gl.InputError, match="no cell and no walls"):
        gl.evolve(gl.loop(sample, 3).scene, to=1e-5)


def lost_between(one, two):
    """Loops of a snapshot that are no more in a later one."""
    match = match_contacts(one.graph, one.ids, two.graph, two.ids)
    return loop_fates(match, one.faces, two.faces).before != Fate.SURVIVED


@pytest.mark.slow
def test_loops_that_yade_lost_are_told_from_the_earlier_snapshot():
    folder = sample_path("slow")
    cells = rows_by_number(folder / "cells.csv")
    one, two = (
        read_snapshot(
            folder / f"grains_{number}.parquet", shear_increment="radii",
            cell=np.reshape(cells[number], (2, 2)),
        )
        for number in (10, 13)
    )  # fmt: skip
    found = gl.forecast(one, "biaxial", to=6e-5, axis=2, spread=False)
    lost = lost_between(one, two)
    p = found.loops["lost_probability"].to_numpy()
    # The page says so: 33 are likely lost, and Yade lost them, of 38.
    assert lost.sum() == 38 and (p > 0.5).sum() == 33 and lost[p > 0.5].all()
    assert p.sum() == pytest.approx(lost.sum(), rel=0.2)


@in_collection
@pytest.mark.parametrize("pair", [(12, 13), (24, 25)])
def test_a_step_of_the_collection_is_told_by_the_other_series(pair):
    """Loops that Yade loses have the large probabilities, by series that this one is not among."""
    one, two = (slow(number)[0] for number in pair)
    found = gl.forecast(one, "biaxial", to=strain_between(one, two)[1, 1], axis=2, spread=False)
    ways = (places(found.evolution, way).lost for way in WAYS.values())
    said, base = calibration().without("yade-slow").probability("lost", *ways, found.reach)
    lost = lost_between(one, two)
    assert score_skill(said, np.where(lost, -1.0, 1.0), signed=False)["auc"] > 0.9
    errors = [np.mean((p - lost) ** 2) for p in (said, base)]
    assert errors[0] < 0.3 * errors[1]
