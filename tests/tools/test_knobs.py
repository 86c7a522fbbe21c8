"""Numbers fixed in the code: which are found, how they are changed, and what counts as moved."""

import sys

import numpy as np
import pandas as pd
import pytest

import loops
from loops import GrainGraph, find_faces
from stability.packing import regime_factor
from tests.tools.knobs import __main__ as knobs
from tests.tools.knobs.compare import moved
from tests.tools.knobs.numbers import (
    ROOT,
    change,
    changed,
    code_called,
    edited,
    frozen,
    kernels_that_read,
    numbers_of,
    reads,
)

PLANTED = '''"""Numbers that decide, one that does not, one frozen as a default, a tolerance."""

SLOPE, UNREAD = 2.0, 7
STEPS = 40
LAST: float = 0.95
CLOSE_RTOL = 1e-3
FROZEN = 3
TURN = 6.28
NAME, FLAG, BOTH = "a", True, ("a", 1)


def answer(by=FROZEN):
    return {"line": SLOPE * np.arange(3.0), "steps": [min(STEPS, 10)], "last": LAST, "last~": 0.2}


import numpy as np
'''


@pytest.fixture
def planted(tmp_path, monkeypatch):
    """Numbers of a module `loops.planted`, and the module."""
    (tmp_path / "loops").mkdir()
    (tmp_path / "loops" / "planted.py").write_text(PLANTED)
    monkeypatch.setattr(loops, "__path__", [*loops.__path__, str(tmp_path / "loops")])
    found = numbers_of(tmp_path, ["loops"])
    yield {number.name: number for number in found}, sys.modules["loops.planted"]
    del sys.modules["loops.planted"]


def test_numbers_are_collected_and_changed(planted):
    numbers, _ = planted
    assert list(numbers) == ["SLOPE", "UNREAD", "STEPS", "LAST", "CLOSE_RTOL", "FROZEN"]
    assert numbers["STEPS"].file == "loops/planted.py" and numbers["STEPS"].line == 4
    assert [frozen(number) for number in numbers.values()] == [False] * 5 + [True]
    values = {name: [value for _, value in changed(number)] for name, number in numbers.items()}
    assert values["STEPS"] == [120, 13] and values["SLOPE"] == [6.0, 2.0 / 3.0]
    # Of a share near 1 the distance from 1 counts; a tolerance is changed by 100.
    assert values["LAST"] == pytest.approx([0.85, 1.0 - 0.05 / 3.0])
    assert values["CLOSE_RTOL"] == pytest.approx([0.1, 1e-5])


def test_a_planted_number_is_found_and_one_that_decides_nothing_is_not(planted, monkeypatch):
    numbers, module = planted
    monkeypatch.setattr(knobs, "ANSWERS", {"planted": module.answer})
    base, codes = code_called(module.answer)
    tried = [numbers[name] for name in ("SLOPE", "UNREAD", "STEPS", "LAST")]
    rows = list(knobs.tried(tried, {"planted": base}, {"planted": codes}))
    told = [(row[0].rpartition(".")[2], row[3], row[5], row[7]) for row in rows]
    assert told == [
        ("SLOPE", "x 3", "line", "2 of 3: 4 -> 12"),
        ("SLOPE", "/ 3", "line", "2 of 3: 4 -> 1.3333"),
        ("UNREAD", "", "", "not read"),
        ("STEPS", "", "", "nothing"),
        # It moves by less than is stated.
        ("LAST", "", "", "nothing"),
    ]
    assert module.SLOPE == 2.0
    table = pd.DataFrame(rows, columns=list(knobs.COLUMNS))
    lines = knobs.as_markdown(table).splitlines()
    assert len(lines) == 2 + 5
    assert lines[2] == "| loops.planted.SLOPE | 2.0 | x 3 | planted | line | 2 of 3: 4 -> 12 (2) |"


def test_an_answer_that_fails_is_an_effect(planted, monkeypatch):
    numbers, module = planted
    monkeypatch.setattr(knobs, "ANSWERS", {"planted": lambda: {"value": 1.0 / (module.STEPS - 13)}})
    rows = list(
        knobs.tried([numbers["STEPS"]], {"planted": {"value": 1.0 / 27.0}}, {"planted": set()})
    )
    assert rows[0][7] == "not read"
    new = knobs.in_fork(lambda: knobs._asked(numbers["STEPS"], 13, ["planted"]))
    assert new == {"planted": {"error": ["ZeroDivisionError('float division by zero')"]}}
    assert [one.entry for one in moved({"value": 1.0}, new["planted"])] == ["error"]


