"""Every snapshot of a folder of Yade samples: set GRAINLOOPS_DEM to it and run with -m slow.

The folder holds one folder a sample with `grains_KK.*`, `contacts_KK.*` and `macro.csv`, Yade's own
averages (tension negative), as described in the sample's README.
"""

import csv
import os
from pathlib import Path

import numpy as np
import pytest
import shapely

from loops import (
    FaceKind,
    LinearFrictional,
    euler_check,
    find_crossings,
    find_faces,
    loop_batches,
    love_weber_stress,
    outline_area,
    traction_tangent,
)
from patterns import read_snapshot
from stability import restrict, symmetric_spectrum

FOLDER = os.environ.get("GRAINLOOPS_DEM")
PATHS = sorted(Path(FOLDER).glob("yade-*/grains_*")) if FOLDER else []

pytestmark = pytest.mark.collection


def macro_of(path):
    number = int(path.name.split("_")[1][:2])
    with open(path.parent / "macro.csv") as file:
        return next(row for row in csv.DictReader(file) if int(row["snap"]) == number)


def read(path):
    macro = macro_of(path)
    cell = None
    if "h_xx" in macro:
        cell = [
            [float(macro["h_xx"]), float(macro["h_xy"])],
            [float(macro["h_yx"]), float(macro["h_yy"])],
        ]
    return read_snapshot(path, cell=cell), macro


@pytest.mark.parametrize("path", PATHS, ids=[f"{p.parent.name}-{p.name[7:9]}" for p in PATHS])
def test_snapshot(path):
    snapshot, macro = read(path)
    graph = snapshot.graph
    faces = find_faces(graph)
    assert euler_check(graph, faces).ok
    assert len(find_crossings(graph)) == 0
    loops = faces.kind == FaceKind.LOOP
    if graph.cell is not None:
        spanning = np.bincount(faces.component).argmax()
        own = loops & (faces.component == spanning)
        assert abs(faces.area[own].sum() / outline_area(graph, faces) - 1) < 1e-12
        yade = -np.array(
            [
                [float(macro["sig2d_xx"]), float(macro["sig2d_xy"])],
                [float(macro["sig2d_yx"]), float(macro["sig2d_yy"])],
            ]
        )
        assert np.abs(love_weber_stress(graph) - yade).max() < 1e-12 * np.abs(yade).max()
        return
    lines = shapely.linestrings(graph.x[graph.contacts])
    polygons = shapely.get_parts(shapely.polygonize(lines))
    grain = {tuple(x): g for g, x in enumerate(graph.x.tolist())}
    rings = {
        frozenset(grain[tuple(corner)] for corner in shapely.get_coordinates(p).tolist())
        for p in polygons
    }
    found = {
        frozenset(faces.grains[faces.offsets[f] : faces.offsets[f + 1]].tolist())
        for f in faces.loops
    }
    assert len(polygons) == len(faces.loops)
    assert rings == found


SLOW_SAMPLE = [path for path in PATHS if path.name[7:9] == "10" and "slow" in path.parent.name]


@pytest.mark.parametrize("path", SLOW_SAMPLE)
def test_free_spins_are_solved_through_the_gear_modes(path):
    """Elastic contacts, 2,000 discs: the medians that K + eps gave; of four by the branch none."""
    snapshot, _ = read(path)
    law, graph = snapshot.mechanics()[0], snapshot.graph
    wanted = {"radii": {3: 1.3180, 4: 0.8006, 5: -0.0030, 6: -0.0033, 7: -0.0133, 8: -0.0148}}
    wanted["branch"] = {3: 1.3180, 5: -0.0030, 7: -0.0133}
    for increment, medians in wanted.items():
        own = LinearFrictional(law.kn, law.kt, np.inf, increment)
        for batch in loop_batches(graph, find_faces(graph)):
            order, elastic = batch.grains.shape[1], np.ones_like(batch.contacts)
            mine = own.take(batch.contacts)
            found = traction_tangent(batch.graph, mine, spins="free", regime=elastic)
            assert found.trusted.all() or (increment == "branch" and order % 2 == 0)
            least = symmetric_spectrum(restrict(np.nan_to_num(found.matrix), "symmetric"))[:, 0]
            if order == 4:
                # Either way of sharing the arms has its sign: no loop of four has a verdict.
                assert (np.abs(least) <= found.error).all()
            if order in medians:
                median = np.median(least[found.trusted]) / np.mean(law.kn)
                assert median == pytest.approx(medians[order], abs=1e-4)
