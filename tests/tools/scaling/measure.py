"""One point of the study in a process of its own: time, memory, and the machine's bandwidth."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np

from loops import find_faces
from loops.arrays import Floats
from loops.compiled import kernel
from studies.snapshot.table import loop_columns
from tests.tools.scaling.methods import (
    COMMANDS,
    KEPT,
    METHODS,
    bytes_moved,
    command,
    synthetic_snapshot,
)

STATUS, RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
TRIAD = 2**23  # doubles in each array: larger than any cache
WARM_UP = 300  # grains
MB = 2.0**20


def measure(what: str, how: str, grains: int, repeats: int) -> dict[str, Any]:
    """Time one method on a network of its own."""
    prepare = METHODS[what, how][0]
    # Loads what the method needs.
    prepare(synthetic_snapshot(WARM_UP))()
    snapshot = synthetic_snapshot(grains)
    work = prepare(snapshot)
    before = _reset_peak()
    first, _ = _timed(work)
    spent = [_timed(work) for _ in range(repeats)]
    taken = max(_peak() - before, 0.0)
    if what == "command":
        taken = 1024.0 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    # The pool ends its process too roughly for folders to go by themselves.
    while KEPT:
        KEPT.pop().cleanup()
    return {
        "what": what,
        "how": how,
        "grains": snapshot.graph.grain_count,
        "first_seconds": first,
        "seconds": min(wall for wall, _ in spent),
        "cpu_seconds": min(cpu for _, cpu in spent),
        "bytes_per_grain": taken / snapshot.graph.grain_count,
    }


def command_row(how: str, repeats: int) -> dict[str, Any]:
    """Time one of `COMMANDS`, from its start to its end."""
    spent = [_timed(command(*COMMANDS[how])) for _ in range(repeats)]
    wall, cpu = (min(times) for times in zip(*spent, strict=True))
    row = {"what": "start", "how": how, "grains": 0, "first_seconds": spent[0][0]}
    return {**row, "seconds": wall, "cpu_seconds": cpu, "bytes_per_grain": None}


def floor_seconds(grains: int, bandwidth: float) -> dict[str, float]:
    """Least time that moving input and result through memory takes."""
    # Per grain the bytes are the same at any size: a small network tells them.
    sample = synthetic_snapshot(min(grains, 20_000))
    faces = find_faces(sample.graph)
    table = loop_columns(sample)
    share = grains / sample.graph.grain_count / bandwidth
    return {what: share * bytes_moved(what, sample.graph, faces, table) for what in FLOORS}


FLOORS = ("faces", "read", "table", "summary", "write")


def triad_bandwidth(repeats: int = 7) -> float:
    """Bandwidth of the memory by `a = b + s c` on one thread, bytes per second."""
    b, c = np.ones(TRIAD), np.ones(TRIAD)
    a = np.zeros(TRIAD)
    triad(a, b, c, 3.0)
    return 24.0 * TRIAD / min(_timed(lambda: triad(a, b, c, 3.0))[0] for _ in range(repeats))


def in_a_process(what: str, how: str, grains: int, repeats: int) -> dict[str, Any]:
    """`measure` in a fresh process, whose memory is its own."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(measure, (what, how, grains, repeats))


def _timed(work: Any) -> tuple[float, float]:
    wall, cpu = time.perf_counter(), _processor()
    work()
    return time.perf_counter() - wall, _processor() - cpu


def _processor() -> float:
    """Seconds of the processor, those of commands that have ended among them."""
    ended = os.times()
    return time.process_time() + ended.children_user + ended.children_system


def _reset_peak() -> float:
    """Forget the peak so far, where the system can; bytes held now."""
    try:
        # What was freed goes back to the system first: it would pass for memory held.
        ctypes.CDLL(None).malloc_trim(0)
        RESET.write_text("5")
    except (OSError, AttributeError):
        return _peak()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return float(pages * os.sysconf("SC_PAGESIZE"))


def _peak() -> float:
    """Largest memory of the process, bytes."""
    try:
        line = next(row for row in STATUS.read_text().splitlines() if row.startswith("VmHWM"))
        return 1024.0 * float(line.split()[1])
    except OSError:
        return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


@kernel
def triad(a: Floats, b: Floats, c: Floats, s: float) -> None:
    """`a = b + s c`, each number read or written once."""
    for k in range(len(a)):
        a[k] = b[k] + s * c[k]