def test_numbers_are_changed_where_they_are_imported():
    """`RANK` is read in another module too, `UNLOADED_SHARE` is a default and frozen."""
    numbers = {one.name: one for one in numbers_of(ROOT, ["stability/packing"])}
    from stability.packing import strain_increment

    assert "PIVOT_STEPS" in numbers and "OPEN" not in numbers and not frozen(numbers["RANK"])
    assert frozen(numbers["UNLOADED_SHARE"]) and frozen(
        numbers_of(ROOT, ["loops/compiled/network.py"])[0]
    )
    old = numbers["RANK"].value
    change(numbers["RANK"], 11)
    assert strain_increment.RANK == regime_factor.RANK == 11
    change(numbers["RANK"], old)


def test_a_number_of_a_kernel_is_read_where_one_that_calls_it_runs():
    """`CLOSE` stands in a kernel that two others lead to; numba shows the outermost alone."""
    numbers = {one.name: one for one in numbers_of(ROOT, ["loops/compiled", "stability/material"])}
    names = {name for _, name in kernels_that_read(numbers["CLOSE"])}
    assert names == {"_sort_by_angle", "following_half_edges", "plane_faces"}
    assert {"SHORT", "TOUCH", "WIDTH"} <= numbers.keys()
    assert frozen(numbers["SHORT"]) and not frozen(numbers["MOST_FAILED"])
    assert not {"ANSWER", "SUMS", "WEIGHT", "FX", "BINS"} & numbers.keys()
    ring = GrainGraph(
        x=[[0, 0], [1, 0], [0, 1]], radii=[0.5] * 3, contacts=[[0, 1], [1, 2], [2, 0]]
    )
    find_faces(ring, compiled=True)
    for compiled in (True, False):
        _, codes = code_called(lambda compiled=compiled: find_faces(ring, compiled=compiled))
        assert reads(numbers["CLOSE"], codes) == compiled
        assert not reads(numbers["SHORT"], codes)


def test_sources_are_edited_behind_the_assignment(planted):
    numbers, _ = planted
    lines = edited(PLANTED, numbers["UNREAD"], 21).splitlines()
    assert lines[2:4] == ["SLOPE, UNREAD = 2.0, 7", "UNREAD = 21"]
    assert lines[:3] + lines[4:] == PLANTED.splitlines()


@pytest.mark.parametrize(
    ("one", "two", "effects"),
    [
        ({"a": [1.0, 2.0]}, {"a": [1.0, 2.0 + 1e-6]}, []),
        ({"a": [1.0, 2.0]}, {"a": [1.0, 2.1]}, ["1 of 2: 2 -> 2.1"]),
        ({"a": [1.0, 2.0], "a~": [0.0, 0.06]}, {"a": [1.0, 2.1], "a~": [0.0, 0.05]}, []),
        ({"a": [np.nan]}, {"a": [np.nan]}, []),
        ({"a": [np.nan]}, {"a": [1.0]}, ["1 of 1 with a number in one alone"]),
        ({"a": ["held", "lost"]}, {"a": ["held", "held"]}, ["1 of 2: lost -> held"]),
        ({"a": [1, 2]}, {"a": [1]}, ["2 entries, then 1"]),
        ({"a": np.ones((2, 2)), "a~": [0.0, 1.0]}, {"a": [[1, 1], [1, 2]]}, []),
    ],
)
def test_moved_is_what_leaves_the_stated_errors(one, two, effects):
    assert [each.effect for each in moved(one, two)] == effects


@pytest.mark.slow
def test_frozen_numbers_are_changed_in_a_copy(tmp_path):
    """With a tolerance of a half every verdict is open; with its own value nothing moves."""
    (number,) = [one for one in numbers_of(ROOT, ["stability/spectra.py"]) if one.name == "RTOL"]
    assert frozen(number)
    base = {"verdicts": knobs.ANSWERS["verdicts"]()}
    for value, still in ((number.value, True), (0.5, False)):
        new = knobs.in_copy(number, value, ["verdicts"], tmp_path)
        effects = [one.effect for one in moved(base["verdicts"], new["verdicts"])]
        assert (not effects) == still
        assert still or any(effect.endswith("-> undetermined") for effect in effects)


@pytest.mark.slow
def test_numbers_of_packings_that_only_cost_time_change_nothing(tmp_path):
    """Beyond what the answers state, at 2,000 grains and in small packings."""
    only = "FILL,RANK,ROOM,PIVOT_STEPS,GROUND_SPRINGS,MAX_SPEED_RATIO"
    rooms = "stability/packing stability/compiled/packing_system.py"
    knobs.main(tmp_path / "all", rooms=rooms, only=only, answers="path,limit")
    table = pd.read_csv(tmp_path / "all" / "numbers.csv")
    assert set(table["effect"]) == {"nothing"} and len(table) == 6
    assert (tmp_path / "all" / "numbers.md").read_text().count("\n") == 8
