"""Kernels compiled by numba, for computations that are slow in numpy on large packings.

Each kernel computes the same as a numpy function of the package; tests compare the two. Functions
import these modules only when the input is large: numba takes a third of a second to load, and
seconds to compile a kernel that is not in its cache. The cache notices changes of a kernel's own
file alone, so a kernel calls only kernels of the same file.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from threading import Thread
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

COMPILED_FROM = 40_000
"""Contacts from which on the kernels are used.

Once compiled, they save a second on a snapshot of 40,000 contacts and six on one of 185,000;
compiling them, once on a machine, takes about half a minute, which small packings never earn back.
Nor do they earn numba's loading: with kernels alone the table of 600 grains takes .6 s more of
processor time, compiled before (2.1 s for 1.5, 29 November 2026). So both ways stay.
"""


def load_ahead(contacts: int) -> None:
    """Load the kernels on another thread if so many contacts will use them."""
    if use_compiled(None, contacts):
        Thread(target=_load, daemon=True).start()


def _load() -> None:
    """Load numba and call one kernel: the first one takes as long as numba itself."""
    import_module("loops.compiled.network").spatial_order(given(np.zeros((1, 2)), np.float64))


def use_compiled(compiled: bool | None, contacts: int) -> bool:
    """Whether to use the kernels: as told, else by the number of contacts."""
    return contacts >= COMPILED_FROM if compiled is None else compiled


compiling: list[Any] = []
"""Kernels that are compiled at present, since they are in no cache."""


@cache
def _watch() -> None:
    """Keep `compiling` up to date."""
    from numba.core import event

    class Watch(event.Listener):
        def on_start(self, event: Any) -> None:
            compiling.append(event.data)

        def on_end(self, event: Any) -> None:
            compiling.pop()

    event.register("numba:compile", Watch())


def kernel(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """Compile a function at its first call, without the interpreter's lock.

    The machine code is kept beside the module, in the user's cache folder if that cannot be
    written, or where NUMBA_CACHE_DIR says. Where nothing can be written it is compiled anew in
    every process.
    """
    import numba

    _watch()
    options |= {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba raises it where it finds no place for the cache
        return numba.njit(**options)(function)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function into the kernels that call it.

    Its loops are then vectorised, and references to arrays that it is given are not counted: these
    counts took a tenth to a fifth of the time of kernels with many small functions.
    """
    return kernel(function, forceinline=True)


def inlined_sum(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `inlined`; the function adds up, and the order of its sums may change."""
    return kernel(function, forceinline=True, fastmath={"reassoc"})


def compiled(
    *modules: ModuleType, entry: tuple[str, ...], inlined: tuple[str, ...] | None = None
) -> Any:
    """Return the functions of modules compiled: they call each other, and no other kernel.

    As they stand numpy runs them, for what is too small to load numba. Python calls the `entry`
    ones; the `inlined` ones, all others if left out, are compiled into those that call them. That
    is faster by a tenth to a fifth, and takes as long for each caller again to compile. The cache
    goes by the sources of all the modules.
    """
    sources = "".join(Path(str(module.__file__)).read_text() for module in modules)
    functions = {name: each for module in modules for name, each in vars(module).items()}
    mark = sha256(sources.encode()).hexdigest()[:16]
    for module in modules:
        for name, function in vars(module).items():
            if isinstance(function, FunctionType) and function.__module__ == module.__name__:
                own = FunctionType(function.__code__, functions, name, function.__defaults__)
                own.__module__, own.__qualname__ = module.__name__, f"{name}-{mark}"
                outer = name in entry
                functions[name] = kernel(
                    own,
                    forceinline=not outer if inlined is None else name in inlined,
                    no_cpython_wrapper=not outer,
                    no_cfunc_wrapper=not outer,
                )
    return SimpleNamespace(**functions)


def given(values: ArrayLike, dtype: Any) -> NDArray[Any]:
    """A contiguous read-only view, copied only if needed, so that kernels compile for one type."""
    view = np.ascontiguousarray(values, dtype=dtype).view()
    view.flags.writeable = False
    return view
