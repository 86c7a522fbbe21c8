"""Store today's answers: `python -m tests.golden.freeze [CASE ...]`, all of them without a name.

Read the change with `git diff tests/golden`, and say in the commit why each number moved.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

os.environ.setdefault("MPLBACKEND", "Agg")

from tests.golden.answers import CASES

FOLDER = Path(__file__).parent


def as_text(value: Any, indent: int = 0) -> str:
    """JSON, sorted, one key a line; a list of numbers or words stays on one line."""
    if isinstance(value, dict) and value:
        pad = " " * (indent + 1)
        lines = [f"{pad}{json.dumps(k)}: {as_text(value[k], indent + 1)}" for k in sorted(value)]
        return "{\n" + ",\n".join(lines) + "\n" + " " * indent + "}"
    if isinstance(value, list) and any(isinstance(one, dict) for one in value):
        pad = " " * (indent + 1)
        lines = [pad + as_text(one, indent + 1) for one in value]
        return "[\n" + ",\n".join(lines) + "\n" + " " * indent + "]"
    return json.dumps(value, ensure_ascii=False)


def main(names: list[str]) -> None:
    for name in names or CASES:
        with tempfile.TemporaryDirectory() as folder:
            text = as_text(CASES[name](Path(folder)))
        (FOLDER / f"{name}.json").write_text(text + "\n")
        print(f"{name}: {len(text)} characters")


if __name__ == "__main__":
    main(sys.argv[1:])
