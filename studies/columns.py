"""Meaning and unit of every column of a result table, and meaning of every key of a summary.

`columns.toml` and `definitions.toml` hold them, for the result files and for `docs/columns.md`.
"""

from __future__ import annotations

import tomllib
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

# A table on its way from the kernels to a file: arrays by column. Tables in which rows are
# selected, grouped or joined are pandas data frames, which take .2 s to load.
Columns = dict[str, NDArray[Any]]
# Commands whose columns are described; tables of other commands share names, not meanings.
COMMANDS = ("snapshot", "series", "probe", "evolve", "diamond", "polygon", "domain")


@cache
def words(name: str) -> dict[str, dict[str, Any]]:
    """Parts of one of the two files."""
    return tomllib.loads((Path(__file__).parent / f"{name}.toml").read_text(encoding="utf-8"))


def definitions(*parts: str) -> dict[str, str]:
    """Meaning of the keys of a summary with these parts."""
    return {key: said for part in parts for key, said in words("definitions")[part].items()}


@cache
def described(place: str, column: str) -> tuple[str, str] | None:
    """Unit and meaning of a column of `command/table`; None if it has no description."""
    command, _, table = place.partition("/")
    if command not in COMMANDS:
        return None
    known = {
        name: (said[0], said[1])
        for part in words("columns").values()
        for name, said in part.items()
    }
    for name in (f"{command}:{column}", f"{table}:{column}", column):
        if name in known:
            return known[name]
        for pattern, said in known.items():
            if (":" in pattern) == (":" in name) and fnmatchcase(name, pattern):
                return said
    return None


def metadata(place: str, column: str) -> dict[bytes, bytes] | None:
    """Unit and meaning of a column as metadata of a Parquet field."""
    said = described(place, column)
    return None if said is None else {b"unit": said[0].encode(), b"meaning": said[1].encode()}
