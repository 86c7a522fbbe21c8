"""A series predicted by its packings: columns, targets, restarts, and the skill on real series."""

import itertools
import json
import shutil
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest

from grainloops import replay
from loops import (
    InputError,
    Regime,
    Scene,
    branch_vectors,
    contact_forces,
    contact_state,
    find_faces,
    rotation_and_stretch,
)
from patterns import Snapshot, WallContacts, read_snapshot, sample_path, snapshot_from_tables
from patterns.snapshots.cells import rows_by_number
from stability import rates_at
from stability.packing import PackingRates, packing_increment
from studies.commands.snapshot import _series_lines
from studies.reading import plan_series, reading
from studies.series import packing as series_packing
from studies.series.evolution import loop_increments, sample_strain, track_loops
from studies.series.figures import (
    MappedInterval,
    nonaffinity_map,
)
from studies.series.packing import (
    PREDICTED,
    STRESS_ERROR,
    WITHHELD,
    Following,
    interval_rate,
    packing_predictions,
    stress_error,
    velocity_beyond,
)
from studies.series.run import followed_summary, missed_stresses
from studies.snapshot.in_packing import (
    box_corners,
    place_columns,
)
from tests.docs.test_packing_page import quotes_the_sample
from tests.packings import (
    LAW,
    jammed,
    loop_changes,
    loop_rates,
    loops_in_place,
    packing,
    start_state,
)
from tests.stability.packing.walled_packings import JAMMED, jammed_in_box
from tests.studies.series.test_run import contents, run, times, write_series

CELLS = sample_path("slow/cells.csv")
PATHS = tuple(sorted(CELLS.parent.glob("grains_*.parquet")))
H = np.array([[0.8, 0.3], [-0.1, -0.5]])
STEP = 1e-7


def predict(out, paths=PATHS, **how):
    given = {"cells": CELLS, "shear_increment": "radii", "in_packing": True}
    return run(paths, out, **given | how)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    out = tmp_path_factory.mktemp("results") / "series"
    predict(out)
    return out


def by_interval(result, name, number):
    frame = pd.read_parquet(result / name)
    return frame[frame["snapshot" if name == "loops" else "snapshot_before"] == number]


def read(number):
    xx, xy, yx, yy = rows_by_number(CELLS)[10 + number]
    how = {"cell": [[xx, xy], [yx, yy]], "shear_increment": "radii"}
    return read_snapshot(PATHS[number], **how)


def test_columns_are_the_answers_to_the_strain_of_the_cell(result):
    """Against the response and the loops' rates, called apart."""
    before, after = read(1), read(2)
    strain = np.eye(2) - after.graph.cell @ np.linalg.inv(before.graph.cell)
    response = packing_increment(Scene(before.graph, before.law), strain)
    rates = loop_rates(response, find_faces(before.graph))
    every, own = by_interval(result, "packing", 1), by_interval(result, "increments", 1)
    for name, field in PREDICTED.items():
        # Workers hold BLAS to one thread, which rounds otherwise.
        found, size = every[name].to_numpy(), getattr(rates, field)
        largest = np.abs(size[np.isfinite(size)]).max()
        np.testing.assert_allclose(found, size, rtol=1e-9, atol=1e-11 * largest)
        np.testing.assert_array_equal(own[name], every[name].to_numpy()[own.loop_before])
    assert set(own.packing_status) == {response.status} <= {"one found", "nearest"}
    table = place_columns(loops_in_place(before.scene), before.mean_kn)
    # Two orders of the same eliminations.
    np.testing.assert_allclose(every.packing_lambda_min, table["packing_lambda_min"], atol=1e-9)
    # At rest its sign is a verdict.
    np.testing.assert_array_equal(every.packing_lambda_min_held, every.packing_lambda_min)
    evolution = pd.read_parquet(result / "evolution.parquet")
    share = (every.packing_lambda_min < 0).mean()
    assert evolution.packing_unstable[1] == pytest.approx(share, rel=1e-12) and share > 0.01
    # The additive work sums to the sample's; the other doesn't.
    area = by_interval(result, "loops", 1).area.to_numpy()
    whole = np.linalg.det(before.graph.cell) * np.sum(response.stress_rate * strain)
    assert np.sum(area * every.packing_work) == pytest.approx(whole, rel=1e-10)
    assert abs(np.sum(area * every.packing_W2) - whole) > 0.01 * abs(whole)
    np.testing.assert_array_equal(own.order, every.order.to_numpy()[own.loop_before])
    e, mean = rotation_and_stretch(own_strain(own))[1], rotation_and_stretch(strain)[1]
    away = np.linalg.norm(e - mean, axis=(1, 2)) / np.linalg.norm(mean)
    np.testing.assert_allclose(own.nonaffinity, away, rtol=1e-9)


