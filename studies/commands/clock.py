"""How long a command has worked, on the last line of a terminal; nothing for short work."""

from __future__ import annotations

import sys
import threading
import time

# Seconds before the first line, and between two.
PATIENCE, TICK = 2.0, 0.5
CLEAR = "\r\x1b[K"


class Clock:
    """A line on stderr that tells the seconds, if that is a terminal, until `stop`."""

    def __init__(self) -> None:
        self._done = threading.Event()
        self._teller: threading.Thread | None = None

    def start(self, name: str) -> None:
        """Tell after a while that `name` is at work."""
        if sys.stderr.isatty():
            self._teller = threading.Thread(target=self._tell, args=(name,), daemon=True)
            self._teller.start()

    def stop(self) -> None:
        """Clear the line: something else is to be printed."""
        self._done.set()
        if self._teller is not None:
            self._teller.join()

    def _tell(self, name: str) -> None:
        start, wait = time.monotonic(), PATIENCE
        while not self._done.wait(wait):
            wait = TICK
            seconds = time.monotonic() - start
            print(f"{CLEAR}{name}: {seconds:.0f} s", end="", file=sys.stderr, flush=True)
        if wait == TICK:
            print(CLEAR, end="", file=sys.stderr, flush=True)


clock = Clock()
