"""The study of paths of packings: its replays in parts, and what it draws."""

from types import SimpleNamespace

import numpy as np
import pytest

from loops import Scene
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
