"""`packing-paths.md` of `docs` and of `docs/evidence`: numbers are those of code and series."""

import numpy as np
import pandas as pd
import pytest

from grainloops import replay
from loops import Scene
from stability import follow
from stability.packing import (
    equations_of_motion,
    loop_changes,
    path,
    path_solver,
    point,
    rattlers,
    regime_factor,
    strain_increment,
)
from stability.packing.path import PackingPathOptions
from tests.docs.pages import DOCS, page, says, sections, tables
from tests.packings import strained
from tests.yade_slow import in_collection, predicted, slow, strain_between

PAGE = " ".join((page("packing-paths") + page("evidence/packing-paths")).split())
TABLES = {section: tables(part) for section, part in sections(page("evidence/packing-paths"))}
TABLE, FORETOLD = TABLES["What it predicts"]


def measured(what):
    """A table of measurements, kept beside its figure."""
    return pd.read_csv(DOCS / f"figures/packing-paths-{what}.csv")


def agrees(told, row, columns):
    """Numbers of a row of the page, a dash for none."""
    for title, name in columns.items():
        token, value = told[title].replace(",", ""), row[name]
        assert token == "-" if np.isnan(value) else says(token, value), (title, value)


def test_skill_of_all_targets():
    """By the study; the path's own counts for one target stand in the table above it."""
    rows = measured("skill").set_index(["target", "predictor", "step"])
    titles = {"W2 < 0": "W2_negative", "least affine tenth": "nonaffine"}
    titles |= {"contact lost": "contact_lost", "topology changed": "topology"}
    assert len(FORETOLD) == 20
    for told in FORETOLD:
        steps = {title: float(title) for title in list(told)[2:]}
        target, predictor = titles[told["target"]], told["predictor"].strip("`")
        number = rows.auc
        if predictor == "share of loops":
            number, predictor = rows.base, "packing_path"
        agrees(told, {step: number[target, predictor, step] for step in steps.values()}, steps)
    counts = rows.groupby("step").steps.first()
    *few, last = (str(count) for count in counts)
    assert f"{', '.join(few)} and {last} steps of 2e-5 to 5e-4" in PAGE


def test_skill_on_several_series():
    """Mean and smallest AUC of the steps, as they were measured one by one."""
    steps = measured("series")
    (skill,), (forecasts,) = TABLES["Skill on several series"], TABLES["How far a forecast holds"]
    columns = {
        "share of loops": "base", "rate problem": "packing", "persistence": "persistence",
        "own motion": "own_motion", "replay from rest": "replay_rest",
        "replay with velocities": "replay_moving", "`viscous`": "viscous",
        "`dynamic`": "dynamic", "load let go": "let_go",
    }  # fmt: skip
    assert sum(int(told["steps"]) for told in skill) == len(steps) == 107
    for told in skill:
        own = steps[(steps.series == told["series"].strip("`"))]
        own = own[np.isclose(own.step, float(told["step"]))]
        assert len(own) == int(told["steps"])
        for title, name in columns.items():
            mean, *least = told[title].split(", ")
            assert mean == "-" if own[name].isna().all() else says(mean, own[name].mean())
            assert all(says(one, own[name].min()) for one in least)
        median, largest = told["spread"].split(", ")
        assert says(median, own.spread.median()) and says(largest, own.spread.max())
    slow = steps[(steps.series == "yade-slow") & (steps.step < 4e-4)].set_index("before")
    assert slow.spread.idxmax() == 28 and slow.dynamic.idxmin() == 28
    assert slow.replay_moving[28] == pytest.approx(0.9997, abs=5e-5)
    parted = (steps.dynamic - steps.viscous).dropna()
    parted = parted[parted.abs() > 1e-6]
    told = f"{len(parted)} of the {steps.dynamic.notna().sum()} intervals that both finish"
    assert f"{told}, and `dynamic` is better in {(parted > 0).sum()} of them" in PAGE
    lost = [(steps[f"{way}_status"] == "lost").sum() for way in ("viscous", "dynamic")]
    assert f"`viscous` ends as `lost` in {lost[0]} and by `dynamic` in {lost[1]}" in PAGE
    rows = measured("forecasts").set_index(["series", "start"])
    assert len(forecasts) == len(rows) == 23
    for told in forecasts:
        row = rows.loc[told["series"].strip("`"), int(told["start"])]
        errors = {"path": "path", "replay": "replay", "stress of the start": "persistence"}
        for title, name in (errors | {"trend": "trend"}).items():
            assert says(told[title], row[f"error_{name}"])
        for way in ("path", "replay", "trend"):
            found = told[f"drops: {way}"]
            assert found == (f"{row[way]:.0f} of {row.drops:.0f}" if row.drops else "-")
        for way in ("path", "replay"):
            found = told[f"lead: {way}"]
            assert found == "-" if np.isnan(row[f"lead_{way}"]) else says(found, row[f"lead_{way}"])
    counts = rows[["drops", "path", "replay", "trend", "false_path", "false_replay", "false_trend"]]
    assert counts.sum().tolist() == [34, 31, 29, 12, 3, 1, 30]
    assert (rows.error_path < rows.error_persistence).all()
    (worse,) = rows.index[rows.error_replay >= rows.error_persistence]
    assert worse == ("yade-walls-linear", 13)
    assert (rows.error_replay < rows.error_trend).all()
    assert rows.index[rows.error_trend < rows.error_path].tolist() == [("yade-slow", 6)]


