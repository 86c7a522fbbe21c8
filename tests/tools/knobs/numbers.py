"""Numbers at module level: which there are, changed values, runs with one of them changed."""

from __future__ import annotations

import ast
import re
import sys
import threading
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[3]
ROOMS = ("loops", "patterns", "stability")
# Below this, or of such a name, a number is a tolerance, and changed by 100 instead of 3.
TOLERANCE = 1e-6
TOLERANCES = re.compile(r".*(TOL|ROUNDING|ROUNDED)")
FACTOR, TOLERANCE_FACTOR = 3.0, 100.0
# Mathematics, codes, formats and parameters of examples, not choices.
FIXED = re.compile(
    r"_?TURN|_?HALF|_?SPLITTER|_?EPS|GOLDEN|TOP|WALL(_ID)?|SPHERE|OUTSIDE|SLIP|INCREMENT|RELEASED|NONE"
    r"|UNDECIDED|OPEN|ELASTIC|SLIDING|ROLLS|SLIDES|HEADERS|COMMENT_LINES|OPPOSITE|RADII|KAPPA\w*"
    r"|MU\w*|SPOKES|OVERLAPS|SMALL|FLAT|ROW_HEIGHT|LARGEST_JITTER|UNLOADING|LARGEST|COLUMNS|BINS"
    r"|ANGLE_STEPS|BITS|GAUSS|P11|A11|STUCK|OPENED|WEIGHT|ANSWER|SUMS|DENSE_STAGES|STAGES|WALL_NUMBERS|LONGEST_REPR|FEW|MOST_WORDS|SHOWN|EXPECTED|HERTZ|NUMBERINGS|[UD][NT]"
)


# Decorators that compile (`loops.compiled`).
KERNELS = {"kernel", "inlined", "inlined_sum"}


class Number(NamedTuple):
    """A number, or a container of numbers, that a module's source names."""

    module: str
    name: str
    file: str
    line: int
    value: Any

    @property
    def label(self) -> str:
        """How tables call it."""
        return f"{self.module}.{self.name}"


def numbers_of(root: Path, rooms: list[str]) -> list[Number]:
    """Numbers of the rooms (folders or files) that are choices, in the order of the source."""
    found = []
    for room in rooms:
        place = root / room
        for path in [place] if room.endswith(".py") else sorted(place.rglob("*.py")):
            module = ".".join(path.relative_to(root).with_suffix("").parts)
            module = module.removesuffix(".__init__")
            values = vars(import_module(module))
            for name, line in _assigned(path.read_text()):
                value = values.get(name)
                if name.isupper() and not FIXED.fullmatch(name) and _smallest(value) is not None:
                    found.append(Number(module, name, str(path.relative_to(root)), line, value))
    return found


