"""Every dump of a folder of LAMMPS and LIGGGHTS runs: set GRAINLOOPS_DEM, run with -m slow.

The folder holds `lammps/periodic`, `lammps/walls`, `liggghts` and `liggghts/gravity`, dumps of
atoms and contacts with the code's log beside them, as described in its README.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from loops import (
    FaceKind,
    contact_forces,
    euler_check,
    find_crossings,
    find_faces,
    love_weber_stress,
    outline_area,
)
from patterns import read_snapshot
from tests.patterns.dump_writers import columns_of

FOLDER = os.environ.get("GRAINLOOPS_DEM")
PATHS = [
    path
    for pattern in ("lammps/*/dump.atoms.*", "liggghts/atoms.*", "liggghts/gravity/atoms.*")
    for path in (sorted(Path(FOLDER).glob(pattern)) if FOLDER else [])
]
IDS = [f"{path.parent.name}-{path.name}" for path in PATHS]
# Fluid drag (N s/m) that `fix viscous` adds to the forces on the grains, by run.
VISCOUS = {"periodic": 0.05, "liggghts": 0.05, "gravity": 0.5}
# Angle of gravity from the vertical (degrees), by step, and the boxes' width.
TILT = {0: 0.0, 60000: 5.0, 120000: 10.0, 180000: 15.0}
WIDTH = 0.67044

pytestmark = pytest.mark.collection


def read(path):
    snapshot = read_snapshot(path, kn=1e6, kt=5e5, mu=0.5, frame=0)
    of_liggghts = any("in the order of pair/gran/local" in note for note in snapshot.notes)
    assert of_liggghts == ("liggghts" in str(path.parent))
    return snapshot


def logged_stress(path, step):
    """All stresses (xx, yy, xy) that the log gives at this step."""
    log = next(path.parent.glob("log.*")).read_text()
    rows = [row.split() for row in log[log.rindex("thermo          40000") :].splitlines()]
    rows = [row for row in rows if row[:1] == [str(step)] and len(row) >= 11]
    last = slice(-5, -2) if "lammps" in path.parts else slice(-3, None)
    return np.array([row[last] for row in rows], dtype=float)


@pytest.mark.parametrize("path", PATHS, ids=IDS)
def test_loops(path):
    graph = read(path).graph
    faces = find_faces(graph)
    assert euler_check(graph, faces).ok
    assert len(find_crossings(graph)) == 0
    if graph.cell is not None:
        spanning = np.bincount(faces.component).argmax()
        own = (faces.kind == FaceKind.LOOP) & (faces.component == spanning)
        assert abs(faces.area[own].sum() / outline_area(graph, faces) - 1) < 1e-12


@pytest.mark.parametrize("path", [p for p in PATHS if p.parent.name in ("periodic", "liggghts")])
def test_stress_is_that_of_the_log(path):
    snapshot = read(path)
    stress = love_weber_stress(snapshot.graph)
    said = logged_stress(path, int(snapshot.step))
    ours = [stress[0, 0], stress[1, 1], stress[0, 1]]
    assert len(said) >= 1
    # A step stands there twice, at the end of a run and the start of the next one.
    assert np.abs(said - ours).max(axis=1).min() < 1e-5 * np.trace(stress) / 2


@pytest.mark.parametrize("path", PATHS, ids=IDS)
def test_forces_on_each_grain(path):
    """Contacts, walls, drag and weight give the force that the code says acts on each grain."""
    snapshot = read(path)
    graph = snapshot.graph
    force = contact_forces(graph)
    total = np.zeros(graph.x.shape)
    np.add.at(total, graph.contacts[:, 1], force)
    np.add.at(total, graph.contacts[:, 0], -force)
    if snapshot.walls is not None:
        np.add.at(total, snapshot.walls.grain, snapshot.walls.force)
    inside = np.ones(len(total), dtype=bool)
    if path.parent.name in VISCOUS:
        speed = columns_of(path, "vx", "vy")
        total -= VISCOUS[path.parent.name] * speed
    if path.parent.name == "gravity":
        # The walls' forces are in no file: grains away from them.
        x, r = graph.x, graph.radii
        inside = (x[:, 0] > r) & (x[:, 0] < WIDTH - r) & (x[:, 1] > r)
        angle = np.radians(TILT[int(snapshot.step)])
        weight = 9.81 * columns_of(path, "mass")[:, 0]
        total += weight[:, None] * [np.sin(angle), -np.cos(angle)]
    said = columns_of(path, "fx", "fy")
    assert inside.sum() > 0.8 * len(total)
    off = np.abs(total - said)[inside] / np.abs(force).mean()
    if path.name == "atoms.180000.dump":
        # Grains still roll down the slope here.
        assert np.median(off) < 1e-3
        return
    # Damping is taken half a time step off.
    assert off.max() < 1e-4
