"""When kernels are loaded, and where their code is kept."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from loops.compiled import LARGE, use_compiled
from loops.compiled.kernel import given

ROOT = Path(__file__).resolve().parents[2]
SMALL = """
import sys
from loops import find_crossings, find_faces
from patterns import synthetic_network
graph = synthetic_network(100)
find_faces(graph), find_crossings(graph)
assert "numba" not in sys.modules
find_faces(graph, compiled=True)
assert "numba" in sys.modules
"""
# A place that cannot be written: numba then finds none at all.
NO_CACHE = """
from numba.core.caching import CacheImpl
CacheImpl._locator_classes = []
from loops import find_faces
from patterns import synthetic_network
graph = synthetic_network(100)
assert len(find_faces(graph, compiled=True).loops) == len(find_faces(graph).loops)
"""


@pytest.mark.parametrize("script", [SMALL, pytest.param(NO_CACHE, marks=pytest.mark.slow)])
def test_in_a_process_of_its_own(script):
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr


def test_a_place_that_cannot_be_written_costs_the_cache_alone(monkeypatch):
    from numba.core import caching

    from loops.compiled.kernel import kernel

    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    assert kernel(lambda a: a + 1)(1) == 2


def test_the_choice_is_by_size_unless_it_is_told():
    assert not use_compiled(None, LARGE - 1)
    assert use_compiled(None, LARGE)
    assert use_compiled(True, 1)
    assert not use_compiled(False, 10 * LARGE)


def test_inputs_are_views_where_they_can_be():
    values = np.arange(6.0)
    view = given(values, np.float64)
    assert np.shares_memory(view, values)
    assert not view.flags.writeable
    assert values.flags.writeable
    assert given(values[::2], np.float64).flags.c_contiguous
