"""The page on larger loops: its numbers against closed forms, and that it can be written."""

from pathlib import Path

import numpy as np
import pytest

from studies.larger_loops import __main__ as command
from studies.larger_loops.cost import exponent, path_seconds, tangent_seconds
from studies.larger_loops.figures import draw_cost, draw_laws
from studies.larger_loops.numbers import (
    KAPPA,
    LONGER,
    TABLE,
    _cells,
    _full,
    _hertz,
    _rolling,
    _square,
    path_threshold,
    rolling_threshold,
)
from studies.larger_loops.page import page
from tests.oracles.polygon_thresholds import critical_strain as oracle

# Free spins stick at the first load; their path is tested with the study of one loop.
ROWS = [pytest.param(e, marks=[pytest.mark.slow] if e[1] == "free" else []) for e in TABLE]


@pytest.mark.parametrize("entry", ROWS)
def test_table_through_paths(entry):
    rows = _cells(*entry)
    assert [row["orders"] for row in rows] == [(3,), (4,), LONGER]
    for row in rows:
        assert row["path_error"] < 1e-9
        assert row["root_error"] < 1e-9


@pytest.mark.parametrize("closure", ["affine", "traction"])
@pytest.mark.parametrize("order", [3, 4, 7])
def test_blocked_thresholds_against_the_oracle(order, closure):
    wanted = oracle(order, KAPPA, closure)
    assert path_threshold(order, closure, "blocked", wanted + 0.01) == pytest.approx(
        wanted, abs=1e-9
    )


def test_remarks():
    assert _square()["diagonal"] is None
    assert _square()["symmetric"] == pytest.approx(KAPPA / (1 + KAPPA), abs=1e-12)
    assert _full() < 1e-9


def test_other_laws():
    for row in _hertz():
        assert row["error"] < 1e-9
        wanted = oracle(6, row["kappa"], "traction", exponent=1.5)
        assert row["found"] == pytest.approx(wanted, abs=1e-9)
    for row in _rolling():
        assert row["error"] < 1e-9
        for order, found in row["found"].items():
            k_r = row["k_r"]
            wanted = oracle(order, KAPPA, "traction", rolling=lambda E, k_r=k_r: k_r / (1 - E) ** 2)
            assert found == pytest.approx(wanted, abs=1e-9)
            assert rolling_threshold(order, KAPPA, k_r) == pytest.approx(wanted, abs=1e-9)


def test_cost_is_measured():
    seconds = tangent_seconds((6, 12), batch=60)
    path, rows = path_seconds((6,))
    assert (seconds > 0).all()
    assert path[0] > 0
    assert rows[0] > 5
    assert exponent((1, 2, 4), np.array([1.0, 4.0, 16.0]), 1) == pytest.approx(2.0)


def test_page(tmp_path, monkeypatch):
    """Written whole, from a comparison of three orders and times that are given."""
    from studies.larger_loops import numbers
    from studies.polygon.comparison import ComparisonParameters, compare
    from studies.polygon.parameters import PolygonParameters

    def few(closure):
        shared = PolygonParameters(3, closure=closure, kappa=KAPPA, confine=0.05, end=0.1)
        return compare(ComparisonParameters((3, 5), shared))

    monkeypatch.setattr(numbers, "compared", few)
    monkeypatch.setattr(numbers, "TABLE", TABLE[:1])
    monkeypatch.setattr(command, "tangent_seconds", lambda: 1e-6 * np.arange(6.0, 15.0))
    monkeypatch.setattr(command, "path_seconds", lambda: (0.1 * np.arange(1.0, 7.0), None))
    command.write_page(tmp_path)
    text = (tmp_path / "larger-loops.md").read_text()
    figures = {line.split("figures/")[1].rstrip(")") for line in text.splitlines() if "](" in line}
    assert figures == {file.name for file in (tmp_path / "figures").iterdir()}
    assert "not found" not in text
    assert "| nan" not in text


def test_the_written_page_is_this_one():
    """Its tables of thresholds are those of today's numbers."""
    text = (Path(__file__).parents[2] / "docs" / "larger-loops.md").read_text()
    for row in _rolling():
        assert all(f"{found:.10f}" in text for found in row["found"].values())
    assert all(word in text for word in ("κ/(1 + κ)", "(1 + κ)/(2 + κ)", "0: the first load"))


def test_figures_show_the_numbers():
    numbers = {"hertz": _hertz(), "rolling": _rolling()}
    spheres, rolling = draw_laws(numbers).axes
    points = spheres.lines[2].get_ydata()
    assert list(points) == [row["found"] for row in numbers["hertz"]]
    assert len(rolling.lines) == 2 * len(LONGER) + 1
    fig = draw_cost({"tangent": np.ones(9), "path": np.ones(6)})
    assert len(fig.axes) == 2


def test_page_says_what_is_missing():
    """A threshold that a path misses is named, not left blank."""
    row = {
        "closure": "traction", "spins": "blocked", "orders": (5,), "words": "w", "expected": 0.2,
        "path": None, "path_error": np.nan, "root_error": 1e-15,
    }  # fmt: skip
    numbers = {
        "table": [row], "full": 0.0, "square": {"diagonal": None, "symmetric": 0.2},
        "hertz": [], "rolling": [],
    }  # fmt: skip

    class Nothing:
        loops = ()

    numbers["compared"] = {"affine": Nothing, "traction": Nothing}
    text = page(numbers, {"tangent": 1.0, "path": 1.0})
    assert "none found | not found" in text
