"""One setting for every property test: the same examples on each run, no clock."""

import gc
import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import settings

# Figures are drawn to files, with or without a screen.
os.environ.setdefault("MPLBACKEND", "Agg")

# Markers of tests on data that are not part of the project, and what names their folder.
FOLDERS = {"collection": "GRAINLOOPS_DEM", "published": "GRAINLOOPS_PUBLISHED"}
# Functions, and cases of others, that are slow besides those marked so in their files.
SLOW = frozenset(Path(__file__).with_name("slow.txt").read_text(encoding="utf-8").splitlines())


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark what is slow by the list; tests that need a folder are, and skipped without it."""
    for item in items:
        if item.nodeid in SLOW or item.nodeid.split("[")[0] in SLOW:
            item.add_marker("slow")
        for name in (name for name in FOLDERS if item.get_closest_marker(name)):
            item.add_marker("slow")
            if not Path(os.environ.get(FOLDERS[name]) or "none").is_dir():
                item.add_marker(pytest.mark.skip(reason=f"{FOLDERS[name]} names no folder"))


def pytest_collection_finish():
    """Modules and collected tests stay: no collection of garbage looks at them again."""
    gc.freeze()


settings.register_profile("grainloops", derandomize=True, deadline=None)
settings.load_profile("grainloops")


@pytest.fixture
def unsaved(monkeypatch):
    """Figures are made, not drawn or saved: for tests of names."""
    from tests.unsaved import leave_files_empty

    leave_files_empty(monkeypatch)


@pytest.fixture
def interruptible():
    """Ctrl-C raises here, also where a shell runs the tests in the background and ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def undrawn(monkeypatch):
    """Studies without figures, where a test is about the rest."""
    leave_undrawn(monkeypatch)


def leave_undrawn(patch):
    """No study draws a figure."""
    patch.setattr("studies.study.Results.save_figures", lambda *_: [])


@pytest.fixture(autouse=True)
def closed_figures():
    """Each test begins without a current figure of pyplot, as a cell of a notebook does."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")
