"""A series on a Dask cluster on loopback: a real scheduler, two real workers, and their losses."""

import json
import os
import pickle
import signal
import socket
import subprocess
import sys
from pathlib import Path

import cloudpickle
import numpy as np
import pytest

import studies
from loops import InputError, Regime
from patterns import Snapshot, sample_path, write_snapshot
from studies.output import code_version
from studies.series import workers as cluster
from tests.command import run_probe, run_sustain
from tests.packings import LAW, jammed
from tests.studies.series.test_run import (
    command,
    contents,
    run,
    times,
    wait_for,
    write_series,
)

ROOT = Path(studies.__file__).resolve().parents[1]
QUIET = ("--host", "127.0.0.1", "--no-dashboard")


def dask(*arguments):
    """A process of Dask's own command."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-m", "dask", *map(str, arguments)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=environment,
        cwd=ROOT,
    )


@pytest.fixture
def scheduler(tmp_path):
    """A scheduler's process and its address."""
    file = tmp_path / "scheduler.json"
    process = dask("scheduler", *QUIET, "--port", 0, "--scheduler-file", file)
    try:
        # It is there before its content is.
        wait_for(lambda: file.exists() and file.read_text())
        yield process, json.loads(file.read_text())["address"]
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def workers(tmp_path, scheduler):
    """Two workers of one thread, which nobody starts again."""
    options = (*QUIET, "--nthreads", 1, "--no-nanny")
    started = [
        dask("worker", scheduler[1], *options, "--local-directory", tmp_path / f"worker{k}")
        for k in range(2)
    ]
    try:
        yield started
    finally:
        for process in started:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_a_worker_lost_in_the_middle(tmp_path, scheduler, workers):
    """Nothing is lost, nothing stands there twice: the same bytes as from one process."""
    paths, out = write_series(tmp_path / "run", 8), tmp_path / "out"
    process = command(*paths, "--out", out, "--scheduler", scheduler[1], "--no-figures")
    # A worker that is stopped keeps the tasks it has until it is killed.
    wait_for(lambda: times(out) or process.poll() is not None)
    workers[0].send_signal(signal.SIGSTOP)
    found = len(times(out))
    workers[0].kill()
    printed, complaints = process.communicate(timeout=120)
    assert process.returncode == 0, complaints
    assert found < 15
    assert complaints == ""
    assert "8 snapshots" in printed
    run(paths, tmp_path / "alone")
    assert contents(out) == contents(tmp_path / "alone")


@pytest.mark.slow
def test_the_packing_predicts_the_same_on_a_cluster(tmp_path, scheduler, workers):
    """Byte for byte, on workers and in this process."""
    cells = sample_path("slow/cells.csv")
    paths = sorted(cells.parent.glob("grains_*.parquet"))
    options = ("--cells", cells, "--shear-increment", "radii", "--in-packing", "--no-figures")
    out = tmp_path / "out"
    process = command(*paths, *options, "--out", out, "--scheduler", scheduler[1])
    printed, complaints = process.communicate(timeout=120)
    assert process.returncode == 0, complaints
    assert "increments of the packing (periodic cell): solved in" in printed
    how = {"cells": cells, "shear_increment": "radii", "in_packing": True}
    run(paths, tmp_path / "alone", **how)
    assert contents(out) == contents(tmp_path / "alone")


@pytest.mark.slow
def test_paths_are_the_same_on_a_cluster(tmp_path, scheduler, workers):
    """Intervals of a series and directions of a probe, byte for byte."""
    cells = sample_path("slow/cells.csv")
    paths = sorted(cells.parent.glob("grains_*.parquet"))[:2]
    how = {"cells": cells, "shear_increment": "radii", "in_packing": "events"}
    run(paths, tmp_path / "alone", workers=1, **how)
    run(paths, tmp_path / "out", scheduler=scheduler[1], workers=None, **how)
    assert contents(tmp_path / "out") == contents(tmp_path / "alone")
    cell = (0.914723458490276, 0.0, 0.0, 0.897826511170329)
    how = {"cell": cell, "shear_increment": "radii", "directions": 4, "amplitude": 5e-6}
    run_probe(paths[0], tmp_path / "one", workers=1, figures=False, **how)
    run_probe(paths[0], tmp_path / "two", scheduler=scheduler[1], figures=False, **how)
    for name in ("probe", "orders", "loops"):
        one, two = (tmp_path / which / f"{name}.parquet" for which in ("one", "two"))
        assert one.read_bytes() == two.read_bytes()


@pytest.mark.slow
def test_directions_of_stress_are_the_same_on_a_cluster(tmp_path, scheduler, workers):
    """A jammed packing of 24 grains, loaded along four directions: byte for byte."""
    graph, state = jammed(24, 3, LAW), tmp_path / "grains.parquet"
    regime = np.full(graph.contact_count, Regime.ELASTIC, dtype=np.int8)
    write_snapshot(state, Snapshot(graph, LAW, regime, np.arange(24), 0, ()))
    how = {"directions": 4, "largest": 0.0022, "interval": 4e-5, "figures": False}
    run_sustain(state, tmp_path / "one", workers=1, **how)
    run_sustain(state, tmp_path / "two", scheduler=scheduler[1], **how)
    for name in ("sustain", "motions", "paths", "orders", "loops"):
        one, two = (tmp_path / which / f"{name}.parquet" for which in ("one", "two"))
        assert one.read_bytes() == two.read_bytes()


