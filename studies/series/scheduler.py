"""Who does the tasks: this process, several, or a cluster; what is finished is not done again."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

from loops import InputError
from studies.series.dataset import is_finished
from studies.series.processes import available_cores, processes, run_here, run_in_processes
from studies.series.tasks import Failure, PairTask, SnapshotTask

Task = SnapshotTask | PairTask


class Runner(Protocol):
    """Calls a function with each task, and gives the answers as they come."""

    def __call__(
        self, function: Callable[[Any], Failure | None], tasks: Sequence[Any]
    ) -> Generator[Failure | None]:
        """Answers in any order."""
        ...


@contextmanager
def open_runner(
    workers: int | None, scheduler: str | None, paths: Sequence[Path]
) -> Iterator[Runner]:
    """The one who does the tasks.

    Parameters
    ----------
    workers : int, optional
        Number of processes; by default as many as cores.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers then do the tasks.
    paths : sequence of Path
        Absolute paths that they must see.

    Yields
    ------
    Runner
        To call with a function and its tasks.

    Raises
    ------
    InputError
        If both are given, there is less than one worker, or the cluster is not fit for it.
    """
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
    runner: Runner,
    function: Callable[[Any], Failure | None],
    tasks: Sequence[Task],
    title: str,
    *,
    skip_bad: bool,
) -> list[Failure]:
    """Do the tasks that are not finished yet, with a progress bar.

    Parameters
    ----------
    runner : Runner
        Who does them.
    function : callable
        Does one task, `do_snapshot` or `do_pair`.
    tasks : sequence of task
        All of them.
    title : str
        What to write beside the progress bar.
    skip_bad : bool
        Whether to go on after a failure.

    Returns
    -------
    list of Failure
        By the snapshots' numbers; empty unless `skip_bad`.

    Raises
    ------
    InputError
        For the first snapshot that could not be read, unless `skip_bad`; if results can't be
        written.
    """
    open_tasks = [task for task in tasks if not is_finished(task.part, task.fingerprint)]
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
        closing(runner(function, open_tasks)) as answers,
    ):
        row = bar.add_task(title, total=len(tasks), completed=len(tasks) - len(open_tasks))
        for answer in answers:
            bar.advance(row)
            if answer is not None and not (skip_bad and answer.skippable):
                raise answer.error()
            if answer is not None:
                failures.append(answer)
    return sorted(failures, key=lambda failure: failure.number)
