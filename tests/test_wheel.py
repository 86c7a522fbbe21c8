"""The sdist and its wheel, installed apart from the checkout under each Python of `.ci/pythons`.

The libraries of another Python than this one come from the index.
"""

import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest

from tests.tools.mutation.__main__ import ROOT, copied

BUILD = "import setuptools.build_meta as back, sys; print(getattr(back, sys.argv[1])(sys.argv[2]))"
VERSION = ("-m", "setuptools_scm")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PYTHONS = (ROOT / ".ci" / "pythons").read_text().split()
OWN = "{}.{}".format(*sys.version_info[:2])


def called(*arguments, cwd, path=None, python=sys.executable):
    """What a Python did; nothing of the checkout is on its path."""
    environment = {**os.environ, "PYTHONPATH": str(path) if path else ""}
    command = [str(python), *map(str, arguments)]
    how = {"cwd": cwd, "env": environment, "capture_output": True, "text": True}
    return subprocess.run(command, check=False, **how)


def output(*arguments, **how):
    """Output of a call that succeeds."""
    done = called(*arguments, **how)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def interpreter(version):
    """A Python of that version which runs, on the path or among pyenv's; None without one."""
    installed = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    places = [shutil.which(f"python{version}"), *installed.glob(f"{version}.*/bin/python{version}")]
    runs = (p for p in places if p and called("--version", cwd="/", python=p).returncode == 0)
    return next(runs, None)


def git(*arguments, cwd):
    who = ("-c", "user.name=a", "-c", "user.email=a@example.org")
    subprocess.run(["git", *who, *arguments], cwd=cwd, check=True, capture_output=True)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of the unpacked sdist of the files that git tracks, without git."""
    folder = tmp_path_factory.mktemp("built")
    checkout = copied(folder / "checkout")
    said = output("-c", BUILD, "build_sdist", folder, cwd=checkout)
    packed = folder / said.splitlines()[-1]
    with tarfile.open(packed) as archive:
        archive.extractall(folder, filter="data")
    unpacked = folder / packed.name.removesuffix(".tar.gz")
    said = output("-c", BUILD, "build_wheel", folder, cwd=unpacked)
    return folder / said.splitlines()[-1]


def test_the_version_is_that_of_the_tag(tmp_path):
    """Without git the stated one, without a tag one after it, with a tag the tag's."""
    stated = PROJECT["tool"]["setuptools_scm"]["fallback_version"]
    for name in ("pyproject.toml", ".git_archival.txt", ".gitattributes"):
        shutil.copy(ROOT / name, tmp_path / name)
    assert output(*VERSION, cwd=tmp_path) == stated
    git("init", "--quiet", ".", cwd=tmp_path)
    git("add", ".", cwd=tmp_path)
    git("commit", "--quiet", "-m", "first", cwd=tmp_path)
    assert output(*VERSION, cwd=tmp_path).startswith("0.1.1.dev1+g")
    git("tag", "v0.3.0", cwd=tmp_path)
    assert output(*VERSION, cwd=tmp_path) == "0.3.0"
    git("archive", "--prefix=archive/", "-o", "archive.tar", "HEAD", cwd=tmp_path)
    with tarfile.open(tmp_path / "archive.tar") as archive:
        archive.extractall(tmp_path.parent / "apart", filter="data")
    apart = tmp_path.parent / "apart" / "archive"
    assert output(*VERSION, cwd=apart) == "0.3.0"


@pytest.mark.parametrize("version", PYTHONS)
def test_the_wheel_works_without_the_checkout(tmp_path, wheel, version):
    site, python = tmp_path / "site", sys.executable
    if version == OWN:
        # The libraries are those of this environment.
        pip = ("-m", "pip", "install", "--quiet", "--no-deps", "--target")
        output(*pip, site, wheel, cwd=tmp_path)
    else:
        found = interpreter(version)
        if found is None:
            pytest.skip(f"no python{version} on this machine")
        output("-m", "venv", tmp_path / "venv", cwd=tmp_path, python=found)
        python = tmp_path / "venv" / "bin" / "python"
        pip = ("-m", "pip", "install", "--quiet", "--no-compile")
        done = called(*pip, wheel, cwd=tmp_path, python=python)
        if "connection broken" in done.stderr:
            pytest.skip("the index is out of reach")
        assert done.returncode == 0, done.stderr
        where = "import studies; print(studies.__path__[0])"
        site = Path(output("-c", where, cwd=tmp_path, python=python)).parent
    how = {"cwd": tmp_path, "path": site, "python": python}
    assert not (site / "tests").exists() and not (site / "studies" / "examples").exists()
    where = "import studies; print(studies.__file__)"
    assert Path(output("-c", where, **how)).is_relative_to(site)
    assert output("-m", "studies.cli", "--version", **how).split()[1] == wheel.name.split("-")[1]
    sample = site / "patterns/snapshots/sample/grains_biaxial.csv.gz"
    output("-m", "studies.cli", "snapshot", sample, "--out", "a", **how)
    assert (tmp_path / "a" / "report.html").exists()
    done = called("-m", "studies.cli", "bench", "--out", "b", **how)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "checkout" in done.stderr
