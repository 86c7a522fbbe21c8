"""Runs of a series: the dataset, restarts, bad snapshots, the choice of cells."""

import errno
import functools
import gzip
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow.parquet
import pytest

import studies
from loops import InputError
from patterns import read_snapshot, sample_cell, sample_path
from patterns.snapshots.cells import number_of
from studies.output import folder_lock
from studies.reading import PlannedSnapshot, reading, with_fingerprints
from studies.series import workers
from studies.snapshot.table import loop_columns
from tests.command import run as run_command
from tests.command import run_series

ROOT = Path(studies.__file__).resolve().parents[1]
KEPT = "id1 id2 fn fsx fsy kn ks mu sliding".split()


def write_series(folder, count, opened=15, start=0):
    """Snapshots made of the sample: it is compressed, and loses contacts from one to the next."""
    grains = pd.read_csv(sample_path())[["id", "type", "x", "y", "radius"]]
    contacts = pd.read_csv(sample_path("contacts_biaxial.csv.gz"))[KEPT]
    order = np.random.default_rng(5).permutation(len(contacts))
    folder.mkdir(exist_ok=True)
    paths = []
    for k in range(start, count):
        moved = grains.assign(x=grains.x * (1 + 0.001 * k), y=grains.y * (1 - 0.002 * k))
        paths.append(folder / f"grains_{k:02d}.csv")
        moved.to_csv(paths[-1], index=False)
        left = contacts.iloc[np.sort(order[opened * k :])]
        left.to_csv(folder / f"contacts_{k:02d}.csv", index=False)
    return tuple(paths)


def run(paths, out, **how):
    """Run a series without figures, by default in this process."""
    how = {"workers": 1, "figures": False, **how}
    return run_series(paths, out, **how)


def contents(folder):
    """Every file of a folder by its path, hidden ones too."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def times(folder):
    """When each part was written."""
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("*/part-*")}


def command(*arguments):
    """The command in a process of its own, in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "studies.cli", "series", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def digests(planned):
    return [one.fingerprint for one in with_fingerprints(planned)]


def test_parts_hold_the_tables_of_the_snapshots(paths, result):
    """Against the table of each snapshot, made apart."""
    frame = pd.read_parquet(result / "loops")
    for k, path in enumerate(paths):
        snapshot = read_snapshot(path)
        table = loop_columns(snapshot)
        own = frame[frame.snapshot == k]
        assert len(own) == len(table["loop"]) > 0
        for name in ("order", "area", "pressure", "traction_lambda_min"):
            np.testing.assert_array_equal(own[name], table[name])
        assert own.grains.iloc[0].tolist() == table["grains"][0].as_py()


def test_three_readers_read_the_datasets(result):
    """pandas from the folder; polars and DuckDB, with other Parquet readers, from its parts."""
    for name, number in (("loops", "snapshot"), ("increments", "snapshot_after")):
        parts = str(result / name / "*.parquet")
        frame = pd.read_parquet(result / name)
        counts = frame.groupby(number).size().to_dict()
        assert len(counts) == (5 if name == "loops" else 4)
        lazy = pl.scan_parquet(parts).group_by(number).len().collect()
        assert dict(lazy.iter_rows()) == counts
        rows = duckdb.sql(f"select {number}, count(*) from read_parquet('{parts}') group by all")
        assert dict(rows.fetchall()) == counts
        area = duckdb.sql(f"select sum(area) from read_parquet('{parts}')").fetchall()[0][0]
        assert area == pytest.approx(frame.area.sum(), rel=1e-12)


def test_documented_ways_of_reading(result, tmp_path, monkeypatch, capsys):
    (tmp_path / "series").symlink_to(result)
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "series.md").read_text()
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(block, {})
    assert capsys.readouterr().out.count("snapshot") == 2
    query = re.findall(r"```sql\n(.*?)```", page, re.DOTALL)[0]
    rows = duckdb.sql(query).fetchall()
    assert [row[0] for row in rows] == [1, 2, 3, 4]
    assert sum(row[2] for row in rows) == len(pd.read_parquet("series/increments"))


