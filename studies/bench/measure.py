"""Time and memory of a call."""

from __future__ import annotations

import os
import platform
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

# Least total time of the repeated runs in seconds; the fastest run counts.
LONG_ENOUGH, LONG_ENOUGH_QUICK = 0.15, 0.01
# Calls longer than this (seconds) are not run again for their memory: tracing slows Python down.
TRACED = 2.0


@dataclass(frozen=True)
class Row:
    """Time, error and memory of one method at one setting."""

    group: str
    method: str
    setting: str
    items: int
    seconds_per_item: float
    error: float
    peak_bytes: float
    oracle: str
    default: bool = False


class Rows(list[Row]):
    """Rows of one group and oracle."""

    def __init__(self, group: str, oracle: str, quick: bool) -> None:
        super().__init__()
        self.group, self.oracle, self.quick = group, oracle, quick

    def add(
        self,
        method: str,
        setting: str,
        call: Callable[[], Any],
        gap: Any,
        items: int = 1,
        default: bool = False,
    ) -> None:
        """Run a method for its time, once more for its memory; `gap` is its error."""
        seconds = least_seconds(call, quick=self.quick)
        peak = peak_bytes(call) if seconds < TRACED else float("nan")
        measured = (items, seconds / items, largest(np.abs(gap)), peak)
        self.append(Row(self.group, method, setting, *measured, self.oracle, default))


def least_seconds(call: Callable[[], Any], *, quick: bool) -> float:
    """Processor time of the fastest of several runs, the least disturbed by other work."""
    enough = LONG_ENOUGH_QUICK if quick else LONG_ENOUGH
    times: list[float] = []
    while sum(times) < enough or (len(times) < 3 and times[0] < enough):
        start = time.process_time()
        call()
        times.append(max(time.process_time() - start, 1e-9))
    return min(times)


def peak_bytes(call: Callable[[], Any]) -> float:
    """Peak of the memory that a call asks for, beyond the memory held before."""
    tracemalloc.start()
    try:
        call()
        return float(tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()


def machine(*packages: str) -> dict[str, Any]:
    """Interpreter, processor, cores and packages: times depend on them."""
    found: dict[str, Any] = {"python": platform.python_version(), "cores": os.cpu_count()}
    found["processor"] = platform.machine()
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def largest(errors: Any) -> float:
    """Largest error, 1 where there is no answer."""
    return float(np.max(np.where(np.isfinite(errors), errors, 1.0)))