@pytest.mark.slow
def test_the_path_and_the_replay_predict_beside(tmp_path, monkeypatch, unsaved):
    """One step of 2e-5, whose AUC of the path is .99 and more, of the replay .995 and more."""
    out, replayed = tmp_path / "series", []

    def kept(start, driven, **how):
        replayed.append((start, driven, replay(start, driven, **how)))
        return replayed[-1][-1]

    monkeypatch.setattr(series_packing, "replay", kept)
    summary = predict(out, PATHS[:2], in_packing="events", figures=True)
    before, after = read(0), read(1)
    strain = np.eye(2) - after.graph.cell @ np.linalg.inv(before.graph.cell)
    faces = find_faces(before.graph)
    ((start, driven, found),) = replayed
    np.testing.assert_allclose(driven, strain, rtol=1e-9, atol=1e-15)
    np.testing.assert_array_equal(start.graph.x, before.graph.x)
    end = found.state
    every = by_interval(out, "packing", 0)
    rates = loop_changes(before.graph, end, faces)
    np.testing.assert_allclose(every.replay_w2, rates.normalised_work, rtol=1e-9)
    np.testing.assert_allclose(every.replay_nonaffinity, rates.nonaffinity, rtol=1e-9)
    skill = summary["skill"]
    assert skill["packing_path"]["auc"] > 0.99 and skill["replay"]["auc"] > 0.998
    apart, row = summary["followed"]["path_from_replay"], pd.read_parquet(out / "skill.parquet")
    assert apart["snapshots"] == row[["snapshot_before", "snapshot_after"]].iloc[0].tolist()
    assert 0 < apart["median"] == apart["largest"] < 0.2
    own = contact_forces(after.graph).T @ branch_vectors(after.graph)
    own /= np.linalg.det(after.graph.cell)
    away = np.linalg.norm(end.stress - own) / (0.5 * np.trace(own))
    told = pd.read_parquet(out / "evolution.parquet")["replay_stress_error"].iloc[1]
    assert told == pytest.approx(away, rel=1e-6) and told < 1e-3
    assert summary["followed"]["replay_missed_stress"] == []
    assert skill["packing"]["auc"] < skill["packing_path"]["auc"]
    far = summary["skill_of_targets"]["nonaffine"]
    assert far["packing"]["auc"] < far["packing_path"]["auc"] < far["replay"]["auc"]
    table = pd.read_parquet(out / "skill.parquet").set_index(["target", "predictor"])
    # A contact of the start that is open at the end has lost its loop a contact.
    opened = end.normal_force[: before.graph.contact_count] == 0
    assert np.array_equal(every.replay_opening < 1, lost_any(faces, opened))
    for target in ("contact_lost", "topology"):
        aucs = [table.auc[target, one] for one in ("packing", "packing_path", "replay")]
        assert aucs[0] < aucs[1] and aucs[2] > 0.99
        assert table.recall[target, "replay"] > 0.95
    with pytest.raises(InputError, match="--in-packing: got 'path', expected False, True, rates"):
        predict(tmp_path / "other", PATHS[:2], in_packing="path")