def test_evolution_and_exchange_belong_to_the_dataset(result):
    evolution = pd.read_parquet(result / "evolution.parquet")
    frame = pd.read_parquet(result / "loops")
    increments = pd.read_parquet(result / "increments")
    exchange = pd.read_parquet(result / "exchange.parquet")
    assert evolution.name.tolist() == [f"grains_{k:02d}.csv" for k in range(5)]
    np.testing.assert_array_equal(evolution.loops, frame.groupby("snapshot").size())
    np.testing.assert_allclose(
        evolution.mean_order, frame.groupby("snapshot").order.mean(), rtol=1e-14
    )
    survived = increments.groupby("snapshot_after").size()
    np.testing.assert_array_equal(evolution.survived[1:], survived)
    earlier = exchange[exchange.order_before > 0].groupby("snapshot_before").loops.sum()
    np.testing.assert_array_equal(earlier, evolution.loops[:-1])
    # The grains were moved by F = diag(1 + 0.001 k, 1 - 0.002 k).
    np.testing.assert_allclose(evolution.H11, [-0.001 * k for k in range(5)], atol=1e-12)
    np.testing.assert_allclose(evolution.H22, [0.002 * k for k in range(5)], atol=1e-12)
    # Contacts are taken away, some of them with walls, which the network is without.
    np.testing.assert_array_equal(evolution.opened[1:], -np.diff(evolution.contacts))
    assert (evolution.opened[1:] > 0).all() and (evolution.closed[1:] == 0).all()


def test_summary(result):
    summary = json.loads((result / "summary.json").read_text())
    evolution = pd.read_parquet(result / "evolution.parquet")
    assert list(summary) == sorted(summary)
    assert (summary["snapshots"], summary["intervals"], summary["skipped"]) == (5, 4, [])
    assert summary["loops"] == evolution.loops.sum()
    assert summary["fates"]["survived"] == evolution.survived.sum()
    assert summary["last"]["loops"] == evolution.loops.iloc[-1]


def test_parts_without_loops_have_the_same_columns(paths, tmp_path):
    """A snapshot with one contact has no loop: its parts are empty, and still of the dataset."""
    bare = write_series(tmp_path / "bare", 1)[0]
    table = pd.read_csv(tmp_path / "bare" / "contacts_00.csv")
    grain = table[table.id1 < table.id2].head(1)
    grain.to_csv(tmp_path / "bare" / "contacts_00.csv", index=False)
    out = tmp_path / "out"
    summary = run([paths[0], bare, paths[1]], out, as_given=True)
    assert summary["snapshots"] == 3
    assert pd.read_parquet(out / "evolution.parquet").loops.tolist()[1] == 0
    for name in ("loops", "increments", "fates"):
        schemas = [pyarrow.parquet.read_schema(part) for part in sorted((out / name).iterdir())]
        assert all(schema.equals(schemas[0]) for schema in schemas)
        assert (pl.scan_parquet(out / name / "*.parquet").collect().dtypes) == (
            pl.read_parquet(sorted((out / name).iterdir())[0]).dtypes
        )


def test_processes_give_the_same_bytes(paths, result, tmp_path):
    run(paths, tmp_path / "out", workers=2)
    assert contents(tmp_path / "out") == contents(result)


def test_one_snapshot_is_a_series_too(paths, tmp_path):
    summary = run(paths[:1], tmp_path / "out", csv=True)
    assert (summary["snapshots"], summary["intervals"]) == (1, 0)
    assert len(pd.read_csv(tmp_path / "out" / "loops.csv")) == summary["loops"]


def test_csv_holds_what_the_dataset_holds(paths, tmp_path):
    run(paths[:2], tmp_path / "out", csv=True)
    for name in ("loops", "increments"):
        frame = pd.read_parquet(tmp_path / "out" / name)
        csv = pd.read_csv(tmp_path / "out" / f"{name}.csv")
        numbers = frame.select_dtypes("number").columns
        np.testing.assert_allclose(csv[numbers], frame[numbers], rtol=1e-15)
    text = pd.read_csv(tmp_path / "out" / "loops.csv").grains[0]
    assert text == " ".join(map(str, pd.read_parquet(tmp_path / "out" / "loops").grains[0]))


def wait_for(condition, seconds=60):
    """Wait until something has happened; far beyond its usual time."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def stop_in_the_middle(folder, paths, how, workers):
    """A command that sends itself a signal when its first task is done; what it said."""
    options = ("--out", folder, "--workers", workers, "--no-figures")
    code = f"""
