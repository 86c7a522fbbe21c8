"""One table of cells serves every command that reads periodic snapshots."""

import json
import shutil

import numpy as np
import pytest

import grainloops as gl
from loops import InputError
from patterns import sample_path, synthetic_network
from tests import command
from tests.patterns.dump_writers import Packing, write_lammps

CELLS = sample_path("slow/cells.csv")
GRAINS = sample_path("slow/grains_10.parquet")
CELL = "0.914723458490276,0,0,0.897826511170329"  # the row of snapshot 10


@pytest.fixture
def run(capsys):
    return lambda *words: (command.run(*words), "".join(capsys.readouterr()))


@pytest.mark.parametrize(
    "command",
    [
        ("snapshot", GRAINS, "--no-figures"),
        pytest.param(
            ("probe", GRAINS, "--directions", "4", "--no-figures"), marks=pytest.mark.slow
        ),
        pytest.param(
            ("polygon", "--snapshot", GRAINS, "--loop", "3", "--end", "1e-5"),
            marks=pytest.mark.slow,
        ),
        ("check", GRAINS),
    ],
    ids=lambda command: command[0],
)
def test_a_table_of_cells_is_the_cell_of_its_row(run, tmp_path, command):
    for name, given in (("table", ("--cells", CELLS)), ("cell", ("--cell", CELL))):
        status, said = run(*command, *given, "--out", tmp_path / name)
        assert status == 0, said
    table, cell = (
        json.loads((tmp_path / name / "summary.json").read_text()) for name in ("table", "cell")
    )
    for summary in (table, cell):
        summary.pop("provenance")
    assert table == cell


@pytest.mark.parametrize("command", ["snapshot", "probe", "check"])
def test_a_missing_row_and_both_options_are_told(run, tmp_path, command):
    for ending in ("grains", "contacts"):
        shutil.copy(sample_path(f"slow/{ending}_10.parquet"), tmp_path / f"{ending}_77.parquet")
    status, said = run(command, tmp_path / "grains_77.parquet", "--cells", CELLS)
    assert status == 2 and "no row with snap = 77, for grains_77.parquet" in said
    status, said = run(command, GRAINS, "--cells", CELLS, "--cell", CELL)
    assert status == 2 and "--cell, --cells: got both" in said


def test_check_takes_the_cell_of_each_snapshot_of_a_file(run, tmp_path):
    """Two frames of one dump: the row of the second is no cell of its grains."""
    graph = synthetic_network(60, seed=1, periodic=True, jitter=0.1)
    cell, force = graph.cell, np.ones(graph.contact_count)
    packing = Packing(graph.replace(normal_force=force), np.arange(graph.grain_count))
    for step in (0, 1):
        path, _ = write_lammps(tmp_path, packing, step)
    table = tmp_path / "cells.csv"
    rows = [f"{k},{','.join(map(repr, (scale * cell).ravel().tolist()))}"
            for k, scale in ((0, 1.0), (1, 1.02))]  # fmt: skip
    table.write_text("\n".join(["snap,h_xx,h_xy,h_yx,h_yy", *rows, ""]))
    status, said = run("check", path, "--cells", table)
    assert status == 2 and f"{path}, snapshot 0" in said
    assert "1 snapshot:" in said and "snapshot 1" not in said


def test_python_reads_the_cell_of_a_table():
    one = gl.read_snapshot(GRAINS, cells=CELLS)
    (same,) = gl.read_frames(GRAINS, cells=str(CELLS))
    for found in (one, same):
        assert found.graph.cell.ravel().tolist() == [float(value) for value in CELL.split(",")]
    with pytest.raises(InputError, match="--cell, --cells: got both"):
        gl.read_snapshot(GRAINS, cells=CELLS, cell=np.eye(2))
    with pytest.raises(InputError, match="no row with snap = 0"):
        gl.read_snapshot(GRAINS, cells=CELLS, frame=0)
