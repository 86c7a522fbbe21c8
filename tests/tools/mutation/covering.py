"""Which tests run which line, and how long each takes: from one run under coverage."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import coverage

RECORD, CONFIGURATION = ".test-seconds.json", ".coveragerc"


class Covering(NamedTuple):
    """`lines`: file to line to tests; `seconds`: duration of each test."""

    lines: dict[str, dict[int, set[str]]]
    seconds: dict[str, float]

    def tests_of(self, file: str, line: int) -> list[str]:
        """Tests that run a line, the shortest first.

        A line that runs on import alone is left to the tests that run anything of its file.
        """
        lines = self.lines.get(file, {})
        found = lines.get(line, set()) or set().union(*lines.values())
        return sorted(found, key=lambda test: (self.seconds[test], test))


def record_covering(root: Path, files: set[str], tests: list[str], workers: int) -> Covering:
    """Run the tests once under coverage of the files; the few that fail under it are left out."""
    (root / CONFIGURATION).write_text("[run]\ninclude =\n" + "".join(f"    {f}\n" for f in files))
    command = [sys.executable, "-m", "tests.tools.mutation.recorder", *tests]
    command += ["--cov", f"--cov-config={CONFIGURATION}", "--cov-context=test", "--cov-report="]
    command += ["-q", "-p", "no:cacheprovider", *(["-n", str(workers)] if workers > 1 else [])]
    environment = {**os.environ, "PYTHONPATH": str(root), "OPENBLAS_NUM_THREADS": "1"}
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
