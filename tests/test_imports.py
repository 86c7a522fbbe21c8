"""The rooms stand one above the other: imports run downwards, and never in a circle."""

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import networkx as nx
import pytest

ROOT = Path(__file__).resolve().parents[1]
BELOW = {
    "loops": set(),
    "patterns": {"loops"},
    "stability": {"loops"},
    "studies": {"loops", "patterns", "stability"},
    "grainloops": {"loops", "patterns", "stability", "studies"},
}
ONLY_IN_STUDIES = {"cyclopts", "matplotlib", "pandas", "rich"}


def room_modules(root: Path) -> dict[str, Path]:
    """Every module of the rooms and of the front door, by its dotted name."""
    return {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for room in BELOW
        for path in sorted((root / room).rglob("*.py"))
    }


@functools.cache
def imports_of(path: Path) -> tuple[tuple[ast.stmt, bool], ...]:
    """Every import of a file, and whether it can run: all but those of ``if TYPE_CHECKING``."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    imports = (ast.Import, ast.ImportFrom)
    return tuple((one, runs) for one, runs in statements(body) if isinstance(one, imports))


def statements(body: list[ast.stmt], runs: bool = True) -> Iterator[tuple[ast.stmt, bool]]:
    """Each statement, those inside others too, and whether it can run."""
    for node in body:
        yield node, runs
        typing = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        yield from statements(getattr(node, "body", []), runs and not typing)
        for part in (node, *getattr(node, "handlers", []), *getattr(node, "cases", [])):
            inside = [] if part is node else part.body
            rest = [*getattr(part, "orelse", []), *getattr(part, "finalbody", [])]
            yield from statements([*inside, *rest], runs)


def import_targets(node: ast.stmt, module: str, is_package: bool) -> list[str]:
    """The dotted names that an import names; ``from a import b`` gives ``a.b``."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if not isinstance(node, ast.ImportFrom):
        return []
    parts = module.split(".")
    climb = node.level - is_package
    package = parts[: len(parts) - climb] if node.level else []
    source = ".".join([*package, *([node.module] if node.module else [])])
    return [f"{source}.{alias.name}" for alias in node.names]


def room_violations(root: Path) -> list[str]:
    """Imports that leave a room in a direction other than down, wherever in a file they stand."""
    found = []
    for module, path in room_modules(root).items():
        room = module.split(".")[0]
        forbidden = set(BELOW) - BELOW[room] - {room}
        if room not in ("studies", "grainloops"):
            forbidden |= ONLY_IN_STUDIES
        for node, _ in imports_of(path):
            targets = import_targets(node, module, path.stem == "__init__")
            found += [
                f"{module} imports {name}" for name in targets if name.split(".")[0] in forbidden
            ]
    return found


def import_graph(root: Path, *, types: bool = True) -> "nx.DiGraph[str]":
    """Module to module, at once or later inside a function; without `types` what can run alone."""
    modules = room_modules(root)
    graph = nx.DiGraph()
    for module, path in modules.items():
        # What a face shows it imports sooner or later.
        whole = types or path.stem == "__init__"
        for node in (node for node, runs in imports_of(path) if runs or whole):
            for name in import_targets(node, module, path.stem == "__init__"):
                # `from a import b` depends on the module a.b, or on a where b is a name within it.
                target = name if name in modules else name.rpartition(".")[0]
                if target in modules:
                    graph.add_edge(module, target)
    return graph


def package_graph(root: Path) -> "nx.DiGraph[str]":
    """Package to package within the rooms, by what can run; a module of a room is one by itself."""
    modules = room_modules(root)

    def package(module: str) -> str:
        inside = module.count(".") > 1 or modules[module].stem == "__init__"
        return ".".join(module.split(".")[:2]) if inside else module

    graph = nx.DiGraph()
    for one, other in import_graph(root, types=False).edges:
        if package(one) != package(other):
            graph.add_edge(package(one), package(other))
    return graph


def write_rooms(root: Path, files: dict[str, str]) -> Path:
    """A small house with the given modules; the rest of each room is empty."""
    for name, source in {**{f"{room}/__init__.py": "" for room in BELOW}, **files}.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source)
    return root


def test_every_room_is_read():
    assert {name.split(".")[0] for name in room_modules(ROOT)} == set(BELOW)


