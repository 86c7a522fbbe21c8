"""Compiled kernels (numba) of what is slow in numpy once a packing is large.

Each kernel does what a function of the room does with arrays, and is held to it by the tests. The
modules here are imported by those functions only when the input is large: numba takes a third of a
second to load, and seconds to compile what is not in its cache yet. The cache knows a kernel by
its own file, so whatever a kernel calls stands in the same one: networks here, loops here, modes
in `stability.compiled`.
"""

from __future__ import annotations

from importlib import import_module
from threading import Thread

LARGE = 40_000
"""Contacts from which on the kernels are used.

Once compiled, they save a second on a snapshot of 40,000 contacts and six on one of 185,000;
compiling them, once on a machine, takes about half a minute, which small packings never earn back.
"""


def load_ahead(contacts: int) -> None:
    """Load on another thread what kernels for so many contacts will ask for, if they are used."""
    if use_compiled(None, contacts):
        Thread(target=import_module, args=("loops.compiled.network",), daemon=True).start()


def use_compiled(compiled: bool | None, contacts: int) -> bool:
    """Whether to take the compiled way."""
    return contacts >= LARGE if compiled is None else compiled
