"""The sdist and its wheel, installed apart from the checkout; setuptools comes from the index."""

import os
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from tests.tools.mutation.__main__ import copied

BUILD = "import setuptools.build_meta as back, sys; print(getattr(back, sys.argv[1])(sys.argv[2]))"


def called(*arguments, cwd, path=None):
    """Output of Python; nothing of the checkout is on its path."""
    environment = {**os.environ, "PYTHONPATH": str(path) if path else ""}
    command = [sys.executable, *map(str, arguments)]
    how = {"cwd": cwd, "env": environment, "capture_output": True, "text": True}
    return subprocess.run(command, check=False, **how)


def built(kind, source, out, tools):
    """Path of what setuptools makes of a folder."""
    done = called("-c", BUILD, kind, out, cwd=source, path=tools)
    assert done.returncode == 0, done.stderr
    return out / done.stdout.splitlines()[-1]


@pytest.mark.slow
def test_the_wheel_of_the_sdist_works_without_the_checkout(tmp_path):
    tools, site, out = (tmp_path / name for name in ("tools", "site", "out"))
    out.mkdir()
    pip = ("-m", "pip", "install", "--quiet", "--no-deps", "--target")
    assert called(*pip, tools, "setuptools>=77", cwd=tmp_path).returncode == 0
    packed = built("build_sdist", copied(tmp_path / "checkout"), out, tools)
    with tarfile.open(packed) as archive:
        archive.extractall(tmp_path, filter="data")
    wheel = built("build_wheel", tmp_path / packed.name.removesuffix(".tar.gz"), out, tools)
    assert called(*pip, site, wheel, cwd=tmp_path).returncode == 0
    assert not (site / "tests").exists() and not (site / "studies" / "examples").exists()
    where = "import studies; print(studies.__file__)"
    assert Path(called("-c", where, cwd=tmp_path, path=site).stdout).is_relative_to(site)
    sample = site / "patterns/snapshots/sample/grains_biaxial.csv.gz"
    done = called("-m", "studies.cli", "snapshot", sample, "--out", "a", cwd=tmp_path, path=site)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a" / "report.html").exists()
    done = called("-m", "studies.cli", "bench", "--out", "b", cwd=tmp_path, path=site)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "checkout" in done.stderr
