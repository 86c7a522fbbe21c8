"""The README's example runs and says what the README says."""

from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def test_the_example_runs(capsys):
    code = README.read_text().split("```python\n")[1].split("```")[0]
    assert len([line for line in code.splitlines() if line.strip()]) <= 15
    exec(compile(code, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    assert printed.startswith("unstable (diagonal)")
    assert "27.66 degrees wide" in printed


def test_the_first_screen_leads_from_nothing_to_a_result():
    first = README.read_text().split("```")[1]
    lines = [line.split("#")[0].strip() for line in first.strip().splitlines()]
    assert lines[:2] == ["make demo", ". .venv/bin/activate"]
    assert lines[-1].startswith("grainloops snapshot ")
    assert len(README.read_text().split("```")[0].splitlines()) < 10


def test_no_page_asks_for_a_package_that_is_on_no_index():
    root = README.parent
    pages = [README, *root.glob("docs/*.md"), *root.glob("[lps]*/**/*.py")]
    assert [page for page in pages if "pip install 'grainloops" in page.read_text()] == []
