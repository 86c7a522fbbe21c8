"""The clock of a command: for how long it has worked, and that kernels are compiled."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from loops.errors import check_type

# Seconds before the clock is first shown.
CLOCK_PATIENCE = 2.0
# Seconds between two changes of it.
TICK = 0.5
COMPILING = "compiling kernels, once: about half a minute"
CLEAR = "\r\x1b[K"


# Seconds from which on work is long: an estimate is printed without a terminal too, once the parts
# have taken so many seconds: the first one loads kernels.
LONG, STEADY = 30.0, 5.0
# Called with how many parts are done, the seconds that the others will take, and their number.
Progress = Callable[[int, float, int], object]


def paced(progress: Progress | None, count: int, done: int = 0) -> Callable[[], None]:
    """Return a function to call after each of so many parts, some of which are `done` already."""
    if progress is not None:
        check_type("progress", progress, Callable, "Give a function, or leave it out.")
    start, ended = time.monotonic(), 0

    def after_one() -> None:
        nonlocal ended
        ended += 1
        if progress is not None:
            left = count - done - ended
            progress(done + ended, left * (time.monotonic() - start) / ended, left)

    return after_one


def of_parts(tell: Callable[..., object], what: str) -> Progress:
    """Return the `progress` of a command: parts done and the time left, on its clock."""

    def progress(done: int, seconds: float, left: int) -> None:
        others = f"{seconds:.0f} s" if seconds < 60 else f"{seconds / 60:.0f} min"
        steady = done > 1 and seconds * done > STEADY * left
        tell(f"{done} of {done + left} {what}, about {others} left", seconds > LONG and steady)

    return progress


@contextmanager
def clock(name: str, *, line: bool = True) -> Iterator[Callable[..., None]]:
    """Show on the last line of a terminal for how many seconds `name` has worked, if `line`.

    Nothing is shown in the first two seconds, without a terminal or with --quiet. The block gets a
    function that adds a text to the line; without a terminal the first one of `long` work is
    printed. While kernels are compiled, a line of its own says so, without a terminal too.
    """
    if os.environ.get("TTY_COMPATIBLE") == "0":
        yield lambda *_: None
        return
    done, text, start, estimated = threading.Event(), "", time.monotonic(), False
    shown = line and sys.stderr.isatty()

    def show() -> None:
        wait, said = CLOCK_PATIENCE, False
        while not done.wait(wait):
            from loops.compiled import compiling  # loads numpy

            wait = TICK
            if compiling and not said:
                said = True
                print(f"{name}: {COMPILING}", file=sys.stderr, flush=True)
            if shown:
                past = f"{CLEAR}{name}: {time.monotonic() - start:.0f} s{text}"
                print(past, end="", file=sys.stderr, flush=True)
        if shown and wait == TICK:
            print(CLEAR, end="", file=sys.stderr, flush=True)

    def tell(more: str, long: bool = False) -> None:
        nonlocal estimated, text
        if long and not (shown or estimated):
            estimated = True
            print(f"{name}: {more}", file=sys.stderr, flush=True)
        text = f", {more}"

    thread = threading.Thread(target=show, daemon=True)
    thread.start()
    try:
        yield tell
    finally:
        done.set()
        thread.join()