@pytest.mark.slow
def test_a_scheduler_lost_in_the_middle(tmp_path, scheduler, workers):
    """It is said in a line, and another runner goes on with what is finished."""
    paths, out = write_series(tmp_path / "run", 8), tmp_path / "out"
    process = command(*paths, "--out", out, "--scheduler", scheduler[1], "--no-figures")
    wait_for(lambda: times(out) or process.poll() is not None)
    scheduler[0].kill()
    _, complaints = process.communicate(timeout=120)
    assert process.returncode == 2
    assert len(complaints.splitlines()) == 1
    assert "the Dask scheduler: got a lost connection" in complaints
    before = times(out)
    run(paths, out)
    assert {name: times(out)[name] for name in before} == before
    run(paths, tmp_path / "alone")
    assert contents(out) == contents(tmp_path / "alone")


@pytest.mark.slow
@pytest.mark.usefixtures("interruptible")
def test_interrupted_on_the_cluster(tmp_path, scheduler, workers):
    """Ctrl-C gives up what has not begun; the workers stay, and the same command goes on."""
    paths, out = write_series(tmp_path / "run", 8), tmp_path / "out"
    options = ("--out", out, "--scheduler", scheduler[1], "--no-figures")
    process = command(*paths, *options)
    wait_for(lambda: times(out) or process.poll() is not None)
    process.send_signal(signal.SIGINT)
    _, complaints = process.communicate(timeout=60)
    assert process.returncode == 130
    assert complaints == (
        "grainloops: interrupted; finished snapshots are kept: the same command continues.\n"
    )
    before = times(out)
    assert len(before) < 15
    assert all(worker.poll() is None for worker in workers)
    again = command(*paths, *options)
    again.communicate(timeout=120)
    assert again.returncode == 0
    assert {name: times(out)[name] for name in before} == before
    run(paths, tmp_path / "alone")
    assert contents(out) == contents(tmp_path / "alone")


@pytest.mark.slow
def test_the_command_without_a_scheduler(tmp_path):
    """One line, no traceback, within the patience."""
    paths = write_series(tmp_path / "run", 1)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        process = command(*paths, "--out", tmp_path / "out", "--scheduler", address)
        printed, complaints = process.communicate(timeout=60)
    assert process.returncode == 2
    assert printed == ""
    assert complaints == (
        f"grainloops: --scheduler {address}: got no answer within 8 s, expected the address of a "
        "Dask scheduler, tcp://HOST:PORT. Start `dask scheduler` and `dask worker ADDRESS` first.\n"
    )


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("silent", "got no answer within 1 s"),
        ("closed", "got no answer within 1 s"),
        ("rubbish://127.0.0.1:8786", "unknown address scheme 'rubbish'"),
        ("tcp://127.0.0.1", "missing port number"),
    ],
)
def test_no_scheduler_at_the_address(monkeypatch, address, message):
    monkeypatch.setattr(cluster, "PATIENCE", 1)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        if address == "silent":
            other.listen()
        if address in ("silent", "closed"):
            address = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(InputError, match=message), cluster.connected(address, []):
            pass


class FewWorkers:
    """Stands for a client whose workers answer what is given."""

    def __init__(self, answers):
        self.answers = answers

    def wait_for_workers(self, count, timeout):
        if len(self.answers) < count:
            raise TimeoutError

    def run(self, function):
        return self.answers


@pytest.mark.parametrize(
    ("answers", "message"),
    [
        ({}, "--scheduler tcp://a:1: got a scheduler without workers"),
        ({"tcp://b:2": (None, None)}, "Dask worker tcp://b:2: got no grainloops, expected grain"),
        ({"tcp://b:2": ("0.0.1", None)}, "got grainloops 0.0.1, expected grainloops"),
        (
            {"tcp://b:2": (code_version()[:-3] + "xy)", None)},
            r"got grainloops \S+ \(code \w+xy\), expected grainloops \S+ \(code \w+\), as here",
        ),
        ({"tcp://b:2": (code_version(), "/x/y")}, "got no file /x/y, expected a file system"),
    ],
)
def test_workers_that_are_not_fit(answers, message):
    with pytest.raises(InputError, match=message):
        cluster._check_workers(FewWorkers(answers), "tcp://a:1", [])


def test_the_question_reaches_a_worker_without_grainloops(tmp_path):
    """It travels as code, and needs nothing but Python there."""
    probe = tmp_path / "probe"
    probe.write_bytes(cloudpickle.dumps(cluster._probe([str(tmp_path), "/not/there"])))
    code = (
        "import pickle, sys; sys.modules['studies'] = None; "
        f"print(pickle.load(open({str(probe)!r}, 'rb'))())"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "(None, '/not/there')"
    assert pickle.loads(probe.read_bytes())() == (code_version(), "/not/there")
