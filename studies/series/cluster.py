"""Runner of tasks on a running Dask cluster."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

from loops import InputError
from studies.output import code_version

Answer = TypeVar("Answer")

# Seconds to wait for an answer of the scheduler, and for a first worker.
PATIENCE = 8


@contextlib.contextmanager
def connected(address: str, paths: Sequence[Path]) -> Iterator[Any]:
    """Connect to the scheduler at an address and check its workers."""
    _require_dask()
    with _quiet():
        client = _client(address)
        try:
            _check_workers(client, address, paths)
            yield client
        finally:
            client.close(timeout=PATIENCE)


def run_on_cluster(
    client: Any, function: Callable[[Any], Answer], tasks: Sequence[Any]
) -> Generator[Answer]:
    """Yield the answers in any order; the tasks of a lost worker go to another one.

    Tasks have a `name` for messages.
    """
    from distributed import CancelledError, KilledWorker, as_completed

    futures = client.map(function, tasks, pure=False, key=function.__name__)
    named: dict[Any, str] = {
        future.key: task.name for future, task in zip(futures, tasks, strict=True)
    }
    try:
        for future in as_completed(futures, loop=client.loop):
            yield future.result()
    except KilledWorker as error:
        raise InputError(
            named.get(error.task, str(error.task)),
            "the loss of one worker after the other that took it",
            "an answer",
            "Their memory may be used up: give the workers more. What is finished is kept.",
        ) from None
    except (CancelledError, OSError) as error:
        raise InputError(
            "the Dask scheduler",
            f"a lost connection ({type(error).__name__})",
            "answers",
            "Start the cluster again and give the same command: what is finished is kept.",
        ) from None
    finally:
        with contextlib.suppress(Exception):
            client.cancel(futures, force=True)


def _require_dask() -> None:
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise InputError(
            "--scheduler",
            "no Dask here",
            "dask.distributed",
            "Install it: pip install distributed.",
        ) from None


def _client(address: str) -> Any:
    from distributed import Client

    # A client waits long for a scheduler that is not there: ask for it first.
    try:
        asyncio.run(_require_scheduler(address))
    except TimeoutError:
        raise _no_scheduler(address, f"no answer within {PATIENCE} s") from None
    except (OSError, ValueError) as error:
        raise _no_scheduler(address, str(error)) from None
    return Client(address, timeout=PATIENCE, set_as_default=False)


async def _require_scheduler(address: str) -> None:
    from distributed.comm.core import connect

    async with asyncio.timeout(PATIENCE):
        comm = await connect(address, timeout=PATIENCE)
        try:
            await comm.write({"op": "identity", "reply": True})
            answer = await comm.read()
        finally:
            comm.abort()
    if not isinstance(answer, dict) or answer.get("type") != "Scheduler":
        raise ValueError("an answer from something else")


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


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence the log of lost connections: an error reports those that matter."""
    names = [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]
    levels = {name: logging.getLogger(name).level for name in (*names, "distributed")}
    for name in levels:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)
