"""The numbered equations of the theory's pages, as text."""

import re
from importlib import import_module
from inspect import isclass, isfunction
from pathlib import Path

PAGES = Path(__file__).parents[1] / "theory"
BLOCK = re.compile(r"^```{equation} (\S+)\n((?::\w+: .*\n)*)((?:.*\n)*?)```", re.MULTILINE)
CITED = re.compile(r"Theory, equations? ((?:\(\d+\.\d+\)(?:, | and |-)?)+)")
NUMBER = re.compile(r"\((\d+\.\d+)\)")


def equations():
    """Of each equation: page, number, and its options as lists of words."""
    for page in sorted(PAGES.glob("*.md")):
        for number, options, _ in BLOCK.findall(page.read_text()):
            said = dict(re.findall(r":(\w+): (.*)", options))
            yield page.stem, number, {key: value.split(", ") for key, value in said.items()}


def named(path):
    """What a dotted name in a module, or in a class of one, stands for."""
    parts = path.split(".")
    for k in range(len(parts) - 1, 0, -1):
        try:
            found = import_module(".".join(parts[:k]))
        except ImportError:
            continue
        for part in parts[k:]:
            found = getattr(found, part)
        return found
    raise ImportError(path)


def shown(face):
    """The functions and classes that a face shows, by name."""
    module = import_module(face)
    names = getattr(module, "__all__", None) or [n for n in vars(module) if n[0] != "_"]
    for name in sorted(names):
        what = getattr(module, name)
        # A module shows its own, a package and one with a list what they import.
        listed = hasattr(module, "__path__") or hasattr(module, "__all__")
        here = listed or getattr(what, "__module__", "") == face
        if here and (isfunction(what) or isclass(what)):
            yield name, what