import os, signal, sys
from rich.progress import Progress
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    Progress.update = lambda *_, **__: {how}
    sys.argv = {["grainloops", "series", *map(str, paths), *map(str, options)]!r}
    from studies.cli import main
    main()
"""
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True,
    )  # fmt: skip
    return process, process.communicate(timeout=300)


def children_of(pid):
    """Processes whose session this one leads."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            state, session = (folder / "stat").read_text().rpartition(") ")[2].split()[0:4:3]
        except OSError:
            continue
        if int(session) == pid and state != "Z":
            found.append(folder.name)
    return found


@pytest.mark.parametrize("workers", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_killed_and_started_again(paths, result, tmp_path, workers):
    """What was finished stays as it was, the rest is the same as without the accident."""
    out = tmp_path / "out"
    process, _ = stop_in_the_middle(out, paths, "os.kill(os.getpid(), signal.SIGKILL)", workers)
    assert process.returncode == -signal.SIGKILL
    before = times(out)
    assert 0 < len(before) < 9
    assert not (out / "summary.json").exists()
    if Path("/proc").is_dir():
        wait_for(lambda: not children_of(process.pid))
    (out / "loops" / ".unfinished-0").write_bytes(b"half of a part")
    (out / ".unfinished").mkdir()
    run(paths, out)
    after = times(out)
    assert {name: after[name] for name in before} == before
    assert contents(out) == contents(result)


@pytest.mark.slow
def test_interrupted(paths, result, tmp_path):
    """Ctrl-C, as a terminal sends it: to the whole group of processes."""
    out = tmp_path / "out"
    process, (_, text) = stop_in_the_middle(out, paths, "os.killpg(0, signal.SIGINT)", workers=2)
    assert process.returncode == 130
    assert text == (
        "grainloops: interrupted; finished snapshots are kept: the same command continues.\n"
    )
    run(paths, out)
    assert contents(out) == contents(result)


def test_only_what_changed_is_done_again(tmp_path):
    """A snapshot exported again: its part and its two pairs are new, and no other."""
    paths, out = write_series(tmp_path / "run", 4), tmp_path / "out"
    run(paths, out)
    before = times(out)
    lines = (tmp_path / "run" / "contacts_01.csv").read_text().splitlines()
    (tmp_path / "run" / "contacts_01.csv").write_text("\n".join(lines[:-9]) + "\n")
    run(paths, out)
    after = times(out)
    assert {name for name in after if after[name] != before[name]} == {
        "part-00001.parquet",
        "part-00000-00001.parquet",
        "part-00001-00002.parquet",
    }


@pytest.mark.slow
def test_what_was_gathered_before_goes_with_its_snapshots(tmp_path):
    """Tables and figures of the shorter series don't stay beside the longer one's."""
    paths, out = write_series(tmp_path / "run", 3), tmp_path / "out"
    run(paths[:2], out, csv=True, figures=True)
    files = {"loops.csv", "orders_over_strain.png", "work_map.png", "report.html"}
    listed = json.loads((out / "summary.json").read_text())["files"]
    assert files <= set(listed)
    assert "traction_free_W2" in (out / "report.html").read_text()
    assert {path.name for path in out.iterdir()} == {
        *listed,
        *("series.json", "summary.json", "loops", "increments", "fates"),
    }
    run(paths, out)
    again = json.loads((out / "summary.json").read_text())
    left = {path.name for path in out.iterdir() if path.is_file()}
    assert left == {"series.json", "summary.json", *again["files"]}
    assert {path.rpartition(".")[2] for path in left} == {"json", "parquet"}


def test_a_full_disk_is_no_bad_snapshot(tmp_path, paths, monkeypatch):
    """It ends the run even with skip_bad, and leaves nothing half-written."""

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pyarrow.parquet.write_table", full)
    with pytest.raises(InputError, match="No space left on device, expected a place") as error:
        run(paths[:2], tmp_path / "out", skip_bad=True)
    assert "--skip-bad" not in str(error.value)
    assert set(contents(tmp_path / "out")) == set()


@pytest.mark.slow
def test_snapshots_may_follow(tmp_path, paths, result):
    out = tmp_path / "out"
    run(paths[:3], out)
    before = times(out)
    run(paths, out)
    after = times(out)
    assert {name: after[name] for name in before} == before
    assert contents(out) == contents(result)


def test_another_series_is_refused(tmp_path, paths):
    out = tmp_path / "out"
    run(paths[:2], out)
    before = contents(out)
    for others, how in ((paths[:2], {"kn": 2.0}), (paths[1:3], {}), (paths[:1], {})):
        with pytest.raises(InputError, match="another series"):
            run(others, out, **how)
    assert contents(out) == before
    run(paths[1:2], out, force=True)
    assert set(times(out)) == {"part-00000.parquet"}


def test_a_run_that_could_not_begin_leaves_nothing(tmp_path):
    bad = tmp_path / "grains_00.csv"
    bad.write_text("id,x\n")
    (tmp_path / "contacts_00.csv").write_text("id1,id2\n")
    out = tmp_path / "out"
    with pytest.raises(InputError, match="grains_00"):
        run([bad], out)
    assert not out.exists()
    # A folder that was there stays.
    out.mkdir()
    with pytest.raises(InputError, match="grains_00"):
        run([bad], out)
    assert out.exists()


def test_a_folder_of_other_files_is_refused(tmp_path, paths):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("x")
    with pytest.raises(InputError, match="holds other files"):
        run(paths[:1], tmp_path / "out")
    with pytest.raises(InputError, match="got a file, expected a folder"):
        run(paths[:1], tmp_path / "out" / "thesis.tex")
    assert contents(tmp_path / "out") == {"thesis.tex": b"x"}
    run(paths[:1], tmp_path / "out", force=True)
    assert (tmp_path / "out" / "thesis.tex").read_text() == "x"


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_bad_snapshot_among_good_ones(tmp_path, workers):
    """It is named; what is finished stays; once it is mended nothing shows of it."""
    paths, out = write_series(tmp_path / "run", 3), tmp_path / "out"
    run(paths, tmp_path / "whole")
    good = paths[1].read_text()
    changed = paths[1].stat()
    paths[1].write_text(good[:-9])
    with pytest.raises(InputError, match=r"snapshot 1 \(grains_01.csv\).*last line") as error:
        run(paths, out, workers=workers)
    assert "--skip-bad" in str(error.value)
    assert not (out / "summary.json").exists()
    summary = run(paths, out, workers=workers, skip_bad=True)
    assert [(one["snapshot"], one["name"]) for one in summary["skipped"]] == [(1, "grains_01.csv")]
    parts = {"part-00000.parquet", "part-00002.parquet", "part-00000-00002.parquet"}
    assert set(times(out)) == parts
    assert pd.read_parquet(out / "evolution.parquet").snapshot.tolist() == [0, 2]
    paths[1].write_text(good)
    os.utime(paths[1], ns=(changed.st_atime_ns, changed.st_mtime_ns))
    run(paths, out)
    assert contents(out) == contents(tmp_path / "whole")


def test_nothing_but_bad_snapshots(tmp_path):
    paths = write_series(tmp_path / "run", 2)
    for path in paths:
        path.write_text("id,x,y\n")
    with pytest.raises(InputError, match=r"grains_00\.csv"):
        run(paths, tmp_path / "out", skip_bad=True)


def test_snapshots_with_and_without_forces_are_two_series(tmp_path):
    paths = write_series(tmp_path / "run", 2)
    bare = pd.read_csv(tmp_path / "run" / "contacts_01.csv")[["id1", "id2"]]
    bare.to_csv(tmp_path / "run" / "contacts_01.csv", index=False)
    with pytest.raises(InputError, match="with forces and without"):
        run(paths, tmp_path / "out")
    summary = run(paths[1:], tmp_path / "bare")
    assert "S11" not in summary["last"]


def test_the_command(paths, result, tmp_path, capsys):
    """Prints JSON alone when asked; one line on stderr and status 2 for bad input."""
    options = ("--workers", 1, "--no-figures", "--out")
    shutil.copytree(result, tmp_path / "out")
    assert run_command("series", *paths, *options, tmp_path / "out", "--json") == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out) == json.loads((result / "summary.json").read_text())
    assert printed.err == ""
    assert contents(tmp_path / "out") == contents(result)
    assert run_command("series", *paths[::-1], *options, tmp_path / "out", "--as-given") == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1 and "another series (other snapshots)" in printed.err
    bad = tmp_path / "grains_77.csv"
    bad.write_text("id,x\n")
    given = (bad, *paths[:2], *options, tmp_path / "o")
    assert run_command("series", *given, "--skip-bad", "--cell=1,2") == 2
    assert run_command("series", *given, "--skip-bad") == 0
    assert "skipped: snapshot 2 (grains_77.csv)" in capsys.readouterr().out


