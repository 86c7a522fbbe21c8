"""Give one damaged snapshot to a reader, in a child process that may crash or hang."""

from __future__ import annotations

import os
import resource
import signal
import tempfile
import time
import traceback
from pathlib import Path

import numpy as np

from loops import InputError
from patterns import read_snapshot
from tests.command import run_snapshot
from tests.tools.fuzz.damage import damaged
from tests.tools.fuzz.samples import Sample

# What a child leaves with.
OUTCOMES = {0: "snapshot", 1: "clear error", 2: "exception", 3: "half-written"}
OUTCOMES[-signal.SIGXCPU] = "hang"
SECONDS = 20  # of the processor that a child may take
WAITED = 15.0  # times as long on a busy machine


def try_one(sample: Sample, seed: int, *, whole: bool) -> tuple[str, str]:
    """Damage a sample and read it."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        path = _damaged_copy(sample, seed, folder)
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reader)
            _attempt(path, sample, folder / "out" if whole else None, writer)
        os.close(writer)
        outcome = _wait(child)
        with os.fdopen(reader, "rb") as pipe:
            return outcome, pipe.read().decode(errors="replace")


def _damaged_copy(sample: Sample, seed: int, folder: Path) -> Path:
    rng = np.random.default_rng(seed)
    files = sorted(file for file in sample.path.parent.iterdir() if file.is_file())
    chosen = files[rng.integers(len(files))]
    for file in files:
        content = file.read_bytes()
        (folder / file.name).write_bytes(damaged(rng, content) if file == chosen else content)
    return folder / sample.path.name


def _attempt(path: Path, sample: Sample, out: Path | None, writer: int) -> None:
    """In the child: leave with the number of the outcome."""
    status, message = 2, ""
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    try:
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        if out is None:
            read_snapshot(path, **sample.options)
            status = 0
        else:
            status, message = _study(path, sample, out)
    except InputError as error:
        message = str(error)
        status = 1 if "\n" not in message else 2
    except BaseException:
        message = traceback.format_exc()
    finally:
        os.write(writer, message.encode()[:60_000])
        os._exit(status)


def _study(path: Path, sample: Sample, out: Path) -> tuple[int, str]:
    before = set(path.parent.iterdir())
    status, message = 0, ""
    try:
        run_snapshot(path, out, figures=False, **sample.options)
    except InputError as error:
        status, message = 1, str(error)
    left = {file.name for file in set(path.parent.iterdir()) - before}
    written = {file.name for file in out.iterdir()} if out.exists() else set()
    if status == 0 and not {"summary.json", "loops.parquet"} <= written:
        return 3, f"incomplete: {sorted(written)}"
    if left != (set() if status else {"out"}):
        return 3, f"left behind: {sorted(left)}"
    return status, message


def _wait(child: int) -> str:
    end = time.monotonic() + WAITED * SECONDS
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return OUTCOMES.get(os.waitstatus_to_exitcode(status), "crash")
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "hang"


def warm_up(samples: list[Sample]) -> None:
    """Load the readers' libraries once: each child then starts with them."""
    for sample in samples:
        read_snapshot(sample.path, **sample.options)