def test_the_last_stress_of_a_replay_is_held_to_that_of_the_later_snapshot():
    """Over its mean stress, in any unit; with all forces of a contact changed by a hundredth."""
    graph = jammed(16, 2)
    later = tracked(graph)
    state = start_state(graph)
    assert stress_error(state, later) == 0.0
    pressure = 0.5 * np.trace(state.stress)
    wanted = 0.01 * np.linalg.norm(state.stress) / pressure
    for unit in (1.0, 1e6):
        N, T = 1.01 * unit * graph.normal_force, 1.01 * unit * graph.shear_force
        strained = replace(state, normal_force=N, shear_force=T)
        first = tracked(graph.replace(normal_force=N / 1.01, shear_force=T / 1.01))
        assert stress_error(strained, first) == pytest.approx(wanted, rel=1e-12)
    nothing = tracked(graph.replace(normal_force=0 * N, shear_force=0 * T))
    assert stress_error(state, nothing) is None


def followed(error, rate=2e-6):
    return {
        "path_status": "refused" if rate is None else "finished",
        "path_instabilities": 0,
        "path_from_replay": None if rate is None else 0.1,
        "replay_inertial_number": rate,
        "replay_rate_from": None if rate is None else "as given",
        "replay_stress_error": error,
    }


def test_replays_that_miss_the_stress_are_named_by_their_snapshots():
    rows = [followed(0.001), followed(None, None), {}, followed(0.9 * STRESS_ERROR),
            followed(0.0123), followed(0.02)]  # fmt: skip
    summary = followed_summary(rows, [3, 4, 6, 7, 8, 9, 12], Following(damping=0.2))
    assert summary["replay_stress_error"] == {
        "median": pytest.approx((0.9 * STRESS_ERROR + 0.0123) / 2),
        "largest": 0.02,
        "snapshots": [9, 12],
    }
    assert missed_stresses(summary) == [
        f"from snapshot {one} to {two} the replay ends {share} % of p from the later snapshot's "
        "stress: its loops are not predicted"
        for one, two, share in ((8, 9, "1.23"), (9, 12, "2"))
    ]
    assert summary["replay_rate_from"] == {"as given": 4}
    assert (summary["programme"], summary["damping"]) == ("straight", 0.2)


def test_a_series_whose_replays_are_all_refused_is_summed_up(tmp_path):
    """No walls and no cell: no interval has a rate, though times and masses are known."""
    paths, listed = write_series(tmp_path / "run", 3), tmp_path / "times.csv"
    listed.write_text("snap,time\n0,0.0\n1,1.0\n2,2.0\n")
    how = {"in_packing": "events", "times": listed, "mean_mass": 1.0}
    summary = run(paths, tmp_path / "out", **how)
    told = summary["followed"]
    assert told["path_statuses"] == {"refused": 2} and told["replay_inertial_number"] is None
    assert told["replay_rate_from"] == {} and told["replay_stress_error"] is None
    assert any("not followed by events" in note for note in summary["notes"])


def lost_any(faces, opened):
    """Whether each loop has one of the contacts."""
    parts = (faces.contacts[a:b] for a, b in itertools.pairwise(faces.offsets))
    return np.array([opened[part].any() for part in parts])[faces.loops]


def own_strain(table):
    H = np.stack([table[f"H{ij}"] for ij in ("11", "12", "21", "22")], -1)
    return H.reshape(-1, 2, 2)


