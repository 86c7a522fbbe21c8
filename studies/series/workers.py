"""Who does the tasks: this process, several, or a cluster; what is finished is not done again."""

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
from contextlib import closing, contextmanager
from functools import partial
from multiprocessing import connection
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

from loops import InputError
from loops.arrays import available_cores
from studies.series.tasks import Failure, PartTask, do_task

Asked = TypeVar("Asked")
Answer = TypeVar("Answer")
THREADS = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"),
    *("VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS"),
)


# Calls a function with each task, and gives the answers as they come, in any order.
Runner = Callable[[Callable[[Any], Any], Sequence[Any]], Generator[Any]]


@contextmanager
def open_runner(
    workers: int | None, scheduler: str | None, paths: Sequence[Path]
) -> Iterator[Runner]:
    """The one who does the tasks."""
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


def do_tasks(
    runner: Runner, tasks: Sequence[PartTask], title: str, *, skip_bad: bool
) -> list[Failure]:
    """Do the tasks that are not finished yet, with a progress bar."""
    open_tasks = [task for task in tasks if not task.finished]
    if not open_tasks:
        return []
    console = Console(stderr=True)
    if len(open_tasks) < len(tasks):
        done = len(tasks) - len(open_tasks)
        console.print(f"{title}: {done} of {len(tasks)} were finished before", highlight=False)
    failures = []
    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    hidden = not console.is_terminal
    with (
        Progress(*columns, console=console, transient=True, disable=hidden) as bar,
        # Whatever ends the loop, tasks that have not begun are left.
        closing(runner(do_task, open_tasks)) as answers,
    ):
        row = bar.add_task(title, total=len(tasks), completed=len(tasks) - len(open_tasks))
        for answer in answers:
            bar.advance(row)
            if answer is not None and not (skip_bad and answer.skippable):
                raise answer.error()
            if answer is not None:
                failures.append(answer)
    return sorted(failures, key=lambda failure: failure.number)


def run_here(function: Callable[[Asked], Answer], tasks: Sequence[Asked]) -> Generator[Answer]:
    """Answers one after the other, in this process."""
    for task in tasks:
        yield function(task)


@contextmanager
def processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that end with the block; tasks that have not begun then are left undone."""
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
    """Answers as they come, from processes of one thread each.

    Whoever stops asking leaves the tasks that have not begun undone.
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


def _begin() -> None:
    """No warnings, as in the command; and a killed parent tells nobody: end with it."""
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