def test_rates():
    rows = measured("rates")
    rows, (table,) = rows[rows.rate > 0], TABLES["How slow is slow"]
    columns = {
        "inertial number": "rate", "steps": "steps", "distance from the path": "from_path",
        "unbalanced force at the end": "unbalanced", "signs that agree": "signs_of_path",
        "AUC for Yade's loops": "auc",
    }  # fmt: skip
    for told, (_, row) in zip(table, rows.iterrows(), strict=True):
        assert told["state"] == row.state
        agrees(told, row, columns)


def test_ways_past_an_instability():
    rows, (table,) = measured("past"), TABLES["Ways past an instability"]
    titles = list(table[0])
    names = ("from_replay", "signs_of_replay", "auc", "unstable", "released", "cpu_seconds")
    assert len(table) == rows.start.nunique()
    for told in table:
        viscous, dynamic = (
            rows[(rows.start == told["start"]) & (rows.past == past)].iloc[0]
            for past in ("viscous", "dynamic")
        )
        pairs = {title: title.split(": viscous")[0] for title in titles[1:] if ": viscous" in title}
        for title, name in zip(pairs, names, strict=True):
            agrees(told, viscous, {title: name})
            agrees(told, dynamic, {f"{pairs[title]}: dynamic": name})
        agrees(told, viscous, {"AUC: slow replay": "replay_auc"})
        agrees(told, viscous, {"seconds: slow replay": "replay_seconds"})
    steps = rows[rows.start.isin([str(number) for number in range(22, 30)])].groupby("past")
    mean = steps[["from_replay", "signs_of_replay", "auc", "replay_auc"]].mean()
    dynamic, viscous = mean.loc["dynamic"], mean.loc["viscous"]
    near = f"`dynamic` is {dynamic.from_replay:.3f} away from the slow replay in the mean"
    assert f"{near} and `viscous` {viscous.from_replay:.3f}, with" in PAGE
    assert f"{dynamic.signs_of_replay:.3f} and {viscous.signs_of_replay:.3f} of the signs" in PAGE
    spent = steps.cpu_seconds.sum()
    assert f"takes {spent['dynamic']:.0f} s where `viscous` takes {spent['viscous']:.0f}" in PAGE
    told = f"mean AUC {dynamic.auc:.3f} and {viscous.auc:.3f}; the slow replay has"
    assert f"{told} {dynamic.replay_auc:.3f}" in PAGE


def test_growth():
    rows, (table,) = measured("growth"), TABLES["What it costs, and where it ends"]
    columns = {
        "grains": "grains", "contacts": "contacts", "events": "events",
        "seconds of the path": "path_seconds", "ms an event": "event_ms",
        "MB of the path": "path_mb", "ms a step of the replay": "step_ms",
        "MB of the replay": "replay_mb",
    }  # fmt: skip
    assert (rows.status == "finished").all()
    for told, (_, row) in zip(table, rows.iterrows(), strict=True):
        agrees(told, row, columns)


def test_probes():
    rows = measured("probes")
    (table,) = TABLES["Probes over their amplitude"]
    for told, (amplitude, own) in zip(table, rows.groupby("amplitude"), strict=True):
        assert float(told["amplitude"]) == amplitude
        for title, against in zip(list(told)[1:], rows.against.unique(), strict=True):
            error = 100 * own[own.against == against].error
            quantiles = error.quantile([0.5, 0.9, 1.0])
            assert all(map(says, told[title].split(" / "), quantiles)), (amplitude, against)
    assert rows.theta_deg.nunique() == 12 and f"{rows.events.mean():.0f} events in the mean" in PAGE
    spent = rows.cpu_seconds
    assert f"{spent.min():.1f} to {spent.max():.1f} s of processor time" in PAGE
    # What was asked of paths at 5e-5, against Yade and against a replay ten times slower.
    last = rows[rows.amplitude == 5e-5].groupby("against").error.quantile([0.5, 0.9]).unstack()
    assert (last.loc["yade"] < [2e-3, 1e-2]).all()
    assert (last.loc["replay 2e-07"] < [5e-4, 3e-3]).all()


