"""The command `grainloops polygon`: keys, one-line errors, exit codes."""

import json
import sys

import pytest

from patterns import sample_path
from studies import cli


def run(monkeypatch, *arguments):
    """Exit status of the command, in this process."""
    monkeypatch.setattr(sys, "argv", ["grainloops", "polygon", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code


def test_json(monkeypatch, capsys, tmp_path, undrawn):
    code = run(
        monkeypatch, "--order", "5", "--kappa", "0.25", "--closure", "traction", "--confine",
        "0.05", "--end", "0.08", "--json", "--out", str(tmp_path / "out"),
    )  # fmt: skip
    assert code == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["critical_strain"]["diagonal"] == pytest.approx(0.2, abs=1e-12)
    assert {"events", "peak", "critical_strain", "status", "message"} <= set(summary)
    assert summary == json.loads((tmp_path / "out" / "summary.json").read_text())


def test_compare(monkeypatch, capsys, tmp_path, undrawn):
    folder = tmp_path / "out"
    arguments = ("--compare", "3,5", "--confine", "0.05", "--end", "0.06", "--out", str(folder))
    assert run(monkeypatch, *arguments) == 0
    assert "order" in capsys.readouterr().out
    assert (folder / "compare.parquet").exists()
    # Nothing is replaced unasked.
    assert run(monkeypatch, *arguments) == 2
    assert run(monkeypatch, *arguments, "--force") == 0


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--order", "2"], "--order"),
        (["--order", "6", "--kappa", "-1"], "--kappa"),
        (["--order", "6", "--confine", "1"], "--confine"),
        (["--order", "6", "--closure", "rigid"], "affine or traction"),
        (["--order", "6", "--spins", "up"], "blocked, affine or free"),
        (["--order", "6", "--programme", "triaxial"], "--programme"),
        (["--order", "6", "--orientation", "corner"], "vertex or edge"),
        (["--order", "six"], "--order"),
        (["--order", "5", "--radii", "1,2,3"], "one of them"),
        (["--order", "5", "--kn", "3"], "--snapshot"),
        (["--order", "5", "--law", "hertz", "--kappa", "0.3"], "spheres"),
        (["--order", "5", "--rolling", "0.3"], "--spins free"),
        (["--radii", "1,2,x"], "--radii"),
        (["--radii", "1,1,-1"], "--radii: got -1, expected positive numbers"),
        (["--snapshot", str(sample_path())], "--loop"),
        (["--snapshot", str(sample_path()), "--loop", "1", "--kappa", "1"], "--kappa"),
        (["--compare", "12-3"], "--compare"),
        (["--compare", "2-4"], "--order"),
        (["--compare", "3-4", "--order", "3"], "--compare"),
        ([], "--order"),
    ],
)
def test_bad_input_is_one_line(monkeypatch, capsys, tmp_path, arguments, word):
    assert run(monkeypatch, *arguments, "--out", str(tmp_path / "out")) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    assert word in shown.err
    assert not (tmp_path / "out").exists()
