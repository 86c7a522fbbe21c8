"""`tests/slow.txt` names tests that exist, each once."""

import ast
from collections import defaultdict

from tests.docs.pages import DOCS

ROOT = DOCS.parent
LIST = (ROOT / "tests" / "slow.txt").read_text(encoding="utf-8").splitlines()
NAMES = [line for line in LIST if line and not line.startswith("#")]


def test_every_line_names_a_test():
    named = defaultdict(set)
    for name in NAMES:
        file, function = name.split("[")[0].split("::")
        named[file].add(function)
    for file, functions in named.items():
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        there = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert functions <= there, (file, functions - there, "Take these lines out of slow.txt.")


def test_lines_are_sorted_and_none_is_there_twice():
    assert sorted(set(NAMES)) == NAMES