def _assigned(source: str) -> Iterator[tuple[str, int]]:
    """Names that a module assigns, with their lines, without those that count columns."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.value).startswith("range("):
            continue
        targets = node.targets if isinstance(node, ast.Assign) else []
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            targets = [node.target]
        for target in targets:
            for one in target.elts if isinstance(target, ast.Tuple) else [target]:
                if isinstance(one, ast.Name):
                    yield one.id, node.lineno


def _smallest(value: Any) -> float | None:
    """Smallest size among the numbers of a value that holds nothing else, else None."""
    if isinstance(value, dict):
        value = tuple(value.values())
    if isinstance(value, tuple | list):
        sizes = [_smallest(one) for one in value]
        known = [size for size in sizes if size is not None]
        return min(known) if known and len(known) == len(sizes) else None
    return abs(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def changed(number: Number) -> list[tuple[str, Any]]:
    """The factors in words, and the values that they lead to where these are others."""
    small = 0.0 < (_smallest(number.value) or 0.0) < TOLERANCE
    tolerance = small or TOLERANCES.match(number.name)
    factor = TOLERANCE_FACTOR if tolerance else FACTOR
    ways = [(f"x {factor:g}", factor), (f"/ {factor:g}", 1.0 / factor)]
    scaled = [(word, _scaled(number.value, by)) for word, by in ways]
    return [(word, value) for word, value in scaled if value != number.value]


def _scaled(value: Any, factor: float) -> Any:
    """A value times a factor; of a number between 0.9 and 1 its distance from 1 is scaled."""
    if isinstance(value, dict):
        return {key: _scaled(one, factor) for key, one in value.items()}
    if isinstance(value, tuple | list):
        return type(value)(_scaled(one, factor) for one in value)
    if isinstance(value, int):
        return max(1, round(value * factor)) if value > 0 else value
    return 1.0 - (1.0 - value) * factor if 0.9 < value < 1.0 else value * factor


def holders(number: Number) -> list[ModuleType]:
    """Modules that have loaded the number: its own, and those that import it."""
    own = sys.modules[number.module]
    found = [own]
    for module in list(sys.modules.values()):
        if module is own or getattr(module, "__name__", "").split(".")[0] not in (
            *ROOMS,
            "studies",
        ):
            continue
        if number.name in vars(module) and number.module in _sources(module, number.name):
            found.append(module)
    return found


def _sources(module: ModuleType, name: str) -> set[str]:
    """Modules from which a module imports a name."""
    nodes = ast.walk(_parsed(module.__file__ or ""))
    return {
        node.module or ""
        for node in nodes
        if isinstance(node, ast.ImportFrom) and any(one.name == name for one in node.names)
    }


def frozen(number: Number) -> bool:
    """Whether it is used while its modules load, or by kernels: then the source is to be edited."""
    return bool(kernels_that_read(number)) or _read_at_load(number)


def _read_at_load(number: Number) -> bool:
    """Whether its modules use it while they load: other numbers, defaults, decorators, classes."""
    for module in holders(number):
        for node in _parsed(module.__file__ or "").body:
            outside = [node]
            if isinstance(node, ast.FunctionDef):
                outside = [node.args, *node.decorator_list]
            elif isinstance(node, ast.ClassDef):
                methods = [one for one in node.body if isinstance(one, ast.FunctionDef)]
                outside = [one for one in node.body if one not in methods]
                outside += [one.args for one in methods]
            if any(number.name in _loaded(part) for part in outside):
                return True
    return False


def kernels_that_read(number: Number) -> set[tuple[str, str]]:
    """File and name of the kernels that have frozen it, and of those that call them."""
    found = set()
    for module in holders(number):
        file = module.__file__ or ""
        names = {
            node.name: _loaded(node)
            for node in _parsed(file).body
            if isinstance(node, ast.FunctionDef)
            and any(KERNELS & _loaded(one) for one in node.decorator_list)
        }
        reading = {name for name, loaded in names.items() if number.name in loaded}
        while more := {name for name, loaded in names.items() if loaded & reading} - reading:
            reading |= more
        found |= {(file, name) for name in reading}
    return found


@cache
def _parsed(file: str) -> ast.Module:
    return ast.parse(Path(file).read_text())


def _loaded(node: ast.AST) -> set[str]:
    """Names that a part of the source reads."""
    names = (one for one in ast.walk(node) if isinstance(one, ast.Name))
    return {one.id for one in names if isinstance(one.ctx, ast.Load)}


def change(number: Number, value: Any) -> None:
    """Change the number in this process."""
    for module in holders(number):
        setattr(module, number.name, value)


def edited(source: str, number: Number, value: Any) -> str:
    """The source text with the number changed behind its assignment."""
    lines = source.splitlines(keepends=True)
    statements = (node for node in ast.parse(source).body if node.lineno == number.line)
    lines.insert(next(statements).end_lineno or number.line, f"{number.name} = {value!r}\n")
    return "".join(lines)


def code_called(work: Callable[[], Any]) -> tuple[Any, set[CodeType]]:
    """What `work` answers, and the code of the Python functions that it calls."""
    seen: set[CodeType] = set()

    def note(frame: Any, event: str, _: Any) -> None:
        if event == "call":
            seen.add(frame.f_code)

    # Checks of snapshots run in threads.
    sys.setprofile(note)
    threading.setprofile(note)
    try:
        return work(), seen
    finally:
        sys.setprofile(None)
        threading.setprofile(None)


def reads(number: Number, codes: set[CodeType]) -> bool:
    """Whether one of the called functions reads the number, or is a kernel that has frozen it.

    Of a number used at load: whether one was called of a module that holds it.
    """
    files = {module.__file__ for module in holders(number)}
    called = {code for code in codes if code.co_filename in files}
    if _read_at_load(number):
        return bool(called)
    kernels = kernels_that_read(number)
    return any(
        number.name in code.co_names or (code.co_filename, code.co_name) in kernels
        for code in called
    )
