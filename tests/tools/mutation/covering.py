"""Which tests run which line, and how long each takes: from one run under coverage."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import coverage

FOLDERS = ("loops", "stability")
RECORD = ".test-seconds.json"


class Covering(NamedTuple):
    """`lines`: file to line to tests; `seconds`: duration of each test."""

    lines: dict[str, dict[int, set[str]]]
    seconds: dict[str, float]

    def tests_of(self, file: str, line: int, limit: float) -> list[str]:
        """Tests that run a line, the shortest first, up to so many seconds together.

        A line that runs on import alone is left to the tests that run anything of its file.
        """
        lines = self.lines.get(file, {})
        found = lines.get(line, set()) or set().union(*lines.values())
        chosen: list[str] = []
        total = 0.0
        for test in sorted(found, key=lambda test: (self.seconds.get(test, 0.0), test)):
            total += self.seconds.get(test, 0.0)
            if chosen and total > limit:
                break
            chosen.append(test)
        return chosen


def record_covering(root: Path, tests: list[str]) -> Covering:
    """Run the tests once under coverage; the few that fail under it are left out."""
    command = [sys.executable, "-m", "tests.tools.mutation.recorder", *tests]
    command += [f"--cov={folder}" for folder in FOLDERS]
    command += ["--cov-context=test", "--cov-report=", "-q", "-p", "no:cacheprovider"]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    done = subprocess.run(command, cwd=root, env=environment, check=False)
    if done.returncode != 0:
        raise RuntimeError("tests fail without any change: nothing to learn from mutants")
    return read_covering(root)


def read_covering(root: Path) -> Covering:
    """What `record_covering` left in the folder."""
    data = coverage.CoverageData(basename=str(root / ".coverage"))
    data.read()
    seconds = json.loads((root / RECORD).read_text())
    lines: dict[str, dict[int, set[str]]] = {}
    for path in data.measured_files():
        by_line = data.contexts_by_lineno(path)
        lines[str(Path(path).relative_to(root))] = {
            line: {context.split("|")[0] for context in contexts} & seconds.keys()
            for line, contexts in by_line.items()
        }
    return Covering(lines, seconds)