def test_what_became_of_every_loop(result):
    """Fates as counted in the evolution; a survived loop has lost nothing, a merged one has."""
    evolution = pd.read_parquet(result / "evolution.parquet")
    for k in range(3):
        every = by_interval(result, "packing", k)
        counts = every.fate.value_counts()
        for fate in ("survived", "merged", "split"):
            assert counts.get(fate, 0) == evolution[fate][k + 1]
        assert not every[every.fate.isin(["survived", "split"])].contact_lost.any()
        assert every[every.fate == "merged"].contact_lost.all()
        survived = np.flatnonzero(every.fate == "survived")
        np.testing.assert_array_equal(by_interval(result, "increments", k).loop_before, survived)
    graph = read(0).graph
    faces = find_faces(graph)
    part = slice(*faces.offsets[faces.loops[7] : faces.loops[7] + 2])
    smallest = graph.normal_force[faces.contacts[part]].min() / graph.normal_force.mean()
    assert by_interval(result, "packing", 0).smallest_N.iloc[7] == pytest.approx(smallest)


@pytest.mark.parametrize("k", range(3))
@pytest.mark.parametrize("target", ["nonaffine", "contact_lost", "topology"])
def test_targets_count_what_they_say(result, target, k):
    """AUC by counting pairs, base rates, and signs, from the datasets."""
    table = pd.read_parquet(result / "skill.parquet")
    row = table[(table.target == target) & (table.predictor == "packing")].iloc[k]
    every, own = by_interval(result, "packing", k), by_interval(result, "increments", k)
    if target == "nonaffine":
        true = (own.nonaffinity > np.quantile(own.nonaffinity, 0.9)).to_numpy()
        score = own.packing_nonaffinity.to_numpy()
        assert np.isnan(row.precision)
    else:
        lost = target == "contact_lost"
        true = (every.contact_lost if lost else every.fate != "survived").to_numpy()
        times = every.packing_opening
        times = times if lost else np.minimum(times, every.packing_closing)
        score = -times.to_numpy()
        assert row.precision == true[score > -1].mean()
        assert row.recall == (score[true] > -1).mean()
    # A loop at the quantile itself is in neither part.
    assert row.base == pytest.approx(true.mean(), abs=1e-3)
    pairs = product(score[true], score[~true])
    auc = np.mean([1.0 if a > b else 0.5 if a == b else 0.0 for a, b in pairs])
    assert row.auc == pytest.approx(auc, abs=1e-3)


def test_persistence_of_a_change_is_that_the_loop_is_new(result):
    table = pd.read_parquet(result / "skill.parquet")
    rows = table[(table.predictor == "persistence") & (table.target == "topology")]
    assert rows.loops.iloc[0] == 0
    past, now = by_interval(result, "increments", 0), by_interval(result, "packing", 1)
    new = ~now.loop.isin(past.loop_after)
    assert 0 < new.sum() < 30
    assert rows.recall.iloc[1] == new[now.fate != "survived"].mean()


def test_skill_by_order_is_that_of_the_loops_of_an_order(result):
    table = pd.read_parquet(result / "skill_by_order.parquet")
    whole = pd.read_parquet(result / "skill.parquet")
    assert sorted(table.order.unique()) == [3, 4, 5, 6, 7, 8]
    keys = ["snapshot_before", "predictor", "target"]
    np.testing.assert_array_equal(
        table.groupby(keys, sort=False).loops.sum(), whole.groupby(keys, sort=False).loops.sum()
    )
    own = by_interval(result, "increments", 2)
    own = own[own.order >= 8]
    picked = table[(table.order == 8) & (table.predictor == "packing")]
    row = picked[picked.target == "W2_negative"].iloc[2]
    assert row.base == (own.w2 < 0).mean()
    assert row.recall == (own.packing_w2[own.w2 < 0] < 0).mean()
    # Within one order, its number says nothing.
    same = table[(table.predictor == "order") & (table.order == 4)]
    assert (same[same.target == "W2_negative"].auc == 0.5).all()


