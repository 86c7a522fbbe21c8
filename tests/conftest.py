"""One setting for every property test: the same examples on each run, no clock."""

import os

import pytest
from hypothesis import settings

# Figures are drawn to files, with or without a screen.
os.environ.setdefault("MPLBACKEND", "Agg")

settings.register_profile("grainloops", derandomize=True, deadline=None)
settings.load_profile("grainloops")


@pytest.fixture
def unsaved(monkeypatch):
    """Figures are drawn, their files stay empty: for tests of names."""
    from tests.unsaved import leave_files_empty

    leave_files_empty(monkeypatch)


@pytest.fixture
def undrawn(monkeypatch):
    """Studies of paths without figures, where a test is about the rest."""
    leave_undrawn(monkeypatch)


def leave_undrawn(patch):
    """No figure of a study of paths."""
    for name in ("diamond_figures.diamond_figures", "figures.polygon_figures"):
        patch.setattr(f"studies.paths.{name}", lambda *_: iter(()))
    patch.setattr("studies.paths.figures.comparison_figures", lambda *_: iter(()))
