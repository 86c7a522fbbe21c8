"""The clock of a command: for how long it has worked, and that kernels are compiled."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# Seconds before the clock is first shown.
CLOCK_PATIENCE = 2.0
# Seconds between two changes of it.
TICK = 0.5
COMPILING = "compiling kernels, once: about half a minute"
CLEAR = "\r\x1b[K"


@contextmanager
def clock(name: str, *, line: bool = True) -> Iterator[Callable[[str], None]]:
    """Show on the last line of a terminal for how many seconds `name` has worked, if `line`.

    Nothing is shown in the first two seconds, without a terminal or with --quiet. The block gets a
    function that adds a text to the line. While kernels are compiled, a line of its own says so,
    without a terminal too.
    """
    done, text = threading.Event(), [""]
    quiet = os.environ.get("TTY_COMPATIBLE") == "0"
    shown = line and sys.stderr.isatty() and not quiet

    def show() -> None:
        start, wait, said = time.monotonic(), CLOCK_PATIENCE, False
        while not done.wait(wait):
            from loops.compiled import compiling  # loads numpy

            wait = TICK
            if compiling and not said:
                said = True
                print(f"{name}: {COMPILING}", file=sys.stderr, flush=True)
            if shown:
                past = f"{CLEAR}{name}: {time.monotonic() - start:.0f} s{text[0]}"
                print(past, end="", file=sys.stderr, flush=True)
        if shown and wait == TICK:
            print(CLEAR, end="", file=sys.stderr, flush=True)

    thread = threading.Thread(target=show, daemon=True)
    if not quiet:
        thread.start()
    try:
        yield lambda more: text.__setitem__(0, f", {more}")
    finally:
        done.set()
        if not quiet:
            thread.join()
