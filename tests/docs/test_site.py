"""The site's own pages: API reference, installation."""

import pkgutil
import re
import sys
import tomllib

import grainloops as gl
from tests.docs.pages import DOCS, page, section, tables

sys.path.insert(0, str(DOCS / "site"))
try:
    from numbered import shown
finally:
    sys.path.pop(0)

PAGES = sorted(path for path in (DOCS / "reference").glob("*.md") if path.stem != "index")


def test_every_name_of_the_front_door_stands_on_one_page_of_the_reference():
    """A new name goes to the page of its task in `docs/reference`."""
    named = []
    for path in PAGES:
        found = re.findall(r"^```{names} (\S+)\n(.*?)```", path.read_text(), re.M | re.S)
        ((face, block),) = found
        if face == "grainloops.plot":
            assert sorted(block.split()) == sorted(gl.plot.__all__)
        else:
            named += block.split()
    # The programmes have a page of their own, and so have the figures.
    assert sorted([*named, "__version__", "plot", "programmes"]) == sorted(gl.__all__)
    assert "rooms/programmes.md" in page("reference/paths")


def test_names_of_the_reference_are_those_that_their_face_shows():
    for path in PAGES:
        blocks = re.findall(r"^```{names} (\S+)\n(.*?)```", path.read_text(), re.M | re.S)
        assert blocks
        for face, names in blocks:
            assert set(names.split()) <= {name for name, _ in shown(face)}, path.name


def test_the_reference_lists_its_pages():
    (rows,) = tables(page("reference/index"))
    linked = [re.search(r"\((\w+)\.md\)", row["page"])[1] for row in rows]
    assert sorted(linked) == [path.stem for path in PAGES]
    assert linked == page("reference/index").partition(":hidden:")[2].strip("`\n").split()


def test_functions_and_classes_of_the_rooms_are_there():
    entry = re.compile(r"^\.\. auto(?:function|class|module|data):: (\S+)", re.M)
    named = [
        name for path in (DOCS / "rooms").glob("*.md") for name in entry.findall(path.read_text())
    ]
    assert len(named) > 30
    assert [name for name in named if pkgutil.resolve_name(name) is None] == []


def test_the_installation_lists_the_optional_libraries():
    project = tomllib.loads((DOCS.parent / "pyproject.toml").read_text())["project"]
    (rows,) = tables(section(page("installation"), "## Optional libraries"))
    listed = {row["extra"].strip("`"): row["brings"] for row in rows}
    extras = project["optional-dependencies"]
    # Those that a user of the package asks for.
    assert listed.keys() == extras.keys() - {"test", "lint", "docs"}
    for name, brings in listed.items():
        assert brings.split(", ") == [re.match(r"[\w-]+", need)[0] for need in extras[name]]
    assert project["requires-python"] == ">=3.11" and "Python 3.11" in page("installation")


def test_the_commands_of_the_installation_are_targets_of_make():
    targets = re.findall(r"^(\w+):", (DOCS.parent / "Makefile").read_text(), re.MULTILINE)
    named = re.findall(r"`make (\w+)`", page("installation"))
    assert named == ["demo", "test", "prose", "slow", "docs"]
    assert set(named) <= set(targets)
