"""Run the mutation check: `python -m tests.tools.mutation --out DIR --rooms FOLDER --sample 200`.

Every mutant meets all fast tests that run its line, the shortest first, until one fails.
"""

from __future__ import annotations

import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import cyclopts
import numpy as np
import pandas as pd
from cyclopts import Parameter
from rich.console import Console
from rich.progress import Progress

from tests.tools.mutation.covering import Covering, record_covering
from tests.tools.mutation.mutants import Mutant, mutants_of

ROOT = Path(__file__).parents[3]
# Tests of one mutant are stopped after so many times their duration without it, and this besides.
PATIENCE, GRACE = 5.0, 60.0


def main(
    out: Annotated[Path, Parameter(help="Result folder.")],
    sample: Annotated[int, Parameter(help="Mutants drawn; 0 for all.")] = 0,
    seed: Annotated[int, Parameter(help="Seed of the draw.")] = 1,
    rooms: Annotated[
        str, Parameter(help="Folders and files, separated by blanks.")
    ] = "loops stability",
    tests: Annotated[
        str,
        Parameter(
            allow_leading_hyphen=True, help="Arguments of pytest; all fast tests if left out."
        ),
    ] = "",
    kernels: Annotated[
        bool, Parameter(negative=(), help="The compiled kernels, run as plain Python.")
    ] = False,
    workers: Annotated[int, Parameter(help="Processes.")] = 2,
    minutes: Annotated[float, Parameter(help="Stop then, and count what was tried.")] = 600.0,
) -> None:
    """Draw mutants of some rooms and count those that the tests notice."""
    if kernels:
        # Machine code is out of coverage's sight, and its cache does not see every change.
        os.environ["NUMBA_DISABLE_JIT"] = "1"
    out.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as scratch:
        copies = [copied(Path(scratch) / f"copy{k}") for k in range(workers)]
        drawn, equivalent = draw(rooms.split(), sample, seed, kernels=kernels)
        files = {mutant.file for mutant in drawn}
        covering = record_covering(copies[0], files, tests.split(), workers)
        rows, end = [], time.monotonic() + 60.0 * minutes
        for row in _try_all(drawn, covering, copies, end):
            rows.append(row)
            if row["outcome"] in ("survived", "uncovered"):
                print(f"{row['outcome']:<9} {row['file']}:{row['line']} {row['operator']}")
                print(f"          {row['before']}")
    counts = Counter(row["outcome"] for row in rows)
    seen = counts["noticed"] + counts["timeout"]
    summary: dict[str, Any] = {
        "asked": {"sample": sample, "seed": seed, "rooms": rooms, "tests": tests},
        "mutants": len(rows),
        "equivalent": equivalent,
        "outcomes": dict(counts),
        "score": seen / max(len(rows), 1),
        "score_by_kind": _score_by(rows, "kind"),
        "score_by_file": _score_by(rows, "file"),
    }
    pd.DataFrame(rows).to_csv(out / "mutants.csv", index=False)
    (out / "summary.json").write_text(json.dumps(summary, indent=1) + "\n")
    print(f"noticed {seen} of {len(rows)}: {summary['score']:.3f}   {dict(counts)}")


def copied(place: Path) -> Path:
    """Every file of the project that git tracks or would."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    found = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in found.rstrip("\0").split("\0"):
        if (ROOT / name).exists():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, place / name)
    return place


def draw(rooms: list[str], sample: int, seed: int, *, kernels: bool) -> tuple[list[Mutant], int]:
    """Mutants to try, and how many were left out as equivalent."""
    files = sorted(
        {
            str(path.relative_to(ROOT))
            for room in rooms
            for path in ([ROOT / room] if room.endswith(".py") else (ROOT / room).rglob("*.py"))
            if ("compiled" in path.parts) == kernels
        }
    )
    if not files:
        raise SystemExit(f"no source files in {' '.join(rooms)}")
    known = tomllib.loads((Path(__file__).parent / "equivalent.toml").read_text())
    names = {entry["name"] for entry in known.get("mutant", [])}
    every = [mutant for file in files for mutant in mutants_of(ROOT, file)]
    kept = [mutant for mutant in every if mutant.name not in names]
    equivalent = len(every) - len(kept)
    if sample and sample < len(kept):
        chosen = np.random.default_rng(seed).choice(len(kept), sample, replace=False)
        kept = [kept[k] for k in chosen.tolist()]
    return kept, equivalent


def _try_all(
    mutants: list[Mutant], covering: Covering, copies: list[Path], end: float
) -> Iterator[dict[str, Any]]:
    """Outcome of each, drawn at random, as long as the clock stands before `end`."""
    triers: queue.Queue[subprocess.Popen[str]] = queue.Queue()
    for copy in copies:
        trier = _trier(copy)
        few = sorted(covering.seconds, key=lambda test: covering.seconds[test])[:20]
        if _ask(trier, [None, few, PATIENCE * GRACE]) != "survived":
            raise RuntimeError("tests fail in the trial without any change")
        triers.put(trier)

    def attempt(mutant: Mutant) -> str:
        if time.monotonic() > end:
            return "left out"
        tests = covering.tests_of(mutant.file, mutant.line)
        expected = sum(covering.seconds[test] for test in tests)
        trier = triers.get()
        try:
            return _ask(trier, [list(mutant), tests, GRACE + PATIENCE * expected])
        finally:
            triers.put(trier)

    try:
        with ThreadPoolExecutor(len(copies)) as pool, Progress(console=Console(stderr=True)) as bar:
            task = bar.add_task("mutants", total=len(mutants))
            for mutant, outcome in zip(mutants, pool.map(attempt, mutants), strict=True):
                bar.advance(task)
                if outcome != "left out":
                    yield {**mutant._asdict(), "outcome": outcome}
    finally:
        for _ in copies:
            triers.get().terminate()


def _trier(copy: Path) -> subprocess.Popen[str]:
    """A process that tries mutants in its own copy; one thread, since it forks."""
    single = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    return subprocess.Popen(
        [sys.executable, "-m", "tests.tools.mutation.trial", str(copy)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, **single, "PYTHONPATH": str(ROOT)},
    )


def _ask(trier: subprocess.Popen[str], task: list[Any]) -> str:
    assert trier.stdin is not None and trier.stdout is not None
    trier.stdin.write(json.dumps(task) + "\n")
    trier.stdin.flush()
    answer = trier.stdout.readline()
    if not answer:
        raise RuntimeError("a process that tries mutants has ended; see what it printed")
    return str(json.loads(answer))


def _score_by(rows: list[dict[str, Any]], key: str) -> dict[str, str]:
    """Noticed of tried, by kind or file."""
    total = Counter(row[key] for row in rows)
    seen = Counter(row[key] for row in rows if row["outcome"] in ("noticed", "timeout"))
    return {name: f"{seen[name]} of {count}" for name, count in sorted(total.items())}


if __name__ == "__main__":
    cyclopts.run(main)
