"""Try mutants: `python -m tests.tools.mutation.trial COPY`, tasks and outcomes as lines of JSON.

Each mutant's tests run in a child process that is forked with the libraries loaded.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import signal
import sys
import time
from pathlib import Path

from tests.tools.mutation.mutants import Mutant, mutated

# Loaded once in the parent, so that a trial costs the tests alone.
LIBRARIES = (
    *("numpy", "scipy.linalg", "scipy.sparse.csgraph", "scipy.integrate", "scipy.optimize"),
    *("scipy.special", "networkx", "mpmath", "sympy", "pytest", "pyarrow.csv"),
    *("pyarrow.parquet", "pandas", "shapely", "matplotlib.figure", "scipy.spatial"),
)

# Kernels run as plain Python warn where machine integers wrap around.
RAW = ("-W", "ignore::RuntimeWarning")


def load_libraries() -> None:
    """Import what the tests need from others, nothing of the project."""
    for name in LIBRARIES:
        importlib.import_module(name)


def noticed(copy: Path, mutant: Mutant | None, tests: list[str], limit: float) -> str:
    """Whether the tests notice a mutant."""
    if not tests:
        return "uncovered"
    if mutant is None:
        return _trial(copy, tests, limit)
    file = copy / mutant.file
    source = file.read_text()
    file.write_text(mutated(source, mutant))
    # Python tells stale bytecode by size and second: a flipped sign may keep both.
    Path(importlib.util.cache_from_source(str(file))).unlink(missing_ok=True)
    try:
        return _trial(copy, tests, limit)
    finally:
        file.write_text(source)


def _trial(copy: Path, tests: list[str], limit: float) -> str:
    child = os.fork()
    if child == 0:
        _run(copy, tests)
    return _wait(child, limit)


def _run(copy: Path, tests: list[str]) -> None:
    """In the child: run the tests and leave with their status."""
    status = 1
    try:
        os.setsid()
        os.chdir(copy)
        sys.path.insert(0, str(copy))
        os.environ["PYTHONPATH"] = str(copy)
        sys.dont_write_bytecode = True
        for name in [name for name in sys.modules if name.split(".")[0] in ("studies", "tests")]:
            del sys.modules[name]
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        import pytest

        status = int(
            pytest.main([*tests, "-x", "-q", "-p", "no:cacheprovider", "-p", "no:cov", *RAW])
        )
    finally:
        os._exit(status)


def _wait(child: int, limit: float) -> str:
    end = time.monotonic() + limit
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return "survived" if status == 0 else "noticed"
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "timeout"


def main(copy: Path) -> None:
    """Answer each task on standard input: mutant, tests, seconds."""
    load_libraries()
    for line in sys.stdin:
        mutant, tests, limit = json.loads(line)
        change = None if mutant is None else Mutant(*mutant)
        print(json.dumps(noticed(copy, change, tests, limit)), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
