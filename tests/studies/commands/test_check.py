"""`grainloops check`: what it prints, writes and exits with."""

import json

import pandas as pd
import pytest

from patterns import sample_path
from studies.cli import main
from tests.patterns import snapshot_faults as faults


def run(monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", ["grainloops", "check", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        main()
    return caught.value.code


@pytest.fixture
def spoilt(tmp_path):
    deck = faults.Tables("csv", sample_path())
    faults.turn_fn(deck)
    faults.other_units(deck)
    return deck.write(tmp_path)


def test_healthy(monkeypatch, capsys):
    assert run(monkeypatch, sample_path()) == 0
    shown = capsys.readouterr().out
    assert "verdict: ok" in shown and "doubt " not in shown
    assert "N is 1 times kn times the overlap" in shown


def test_findings_are_printed_and_written(monkeypatch, capsys, spoilt, tmp_path):
    out = tmp_path / "out"
    assert run(monkeypatch, spoilt, "--out", out, "--csv") == 0
    shown = capsys.readouterr().out
    assert "doubt  stiffness      N is 1e+04 times" in shown and "fn is tension positive" in shown
    summary = json.loads((out / "summary.json").read_text())
    assert summary["verdict"] == "doubt" and summary["findings"]["doubt"] == 2
    table = pd.read_parquet(out / "findings.parquet")
    assert set(table["check"][table["severity"] == "doubt"]) == {"stiffness", "fn"}
    assert (out / "findings.csv").exists()


def test_errors_exit_with_0_too(monkeypatch, capsys, tmp_path):
    deck = faults.Tables("csv", sample_path())
    faults.flip(deck)
    path = deck.write(tmp_path)
    assert run(monkeypatch, path, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["verdict"] == "error"
    (error,) = [row for row in summary["checks"] if row["severity"] == "error"]
    assert error["check"] == "directions" and error["number"] < -0.9


def test_unreadable_exits_with_2_after_the_others(monkeypatch, capsys, tmp_path):
    assert run(monkeypatch, sample_path(), tmp_path / "grains_none.csv") == 2
    captured = capsys.readouterr()
    assert "1 snapshots" in captured.out and captured.err.count("\n") == 1


def test_snapshot_refuses_what_check_calls_an_error(monkeypatch, capsys, tmp_path):
    deck = faults.Tables("csv", sample_path())
    faults.flip(deck)
    path = deck.write(tmp_path)
    monkeypatch.setattr(
        "sys.argv", ["grainloops", "snapshot", str(path), "--out", str(tmp_path / "o")]
    )
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2 and "they pull" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()
