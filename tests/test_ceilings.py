"""Rooms only shrink: no folder holds more code lines than ceilings.toml allows it."""

import ast
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("grainloops", "loops", "patterns", "stability", "studies")
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def code_lines(text):
    """Lines that are no comment, no docstring, and blank only within a text."""
    lines = {
        number
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith("#")
    }
    nodes = list(ast.walk(ast.parse(text)))
    for node in nodes:
        if isinstance(node, ast.Constant | ast.JoinedStr) and node.end_lineno > node.lineno:
            lines |= set(range(node.lineno, node.end_lineno + 1))
    for node in nodes:
        if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            lines -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return len(lines)


@cache
def lines_by_room():
    rooms = Counter()
    for room in ROOMS:
        for path in (ROOT / room).rglob("*.py"):
            count, parts = code_lines(path.read_text()), path.relative_to(ROOT).parts
            for name in ("all rooms", parts[0], *["/".join(parts[:2])] * (len(parts) > 2)):
                rooms[name] += count
    return rooms


def test_lines_are_counted_without_comments_and_docstrings():
    text = '"""Page."""\n\n# why\ndef f(x):\n    """Return\n    it."""\n    return (x,\n  1)\n'
    assert code_lines(text) == 3
    assert code_lines('x = """two\nlines"""\n') == 2


@pytest.mark.parametrize(
    ("room", "ceiling"), tomllib.loads((ROOT / "ceilings.toml").read_text())["code"].items()
)
def test_no_room_is_above_its_ceiling(room, ceiling):
    assert lines_by_room()[room] <= ceiling