def test_skill_on_the_sample_series(result):
    """Measured: .977, .953 and .992; persistence .941."""
    summary = json.loads((result / "summary.json").read_text())
    assert (summary["packing"]["solved"], summary["packing"]["intervals"]) == (2, 3)
    assert summary["packing"]["intervals nearest"] == 1
    assert summary["packing"]["worst residual"] < 1e-12
    for solved in (3, 2):
        told = {"solved": solved, "intervals nearest": 3 - solved}
        said = _series_lines(summary | {"packing": summary["packing"] | told})[0]
        left = f"nearest regimes in {3 - solved}"
        assert said.endswith(f"solved in {solved} of 3 intervals, {left}")
    skill, others = summary["skill"], summary["skill_of_targets"]
    assert quotes_the_sample(skill)
    assert skill["packing"]["auc"] > 0.965 and skill["packing"]["rank_correlation"] > 0.92
    assert skill["packing"]["auc_min"] > 0.95
    assert skill["packing"]["auc"] > skill["persistence"]["auc"] + 0.02
    assert skill["packing"]["auc"] > skill["traction_free"]["auc"] + 0.15
    assert skill["own_motion"]["auc"] > 0.99
    assert others["nonaffine"]["packing"]["auc"] > 0.99
    assert others["topology"]["packing"]["auc"] > 0.97
    assert 0.25 < skill["packing"]["base"] < 0.31
    by_order = summary["skill_by_order"]["packing"]
    assert min(by_order[f"order_{n}"] for n in (4, 5, 6, 7)) > 0.9


def test_every_predictor_is_printed(result):
    """The smallest force ranks lost contacts as well as the packing does, 0.992 of 1."""
    summary = json.loads((result / "summary.json").read_text())
    lines, targets = _series_lines(summary), summary["skill_of_targets"]
    (head,) = (place for place, line in enumerate(lines) if "AUC of all predictors" in line)
    printed = {line[:35].strip(): line[35:].split() for line in lines[head + 1 :]}
    known = {name for skill in targets.values() for name in skill}
    assert len(printed) == 1 + len(known) and "smallest_N" in known
    for name, values in printed.items():
        assert len(values) == len(targets), name
    lost = printed["smallest force N"][[*targets].index("contact_lost")]
    assert lost == f"{targets['contact_lost']['smallest_N']['auc']:.3f}" and float(lost) > 0.98


def tracked(graph, rotation=None):
    count = graph.contact_count
    law = LAW.__class__(*(np.full(count, v) for v in (LAW.kn, LAW.kt, LAW.mu)), "radii")
    regime = np.full(count, Regime.ELASTIC, dtype=np.int8)
    ids = np.arange(graph.grain_count)
    snapshot = Snapshot(graph, law, regime, ids, 0, (), rotation=rotation)
    return snapshot


def moved(graph, response, step):
    """The packing after the motion and the forces that the response asks for."""
    F = np.eye(2) - step * response.strain_rate
    x, cell = graph.x @ F.T + step * response.motion, F @ graph.cell
    later = graph.replace(x=x, x0=x, cell=cell, cell0=cell)
    force = contact_forces(graph) + step * response.force_rate
    state = contact_state(later)
    normal, shear = (np.sum(axis * force, axis=1) for axis in (state.n, state.t))
    return later.replace(normal_force=normal, shear_force=shear)


def test_a_packing_that_does_as_told_is_predicted():
    """To first order in the step, by the rate problem and by its own motion."""
    graph = packing(30, seed=12, sliding=0.3)
    response = rates_at(Scene(graph, LAW), H=H)
    turns = np.round(np.linspace(-3, 3, graph.grain_count))
    before = tracked(graph, np.zeros(graph.grain_count))
    assert response.status == "one found" and response.sliding > 2
    errors = []
    for step in (4e-5, 2e-5, 1e-5):
        spins = step * response.spin + 2 * np.pi * turns
        after = tracked(moved(graph, response, step), spins)
        fates = track_loops(before, after)
        columns, row, notes = packing_predictions(before, after, fates)
        actual = loop_increments(before, after, fates)
        assert row["packing_status"] == "one found" and notes == [WITHHELD]
        assert len(actual["w2"]) == len(columns["loop"])
        size = np.abs(actual["W2"]).max()
        errors.append(np.abs(columns["packing_W2"] - actual["W2"]).max() / size)
        # The motion is the rates' own: differences over the step are all that it loses.
        np.testing.assert_allclose(columns["own_w2"], columns["packing_w2"], rtol=0, atol=1e-8)
        for what in ("opening", "closing"):
            times = columns[f"own_{what}"], columns[f"packing_{what}"]
            np.testing.assert_allclose(*times, rtol=1e-5)
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 2.0, atol=0.01)