@pytest.mark.slow
def test_a_worker_that_ends_by_itself():
    """As the system ends a process when the memory is used up."""
    with (
        pytest.raises(InputError, match="smaller --workers"),
        workers.open_runner(2, None, []) as runner,
    ):
        list(runner(os._exit, [1]))


class Pressed:
    """A pool for which Ctrl-C is pressed while its processes start."""

    def __init__(self, pool):
        self.pool = pool

    def submit(self, function, task):
        os.kill(os.getpid(), signal.SIGINT)
        return self.pool.submit(function, task)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_is_not_lost_while_processes_start():
    with pytest.raises(KeyboardInterrupt), workers.processes(1) as pool:
        list(workers.run_in_processes(Pressed(pool), abs, [1]))
    # The processes hold it back for good, the main process does not.
    held = functools.partial(signal.pthread_sigmask, signal.SIG_BLOCK)
    with workers.processes(1) as pool:
        ((_, found),) = workers.run_in_processes(pool, held, [()])
    assert signal.SIGINT in found and signal.SIGINT not in held(())


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"workers": 0}, "--workers: got 0, expected at least 1"),
        ({"workers": 2, "scheduler": "tcp://127.0.0.1:1"}, "--workers, --scheduler: got both"),
        ({"cell": (1, 0, 0, 1), "cells": Path("cells.csv")}, "--cell, --cells: got both"),
        ({"format": "rubbish"}, "--format: got 'rubbish'"),
        ({"in_packing": "events", "mean_mass": -1.0}, "--mean-mass: got -1.0, expected a finite"),
        ({"probe": 0}, "--probe: got 0, expected a whole number"),
        (
            {"in_packing": "events", "times": Path("nothere.csv")},
            "--times nothere.csv: got no such file, expected a table with the columns snap, time",
        ),
        ({"cells": Path("nothere.csv")}, "--cells nothere.csv: got no such file, expected a table"),
    ],
)
def test_bad_options(paths, tmp_path, how, message):
    with pytest.raises(InputError, match=message):
        run(paths[:2], tmp_path / "out", **how)


