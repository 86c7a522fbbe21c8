"""Yade's shear increment, measured on its own grains from one snapshot to the next.

Between snapshots 2e-5 of strain apart, `T` of a contact that does not slide changes by `-kt` times
the tangential displacement of its grains, positions and rotations taken from the tables. With
`radii` that holds to the second order of the steps between (1e-6 of the change); `branch` is off by
the overlap (1e-3).
"""

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from loops import InputError, Regime
from patterns import read_snapshot, write_snapshot
from tests.patterns.snapshots.yade_samples import BOX, PERIODIC

SAMPLES = Path(__file__).parent / "samples"
FOLDER = os.environ.get("GRAINLOOPS_DEM")


def shear_errors(paths, cells=(None, None)):
    """Median relative error of the change of T, by shear increment."""
    one, two = (read_snapshot(path, cell=h) for path, h in zip(paths, cells, strict=True))
    spin = two.rotation - one.rotation
    keys = [_keys(one), _keys(two)]
    shared = [(keys[0][key], keys[1][key]) for key in keys[0] if key in keys[1]]
    first, second = np.transpose(shared)
    stuck = (one.regime[first] == Regime.ELASTIC) & (two.regime[second] == Regime.ELASTIC)
    first, second = first[stuck], second[stuck]
    pairs = one.graph.contacts[first]
    d, e = _branches(one, first), _branches(two, second)
    turn = np.arctan2(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0], np.einsum("ck,ck->c", d, e))
    radii = one.graph.radii[pairs]
    length = (np.hypot(*d.T) + np.hypot(*e.T)) / 2
    change = two.graph.shear_force[second] - one.graph.shear_force[first]
    errors = {}
    for name, reach in (("radii", radii.sum(axis=1)), ("branch", length)):
        arms = radii * (reach / radii.sum(axis=1))[:, None]
        slip = reach * turn - (arms * spin[pairs]).sum(axis=1)
        errors[name] = float(np.median(np.abs(1 + one.law.kt[first] * slip / change)))
    return errors, len(first)


def _keys(snapshot):
    graph = snapshot.graph
    images = np.zeros((graph.contact_count, 2), int) if graph.images is None else graph.images
    rows = np.column_stack([snapshot.ids[graph.contacts], images])
    return {tuple(row): c for c, row in enumerate(rows.tolist())}


def _branches(snapshot, rows):
    graph = snapshot.graph
    one, two = graph.contacts[rows].T
    shift = 0.0 if graph.images is None else graph.images[rows] @ graph.cell.T
    return graph.x[two] - graph.x[one] + shift


def test_yade_turns_shear_by_the_radii():
    paths = [SAMPLES / f"grains_slow_{k:02d}.csv.gz" for k in (2, 3)]
    errors, contacts = shear_errors(paths)
    assert contacts > 50
    assert errors["radii"] < 1e-6 and errors["branch"] > 2e-4
    assert read_snapshot(paths[0]).law.shear_increment == "radii"


@pytest.mark.collection
def test_yade_turns_shear_by_the_radii_in_the_whole_sample():
    folder = Path(FOLDER) / "yade-slow"
    with open(folder / "macro.csv") as file:
        cells = {int(row["snap"]): row for row in csv.DictReader(file)}
    for k in range(2, 21, 3):
        paths = [folder / f"grains_{n:02d}.parquet" for n in (k, k + 1)]
        given = [
            [[float(cells[n][f"h_{row}{axis}"]) for axis in "xy"] for row in "xy"]
            for n in (k, k + 1)
        ]
        errors, contacts = shear_errors(paths, given)
        assert contacts > 2000
        # Measured: 4e-8 to 7e-8 against 6.8e-4 to 7.2e-4.
        assert errors["radii"] < 2e-7 and errors["branch"] > 5e-4


@pytest.mark.parametrize("folder", [BOX, PERIODIC])
def test_files_of_yade_have_the_increment_radii(folder):
    assert read_snapshot(folder / "state.xml.gz").law.shear_increment == "radii"


def test_save_without_the_default_has_the_increment_branch(tmp_path):
    import gzip

    text = gzip.decompress((BOX / "state.xml.gz").read_bytes())
    switch = b"<avoidGranularRatcheting>1<"
    assert text.count(switch) == 1
    path = tmp_path / "state.xml"
    path.write_bytes(text.replace(switch, switch.replace(b"1", b"0")))
    assert read_snapshot(path).law.shear_increment == "branch"


def test_the_user_overrides():
    path = SAMPLES / "grains_slow_02.csv.gz"
    snapshot = read_snapshot(path, shear_increment="branch")
    assert snapshot.law.shear_increment == "branch"
    assert any("'branch' as given, not 'radii'" in note for note in snapshot.notes)
    assert any("avoidGranularRatcheting" in note for note in read_snapshot(path).notes)
    with pytest.raises(InputError, match="branch or radii"):
        read_snapshot(path, shear_increment="both")


def test_written_snapshots_keep_it(tmp_path):
    snapshot = read_snapshot(SAMPLES / "grains_slow_02.csv.gz")
    for increment in ("radii", "branch"):
        write_snapshot(
            tmp_path / "grains_1.csv",
            read_snapshot(SAMPLES / "grains_slow_02.csv.gz", shear_increment=increment),
        )
        assert read_snapshot(tmp_path / "grains_1.csv").law.shear_increment == increment
    assert snapshot.law.shear_increment == "radii"


def test_other_tables_have_the_increment_branch(tmp_path):
    lines = ["id,x,y,radius", "1,0,0,1", "2,1.99,0,1", "3,1,1.72,1"]
    (tmp_path / "grains_1.csv").write_text("\n".join(lines) + "\n")
    rows = ["id1,id2,fn,fsx,fsy", "1,2,1,0,0.1", "2,3,1,0,0", "3,1,1,0,0"]
    (tmp_path / "contacts_1.csv").write_text("\n".join(rows) + "\n")
    law = read_snapshot(tmp_path / "grains_1.csv", kn=1, kt=1, mu=1).law
    assert law.shear_increment == "branch"
