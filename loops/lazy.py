"""Faces of the rooms: a name is imported from its module when it is first asked for (PEP 562)."""

from __future__ import annotations

import ast
import sys
from collections.abc import Mapping
from importlib import import_module
from types import ModuleType
from typing import Any

# Functions that answer `result.table()` and `result.plot()`: the front door names them.
SERVED: dict[str, str] = {}


def named(place: str) -> Any:
    """Return what 'module.name' stands for."""
    module, _, name = place.rpartition(".")
    return getattr(import_module(module), name)


class LazyFace(ModuleType):
    """A package whose names are each loaded at its first use."""

    places: dict[str, str]

    def __getattr__(self, name: str) -> Any:
        places = self.__dict__["places"]
        if name not in places:
            raise AttributeError(self._missing(name), name=name, obj=self)
        module = import_module(places[name])
        # A name that the module does not have stands for the module itself.
        value = getattr(module, name, module)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        # Python sets an imported module in its package: keep a function of the same name.
        if not (name in self.places and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*filter(_is_special, self.__dict__), *self.places})

    def _missing(self, name: str) -> str:
        """Say that there is no such name, and which one may be meant."""
        said = f"module {self.__name__!r} has no attribute {name!r}"
        if _is_special(name):
            return said
        from difflib import get_close_matches

        meant = self.__dict__["meant"].get(name.lower())
        near = meant or ", ".join(get_close_matches(name, self.places))
        return f"{said}: see {near}" if near else said


def _is_special(name: str) -> bool:
    return name.startswith("__")


def lazy_face(package: str, meant: Mapping[str, str] | None = None) -> None:
    """Make a package a `LazyFace` of the names that it imports for type checkers.

    They are read from its source, so that each stands there once. `meant` has for words that are no
    names those that the error points to.
    """
    face = sys.modules[package]
    loader: Any = face.__loader__
    places = {
        name.name: f"{package}.{name.name}" if one.module == package else str(one.module)
        for one in ast.walk(ast.parse(loader.get_source(package)))
        if isinstance(one, ast.ImportFrom) and one.module not in ("typing", __name__)
        for name in one.names
    }
    face.__dict__.update(places=places, __all__=sorted(places))
    face.__dict__["meant"] = {word: said for key, said in (meant or {}).items()
                              for word in key.split()}  # fmt: skip
    face.__class__ = LazyFace
