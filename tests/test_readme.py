"""The README's example runs and says what the README says."""

import re
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def test_the_example_runs(capsys):
    code = README.read_text().split("```python\n")[1].split("```")[0]
    assert len([line for line in code.splitlines() if line.strip()]) <= 15
    exec(compile(code, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    assert printed.startswith("unstable (diagonal)")
    assert "27.66 degrees wide" in printed


def commands(block):
    """Lines of a block of README, without their comments."""
    lines = README.read_text().split("```")[2 * block + 1].strip().splitlines()
    return [line.split("#")[0].strip() for line in lines]


def test_two_commands_do_everything_on_a_fresh_machine():
    demo, test = commands(0)
    assert demo == "make demo"
    script = (README.parent / ".ci/run").read_text()
    called = [re.split(r" 2>&1| \|", line)[0] for line in script.splitlines()]
    assert [line for line in called if line.startswith("make ")] == [
        test,
        "make prose",
        "make lint",
        "make types",
    ]
    targets = (README.parent / "Makefile").read_text()
    assert all(
        f"\n{line.removeprefix('make ')}: $(INSTALLED)\n" in targets for line in (demo, test)
    )


def test_the_first_screen_leads_to_a_snapshot_of_your_own():
    lines = commands(1)
    assert lines[0] == ". .venv/bin/activate"
    assert lines[-1].startswith("grainloops snapshot ")
    assert len(README.read_text().split("```")[0].splitlines()) < 10


def test_no_page_asks_for_a_package_that_is_on_no_index():
    root = README.parent
    pages = [README, *root.glob("docs/*.md"), *root.glob("[lps]*/**/*.py")]
    assert [page for page in pages if "pip install 'grainloops" in page.read_text()] == []
