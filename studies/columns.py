"""What every column of a result table is, and every key of a summary.

The words stand in `columns.toml` and `definitions.toml`, for the files themselves and for
`docs/columns.md`.
"""

from __future__ import annotations

import tomllib
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any

# Of these commands; tables of others share names, not meanings.
COMMANDS = ("snapshot", "series", "probe", "evolve", "diamond", "polygon", "domain")


@cache
def words(name: str) -> dict[str, dict[str, Any]]:
    """One of the two files, by its parts."""
    return tomllib.loads((Path(__file__).parent / f"{name}.toml").read_text(encoding="utf-8"))


def definitions(*parts: str) -> dict[str, str]:
    """What the keys of a summary mean that has these parts."""
    return {key: said for part in parts for key, said in words("definitions")[part].items()}


@cache
def described(place: str, column: str) -> tuple[str, str] | None:
    """Unit and meaning of a column of `command/table`; None where these commands have none."""
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
    """The same for the field of a Parquet file."""
    said = described(place, column)
    return None if said is None else {b"unit": said[0].encode(), b"meaning": said[1].encode()}
