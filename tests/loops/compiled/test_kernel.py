"""When kernels are loaded, and where their code is kept."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from loops.compiled import COMPILED_FROM, given, use_compiled

ROOT = Path(__file__).resolve().parents[3]
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

COMPARED = """
import numpy as np
from loops import find_crossings, find_faces
from studies.snapshot.table import loop_columns
from tests.studies.snapshot.test_table import synthetic_snapshot
snapshot = synthetic_snapshot(300, periodic=True)
faces = find_faces(snapshot.graph, compiled=True)
table = loop_columns(snapshot, compiled=True)
pairs = find_crossings(snapshot.graph, compiled=True)
print([name for name in table if name != "grains"], len(pairs), faces.grains.sum())
print([float(np.nansum(table[name])).hex() for name in table if name != "grains"])
"""


@pytest.mark.slow
def test_freshly_compiled_kernels_say_what_cached_ones_do(tmp_path):
    """A cache that did not notice a change would go on with the old code."""
    said = []
    for place in ({}, {"NUMBA_CACHE_DIR": str(tmp_path)}):
        done = subprocess.run(
            [sys.executable, "-c", COMPARED],
            cwd=ROOT,
            env={**os.environ, **place},
            capture_output=True,
            text=True,
            check=True,
        )
        said.append(done.stdout)
    assert list(tmp_path.rglob("*.nbc"))
    assert said[0] == said[1]


def test_no_kernel_calls_one_of_another_file():
    """Numba's cache looks at the kernel's own file alone."""
    allowed = {"kernel", "inlined", "inlined_sum", "given", "use_compiled"}
    for path in (
        path for room in ("loops", "stability", "studies") for path in (ROOT / room).rglob("*.py")
    ):
        text = path.read_text()
        if "@kernel" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and ".compiled" in str(node.module):
                assert {alias.name for alias in node.names} <= allowed, path


@pytest.mark.parametrize("script", [SMALL, pytest.param(NO_CACHE, marks=pytest.mark.slow)])
def test_in_a_process_of_its_own(script):
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr


def test_a_place_that_cannot_be_written_costs_the_cache_alone(monkeypatch):
    from numba.core import caching

    from loops.compiled import kernel

    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    assert kernel(lambda a: a + 1)(1) == 2


def test_the_choice_is_by_size_unless_it_is_told():
    assert not use_compiled(None, COMPILED_FROM - 1)
    assert use_compiled(None, COMPILED_FROM)
    assert use_compiled(True, 1)
    assert not use_compiled(False, 10 * COMPILED_FROM)


def test_inputs_are_views_where_they_can_be():
    values = np.arange(6.0)
    view = given(values, np.float64)
    assert np.shares_memory(view, values)
    assert not view.flags.writeable
    assert values.flags.writeable
    assert given(values[::2], np.float64).flags.c_contiguous
