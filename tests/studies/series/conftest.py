"""One series of the sample for all tests of its files."""

import pytest

from tests.command import run
from tests.studies.series.test_run import write_series


@pytest.fixture(scope="session")
def paths(tmp_path_factory):
    return write_series(tmp_path_factory.mktemp("snapshots") / "run", 5)


@pytest.fixture(scope="session")
def result(paths, tmp_path_factory):
    """The whole series in one go, by the command in this process."""
    out = tmp_path_factory.mktemp("results") / "series"
    assert run("series", *paths, "--workers", 1, "--no-figures", "--out", out) == 0
    return out
