"""The mutation check notices what tests notice, and nothing else."""

import pytest

from tests.tools.mutation.covering import Covering
from tests.tools.mutation.mutants import Mutant, mutants_of, mutated

SOURCE = '''"""A sum."""

LIMIT = -3


def total(a, b, c):
    """Sum."""
    if a < LIMIT:
        return 0
    return a + b - 2 * c
'''


@pytest.fixture
def place(tmp_path):
    (tmp_path / "loops").mkdir()
    (tmp_path / "loops" / "__init__.py").touch()
    (tmp_path / "loops" / "total.py").write_text(SOURCE)
    return tmp_path


def test_every_mutant_of_a_file(place):
    changed = {}
    for mutant in mutants_of(place, "loops/total.py"):
        old, new = SOURCE.splitlines(), mutated(SOURCE, mutant).splitlines()
        lines = [k for k in range(len(old)) if old[k] != new[k]]
        assert [k + 1 for k in lines] == [mutant.line]
        changed.setdefault(mutant.kind, set()).add(new[lines[0]].strip())
    assert changed == {
        "sign": {"LIMIT = 3", "return a - b - 2 * c", "return a + b + 2 * c"},
        "term": {"return b - 2 * c", "return a - 2 * c", "return a + b"},
        "factor": {"return a + b - 2 / c"},
        "comparison": {"if a >= LIMIT:"},
    }


def test_a_difference_keeps_its_first_term():
    source = "x = a - b\n"
    mutant = Mutant("f.py", "term", "DropTerm", 0, 1, "x = a - b")
    assert mutated(source, mutant) == "x = a\n"
    with pytest.raises(ValueError, match="no such place"):
        mutated(source, mutant._replace(occurrence=1))


def test_tests_of_a_line_are_the_shortest_first():
    """A line that no test runs is that of an import: all tests of its file."""
    lines = {"f.py": {2: {"slow", "quick"}, 3: {"other"}, 4: set()}}
    covering = Covering(lines, {"slow": 2.0, "quick": 1.0, "other": 0.5})
    assert covering.tests_of("f.py", 2) == ["quick", "slow"]
    assert covering.tests_of("f.py", 4) == ["other", "quick", "slow"]
    assert covering.tests_of("g.py", 2) == []
