"""The study of paths of packings: its replays in parts, and what it draws."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from loops import Scene
from patterns import sample_path
from stability.packing import replay
from tests.packings import LAW, jammed
from tests.tools.scaling import packing_paths as study


def test_a_replay_in_parts_is_one_replay():
    """Velocities are handed on, so that a part goes on where the one before ended."""
    graph, direction = jammed(16, 2), np.diag([0.6, -0.8])
    amplitudes = np.array([1e-5, 2.5e-5, 1e-4])
    stresses = study.replayed(graph, LAW, direction, amplitudes, 1e-5)
    whole = replay(Scene(graph, LAW), 1e-4 * direction, inertial_number=1e-5).state.stress
    start = replay(Scene(graph, LAW), np.zeros((2, 2)), duration=1e-9).state.stress
    # Parts end on whole steps, and their rates are constant each.
    change = np.linalg.norm(whole - start)
    np.testing.assert_allclose(stresses[-1], whole, atol=2e-3 * change)
    assert np.linalg.norm(stresses[0] - start) < 0.5 * change


def test_ways_past_agree_where_nothing_is_unstable():
    """Each a row, as near to the slow replay as its rate and the interval leave."""
    given = SimpleNamespace(graph=jammed(16, 2))
    rows = list(study._ways("jammed", given, None, LAW, 2e-4 * np.diag([1.0, -1.0])))
    assert [row["past"] for row in rows] == ["viscous", "dynamic"]
    for row in rows:
        assert row["status"] == "finished" and row["unstable"] == 0
        assert row["from_replay"] < 2e-3 and row["signs_of_replay"] == 1.0


@pytest.fixture
def collection(tmp_path):
    """The four snapshots of the slow compression that are in the repository, as a collection."""
    folder, stored = tmp_path / "yade-slow", sample_path("slow")
    folder.mkdir()
    for path in stored.glob("*.parquet"):
        (folder / path.name).symlink_to(path)
    table = pd.read_csv(stored / "cells.csv")
    table.assign(unbalanced=1e-4).to_csv(folder / "macro.csv", index=False)
    return tmp_path


def test_an_interval_is_told_by_every_way(collection):
    """A slow step: what moves with the grains tells nearly all, the step before less."""
    row = study._of_interval(collection, study.SERIES[0], (11, 12))
    ways = ("replay_moving", "replay_rest", *study.PATHS)
    assert row["step"] == 2e-5 and row["viscous_status"] == "finished"
    assert all(row[way] > 0.99 for way in ways), row
    assert all(abs(row[f"{way}_stress"] - row["stress"]) < 0.1 for way in ways), row
    assert 0.8 < row["persistence"] < row["packing"] < min(row[way] for way in ways)
    assert 0 < row["spread"] < 0.3 and 0.2 < row["base"] < 0.35


def test_drops_and_leads_are_counted(collection, monkeypatch):
    """Stresses of 100 at the start: one drop told, one missed by the trend, one told falsely."""

    def run_evolve(paths, out, **how):
        assert len(paths) == 3 and how["to"] == pytest.approx(4e-5, rel=0.05)
        out.mkdir()
        table = {"driven": [1e-5, 2e-5, 3e-5], "stress_dem": [99.0, 100.0, 98.0]}
        table |= {"stress_events": [99.0, 98.0, 97.0], "stress_replay": [101.0, 102.0, 101.0]}
        pd.DataFrame(table | {"stress_persistence": 100.0}).to_parquet(out / "forecast.parquet")
        return {"status": "finished"}

    stresses = iter([100.0, 99.0])
    monkeypatch.setattr(study, "run_evolve", run_evolve)
    monkeypatch.setattr(study, "stress_of", lambda _: next(stresses) * np.eye(2))
    row = study._forecast(collection, study.SERIES[0], range(11, 14))
    assert [row[name] for name in ("drops", "path", "replay", "trend")] == [2, 2, 1, 0]
    assert [row[f"false_{name}"] for name in ("path", "replay", "trend")] == [1, 0, 0]
    assert row["lead_path"] == row["lead_replay"] == 3e-5 and np.isnan(row["lead_trend"])
    np.testing.assert_allclose(row["error_path"], np.sqrt(5 / 3), rtol=1e-15)
    np.testing.assert_allclose(row["error_persistence"], np.sqrt(5 / 3), rtol=1e-15)
    slope = 1.0 / 2e-5
    off = np.array([100 + slope * k * 1e-5 for k in (1, 2, 3)]) - [99.0, 100.0, 98.0]
    np.testing.assert_allclose(row["error_trend"], np.sqrt(np.mean(off**2)), rtol=0.01)


@pytest.mark.parametrize("what", ["skill", "probes", "rates", "growth"])
def test_figures_show_what_was_measured(what):
    names = ("yade", *(f"replay {rate:g}" for rate in study.PROBED))
    rows = {
        "skill": [
            {"step": step, "target": target, "predictor": name, "auc": 0.9}
            for step in study.STEPS for target in study.TARGETS for name in study.SHOWN
        ],
        "probes": [
            {"state": "before", "against": name, "amplitude": a, "theta_deg": k, "error": a * k}
            for name in names for a in (1e-6, 1e-5) for k in (1, 2)
        ],
        "rates": [
            {"state": "held", "rate": rate, "from_path": 2 * rate, "auc": 0.9}
            for rate in (0.0, *study.RATES)
        ],
        "growth": [
            {"grains": n, "event_ms": n, "step_ms": n / 2, "path_mb": n, "replay_mb": n}
            for n in (2000, 8000)
        ],
    }[what]  # fmt: skip
    axes = study.STUDIES[what][1](rows).axes
    assert all(ax.get_xscale() == "log" and ax.get_xlabel() for ax in axes)
    lines = axes[0].lines
    wanted = {"skill": 0.9, "probes": 1.5e-3, "rates": 2 * study.RATES[0], "growth": 8000}[what]
    assert any(np.isclose(np.max(line.get_ydata()), wanted) for line in lines)
