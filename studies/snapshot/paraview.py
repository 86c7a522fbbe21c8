"""Loops and contacts as VTK PolyData, for ParaView."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import Faces, InputError, Regime, branch_vectors
from loops.arrays import Floats, Integers
from patterns import Snapshot
from studies.output import as_json
from studies.snapshot.polygons import half_edges_of_loops, loop_corners


def write_paraview(
    folder: Path,
    snapshot: Snapshot,
    faces: Faces,
    table: Mapping[str, Any],
    provenance: Mapping[str, Any],
) -> None:
    """Write `loops.vtp`, a polygon a loop, and `contacts.vtp`, a line a contact.

    Loops and contacts that cross the border of a periodic cell are unrolled. Cell data of the
    polygons are the columns of the table, point data the ids of the grains; cell data of the
    lines are the ids of both grains, the branch length and, where there are forces, N, T and
    whether the contact slides. The provenance is field data of both, as JSON.
    """
    source = as_json(provenance)
    offsets, at = half_edges_of_loops(faces)
    write_polydata(
        folder / "loops.vtp",
        points=loop_corners(snapshot.graph, faces, offsets, at),
        offsets=offsets,
        lines=False,
        cell_data={name: np.asarray(v) for name, v in table.items() if name != "grains"},
        point_data={"grain": snapshot.ids[faces.grains[at]]},
        source=source,
    )
    x = snapshot.graph.x[snapshot.graph.contacts[:, 0]]
    ends = np.stack([x, x + branch_vectors(snapshot.graph)], axis=1).reshape(-1, 2)
    write_polydata(
        folder / "contacts.vtp",
        points=ends,
        offsets=2 * np.arange(snapshot.graph.contact_count + 1),
        lines=True,
        cell_data=_contact_columns(snapshot),
        point_data={},
        source=source,
    )


def write_polydata(
    path: Path,
    *,
    points: Floats,
    offsets: Integers,
    lines: bool,
    cell_data: Mapping[str, NDArray[Any]],
    point_data: Mapping[str, NDArray[Any]],
    source: str,
) -> None:
    """Write cells whose points follow one another."""
    try:
        from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
        from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
        from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter
    except ImportError:
        raise InputError(
            path.name, "no library to write it", "vtk", "Install it: pip install vtk."
        ) from None
    # VTK keeps pointers, not copies: every array has a name until the file is written.
    corners = np.column_stack([points, np.zeros(len(points))])
    starts, along = np.ascontiguousarray(offsets, np.int64), np.arange(len(points), dtype=np.int64)
    at, cells, data = vtkPoints(), vtkCellArray(), vtkPolyData()
    at.SetData(numpy_to_vtk(corners))
    cells.SetData(numpy_to_vtkIdTypeArray(starts), numpy_to_vtkIdTypeArray(along))
    data.SetPoints(at)
    (data.SetLines if lines else data.SetPolys)(cells)
    kept = []
    for columns, attributes in ((cell_data, data.GetCellData()), (point_data, data.GetPointData())):
        for name, values in columns.items():
            kept.append(np.ascontiguousarray(values))
            array = numpy_to_vtk(kept[-1])
            array.SetName(name)
            attributes.AddArray(array)
    text = vtkStringArray()
    text.SetName("grainloops")
    text.InsertNextValue(source)
    data.GetFieldData().AddArray(text)
    writer = vtkXMLPolyDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    writer.SetCompressorTypeToLZ4()
    if writer.Write() != 1:
        raise InputError(str(path), "not written", "a place to write", "Is the disk full?")


def _contact_columns(snapshot: Snapshot) -> dict[str, NDArray[Any]]:
    graph = snapshot.graph
    ids = snapshot.ids[graph.contacts]
    columns: dict[str, NDArray[Any]] = {
        "grain_1": ids[:, 0],
        "grain_2": ids[:, 1],
        "branch_length": np.hypot(*branch_vectors(graph).T),
    }
    if snapshot.mechanical:
        _, regime = snapshot.mechanics()
        columns["normal_force"] = graph.normal_force
        columns["shear_force"] = graph.shear_force
        columns["sliding"] = (regime == Regime.SLIDING).astype(np.int8)
    return columns
