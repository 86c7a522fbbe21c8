"""The command `grainloops polygon`: keys, one-line errors, exit codes."""

import json

import numpy as np
import pytest

from patterns import random_loop, regular_polygon, sample_path
from tests.command import run


def test_compare(capsys, tmp_path, undrawn):
    folder = tmp_path / "out"
    arguments = ("--compare", "3,5", "--confine", "0.05", "--end", "0.06", "--out", str(folder))
    assert run("polygon", *arguments) == 0
    assert "order" in capsys.readouterr().out
    assert (folder / "compare.parquet").exists()
    # Nothing is replaced unasked.
    assert run("polygon", *arguments) == 2
    assert run("polygon", *arguments, "--force") == 0


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
        (["--snapshot", str(sample_path())], "loop: got none"),
        (["--snapshot", str(sample_path()), "--loop", "1", "--kappa", "1"], "--kappa"),
        (["--compare", "12-3"], "--compare"),
        (["--compare", "2-4"], "--order"),
        (["--compare", "3-4", "--order", "3"], "--compare"),
        ([], "--order"),
    ],
)
def test_bad_input_is_one_line(capsys, tmp_path, arguments, word):
    assert run("polygon", *arguments, "--out", str(tmp_path / "out")) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    assert word in shown.err
    assert not (tmp_path / "out").exists()


def write_ring(path, x, radii):
    rows = [f"{a!r},{b!r},{r!r}" for (a, b), r in zip(x.tolist(), radii, strict=True)]
    path.write_text("\n".join(["x,y,radius", *rows]) + "\n")
    return ["--centres", str(path)]


@pytest.mark.parametrize("order", [1, -1])
def test_centres_of_a_regular_loop_give_its_path(capsys, tmp_path, undrawn, order):
    """Whatever its size, its place and the sense in which its grains are listed."""
    x = (20.0 * regular_polygon(5).x + 3.0)[::order]
    how = ["--closure", "traction", "--confine", "0.05", "--end", "0.08", "--json", "--out"]
    given = (write_ring(tmp_path / "ring.csv", x, [10.0] * 5), ["--order", "5"])
    found = []
    for name, loop in zip("ab", given, strict=True):
        assert run("polygon", *loop, *how, str(tmp_path / name)) == 0
        found.append(json.loads(capsys.readouterr().out)["states"])
    for name in ("A", "end"):
        one, other = (states[name] for states in found)
        for key in ("E1", "E2", "s1", "s2"):
            assert one[key] == pytest.approx(other[key], abs=1e-13)


def test_a_reentrant_loop_of_a_table(capsys, tmp_path, undrawn):
    """Grains that are off by a tenth are moved until neighbours touch; the move is told."""
    loop = random_loop(8, seed=3, convex=False)
    x = loop.x + 0.02 * np.array([1.0, -1.0]) * (-1.0) ** np.arange(8)[:, None]
    ring = write_ring(tmp_path / "ring.csv", x, loop.radii.tolist())
    assert run("polygon", *ring, "--end", "0.12", "--json", "--out", str(tmp_path / "out")) == 0
    parameters = json.loads(capsys.readouterr().out)["parameters"]
    assert parameters["order"] == 8 and 0.0 < parameters["moved"] < 0.05


@pytest.mark.parametrize(
    ("rows", "word"),
    [("x,y\n0,0\n", "columns x, y and radius"), ("x,y,radius\n0,0,1\n9,0,1\n0,9,1\n", "in order")],
)
def test_tables_that_are_no_loop(capsys, tmp_path, rows, word):
    path = tmp_path / "ring.csv"
    path.write_text(rows)
    assert run("polygon", "--centres", str(path), "--out", str(tmp_path / "out")) == 2
    assert word in capsys.readouterr().err


@pytest.mark.parametrize("how", ["dart", "unconfined"])
def test_a_loop_that_takes_no_load_has_no_path(capsys, tmp_path, how):
    """A re-entrant loop folds, an unconfined one flattens: no contact ever carries a force."""
    ring = ["--order", "4", "--confine", "0", "--end", "0.1"]
    if how == "dart":
        x, side = np.array([[1.5, 0.0], [-0.8, 1.0], [0.0, 0.0], [-0.8, -1.0]]), 0.95
        radii = [np.hypot(2.3, 1.0) - side, side, np.hypot(0.8, 1.0) - side, side]
        ring = write_ring(tmp_path / "ring.csv", x, [float(r) for r in radii])
    words, out = ["polygon", *ring, "--closure", "traction"], tmp_path / "out"
    assert run(*words, "--out", str(out)) == 0
    said = capsys.readouterr().out
    assert said.startswith("there is no path, the loop takes no load: no contact carries a force")
    assert not any(word in said for word in ("stable", "state ", "E1 = -", "yield"))
    assert sorted(path.name for path in out.iterdir()) == ["report.html", "summary.json"]
    assert run(*words, "--json", "--force", "--out", str(out)) == 0
    found = json.loads(capsys.readouterr().out)
    assert not any(found["states"].values()) and found["events"] == [] and found["rows"] == 0
    assert found["status"] == "no_load" and found["peak"] is None
    assert not any("events" in note or "ends early" in note for note in found["notes"])


def test_results_of_centres_are_named_after_their_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    x, y = np.cos(0.4 * np.pi * np.arange(5)), np.sin(0.4 * np.pi * np.arange(5))
    rows = [f"{a},{b},{np.sin(0.2 * np.pi)}" for a, b in zip(x, y, strict=True)]
    (tmp_path / "pent.csv").write_text("\n".join(["x,y,radius", *rows]))
    assert run("polygon", "--centres", "pent.csv", "--end", "0.11", "--figures", "none") == 0
    assert (tmp_path / "pent-polygon" / "summary.json").is_file()
