"""The snippet that runs inside Yade, here on a stand-in for Yade's `O` with a real sample in it.

The tables in the sample were written by the same snippet inside Yade: the oracle.
"""

import json
import sys
import types

import numpy as np
import pytest

from patterns import read_snapshot
from patterns.snapshots.tables import read_table
from patterns.snapshots.yade_export import export_tables
from patterns.snapshots.yade_save import read_save
from tests.patterns.snapshots.yade_samples import BOX, PERIODIC, cycles, table_of

# The tables of the sample were written without masses and velocities.
Box = types.SimpleNamespace
MOTION = ("mass", "vx", "vy", "omega_z")


class Vector(tuple):
    def dot(self, other):
        return sum(a * b for a, b in zip(self, other, strict=True))


def shape_of(name):
    return type(name, (), {})()


def stand_in(folder):
    """Yade's `O` as the save of the sample has it."""
    return read_save(folder / "state.xml.gz")


@pytest.fixture
def yade(monkeypatch):
    module = types.ModuleType("yade")
    monkeypatch.setitem(sys.modules, "yade", module)
    return module


@pytest.mark.parametrize("folder", [BOX, PERIODIC], ids=lambda folder: folder.name)
def test_tables_are_those_written_in_yade(yade, tmp_path, folder):
    yade.O = stand_in(folder)
    path = export_tables(str(tmp_path / "out"))
    assert path == str(tmp_path / "out" / "grains_00.csv.gz")
    for name, keys in (("grains", ["id"]), ("contacts", ["id2", "id1"])):
        given, expected = (
            read_table(place / f"{name}_00.csv.gz") for place in (tmp_path / "out", folder)
        )
        assert [one for one in given.names if one not in MOTION] == expected.names
        orders = [np.lexsort([t.column(key) for key in keys]) for t in (given, expected)]
        for column in expected.names:
            values = [t.column(column)[o] for t, o in zip((given, expected), orders, strict=True)]
            assert (values[0] == values[1]).all()
    assert cycles(table_of(tmp_path / "out")) == cycles(table_of(folder))


@pytest.mark.parametrize("folder", [BOX, PERIODIC], ids=lambda folder: folder.name)
def test_cell_and_iteration_stand_beside(yade, tmp_path, folder):
    yade.O = stand_in(folder)
    export_tables(str(tmp_path))
    told = json.loads((tmp_path / "cell_00.json").read_text())
    expected = json.loads((folder / "cell_00.json").read_text())
    assert (expected["cell"] is None) == (folder == BOX)
    assert told["cell"] == expected["cell"]
    assert told["iteration"] == expected["iteration"]
    assert table_of(folder).step == expected["iteration"]


def test_masses_velocities_and_spins_are_those_of_yade(yade, tmp_path):
    yade.O = stand_in(PERIODIC)
    for body in yade.O.bodies:
        state = body.state
        state.mass, state.vel = 2.0 + body.id, Vector((0.1 * body.id, -0.2 * body.id, 0))
        state.angVel = Vector((0, 0, 0.3 * body.id))
    snapshot = read_snapshot(export_tables(str(tmp_path)))
    assert np.array_equal(snapshot.mass, 2.0 + snapshot.ids)
    assert np.array_equal(snapshot.velocity, snapshot.ids[:, None] * np.array([0.1, -0.2]))
    assert np.array_equal(snapshot.spin, 0.3 * snapshot.ids)


def test_numbers_go_on_where_the_folder_ends(yade, tmp_path):
    yade.O = stand_in(PERIODIC)
    names = [export_tables(str(tmp_path)).rsplit("/", 1)[1] for _ in range(3)]
    assert names == [f"grains_0{k}.csv.gz" for k in range(3)]
    assert export_tables(str(tmp_path), 117).endswith("grains_117.csv.gz")
    assert export_tables(str(tmp_path)).endswith("grains_118.csv.gz")
    assert not list(tmp_path.glob("*.part"))


