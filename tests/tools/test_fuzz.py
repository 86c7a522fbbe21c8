"""Damaged files of every format: a snapshot or one clear line, no crash, no hang, nothing left."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

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
