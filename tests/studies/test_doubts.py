"""Doubts about a file come first in what a command prints, and `--strict` refuses it."""

import json
from dataclasses import replace

import numpy as np
import pytest

import grainloops as gl
from patterns import write_snapshot
from tests.command import run
from tests.packings import LAW, jammed
from tests.studies.test_wrong_arguments import made

WRONG = {
    "mu in degrees": (lambda law: gl.LinearFrictional(law.kn, law.kt, 26.6), "as an angle in deg"),
    "exchanged": (lambda law: gl.LinearFrictional(law.kt, law.kn, law.mu), "kn and kt exchanged"),
    "kn in another unit": (
        lambda law: gl.LinearFrictional(1e-3 * law.kn, 1e-3 * law.kt, law.mu),
        "units differ by 10^3",
    ),
}
COMMANDS = {
    "snapshot": (),
    "series": ("--workers", 1),
    "probe": ("--directions", 4),
    "sustain": ("--directions", 1),
    "evolve": ("--to", 1e-6),
    "forecast": ("--to", 1e-6, "--no-spread"),
    "material": ("--count", 4),
    "polygon --snapshot": ("--loop", 62),
    "domain --snapshot": ("--loop", 62),
}


@pytest.fixture(scope="module")
def doubtful(tmp_path_factory):
    """The sample with other laws in its table, by what is wrong."""
    sample, folder, files = made("sample"), tmp_path_factory.mktemp("files"), {}
    for number, (wrong, (law_of, _)) in enumerate(WRONG.items()):
        files[wrong] = folder / f"grains_{number}.parquet"
        write_snapshot(files[wrong], replace(sample, law=law_of(sample.law)))
    return files


def ask(command, grains, *more):
    name, *option = command.split()
    return (name, *option, grains, *COMMANDS[command], *more)


@pytest.mark.parametrize("command", COMMANDS)
def test_strict_refuses_before_anything_is_written(command, doubtful, capsys, tmp_path):
    out = tmp_path / "out"
    status = run(*ask(command, doubtful["exchanged"], "--strict", "--out", out))
    said = capsys.readouterr()
    assert status == 2 and said.out == "" and said.err.count("\n") == 1
    assert WRONG["exchanged"][1] in said.err and "no doubt under --strict" in said.err
    assert not (out / "summary.json").exists()


@pytest.mark.parametrize("wrong", WRONG)
def test_a_check_that_is_strict_exits_with_two(wrong, doubtful, capsys):
    assert run("check", doubtful[wrong]) == 0
    assert run("check", doubtful[wrong], "--strict") == 2
    assert WRONG[wrong][1] in capsys.readouterr().out


@pytest.mark.parametrize(
    ("command", "wrong"),
    [
        *(("snapshot", wrong) for wrong in WRONG),
        ("series", "exchanged"),
        ("material", "exchanged"),
        ("polygon --snapshot", "exchanged"),
    ],
)
def test_doubts_are_the_first_lines(command, wrong, doubtful, capsys, tmp_path):
    out, says = tmp_path / "out", WRONG[wrong][1]
    assert run(*ask(command, doubtful[wrong], "--no-figures", "--out", out)) == 0
    lines = capsys.readouterr().out.splitlines()
    doubts = [place for place, line in enumerate(lines) if line.startswith("doubt: ")]
    assert says in lines[0] and doubts == [*range(len(doubts))]
    notes = json.loads((out / "summary.json").read_text())["notes"]
    assert [note for note in notes if note.startswith("doubt: ")] == lines[: len(doubts)]


def test_a_file_without_doubts_is_taken(capsys, tmp_path):
    args = ("snapshot", gl.sample_path(), "--strict", "--no-figures", "--out", tmp_path / "out")
    assert run(*args) == 0
    assert "doubt: " not in capsys.readouterr().out


# ---- the axis that is driven


@pytest.fixture(scope="module")
def across(tmp_path_factory):
    """A packing with its larger stress along axis 2, and the same turned by a right angle."""
    graph, turn = jammed(16, 2), np.array([[0.0, -1.0], [1.0, 0.0]])
    folder, files = tmp_path_factory.mktemp("axes"), {}
    turned = graph.replace(x=graph.x @ turn.T, x0=None, cell=turn @ graph.cell, cell0=None)
    for one in (graph, turned):
        stress = gl.love_weber_stress(one)
        major = 1 if stress[0, 0] > stress[1, 1] else 2
        grains = folder / f"grains_{major}.parquet"
        regime = np.ones(one.contact_count, dtype=np.int8)
        ids = np.arange(one.grain_count)
        write_snapshot(grains, gl.Snapshot(one, LAW, regime, ids, 0, ()))
        files[major] = grains
    assert {*files} == {1, 2}
    return files


@pytest.mark.parametrize(
    ("command", "major"),
    [
        (("evolve", "--to", 1e-6, "--rows", 1), 1),
        (("evolve", "--to", 1e-6, "--rows", 1), 2),
        (("forecast", "--to", 1e-6, "--no-spread", "--rows", 1), 2),
        (("material", "--steps", 5), 1),
        (("material", "--steps", 5), 2),
    ],
)
def test_the_major_stress_is_driven_unless_an_axis_is_named(
    across, major, command, capsys, tmp_path
):
    name, *more = command
    other = f"axis {3 - major}; the major stress is along axis {major}"
    for axis, said in ((None, f"axis {major}, that of the major stress"), (3 - major, other)):
        out = tmp_path / f"{axis}"
        given = () if axis is None else ("--axis", axis)
        assert run(name, across[major], *more, *given, "--no-figures",
                   "--shear-increment", "radii", "--out", out) == 0  # fmt: skip
        first = next(
            line for line in capsys.readouterr().out.splitlines() if not line.startswith("doubt")
        )
        assert first.startswith(f"drained along {said} (P11 = ")
        told = json.loads((out / "summary.json").read_text())
        assert told["axis"] == (axis or major) and told["major_axis"] == major
        assert (told["start"]["P11"] > told["start"]["P22"]) == (major == 1)


def test_python_and_command_drive_the_same_axis(across):
    """A turned sample answers as the other one, along its own axis."""
    files = across
    one, two = (gl.evolve(gl.read_snapshot(files[k]), to=1e-6, rows=1) for k in (1, 2))
    assert (one.driven, two.driven) == ("H11", "H22")
    np.testing.assert_allclose(one.way.P[-1, [0, 3]], two.way.P[-1, [3, 0]], rtol=1e-9)
    assert gl.evolve(gl.read_snapshot(files[2]), to=1e-6, axis=1, rows=1).driven == "H11"
    assert gl.evolve(gl.read_snapshot(files[2]), "isotropic", to=1e-6, rows=1).driven == "H11"
    shear = gl.evolve(gl.read_snapshot(files[2]), "simple-shear", to=1e-6, rows=1)
    assert shear.driven == "H12"


def test_equal_stresses_drive_axis_1():
    lattice = gl.GrainGraph(
        x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.505] * 4, cell=2 * np.eye(2),
        contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
        images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
        normal_force=np.full(8, 0.01) * (1 + 1e-12 * np.arange(8)),
    )  # fmt: skip
    scene = gl.Scene(lattice, gl.LinearFrictional(1.0, 0.5, 0.5))
    assert gl.evolve(scene, "oedometric", to=1e-5, rows=1).driven == "H11"