def test_bad_paths(paths, tmp_path):
    for given, message in (
        ((), "PATHS: got none"),
        ((paths[0], paths[1], paths[0]), "grains_00.csv twice"),
        ((paths[0], tmp_path), "got a folder"),
        ((tmp_path / "grains_99.csv",), "no such file"),
    ):
        with pytest.raises(InputError, match=message):
            run(given, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def write_cells(path, rows):
    """A table of cells as a DEM code writes it beside its snapshots, other columns among them."""
    names = ("h_xx", "h_xy", "h_yx", "h_yy")
    table = [
        {"snap": snap, "eps": 0.0} | dict(zip(names, np.ravel(cell), strict=True))
        for snap, cell in rows
    ]
    pd.DataFrame(table).to_csv(path, index=False)
    return path


@pytest.fixture
def periodic(tmp_path):
    """The periodic sample under two numbers, and deformed as a whole at the second."""
    grains = pd.read_parquet(sample_path("grains_periodic.parquet"))
    contacts = pd.read_parquet(sample_path("contacts_periodic.parquet"))
    F = np.array([[1.0, 0.01], [0.0, 0.98]])
    kept = [*KEPT, "cell_dx", "cell_dy"]
    for k, turn in ((3, np.eye(2)), (14, F)):
        x = grains[["x", "y"]].to_numpy() @ turn.T
        moved = grains[["id", "radius"]].assign(x=x[:, 0], y=x[:, 1])
        moved.to_parquet(tmp_path / f"grains_{k:02d}.parquet")
        contacts[kept].to_parquet(tmp_path / f"contacts_{k:02d}.parquet")
    paths = [tmp_path / "grains_03.parquet", tmp_path / "grains_14.parquet"]
    return paths, [(3, sample_cell()), (7, np.eye(2)), (14, F @ sample_cell())], F


@pytest.mark.slow
def test_cells_by_the_numbers_of_the_files(periodic, tmp_path):
    paths, rows, F = periodic
    cells = write_cells(tmp_path / "macro.csv", rows)
    summary = run(paths, tmp_path / "out", cells=cells)
    assert summary["last"]["strain_from"] == "cell"
    H = [summary["last"][f"H{ij}"] for ij in ("11", "12", "21", "22")]
    np.testing.assert_allclose(H, (np.eye(2) - F).ravel(), atol=1e-14)
    assert summary["fates"]["survived"] == summary["first"]["loops"] == summary["last"]["loops"]
    with pytest.raises(InputError, match=r"no row with snap = 14, for grains_14.parquet"):
        run(paths, tmp_path / "o", cells=write_cells(tmp_path / "short.csv", rows[:2]))
    with pytest.raises(InputError, match="3 twice"):
        run(paths, tmp_path / "o", cells=write_cells(tmp_path / "twice.csv", [*rows, rows[0]]))
    with pytest.raises(InputError, match="no such file"):
        run(paths, tmp_path / "o", cells=tmp_path / "none.csv")


def test_a_name_without_a_number_has_no_cell(periodic, tmp_path):
    _, rows, _ = periodic
    for what in ("grains", "contacts"):
        (tmp_path / f"{what}_03.parquet").rename(tmp_path / f"{what}.parquet")
    cells = write_cells(tmp_path / "macro.csv", rows)
    with pytest.raises(InputError, match="no number in it"):
        run([tmp_path / "grains.parquet"], tmp_path / "out", cells=cells)


def test_every_frame_of_a_file_is_a_snapshot(tmp_path):
    """A dump of three frames, made of the sample's one; each task reads its own."""
    for what in ("atoms", "contacts"):
        one = gzip.decompress(sample_path(f"lammps/dump.{what}.0.gz").read_bytes())
        frames = [
            one.replace(b"ITEM: TIMESTEP\n0\n", b"ITEM: TIMESTEP\n%d\n" % k) for k in (0, 5, 9)
        ]
        (tmp_path / f"dump.{what}").write_bytes(b"".join(frames))
    summary = run([tmp_path / "dump.atoms"], tmp_path / "out", kn=1e6, kt=5e5, mu=0.3)
    evolution = pd.read_parquet(tmp_path / "out" / "evolution.parquet")
    assert evolution.name.tolist() == [f"dump.atoms, frame {k}" for k in range(3)]
    assert evolution.step.tolist() == [0, 5, 9]
    assert summary["fates"]["survived"] == 2 * summary["first"]["loops"] > 0
    assert pd.read_parquet(tmp_path / "out" / "loops").groupby(
        "snapshot"
    ).step.first().tolist() == [0, 5, 9]


@pytest.mark.parametrize(
    ("name", "beside"),
    [
        ("grains_05.csv.gz", ["contacts_05.csv.gz", "cell_05.json"]),
        ("dump.atoms.40000", ["dump.contacts.40000.gz", "dump.local.40000"]),
        ("atoms.0.dump", ["contacts.0.dump"]),
        ("box.data", ["box.fstat"]),
    ],
)
def test_a_change_of_any_file_of_a_snapshot_shows(tmp_path, name, beside):
    """In the fingerprint of this snapshot; files of others don't matter to it."""
    planned = [PlannedSnapshot(0, tmp_path / name, reading())]
    for file in (name, *beside):
        (tmp_path / file).write_text("1")
    seen = digests(planned)
    for file in (name, *beside):
        (tmp_path / file).write_text("22" + file)
        seen += digests(planned)
    assert len(set(seen)) == len(beside) + 2
    for file in ("grains_06.csv", "dump.atoms.50000", "atoms.1.dump", "macro.csv", "log.lammps"):
        (tmp_path / file).write_text("1")
    assert digests(planned) == seen[-1:]


def test_the_number_of_a_snapshot(tmp_path):
    """Of a file of several frames, the number is the frame's."""
    assert number_of(tmp_path / "dump.12", frame=7) == 7
    assert number_of(tmp_path / "run2" / "grains_05.h5") == 5
    assert number_of(tmp_path / "grains.12.csv.gz") == 12
    assert number_of(tmp_path / "dump.atoms.40000") == 40000


def test_two_runs_of_one_series_at_once(paths, result):
    before = contents(result)
    with folder_lock(result), pytest.raises(InputError, match="another run writes to"):
        run(paths, result)
    assert contents(result) == before
