"""Faces of the rooms: a name is imported from its module when it is first asked for (PEP 562)."""

from __future__ import annotations

import ast
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any


class LazyFace(ModuleType):
    """A package that shows what its `if TYPE_CHECKING` imports, each loaded at its first use."""

    places: dict[str, str]

    def __getattr__(self, name: str) -> Any:
        places = self.__dict__["places"]
        if name not in places:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        module = import_module(places[name])
        # Where the module itself is what the face shows, it has no such name inside.
        value = getattr(module, name, module)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        # Importing a module sets it in its package: it must not hide a function of the same name.
        if not (name in self.places and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*self.__dict__, *self.places})


def lazy_face(name: str, file: str) -> None:
    """Make the package `name`, written in `file`, a `LazyFace`."""
    package = sys.modules[name]
    places = {
        alias.name: f"{name}.{alias.name}" if node.module == name else str(node.module)
        for node in ast.walk(ast.parse(Path(file).read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module not in ("typing", "loops.lazy")
        for alias in node.names
    }
    package.__dict__.update(places=places, __all__=sorted(places))
    package.__class__ = LazyFace
