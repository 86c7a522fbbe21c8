"""Tasks on one machine: in this process, or in several."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import connection
from typing import Any, TypeVar

import numpy as np

from loops import InputError

Task = TypeVar("Task")
Answer = TypeVar("Answer")
THREADS = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"),
    *("VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS"),
)

# How OpenBLAS calls its number of threads, in numpy's wheels and elsewhere.
BLAS = tuple(
    (f"{prefix}openblas_get_num_threads{suffix}", f"{prefix}openblas_set_num_threads{suffix}")
    for prefix in ("scipy_", "")
    for suffix in ("64_", "")
)


def available_cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_here(function: Callable[[Task], Answer], tasks: Sequence[Task]) -> Generator[Answer]:
    """Answers one after the other, in this process."""
    for task in tasks:
        yield function(task)


@contextmanager
def processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that end with the block; tasks that have not begun then are left undone.

    Parameters
    ----------
    workers : int
        How many, at least 1.

    Yields
    ------
    ProcessPoolExecutor
        For `run_in_processes`.
    """
    pool = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_end_with_parent,
    )
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def run_in_processes(
    pool: ProcessPoolExecutor, function: Callable[[Task], Answer], tasks: Sequence[Task]
) -> Generator[Answer]:
    """Answers as they come, from processes of one thread each.

    Whoever stops asking leaves the tasks that have not begun undone.

    Parameters
    ----------
    pool : ProcessPoolExecutor
        From `processes`.
    function : callable
        A function of a module, of one task.
    tasks : sequence
        What to call it with.

    Yields
    ------
    object
        What `function` returned, in the order of completion.

    Raises
    ------
    InputError
        If a process ended by itself, as one does when the memory is used up.
    """
    futures: list[Future[Answer]] = []
    try:
        # The processes start while the tasks are handed out.
        with _one_thread_each(), _interrupts_ignored():
            futures += [pool.submit(function, task) for task in tasks]
        for future in as_completed(futures):
            yield future.result()
    except BrokenProcessPool:
        raise InputError(
            "a worker process",
            "its sudden end",
            "an answer",
            "Its memory may be used up: give a smaller --workers. What is finished is kept.",
        ) from None
    finally:
        for future in futures:
            future.cancel()


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Environment of the processes: as many of them as cores, so one thread each."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Processes started here don't hear Ctrl-C: it is for the one who hands out the tasks."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Linear algebra of numpy in one thread, in whatever process the task is done.

    How OpenBLAS shares out a decomposition changes its last digit, from some 40 unknowns on; the
    same bytes must come from one process, several, or a cluster of other machines.
    """
    get, put = _blas_threads()
    before = get()
    put(1)
    try:
        yield
    finally:
        put(before)


def _blas_threads() -> tuple[Any, Any]:
    """How many threads numpy's OpenBLAS takes, to ask and to set; nothing for other libraries."""
    try:
        library = ctypes.CDLL(np.linalg._umath_linalg.__file__)
    except (OSError, AttributeError):
        library = None
    for get, put in BLAS:
        if hasattr(library, get) and hasattr(library, put):
            return getattr(library, get), getattr(library, put)
    return (lambda: 1), (lambda number: None)


def _end_with_parent() -> None:
    """A killed parent tells nobody: its processes would wait for tasks for ever."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    sentinel = parent.sentinel

    def wait() -> None:
        connection.wait([sentinel])
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
