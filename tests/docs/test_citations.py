"""What docstrings cite is there: pages of the repository, equations of the paper."""

import re

import pytest

from tests.docs.pages import DOCS

ROOT = DOCS.parent
SOURCES = [
    path
    for room in ("grainloops", "loops", "patterns", "stability", "studies", "tests")
    for path in sorted((ROOT / room).rglob("*.py"))
]


def test_pages_that_docstrings_cite_are_there():
    cited = {page for path in SOURCES for page in re.findall(r"docs/[\w-]+\.md", path.read_text())}
    assert "docs/paper.md" in cited
    assert [page for page in sorted(cited) if not (ROOT / page).is_file()] == []


def test_the_site_shows_every_page():
    blocks = re.findall(r"```{toctree}\n(?::.*\n)*((?:.+\n)+?)```", (DOCS / "index.md").read_text())
    shown = sorted(name for block in blocks for name in block.split())
    assert shown == sorted(path.stem for path in DOCS.glob("*.md") if path.stem != "index")


def test_numbers_of_the_questions_stand_on_the_page_that_holds_them():
    numbers = re.findall(r"\b0\.\d+", (DOCS / "questions.md").read_text())
    held = re.findall(r"\b0\.\d+", (DOCS / "series.md").read_text())
    assert len(numbers) == 4 and set(numbers) <= set(held)


def test_nothing_cites_a_note_that_is_not_here():
    word = "theory" + " note"
    assert [path.name for path in SOURCES if word in path.read_text().lower()] == []


@pytest.mark.parametrize(
    "page", sorted([*DOCS.glob("*.md"), *ROOT.glob("*.md")]), ids=lambda p: p.name
)
def test_links_between_pages_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text()):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target