def test_nothing_is_predicted_where_nothing_can_be_trusted(monkeypatch):
    graph = packing(24, seed=3)
    before = tracked(graph)
    after = tracked(moved(graph, rates_at(Scene(graph, LAW), H=H), STEP))
    fates = track_loops(before, after)
    solved = PackingRates.increment
    for status in ("not converged",):
        with monkeypatch.context() as patch:
            patch.setattr(
                PackingRates,
                "increment",
                lambda self, control, status=status: replace(solved(self, control), status=status),
            )
            columns, row, _ = packing_predictions(before, after, fates)
        assert row["packing_status"] == status
        assert all(np.isnan(columns[name]).all() for name in PREDICTED)
    columns, _, _ = packing_predictions(before, after, fates)
    assert np.isfinite(columns["packing_W2"]).all()
    # Without rotations nobody knows the own motion.
    assert np.isnan(columns["own_w2"]).all()


def test_a_packing_that_floats_is_refused():
    graph = packing(24, seed=3)
    across = graph.images.any(axis=1)
    alone = graph.__class__(
        graph.x, graph.radii, graph.contacts[~across], images=graph.images[~across], cell=graph.cell
    )
    state = tracked(alone)
    columns, row, notes = packing_predictions(state, state, track_loops(state, state))
    assert row == {"packing_status": "refused"}
    assert "float" in notes[0]
    assert np.isnan(columns["packing_W2"]).all() and len(columns["fate"]) == len(columns["loop"])


@pytest.mark.slow
def test_paths_and_replays_in_processes_give_the_same_bytes(tmp_path):
    """Both turn on rounding; an interval for each of two processes."""
    for workers in (1, 2):
        predict(tmp_path / str(workers), workers=workers, in_packing="events")
    alone, shared = (contents(tmp_path / str(workers)) for workers in (1, 2))
    assert shared == alone
    assert sum(name.startswith("packing/part-") for name in alone) == len(PATHS) - 1
    told = pd.read_parquet(tmp_path / "2" / "skill.parquet")
    assert {"packing_path", "replay"} < set(told.predictor)


@pytest.mark.slow
def test_processes_and_restarts_give_the_same_bytes(tmp_path):
    """Either of the two parts of an interval that is lost is made again, and the rest is kept."""
    alone, out = tmp_path / "alone", tmp_path / "out"
    predict(alone, PATHS[:2])
    predict(out, PATHS[:2], workers=2)
    assert contents(out) == contents(alone)
    before = times(alone)
    for dataset in ("packing", "increments"):
        (out / dataset / "part-00000-00001.parquet").unlink()
        kept = (out / "loops" / "part-00000.parquet").stat().st_mtime_ns
        predict(out, PATHS[:2])
        assert contents(out) == contents(alone)
        assert (out / "loops" / "part-00000.parquet").stat().st_mtime_ns == kept
    predict(alone, PATHS[:2])
    assert times(alone) == before


