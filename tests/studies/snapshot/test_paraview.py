"""Files for ParaView, read back with VTK."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from loops import InputError, Regime, branch_vectors, find_faces, loop_batches, polygon_area
from patterns import read_snapshot, sample_cell, sample_path
from studies.output import provenance
from studies.snapshot.table import loop_columns, write_paraview

MADE = provenance("snapshot", {"path": "grains.csv"}, "as the input's")


def read_back(path):
    """PolyData, points in the plane, and arrays of its cells and points."""
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()

    def arrays(holder):
        found = [holder.GetArray(k) for k in range(holder.GetNumberOfArrays())]
        return {a.GetName(): numpy_support.vtk_to_numpy(a) for a in found}

    points = numpy_support.vtk_to_numpy(data.GetPoints().GetData())
    assert (points[:, 2] == 0).all()
    return data, points[:, :2], arrays(data.GetCellData()), arrays(data.GetPointData())


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    pytest.importorskip("vtkmodules")
    folder = tmp_path_factory.mktemp("vtk")
    snapshot = read_snapshot(sample_path("grains_periodic.parquet"), cell=sample_cell())
    faces = find_faces(snapshot.graph)
    table = loop_columns(snapshot)
    write_paraview(folder, snapshot, table, MADE)
    return folder, snapshot, faces, table


def test_polygons_come_back(written):
    folder, snapshot, faces, table = written
    data, points, cells, at_points = read_back(folder / "loops.vtp")
    assert data.GetNumberOfPolys() == data.GetNumberOfCells() == len(table["loop"])
    for name in set(table) - {"grains"}:
        np.testing.assert_array_equal(cells[name], table[name])
    assert set(cells) == set(table) - {"grains"}
    ids = table["grains"].to_pylist()
    for row in range(0, len(ids), 97):
        corners = [data.GetCell(row).GetPointId(k) for k in range(len(ids[row]))]
        assert data.GetCell(row).GetNumberOfPoints() == len(ids[row])
        assert at_points["grain"][corners].tolist() == ids[row]
        assert polygon_area(points[corners]) == pytest.approx(table["area"][row], rel=1e-12)
    # Unrolled: the same corners as the loops cut out of the packing.
    row = np.full(len(faces.kind), -1)
    row[faces.loops] = np.arange(len(faces.loops))
    start = np.concatenate([[0], np.cumsum(table["order"])])
    for batch in loop_batches(snapshot.graph, faces):
        at = start[row[batch.face]][:, None] + np.arange(batch.grains.shape[1])
        corners = batch.origin[:, None] + batch.graph.x
        np.testing.assert_allclose(points[at], corners, atol=1e-14)


def test_vtk_measures_the_same_area(written):
    folder, _, _, table = written
    filters = pytest.importorskip("vtkmodules.vtkFiltersCore")
    data, *_ = read_back(folder / "loops.vtp")
    triangles = filters.vtkTriangleFilter()
    triangles.SetInputData(data)
    mass = filters.vtkMassProperties()
    mass.SetInputConnection(triangles.GetOutputPort())
    mass.Update()
    assert mass.GetSurfaceArea() == pytest.approx(np.linalg.det(sample_cell()), rel=1e-6)
    assert table["area"].sum() == pytest.approx(np.linalg.det(sample_cell()), rel=1e-12)


def test_contacts_come_back(written):
    folder, snapshot, _, _ = written
    data, points, cells, _ = read_back(folder / "contacts.vtp")
    graph = snapshot.graph
    assert data.GetNumberOfLines() == data.GetNumberOfCells() == graph.contact_count
    last = data.GetCell(graph.contact_count - 1)
    ends = [last.GetPointId(k) for k in range(last.GetNumberOfPoints())]
    assert ends == [len(points) - 2, len(points) - 1]
    np.testing.assert_array_equal(points[0::2], graph.x[graph.contacts[:, 0]])
    np.testing.assert_allclose(points[1::2] - points[0::2], branch_vectors(graph), atol=1e-15)
    np.testing.assert_array_equal(cells["normal_force"], graph.normal_force)
    np.testing.assert_array_equal(cells["shear_force"], graph.shear_force)
    np.testing.assert_array_equal(cells["sliding"], snapshot.regime == Regime.SLIDING)
    pairs = np.column_stack([cells["grain_1"], cells["grain_2"]])
    np.testing.assert_array_equal(pairs, snapshot.ids[graph.contacts])


def test_provenance_is_in_the_files(written):
    for name in ("loops", "contacts"):
        data, *_ = read_back(written[0] / f"{name}.vtp")
        text = data.GetFieldData().GetAbstractArray("grainloops").GetValue(0)
        assert json.loads(text) == MADE


def test_without_forces_only_the_geometry(written, tmp_path):
    _, snapshot, _, _ = written
    bare = replace(snapshot, law=None, regime=None)
    write_paraview(tmp_path, bare, loop_columns(bare), MADE)
    _, _, cells, _ = read_back(tmp_path / "contacts.vtp")
    assert set(cells) == {"grain_1", "grain_2", "branch_length"}
    _, _, cells, _ = read_back(tmp_path / "loops.vtp")
    assert "pressure" not in cells
    assert "area" in cells


def test_without_the_library_the_extra_is_named(written, tmp_path, monkeypatch):
    _, snapshot, _, table = written
    monkeypatch.setitem(sys.modules, "vtkmodules.vtkIOXML", None)
    with pytest.raises(InputError, match="pip install vtk"):
        write_paraview(tmp_path, snapshot, table, MADE)
    assert not list(tmp_path.iterdir())
