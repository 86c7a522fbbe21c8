"""Loops of a snapshot as polygons, for figures, the page of a study and ParaView."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import Faces, GrainGraph, InputError, Regime, branch_vectors
from loops.arrays import Floats, Integers
from patterns import Snapshot
from studies.output import Columns, as_json
from studies.study import MOST_LOOPS, LoopsForMap


def half_edges_of_loops(
    faces: Faces, picked: Integers | slice = slice(None)
) -> tuple[Integers, Integers]:
    """Offsets (L + 1,) and places of the half-edges of the loops, or of those picked."""
    loops = faces.loops[picked]
    order = faces.order[loops]
    offsets = np.concatenate([[0], np.cumsum(order)])
    first = faces.offsets[loops] - offsets[:-1]
    return offsets, np.repeat(first, order) + np.arange(offsets[-1])


def loop_corners(graph: GrainGraph, faces: Faces, offsets: Integers, at: Integers) -> Floats:
    """Corners of the loops, unrolled through periodic images from each loop's first grain."""
    x = graph.x[faces.grains[at]]
    if graph.cell is None or graph.images is None or len(at) == 0:
        return x
    image = graph.images[faces.contacts[at]] * np.where(faces.forward[at], 1, -1)[:, None]
    passed = np.cumsum(image, axis=0) - image
    passed -= np.repeat(passed[offsets[:-1]], np.diff(offsets), axis=0)
    return x + passed @ graph.cell.T


def loops_for_map(snapshot: Snapshot, table: Mapping[str, Any], **series: Any) -> list[LoopsForMap]:
    """Map of the loops of a snapshot with the columns of a table; none beyond `MOST_LOOPS`."""
    faces = snapshot.faces
    if len(faces.loops) > MOST_LOOPS:
        return []
    offsets, at = half_edges_of_loops(faces)
    corners = loop_corners(snapshot.graph, faces, offsets, at)
    columns = {name: np.asarray(values) for name, values in table.items() if name != "grains"}
    return [LoopsForMap(offsets, corners, snapshot.ids[faces.grains[at]], columns, **series)]


def write_paraview(
    folder: Path, snapshot: Snapshot, table: Mapping[str, Any], provenance: Mapping[str, Any]
) -> None:
    """Write `loops.vtp`, one polygon per loop, and `contacts.vtp`, one line per contact.

    Loops and contacts that cross the border of a periodic cell are unrolled. Cell data of the
    polygons are the columns of the table, point data the ids of the grains; cell data of the
    lines are the ids of both grains, the branch length and, where there are forces, N, T and
    whether the contact slides. The provenance is field data of both, as JSON.
    """
    source, graph, faces = as_json(provenance), snapshot.graph, snapshot.faces
    offsets, at = half_edges_of_loops(faces)
    write_polydata(
        folder / "loops.vtp",
        points=loop_corners(graph, faces, offsets, at),
        offsets=offsets,
        lines=False,
        cell_data={name: np.asarray(v) for name, v in table.items() if name != "grains"},
        point_data={"grain": snapshot.ids[faces.grains[at]]},
        source=source,
    )
    start, branches = graph.x[graph.contacts[:, 0]], branch_vectors(graph)
    ids = snapshot.ids[graph.contacts]
    columns: Columns = {
        "grain_1": ids[:, 0],
        "grain_2": ids[:, 1],
        "branch_length": np.hypot(*branches.T),
    }
    if snapshot.mechanical:
        _, regime = snapshot.mechanics()
        columns["normal_force"] = graph.normal_force
        columns["shear_force"] = graph.shear_force
        columns["sliding"] = (regime == Regime.SLIDING).astype(np.int8)
    write_polydata(
        folder / "contacts.vtp",
        points=np.stack([start, start + branches], axis=1).reshape(-1, 2),
        offsets=2 * np.arange(graph.contact_count + 1),
        lines=True,
        cell_data=columns,
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
