"""Damaged files of every format: a snapshot or one clear line, no crash, no hang, nothing left."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from loops import InputError
from patterns import read_snapshot
from tests.tools.fuzz import trial
from tests.tools.fuzz.damage import damaged
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


def test_damage_differs_and_repeats():
    content = bytes(range(256)) * 4
    hurt = {damaged(np.random.default_rng(seed), content) for seed in range(50)}
    assert len(hurt) > 45
    assert damaged(np.random.default_rng(3), content) == damaged(np.random.default_rng(3), content)
    assert damaged(np.random.default_rng(3), b"") is not None


FAULTS = {
    "raise ValueError('no')": "exception",
    "raise InputError('a', 'b', 'd', 'e')": "clear error",
    "os.abort()": "crash",
    "time.sleep(60)": "hang",
    "pass": "snapshot",
}


def test_each_outcome_is_seen(tmp_path):
    """A reader with a fault of each kind, in a process of its own: the fuzzer forks."""
    script = (
        "import os, sys, time; from pathlib import Path; from loops import InputError\n"
        "from tests.tools.fuzz import trial; from tests.tools.fuzz.samples import Sample\n"
        "sample = Sample('csv', Path(sys.argv[1]) / 'grains_1.csv', {})\n"
        "sample.path.write_text('id')\n"
        "for fault in sys.argv[2:]:\n"
        "    trial.SECONDS = 0.5 if 'sleep' in fault else 60.0\n"
        "    trial.read_snapshot = lambda path, **_: exec(fault)\n"
        "    print(trial.try_one(sample, 0, whole=False)[0], flush=True)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path), *FAULTS],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == list(FAULTS.values())


def test_healthy_samples_are_read(tmp_path):
    samples = write_samples(tmp_path)
    trial.warm_up(samples)
    counts = {one.name: read_snapshot(one.path, **one.options).graph for one in samples}
    assert counts["csv"].contact_count == counts["h5"].contact_count == 819
    dump = read_snapshot(next(one.path for one in samples if one.name == "lammps"))
    with pytest.raises(InputError, match="kn"):
        dump.mechanics()
