"""What docstrings cite is there: pages of the repository, equations of the paper."""

import re
import tomllib

import pytest

from patterns.snapshots.columns import KINDS, PLAIN_NAMES, plain_name
from patterns.snapshots.formats import FORMATS
from tests.docs.pages import DOCS, section, tables

ROOT = DOCS.parent
SOURCES = [
    path
    for room in ("grainloops", "loops", "patterns", "stability", "studies", "tests")
    for path in sorted((ROOT / room).rglob("*.py"))
]


PAGES = sorted(path for path in DOCS.rglob("*.md") if "gallery" not in path.parts)


def test_pages_that_docstrings_cite_are_there():
    cited = {page for path in SOURCES for page in re.findall(r"docs/[\w/-]+\.md", path.read_text())}
    assert "docs/paper.md" in cited
    assert [page for page in sorted(cited) if not (ROOT / page).is_file()] == []


def test_the_site_shows_every_page():
    shown = ["index", "gallery/index"]
    for index in (path for path in PAGES if path.name == "index.md"):
        blocks = re.findall(r"```{toctree}\n(?::.*\n)*\n*((?:.+\n)+?)```", index.read_text())
        folder = index.parent.relative_to(DOCS)
        shown += [(folder / name).as_posix() for block in blocks for name in block.split()]
    # The gallery is written by the build.
    pages = [path.relative_to(DOCS).with_suffix("").as_posix() for path in PAGES]
    assert sorted(set(shown)) == sorted({*pages, "gallery/index"})


def test_numbers_of_the_questions_stand_on_the_page_that_holds_them():
    asked = section((DOCS / "questions.md").read_text(), "## Why is everything stable?")
    numbers = re.findall(r"\b0\.\d+", asked)
    held = re.findall(r"\b0\.\d+", (DOCS / "evidence" / "series.md").read_text())
    assert len(numbers) == 4 and set(numbers) <= set(held)


def test_nothing_cites_a_note_that_is_not_here():
    word = "theory" + " note"
    texts = {path.name: " ".join(path.read_text().lower().split()) for path in SOURCES}
    assert [name for name, text in texts.items() if word in text] == []


@pytest.mark.parametrize("page", [*PAGES, *sorted(ROOT.glob("*.md"))], ids=lambda p: p.name)
def test_links_between_pages_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+\.\w+)[^)]*\)", page.read_text()):
        built = re.search(r"gallery/(\w+)\.md$", target)
        if built:
            example = "__init__" if built[1] == "index" else built[1]
            assert (ROOT / "studies" / "examples" / f"{example}.py").is_file(), target
        elif not target.startswith("http"):
            assert (page.parent / target).exists(), target


def test_formats_and_names_of_columns_are_those_that_are_read():
    text = (DOCS / "formats.md").read_text()
    formats, *columns = tables(text)[:3]
    named = {name for row in formats for name in re.findall(r"`([\w-]+)`", row["format"])}
    assert named == set(FORMATS)
    documented, others = set(), {"grains": set(), "contacts": set()}
    for kind, table in zip(others, columns, strict=True):
        for row in table:
            names = re.findall(r"`(\w+)`", row["column"])
            documented.update(names)
            for other in re.findall(r"`(\w+)`", row["also read as"]):
                assert other in ("id", "identifier", "number") or plain_name(other, kind) in names
                others[kind].add(other.replace("_", ""))
    # Vectors of a plane may have other components; z of the grains stands in the table.
    out = re.compile(r"(?!mz_on_2|omega_z|theta_z).*(z|z_on_2)|(theta|omega)_[xy]|m[xy]_on_2")
    assert documented | {name for name in PLAIN_NAMES if out.fullmatch(name)} == set(PLAIN_NAMES)
    for kind, known in others.items():
        for name, column in KINDS[kind].items():
            if name in documented and not name.removesuffix("_on_2").endswith(("y", "z")):
                told = {one for one in column.others if not one.endswith(("y", "z", "1", "2"))}
                assert told <= others["grains"] | known, name


def test_the_citation_is_that_of_the_newest_release():
    changes = (ROOT / "CHANGELOG.md").read_text()
    unreleased, (version, date) = re.findall(r"^## \[(.*?)\](?: - (\S+))?$", changes, re.M)[:2]
    assert unreleased == ("Unreleased", "")
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {version}\n" in citation and f"\ndate-released: {date}\n" in citation
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["tool"]["setuptools_scm"]["fallback_version"] == version
