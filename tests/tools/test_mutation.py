"""The mutation check notices what tests notice, and nothing else."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.tools.mutation.__main__ import draw
from tests.tools.mutation.covering import Covering
from tests.tools.mutation.mutants import Mutant, mutants_of, mutated

ROOT = Path(__file__).parents[2]
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


def test_the_star_of_keyword_only_arguments_is_no_product(tmp_path):
    (tmp_path / "f.py").write_text("def f(a, *, b):\n    return b * a\n")
    assert [(mutant.kind, mutant.line) for mutant in mutants_of(tmp_path, "f.py")] == [
        ("factor", 2)
    ]


def test_a_difference_keeps_its_first_term():
    source = "x = a - b\n"
    mutant = Mutant("f.py", "term", "DropTerm", 0, 1, "x = a - b")
    assert mutated(source, mutant) == "x = a\n"
    with pytest.raises(ValueError, match="no such place"):
        mutated(source, mutant._replace(occurrence=1))


def test_mutants_are_drawn_from_folders_and_files():
    rooms = ["loops/laws", "loops/geometry.py"]
    drawn, _ = draw(rooms, 60, 1, kernels=False)
    assert len(set(drawn)) == 60 and drawn == draw(rooms, 60, 1, kernels=False)[0]
    folders = {str(Path(mutant.file).parent) for mutant in drawn}
    assert folders == {"loops/laws", "loops"}
    with pytest.raises(SystemExit, match="no source files in stability/nowhere"):
        draw(["stability/nowhere"], 1, 1, kernels=False)


def test_tests_of_a_line_are_the_shortest_first():
    """A line that no test runs is that of an import: all tests of its file."""
    lines = {"f.py": {2: {"slow", "quick"}, 3: {"other"}, 4: set()}}
    covering = Covering(lines, {"slow": 2.0, "quick": 1.0, "other": 0.5})
    assert covering.tests_of("f.py", 2) == ["quick", "slow"]
    assert covering.tests_of("f.py", 4) == ["other", "quick", "slow"]
    assert covering.tests_of("g.py", 2) == []


@pytest.mark.slow
def test_good_tests_notice_and_poor_ones_do_not(place):
    (place / "tests").mkdir()
    (place / "tests" / "test_total.py").write_text(
        "from loops.total import total\n\n"
        "def test_good():\n    assert total(5, 2, 3) == 1\n\n"
        "def test_poor():\n    total(-9, 1, 1)\n"
    )
    script = (
        "import sys; from pathlib import Path\n"
        "from tests.tools.mutation.mutants import mutants_of\n"
        "from tests.tools.mutation.trial import noticed\n"
        "place = Path(sys.argv[1])\n"
        "for mutant in [m for m in mutants_of(place, 'loops/total.py') if not m.occurrence][:4]:\n"
        "    for test in ('good', 'poor'):\n"
        "        print(mutant.operator, mutant.occurrence, test, noticed(\n"
        "            place, mutant, [f'tests/test_total.py::test_{test}'], 60.0))\n"
        "print(noticed(place, mutant, [], 1.0))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(place)],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    *lines, last = [line.split() for line in done.stdout.splitlines()]
    assert last == ["uncovered"]
    assert {line[3] for line in lines if line[2] == "poor"} == {"survived"}
    good = {(line[0], line[1]): line[3] for line in lines if line[2] == "good"}
    # The limit itself is out of this test's sight.
    missed = {name for name, outcome in good.items() if outcome == "survived"}
    assert missed == {("ReplaceUnaryOperator_Delete_USub", "0")}
    assert (place / "loops" / "total.py").read_text() == SOURCE
