"""Runners of tasks: this process, several processes, or a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import connection
from pathlib import Path
from typing import Any, TypeVar

# Limits hold for what is loaded before them: scipy brings its own linear algebra.
import scipy.linalg  # noqa: F401
from threadpoolctl import threadpool_limits

from loops import InputError
from loops.arrays import available_cores

Asked = TypeVar("Asked")
Answer = TypeVar("Answer")
THREADS = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"),
    *("VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS"),
)
Runner = Callable[[Callable[[Any], Any], Sequence[Any]], Generator[Any]]


@contextmanager
def open_runner(
    workers: int | None, scheduler: str | None, paths: Sequence[Path]
) -> Iterator[Runner]:
    """Open the runner that was asked for; `paths` are files that a cluster must see."""
    if workers is not None and scheduler is not None:
        raise InputError("--workers, --scheduler", "both", "one of them", "Leave one out.")
    if workers is not None and workers < 1:
        raise InputError("--workers", str(workers), "at least 1", "Change it.")
    if scheduler is not None:
        from studies.series.cluster import connected, run_on_cluster

        with connected(scheduler, paths) as client:
            yield partial(run_on_cluster, client)
        return
    number = available_cores() if workers is None else workers
    if number == 1:
        yield run_here
        return
    with processes(number) as pool:
        yield partial(run_in_processes, pool)


def run_here(function: Callable[[Asked], Answer], tasks: Sequence[Asked]) -> Generator[Answer]:
    """Yield the answers one after the other, in this process."""
    for task in tasks:
        yield function(task)


@contextmanager
def processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that end with the block; tasks that have not started by then are dropped."""
    pool = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin,
    )
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def run_in_processes(
    pool: ProcessPoolExecutor, function: Callable[[Asked], Answer], tasks: Sequence[Asked]
) -> Generator[Answer]:
    """Yield the answers in any order, from processes of one thread each.

    Closing the generator drops the tasks that have not started.
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
    """Give the processes that start here one thread each: there is one process a core."""
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
    """Let processes that start here ignore Ctrl-C, which the main process handles."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _begin() -> None:
    """Start a process: no warnings, as in the command, and an end when its parent is killed."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    sentinel = parent.sentinel

    def wait() -> None:
        connection.wait([sentinel])
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def one_blas_thread() -> threadpool_limits:
    """Run the linear algebra of numpy and scipy in one thread until the block ends.

    The number of threads of OpenBLAS changes the last digit of a decomposition, from some 40
    unknowns on; one process, several, and a cluster of other machines must write the same bytes.
    """
    return threadpool_limits(1, user_api="blas")
