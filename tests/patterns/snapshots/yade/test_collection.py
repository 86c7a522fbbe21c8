"""Every native file of a folder of Yade samples: set GRAINLOOPS_DEM to it and run with -m slow.

The folder holds one folder a sample with tables `grains_KK.*`, `contacts_KK.*` and, in `native/`,
files of the same snapshots: `sKK-spheres.*`, `mbKK-*`, `state_KK.*`, `spheres_KK.txt`.
"""

import os
import re
from pathlib import Path

import numpy as np
import pytest

from loops import InputError, love_weber_stress
from patterns import read_snapshot
from tests.patterns.snapshots.yade_samples import by_pair, cycles, snapshot_of

FOLDER = os.environ.get("GRAINLOOPS_DEM")
FILES = sorted(Path(FOLDER).glob("yade-*/native/*")) if FOLDER else []
SAVED = [p for p in FILES if p.name.startswith("state_") and ".xml" in p.name]
REFUSED = [
    p for p in FILES if re.search(r"^s\d+-spheres|^legacy|^mb.*\.vtm|^spheres_|\.yade", p.name)
]

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


@pytest.mark.parametrize("path", SAVED, ids=name_of)
def test_saved(path):
    found = snapshot_of(path)
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
    with pytest.raises(InputError, match=r"docs/yade\.md"):
        read_snapshot(path)