def test_other_candidates_are_another_series(result, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(result, out)
    for how in ({"candidates": 0.9}, {"in_packing": False}):
        with pytest.raises(InputError, match=r"another series \(--in-packing\)"):
            predict(out, **how)
    predict(out, PATHS[:2], force=True, in_packing=False)
    assert not (out / "packing").exists()
    for band in (0.0, 1.5, float("nan")):
        with pytest.raises(InputError, match=r"candidates: got .*, expected a finite number"):
            predict(out, PATHS[:2], candidates=band)


def test_samples_between_walls_and_without_forces(tmp_path):
    """An outline is held where walls tell no branches; geometry alone is refused."""
    paths = write_series(tmp_path / "run", 2)
    summary = run(paths, tmp_path / "walls", in_packing=True)
    assert summary["packing"]["boundary"] == "grains held to the affine motion"
    for path in paths:
        contacts = path.with_name(path.name.replace("grains", "contacts"))
        pd.read_csv(contacts)[["id1", "id2"]].to_csv(contacts, index=False)
    with pytest.raises(InputError, match=r"got no forces.*, expected forces and a law"):
        run(paths, tmp_path / "bare", in_packing=True)


@pytest.mark.slow
def test_figures_stand_on_the_page(result, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(result, out)
    predict(out, figures=True)
    summary = json.loads((out / "summary.json").read_text())
    page = (out / "report.html").read_text()
    for name in ("skill_by_predictor", "nonaffinity_map"):
        assert f"{name}.png" in summary["files"]
    assert page.count("Map of the non-affinity") == 2 and "packing_opening" in page


def test_the_map_shows_what_is_predicted_beside_what_came(result):
    """In the order that the drawer has, values of all loops, and none for those that are lost."""
    before, after = read(0), read(1)
    fates = track_loops(before, after)
    every, own = by_interval(result, "packing", 0), by_interval(result, "increments", 0)
    mapped = MappedInterval(before, fates, dict(own.items()), dict(every.items()))
    drawn = [ax.collections[0].get_array() for ax in nonaffinity_map(mapped).axes[:2]]
    sums = every.packing_nonaffinity.sum(), own.nonaffinity.sum()
    assert [np.ma.masked_invalid(one).sum() for one in drawn] == pytest.approx(sums)
    assert [np.ma.masked_invalid(one).count() for one in drawn] == [len(every), len(own)]


def test_the_rate_of_the_sample():
    """Strain over time, times sqrt(mean mass/pressure), from table, file or options."""
    cells = rows_by_number(CELLS)
    before, after = (
        read_snapshot(path, cell=np.reshape(cells[k], (2, 2)))
        for path, k in zip(PATHS, (10, 11), strict=False)
    )
    strain = np.diag([-2.6e-5, 2e-5])
    masses = 5.0 * before.graph.radii**2
    stress = contact_forces(before.graph).T @ branch_vectors(before.graph)
    pressure = 0.5 * np.trace(stress) / np.linalg.det(before.graph.cell)
    expected = np.linalg.norm(strain) / 0.06 * np.sqrt(masses.mean() / pressure)
    bare = replace(before, mass=None, velocity=None, spin=None)
    heavy = replace(bare, mass=masses, step=100.0, time=3.0)
    known = Following(time_step=1e-3)
    for found in (
        interval_rate(heavy, replace(after, time=3.06), strain, (None, None), Following()),
        interval_rate(heavy, after, strain, (7.0, 7.06), Following()),
        interval_rate(replace(heavy, time=None), replace(after, step=160.0), strain,
                      (None, None), known),
        interval_rate(bare, after, strain, (7.0, 7.06), Following(mean_mass=masses.mean())),
    ):  # fmt: skip
        assert found.inertial_number == pytest.approx(expected, rel=1e-3)
        assert found.options["duration"] == pytest.approx(0.06)
    slow = interval_rate(heavy, after, strain, (0.0, 1e6), Following())
    assert slow.options["duration"] < 100.0 and "at most" in slow.source
    for lacks, (one, listed) in {
        "no times": (heavy, (None, None)),
        "no masses": (bare, (0.0, 1.0)),
        "no growing times": (heavy, (1.0, 1.0)),
    }.items():
        one = replace(one, time=None)
        assert interval_rate(one, after, strain, listed, Following())[:2] == (2e-6, lacks)
    given = interval_rate(heavy, after, strain, (0.0, 1.0), Following(inertial_number=1e-5))
    assert given[:2] == (1e-5, "as given")


def test_the_slow_sample_tells_its_own_rate():
    """Yade made it at 2e-6; replays start with its velocities, and are better for it."""
    before, after = (one.read() for one in plan_series(PATHS[:2], CELLS, reading()))
    times = [float(time) for time in pd.read_csv(CELLS)["time"][:2]]
    H = sample_strain(before, after)[0]
    rate = interval_rate(before, after, H, times, Following())
    assert rate.source == "times, masses and velocities"
    assert rate.inertial_number == pytest.approx(2.7e-6, rel=0.02)  # 2e-6 of the axial strain alone
    affine = before.graph.x @ (H / (times[1] - times[0])).T
    beyond = before.velocity + affine
    beyond -= beyond.mean(axis=0)
    rounding = 1e-6 * np.abs(beyond).max()
    np.testing.assert_allclose(rate.options["velocity"], beyond, rtol=0, atol=rounding)
    # A code that leaves the affine motion out: the velocities as they stand.
    left_out = replace(before, velocity=beyond)
    found = interval_rate(left_out, after, H, times, Following()).options["velocity"]
    np.testing.assert_allclose(found, beyond, rtol=0, atol=1e-6 * rounding)


def walled(**how):
    """A small packing between rough walls as a snapshot."""
    graph, planes, force = jammed_in_box(*JAMMED[4])
    springs = (planes.kn, planes.kt, planes.mu)
    walls = WallContacts(planes.grain, force, -planes.branch, *springs)
    regime, ids = np.ones(graph.contact_count, dtype=np.int8), np.arange(graph.grain_count)
    return Snapshot(graph, LAW, regime, ids, len(force), (), walls, **how)


def test_velocities_between_walls_are_those_beyond_the_walls_motion():
    """Grains that drift as a whole between walls do move; with their walls they don't."""
    strain, duration = np.diag([2e-5, -1e-5]), 0.5
    own = 1e-6 * np.array([3.0, 1.0]) + 1e-7 * np.sin(np.arange(72)).reshape(36, 2)
    before = walled()
    x, walls = before.graph.x, before.walls
    corner = box_corners(x, walls)[0]
    for frame in (np.zeros(2), np.array([1e-4, -2e-4])):
        moved = x - (x - corner) @ strain.T + duration * frame
        shift = (moved - x)[walls.grain]
        # Feet go with the walls, whatever the grains do.
        feet = x[walls.grain] - walls.branch
        branch = walls.branch + shift - (duration * frame - (feet - corner) @ strain.T)
        branch = np.where(np.abs(walls.branch) > 1e-9, branch, 0.0)
        after = replace(
            before,
            graph=before.graph.replace(x=moved, x0=None),
            walls=replace(walls, branch=branch),
        )
        given = own + frame - (x - corner) @ strain.T / duration
        found = velocity_beyond(replace(before, velocity=given), after, strain, duration)
        np.testing.assert_allclose(found, own, rtol=0, atol=1e-14)


def test_a_walls_contact_slides_where_the_file_says_so():
    """Flags decide in the rate problem, forces where there are none; in a path all may stick."""
    one = walled()
    n = one.walls.branch / np.linalg.norm(one.walls.branch, axis=1, keepdims=True)
    N = np.sum(n * one.walls.force, axis=1)
    T = np.abs(n[:, 0] * one.walls.force[:, 1] - n[:, 1] * one.walls.force[:, 0])
    at_yield = T >= 0.999 * one.walls.mu * N
    np.testing.assert_array_equal(one.boundary_and_notes[0].walls.regime == 2, at_yield)
    flags = np.arange(len(N)) % 3 == 0
    assert (flags != at_yield).any()
    again = snapshot_from_tables(**replace(one, walls=replace(one.walls, sliding=flags)).tables())
    np.testing.assert_array_equal(again.walls.sliding, flags)
    np.testing.assert_array_equal(again.boundary_and_notes[0].walls.regime == 2, flags)
    np.testing.assert_array_equal(again.boundary_and_notes[0].walls.kt, one.walls.kt)