def test_every_folder_of_modules_is_a_package():
    folders = {path.parent for path in room_modules(ROOT).values()}
    assert [folder for folder in folders if not (folder / "__init__.py").exists()] == []


def test_imports_run_downwards():
    assert room_violations(ROOT) == []


def test_no_import_cycles():
    assert list(nx.simple_cycles(import_graph(ROOT, types=False))) == []
    assert list(nx.simple_cycles(package_graph(ROOT))) == []
    assert list(nx.simple_cycles(import_graph(ROOT))) == []


@pytest.mark.parametrize(
    ("file", "source", "violation"),
    [
        ("loops/a.py", "import patterns", "loops.a imports patterns"),
        ("studies/a.py", "import grainloops as gl", "studies.a imports grainloops"),
        (
            "loops/a.py",
            "def f():\n    from studies.cli import main",
            "loops.a imports studies.cli.main",
        ),
        ("patterns/a.py", "from stability import x", "patterns.a imports stability.x"),
        ("stability/__init__.py", "import patterns.a", "stability imports patterns.a"),
        (
            "stability/a.py",
            "import matplotlib.pyplot as plt",
            "stability.a imports matplotlib.pyplot",
        ),
        ("patterns/sub/a.py", "import pandas", "patterns.sub.a imports pandas"),
    ],
)
def test_an_import_that_runs_upwards_is_named(tmp_path, file, source, violation):
    assert room_violations(write_rooms(tmp_path, {file: source})) == [violation]


def test_imports_that_run_downwards_pass(tmp_path):
    house = write_rooms(
        tmp_path,
        {
            "loops/a.py": "import numpy\nfrom . import b\nfrom .b import c",
            "loops/b.py": "",
            "patterns/a.py": "from loops.a import c",
            "studies/a.py": "import pandas\nfrom stability import x\nfrom patterns import a",
        },
    )
    assert room_violations(house) == []
    assert list(nx.simple_cycles(import_graph(house))) == []
    assert set(import_graph(house).edges) == {
        ("loops.a", "loops.b"),
        ("patterns.a", "loops.a"),
        ("studies.a", "stability"),
        ("studies.a", "patterns.a"),
    }


@pytest.mark.parametrize(
    ("b", "cycles"),
    [
        ("from loops.a import f", 1),
        ("def g():\n    from .a import f", 1),
        ("from . import a", 1),
        ("if TYPE_CHECKING:\n    from loops.a import f", 1),
        ("from loops.c import f", 0),
    ],
)
def test_import_cycles_are_found(tmp_path, b, cycles):
    house = write_rooms(
        tmp_path, {"loops/a.py": "import loops.b", "loops/b.py": b, "loops/c.py": ""}
    )
    assert len(list(nx.simple_cycles(import_graph(house)))) == cycles
    running = 0 if "TYPE_CHECKING" in b else cycles
    assert len(list(nx.simple_cycles(import_graph(house, types=False)))) == running


def test_a_module_that_imports_its_own_package_is_a_cycle(tmp_path):
    files = {"loops/__init__.py": "from loops.a import f", "loops/a.py": "from loops import g"}
    (cycle,) = nx.simple_cycles(import_graph(write_rooms(tmp_path, files)))
    assert set(cycle) == {"loops", "loops.a"}


@pytest.mark.parametrize(
    ("of_c", "cycles"),
    [
        ("from loops.one.a import f", [{"loops.one", "loops.two"}]),
        ("def g():\n    from loops.one import f", [{"loops.one", "loops.two"}]),
        # By way of a module of the room.
        ("import loops.d", [{"loops.one", "loops.two", "loops.d"}]),
        ("from loops.two import e", []),
    ],
)
def test_packages_that_need_each_other_are_found_where_no_modules_do(tmp_path, of_c, cycles):
    files = {"loops/one/__init__.py": "", "loops/two/__init__.py": "", "loops/two/e.py": ""}
    files |= {"loops/one/a.py": "", "loops/one/b.py": "from loops.two.c import f"}
    house = write_rooms(
        tmp_path, files | {"loops/two/c.py": of_c, "loops/d.py": "from loops.one.a import f"}
    )
    assert list(nx.simple_cycles(import_graph(house))) == []
    assert [set(one) for one in nx.simple_cycles(package_graph(house))] == cycles
