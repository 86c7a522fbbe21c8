"""Damaged files of every format: a snapshot or one clear line, no crash, no hang, nothing left."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from loops import InputError
from patterns import read_snapshot
from tests.tools.fuzz import trial
from tests.tools.fuzz.samples import write_samples

ROOT = Path(__file__).parents[2]


def run(out, inputs):
    command = [sys.executable, "-m", "tests.tools.fuzz", "--out", str(out), "--inputs", str(inputs)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads((out / "summary.json").read_text())


def test_a_few_of_each_format(tmp_path):
    summary = run(tmp_path / "out", 2)
    assert summary["bad"] == []
    assert len(summary["formats"]) == 9
    found = {name for counts in summary["formats"].values() for name in counts}
    assert "clear error" in found


@pytest.mark.slow
def test_many_of_each_format(tmp_path):
    assert run(tmp_path / "out", 500)["bad"] == []


def test_healthy_samples_are_read(tmp_path):
    samples = write_samples(tmp_path)
    trial.warm_up(samples)
    counts = {one.name: read_snapshot(one.path, **one.options).graph for one in samples}
    assert counts["csv"].contact_count == counts["h5"].contact_count == 819
    dump = read_snapshot(next(one.path for one in samples if one.name == "lammps"))
    with pytest.raises(InputError, match="kn"):
        dump.mechanics()
