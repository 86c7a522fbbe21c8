"""Every native file of a folder of Yade samples: set GRAINLOOPS_DEM to it and run with -m slow.

The folder holds one folder a sample with tables `grains_KK.*`, `contacts_KK.*` and, in `native/`,
files of the same snapshots: `sKK-spheres.*`, `mbKK-*`, `state_KK.*`, `spheres_KK.txt`.
"""

import gzip
import os
import re
from pathlib import Path

import numpy as np
import pytest

from loops import InputError, love_weber_stress
from patterns.snapshots.formats import FORMATS, read_snapshot
from tests.patterns.snapshots.yade_samples import by_pair, cycles, frame_of, snapshot_of

FOLDER = os.environ.get("GRAINLOOPS_DEM")
FILES = sorted(Path(FOLDER).glob("yade-*/native/*")) if FOLDER else []
RECORDED = [p for p in FILES if re.match(r"s\d+-spheres|mb\d+-\d+\.vtm|legacy\d+-spheres", p.name)]
SAVED = [p for p in FILES if p.name.startswith("state_") and ".xml" in p.name]
REFUSED = [p for p in FILES if p.name.startswith("spheres_") or ".yade" in p.name]

pytestmark = pytest.mark.collection


def name_of(path):
    return f"{path.parts[-3]}-{path.name}"


def table_of(path, cell=None):
    number = re.search(r"\d+", path.name).group()
    (grains,) = path.parents[1].glob(f"grains_{number}.*")
    return read_snapshot(grains, cell=cell)


def same_geometry(found, table):
    assert cycles(found) == cycles(table)
    pairs = [by_pair(s, np.sort(s.ids[s.graph.contacts], axis=1)) for s in (found, table)]
    assert (pairs[0] == pairs[1]).all()


@pytest.mark.parametrize("path", [p for p in RECORDED if "periodic" not in str(p)], ids=name_of)
def test_recorded(path):
    found, table = snapshot_of(FORMATS["yade-vtk"], path), table_of(path)
    same_geometry(found, table)
    # Positions to single precision or six digits, forces to double precision or six digits.
    exact = 1e-5 if path.name.startswith("legacy") else 2e-9
    normal = by_pair(table, table.graph.normal_force)
    scale = normal.max()
    assert np.abs(by_pair(found, found.graph.normal_force) - normal).max() < exact * scale
    if path.name.startswith("legacy"):
        shear, right = (by_pair(s, s.graph.shear_force) for s in (found, table))
        assert np.abs(shear - right).max() < exact * scale
    else:
        assert found.law is None and not found.graph.shear_force.any()


@pytest.mark.parametrize("path", [p for p in RECORDED if "periodic" in str(p)], ids=name_of)
def test_recorded_in_a_periodic_cell(path):
    with pytest.raises(InputError, match=r"lines and .* values of forceN"):
        frame_of(FORMATS["yade-vtk"], path)


@pytest.mark.parametrize("path", SAVED, ids=name_of)
def test_saved(path):
    found = snapshot_of(FORMATS["yade-xml"], path)
    table = table_of(path, found.graph.cell)
    same_geometry(found, table)
    # The tables have 15 digits or all.
    scale = table.graph.normal_force.max()
    for name in ("normal_force", "shear_force"):
        given, expected = (by_pair(s, getattr(s.graph, name)) for s in (found, table))
        assert np.abs(given - expected).max() < 3e-14 * scale
    volume = 1.0 if found.graph.cell is None else None
    stress, expected = (love_weber_stress(s.graph, volume) for s in (found, table))
    assert np.abs(stress - expected).max() < 1e-13 * np.abs(expected).max()
    assert found.wall_contacts == table.wall_contacts


@pytest.mark.parametrize("path", REFUSED, ids=name_of)
def test_refused(path):
    content = path.read_bytes()
    head = (gzip.decompress(content) if path.suffix == ".gz" else content)[:4096]
    (module,) = [
        m
        for m in map(FORMATS.get, ("yade-text", "yade-vtk", "yade-xml"))
        if m.recognises(path, head)
    ]
    with pytest.raises(InputError, match=r"docs/yade\.md"):
        frame_of(module, path)