def test_walls_come_first_in_any_order_of_yade(yade, tmp_path):
    yade.O = stand_in(BOX)
    for i in yade.O.interactions:
        n = i.geom.normal
        i.phys.shearForce = Vector((-3 * n[1], 3 * n[0], 0))
    export_tables(str(tmp_path))
    for i in yade.O.interactions:
        if not hasattr(yade.O.bodies[i.id1].shape, "radius"):
            i.id1, i.id2 = i.id2, i.id1
            i.cellDist = tuple(-k for k in i.cellDist)
            i.geom.normal = Vector(-k for k in i.geom.normal)
            i.phys.normalForce = Vector(-k for k in i.phys.normalForce)
            i.phys.shearForce = Vector(-k for k in i.phys.shearForce)
    export_tables(str(tmp_path))
    first, second = (read_table(tmp_path / f"contacts_0{k}.csv.gz") for k in (0, 1))
    for name in first.names:
        assert (first.column(name) == second.column(name)).all()


def test_foot_on_boxes_and_facets(yade, tmp_path):
    """Yade puts the contact point halfway through the overlap there, on a Wall at its foot."""
    yade.O = stand_in(BOX)
    export_tables(str(tmp_path))
    for i in yade.O.interactions:
        wall, grain = yade.O.bodies[i.id1], yade.O.bodies[i.id2]
        if not hasattr(wall.shape, "radius"):
            wall.shape = shape_of("Facet")
            point, n, x = i.geom.contactPoint, i.geom.normal, grain.state.pos
            overlap = grain.shape.radius - sum((x[k] - point[k]) * n[k] for k in (0, 1))
            i.geom.contactPoint = Vector(point[k] - 0.5 * overlap * n[k] for k in range(3))
    export_tables(str(tmp_path))
    first, second = (read_table(tmp_path / f"contacts_0{k}.csv.gz") for k in (0, 1))
    for name in ("branch_x", "branch_y"):
        assert np.abs(first.column(name) - second.column(name)).max() < 1e-15


def test_interactions_that_are_not_real_are_left_out(yade, tmp_path):
    yade.O = stand_in(BOX)
    yade.O.interactions[5].isReal = False
    export_tables(str(tmp_path))
    assert len(read_table(tmp_path / "contacts_00.csv.gz")) == len(yade.O.interactions) - 1


def test_friction_is_left_out_where_a_law_has_none(yade, tmp_path):
    yade.O = stand_in(BOX)
    del yade.O.interactions[3].phys.tangensOfFrictionAngle
    export_tables(str(tmp_path))
    assert not read_table(tmp_path / "contacts_00.csv.gz").has("mu")


def test_scenes_without_export_are_refused_before_writing(yade, tmp_path):
    yade.O = stand_in(BOX)
    del yade.O.interactions[3].phys.ks
    with pytest.raises(ValueError, match="lacks kn, ks or shearForce"):
        export_tables(str(tmp_path / "out"))
    yade.O = stand_in(BOX)
    yade.O.bodies[4].isClumpMember = True
    with pytest.raises(ValueError, match="body 4 belongs to a clump"):
        export_tables(str(tmp_path / "out"))
    yade.O = stand_in(BOX)
    yade.O.interactions = []
    with pytest.raises(ValueError, match="no real interaction"):
        export_tables(str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_a_crash_while_writing_leaves_no_table_of_grains(yade, tmp_path, monkeypatch):
    yade.O = stand_in(BOX)
    import patterns.snapshots.yade_export as module

    def fail(source, target):
        raise OSError("disk full")

    monkeypatch.setattr(module.os, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        export_tables(str(tmp_path))
    assert not list(tmp_path.glob("*.csv.gz"))


@pytest.mark.parametrize(("switch", "told"), [(True, "radii"), (False, "branch"), (None, "radii")])
def test_cell_file_has_the_shear_increment(yade, tmp_path, switch, told):
    yade.O = stand_in(PERIODIC)
    functor = type("Ig2_Sphere_Sphere_ScGeom", (), {"avoidGranularRatcheting": switch})()
    if switch is not None:
        yade.O.engines = [Box(), Box(geomDispatcher=Box(functors=[Box(), functor]))]
    export_tables(str(tmp_path))
    assert json.loads((tmp_path / "cell_00.json").read_text())["shear_increment"] == told
    assert read_snapshot(tmp_path / "grains_00.csv.gz").law.shear_increment == told
