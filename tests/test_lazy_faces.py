"""A room is loaded when it is used: the faces bring nothing with them, and hide nothing."""

import ast
import importlib
import pkgutil
import re
import subprocess
import sys
from functools import reduce
from pathlib import Path
from types import ModuleType

import pytest

import grainloops
import grainloops as gl
import loops
import patterns
import stability
from grainloops import MEANT
from patterns import sample_path

ROOMS = (loops, patterns, stability, grainloops)
HEAVY = {"matplotlib", "networkx", "numba", "pandas", "scipy", "sympy"}
BESIDE = {"numpy", "pyarrow", "rich"}


def loaded_by(code):
    """Modules of rooms and of packages that take long, which a new process has after `code`."""
    after = "\nimport sys\nprint(); print(*sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", code + after], capture_output=True, text=True, check=True
    )
    names = run.stdout.splitlines()[-1].split()
    rooms = {room.__name__ for room in ROOMS} | {"studies"}
    return {name for name in names if name.split(".")[0] in rooms | HEAVY | BESIDE}


def command(*arguments):
    call = f"import sys\nsys.argv = {['grainloops', *map(str, arguments)]}\n"
    return call + "from studies.cli import main\ntry:\n    main()\nexcept SystemExit:\n    pass"


def test_a_face_alone_loads_nothing():
    expected = {"loops", "loops.lazy", "patterns", "stability", "grainloops"}
    assert loaded_by("import loops, patterns, stability, grainloops") == expected


def test_a_name_loads_its_module():
    loaded = loaded_by("from loops import polygon_area")
    assert "loops.geometry" in loaded
    assert not loaded & {*HEAVY, "loops.faces", "loops.closures", "loops.crossings"}


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.__name__)
def test_a_face_shows_all_its_names_whatever_was_imported_before(room):
    for found in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
        importlib.import_module(found.name)
    assert sorted(room.places) == sorted(room.__all__)
    assert set(room.__all__) <= set(dir(room))
    modules = [name for name in room.__all__ if isinstance(getattr(room, name), ModuleType)]
    expected = {grainloops: ["plot", "programmes"], stability: ["programmes"]}
    assert modules == expected.get(room, [])
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        room.nothing  # noqa: B018


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: room.__name__)
def test_a_face_loads_what_it_shows_type_checkers(room):
    """Each import under TYPE_CHECKING, run as it stands, gives what the face loads."""
    shown: dict[str, object] = {}
    for node in ast.parse(Path(room.__file__).read_text()).body:
        if isinstance(node, ast.If):
            exec(compile(ast.Module(node.body, []), room.__file__, "exec"), shown)
    del shown["__builtins__"]
    assert sorted(shown) == sorted(room.places)
    assert all(getattr(room, name) is value for name, value in shown.items())


def test_help_loads_no_numbers():
    names = ([], ["snapshot"], ["series"], ["diamond"], ["polygon"], ["domain"])
    version, *helps = [command("--version")] + [command(*name, "--help") for name in names]
    assert not loaded_by(version) & {*HEAVY, "numpy", "rich", "loops.graph"}
    assert not loaded_by("\n".join(helps)) & {*HEAVY, "numpy", "patterns", "stability"}


def test_a_snapshot_loads_what_it_needs(tmp_path):
    path = sample_path("grains_biaxial.csv.gz")
    loaded = loaded_by(command("snapshot", path, "--no-figures", "--out", tmp_path / "out"))
    assert {"loops.faces", "patterns.snapshots", "stability.verdict"} <= loaded
    unused = {*HEAVY, "pyarrow.compute", "patterns.diamond", "patterns.polygons"}
    unused |= {
        "studies.paths",
        "stability.paths",
        "stability.directional",
        "studies.series",
        "tests.benchmarks",
    }
    assert not loaded & unused


def test_the_diamond_loads_no_snapshots(tmp_path):
    loaded = loaded_by(command("diamond", "--out", tmp_path / "out"))
    assert (tmp_path / "out" / "summary.json").is_file()
    unused = {"sympy", "patterns.snapshots", "loops.loop_batches", "loops.tracking"}
    assert not loaded & {*unused, "studies.snapshot", "studies.series"}


def test_tab_shows_the_names_of_the_face_alone():
    shown = [name for name in dir(gl) if not name.startswith("__")]
    assert shown == sorted(name for name in gl.__all__ if not name.startswith("__"))


@pytest.mark.parametrize("word", sorted(word for key in MEANT for word in key.split()))
def test_a_word_that_is_no_name_points_to_names(word):
    if word in gl.__all__:
        return
    with pytest.raises(AttributeError, match=f"no attribute '{word}': see ") as error:
        getattr(gl, word)
    said = re.sub(r"\(.*?\)|;.*", "", str(error.value).split(": see ")[1])
    named = re.findall(r"[A-Za-z_][\w.]*", said)
    assert named and all(reduce(getattr, name.split("."), gl) for name in named)


def test_a_name_that_is_nearly_right_is_told():
    with pytest.raises(AttributeError, match=r"see .*read_snapshot"):
        gl.read_snapshots  # noqa: B018
    with pytest.raises(AttributeError, match=r"has no attribute 'xyzzy'$"):
        gl.xyzzy  # noqa: B018
    assert not hasattr(gl, "__wrapped__")