def test_settings():
    usual = PackingPathOptions()
    assert f"Intervals of strain {usual.interval:.0e}".replace("e-06", "e-6") in PAGE
    assert f"At {usual.instabilities} unstable contacts" in PAGE
    assert f"gap below {point.MAY_CLOSE_GAP} mean diameters" in PAGE
    assert f"Beyond {regime_factor.RANK} columns" in PAGE
    assert regime_factor.REGULARISATION == 1e-11 and "a ground spring of 1e-11 kn" in PAGE
    shares = rattlers.LOADED_SHARE, rattlers.UNLOADED_SHARE, rattlers.LIGHT_SHARE
    assert shares == (1e-4, 1e-5, 1e-2)
    assert rattlers.CAUGHT_SHARE == 2e-3 and "at a force of at most 2e-3 of the mean" in PAGE
    assert "no force above 1e-4 of the mean" in PAGE and "until 1e-5 of the mean force" in PAGE
    assert path_solver.HISTORY == 64 and path.STRETCH == 0.5 and "half of them, at most 64" in PAGE
    assert path.MOST_HALVINGS == 5 and path.CONVERGED == 0.01 and "After five halvings" in PAGE
    assert (
        strain_increment.GROUND_SPRINGS[:3] == (1e-3, 1e-2, 1e-1) and "1e-3, 1e-2, 1e-1 kn" in PAGE
    )
    assert f"more than {strain_increment.CHATTER} events of a contact in an interval" in PAGE
    motion = equations_of_motion
    assert (motion.SNAP_RATE, motion.REST_FORCE, motion.REST_STRAIN) == (2.5e-7, 1e-6, 1e-2)
    assert f"after {motion.CHECK_STEPS * motion.MAX_CHECKS:,} steps without rest" in PAGE
    assert strain_increment.MAX_SPEED_RATIO == 1e3 and "1000 times the strain" in PAGE
    assert point.JUMP == 0.5 and f"leaps by {point.LEAP} diameters" in PAGE


def test_sums_of_the_events():
    events, contacts = (
        sum(int(row[name]) for row in TABLE) for name in ("events", "unstable contacts")
    )
    assert f"Of the {events:,} events" in PAGE and f"at {contacts} contacts" in PAGE


def test_slow_replays_of_the_slow_series():
    """Rows and sums are those of the ways past an instability, by springs."""
    rows = measured("past").query("past == 'viscous'").set_index("start")
    (table,) = TABLES["What is quasi-static about Yade"]
    for told in table:
        row = rows.loc[told["snapshot"]]
        columns = {"path": "auc", "slow replay": "replay_auc"}
        agrees(told, row, {f"AUC: {title}": name for title, name in columns.items()})
        agrees(told, row, {"distance of the forces": "from_replay"})
        found = f"{row.opened_too} of {row.opened}", f"{row.replay_opened_too} of {row.opened}"
        assert (told["openings found: path"], told["openings found: slow replay"]) == found
        both = f"{row.opened_with_replay} of {row.replay_opened}"
        assert told["openings of the slow replay that the path has"] == both
    own = rows.loc[[told["snapshot"] for told in table]].sum()
    told = f"the slow replay has {own.replay_opened_too} of {own.opened}, the path {own.opened_too}"
    assert f"{told}, and {own.opened_with_replay} of the slow replay's {own.replay_opened}" in PAGE


@pytest.mark.slow
@in_collection
@pytest.mark.parametrize("row", [5, 6])
def test_slow_replays(row):
    """The same loops, and forces as near as the page says; replays turn on rounding."""
    told = TABLES["What is quasi-static about Yade"][0][row]
    number = int(told["snapshot"])
    (one, _), (two, _) = slow(number), slow(number + 1)
    H, graph = strain_between(one, two), one.graph
    way = follow(Scene(graph, one.law), strained(H), closure="packing", instabilities=1000)
    end = replay(Scene(graph, one.law), H, inertial_number=2.5e-7, balanced=True).state
    for title, reached in (("AUC: path", way.states[-1]), ("AUC: slow replay", end)):
        found = predicted(one, two, lambda faces, s=reached: loop_changes(graph, s, faces))
        assert found == pytest.approx(float(told[title]), abs=3e-3)
    first, last, other = (s.forces[: graph.contact_count] for s in (*way.states, end))
    apart = np.linalg.norm(last - other) / np.linalg.norm(other - first)
    assert apart == pytest.approx(float(told["distance of the forces"]), rel=0.3)


@pytest.mark.slow
@in_collection
@pytest.mark.parametrize(
    ("row", "numbers", "step"),
    [(0, range(2, 22), 1), (1, range(22, 32), 1), (2, range(22, 32, 2), 2), (3, (22, 27), 5)],
)
def test_skill(row, numbers, step):
    """Events by pivots turn on rounding: their count within 2 per cent, areas to their digits."""
    told, areas, events = TABLE[row], [], 0
    for number in numbers:
        (one, _), (two, _) = slow(number), slow(number + step)
        stage = strained(strain_between(one, two))
        way = follow(Scene(one.graph, one.law), stage, closure="packing", instabilities=1000)
        end, events = way.states[-1], events + len(way.events)
        areas.append(predicted(one, two, lambda f, g=one.graph, e=end: loop_changes(g, e, f)))
    assert len(areas) == int(told["steps"])
    assert says(told["AUC: mean"], np.mean(areas))
    assert says(told["AUC: median"], np.median(areas))
    assert says(told["AUC: smallest"], np.min(areas))
    assert events == pytest.approx(int(told["events"]), rel=0.02)
