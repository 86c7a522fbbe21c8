"""Runners of tasks: this process, several processes, or a running Dask cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import pickle
import shutil
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import connection, resource_tracker
from pathlib import Path
from typing import Any

# A limit holds for libraries that are loaded before it: scipy has linear algebra of its own.
import scipy.linalg  # noqa: F401

from loops import InputError
from loops.arrays import Floats, available_cores
from loops.errors import library
from studies import environment
from studies.clock import Progress, clock, paced
from studies.output import code_version, errors_of, write_whole

THREADS = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"),
    *("VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS"),
)
Function = Callable[[Any], Any]
# Places of tasks and their answers, in any order; closed, it drops the tasks that have not started.
Answers = Generator[tuple[int, Any]]
Runner = Callable[[Function, Sequence[Any]], Answers]

# Seconds to wait for an answer of the scheduler, and for a first worker.
PATIENCE = 8


@contextmanager
def open_runner(
    workers: int | None, scheduler: str | None, paths: Sequence[Path]
) -> Iterator[Runner]:
    """Open the runner of the options; `paths` are files that all workers of a cluster must see."""
    if workers is not None and scheduler is not None:
        raise InputError("--workers, --scheduler", "both", "one of them", "Leave one out.")
    if workers is not None and workers < 1:
        raise InputError("--workers", str(workers), "at least 1", "Change it.")
    if scheduler is not None:
        with connected(scheduler, paths) as client:
            yield partial(run_on_cluster, client)
        return
    number = available_cores() if workers is None else workers
    if number == 1:
        yield run_here
        return
    with processes(number) as pool:
        yield partial(run_in_processes, pool)


def run_here(function: Function, tasks: Sequence[Any]) -> Answers:
    """Yield the answers one after the other, in this process."""
    for place, task in enumerate(tasks):
        yield place, function(task)


@dataclass(frozen=True)
class Store:
    """Finished directions of an unfinished run, by a digest of what they depend on.

    One file each in a folder beside the results in `out`.
    """

    out: Path
    digest: str = ""

    @property
    def folder(self) -> Path:
        """Folder of the files."""
        return self.out.parent / f".{self.out.name}.directions"

    def file(self, number: int) -> Path:
        """File of a direction."""
        return self.folder / f"{self.digest}-{number:05d}.pickle"

    def read(self, count: int) -> dict[int, Any]:
        """Return the finished ones of so many directions."""
        files = {number: self.file(number) for number in range(count)}
        return {k: pickle.loads(one.read_bytes()) for k, one in files.items() if one.is_file()}

    def write(self, number: int, answer: Any) -> None:
        """Keep a finished direction as processes pass it on."""
        with errors_of(self.out):
            write_whole(self.file(number), partial(pickle.dump, answer))

    def remove(self) -> None:
        """Remove the folder: the results are written."""
        shutil.rmtree(self.folder, ignore_errors=True)


def do_all(
    runner: Runner,
    function: Function,
    given: Sequence[Any] | Floats,
    store: Store | None = None,
    progress: Progress | None = None,
) -> list[Any]:
    """Answers for all that is given, independent of the number of processes; a store keeps them."""
    found = {} if store is None else store.read(len(given))
    after_one = paced(progress, len(given), len(found))
    left = [k for k in range(len(given)) if k not in found]
    with closing(runner(function, [given[k] for k in left])) as answers:
        for place, answer in answers:
            if store is not None:
                store.write(left[place], answer)
            found[left[place]] = answer
            after_one()
    return [found[k] for k in range(len(given))]


# Measured beside loky (joblib): after `kill -9` of the parent the workers of either live on: both
# need `_begin`; a killed worker ends the run with the same error; what is finished is known by its
# files. loky would save no line here.
@contextmanager
def processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that end with the block; tasks that have not started by then are dropped."""
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=spawn, initializer=_begin)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def run_in_processes(
    pool: ProcessPoolExecutor, function: Function, tasks: Sequence[Any]
) -> Answers:
    """Yield the answers from processes of one thread each."""
    places: dict[Future[Any], int] = {}
    try:
        # The processes start while the tasks are handed out, one a core, of one thread each.
        with environment(**dict.fromkeys(THREADS, "1")), _interrupts_held():
            for place, task in enumerate(tasks):
                places[pool.submit(function, task)] = place
        for future in as_completed(places):
            yield places[future], future.result()
    except BrokenProcessPool:
        raise InputError(
            "a worker process",
            "its sudden end",
            "an answer",
            "Its memory may be used up: give a smaller --workers. Finished snapshots are kept.",
        ) from None
    finally:
        for future in places:
            future.cancel()


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold a Ctrl-C back until the block ends; processes that start here hold it back for good.

    The main process handles it. Where signals cannot be held back, nothing is done.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # It starts with the first process otherwise, and some Pythons release the signal then.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin() -> None:
    """Start a process: no warnings, as in the command, and an end when its parent is killed.

    All compile the same kernels, and the first one says so.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    sentinel, first = parent.sentinel, multiprocessing.current_process().name.endswith("-1")

    def wait() -> None:
        with clock("grainloops", line=False) if first else nullcontext():
            connection.wait([sentinel])
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


@contextmanager
def connected(address: str, paths: Sequence[Path]) -> Iterator[Any]:
    """Connect to the scheduler at an address and check its workers."""
    with library("--scheduler", "distributed"):
        import distributed  # noqa: F401
    # The log of lost connections is silenced: an error reports those that matter.
    names = [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    levels = {name: logging.getLogger(name).level for name in (*names, "distributed")}
    for name in levels:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        client = _client(address)
        try:
            _check_workers(client, address, paths)
            yield client
        finally:
            client.close(timeout=PATIENCE)
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def run_on_cluster(client: Any, function: Function, tasks: Sequence[Any]) -> Answers:
    """Yield the answers; the tasks of a lost worker go to another one.

    Tasks may have a `name` for messages.
    """
    from distributed import CancelledError, KilledWorker, as_completed

    futures = client.map(function, tasks, pure=False, key="grainloops")
    places = {future.key: place for place, future in enumerate(futures)}
    try:
        for future in as_completed(futures, loop=client.loop):
            yield places[future.key], future.result()
    except KilledWorker as error:
        raise InputError(
            getattr(tasks[places[error.task]], "name", "a direction"),
            "the loss of every worker that computed it",
            "an answer",
            "Their memory may be used up: give the workers more. Finished snapshots are kept.",
        ) from None
    except (CancelledError, OSError) as error:
        raise InputError(
            "the Dask scheduler",
            f"a lost connection ({type(error).__name__})",
            "answers",
            "Start the cluster again and give the same command: finished snapshots are kept.",
        ) from None
    finally:
        with suppress(Exception):
            client.cancel(futures, force=True)


def _client(address: str) -> Any:
    """Client of a scheduler; a client alone would wait long for one that is not there."""
    import asyncio

    from distributed import Client
    from distributed.comm.core import connect

    async def ask() -> Any:
        async with asyncio.timeout(PATIENCE):
            comm = await connect(address, timeout=PATIENCE)
            try:
                await comm.write({"op": "identity", "reply": True})
                return await comm.read()
            finally:
                comm.abort()

    try:
        answer = asyncio.run(ask())
        if not isinstance(answer, dict) or answer.get("type") != "Scheduler":
            raise ValueError("an answer from something else")
    except TimeoutError:
        raise _no_scheduler(address, f"no answer within {PATIENCE} s") from None
    except (OSError, ValueError) as error:
        raise _no_scheduler(address, str(error)) from None
    return Client(address, timeout=PATIENCE, set_as_default=False)


def _no_scheduler(address: str, received: str) -> InputError:
    return InputError(
        f"--scheduler {address}",
        received,
        "the address of a Dask scheduler, tcp://HOST:PORT",
        "Start `dask scheduler` and `dask worker ADDRESS` first.",
    )


def _check_workers(client: Any, address: str, paths: Sequence[Path]) -> None:
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise _no_scheduler(address, "a scheduler without workers") from None
    expected = code_version()
    for worker, (version, missing) in client.run(_probe([str(path) for path in paths])).items():
        where = f"Dask worker {worker}"
        if version != expected:
            raise InputError(
                where,
                f"grainloops {version}" if version else "no grainloops",
                f"grainloops {expected}, as here",
                "Install the same version for the workers, and start them again.",
            )
        if missing:
            raise InputError(
                where,
                f"no file {missing}",
                "a file system shared with this machine",
                "Use paths that every worker sees, for the snapshots and for --out.",
            )


def _probe(paths: list[str]) -> Callable[[], tuple[str | None, str | None]]:
    # A nested function is sent as code: it runs on workers without grainloops too.
    def probe() -> tuple[str | None, str | None]:
        import os

        try:
            from studies.output import code_version

            version = code_version()
        except ImportError:
            version = None
        missing = [path for path in paths if not os.path.exists(path)]
        return version, missing[0] if missing else None

    return probe
