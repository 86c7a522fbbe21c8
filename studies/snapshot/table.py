"""The loops of a snapshot: one row per loop, and their polygons for figures, pages and ParaView."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from loops import (
    FaceKind,
    Faces,
    GrainGraph,
    InputError,
    Regime,
)
from loops.arrays import Flags, Floats, Integers
from loops.compiled import use_compiled
from loops.errors import library
from loops.loop_batches import LoopNumbers, loop_numbers
from patterns import Snapshot
from stability.verdict import loop_spectra, loop_stability
from studies.output import Columns, as_arrow, as_json
from studies.study import MOST_LOOPS, LoopsForMap

CLOSURES: tuple[Literal["affine", "traction"], ...] = ("affine", "traction")
SHAPE = ("x", "y", "area", "perimeter", "elongation", "orientation")
STRESS_COLUMNS = ("stress_11", "stress_12", "stress_21", "stress_22", "pressure", "deviator")
EIGENVALUES = ("lambda_min", "lambda_mid", "lambda_max")
STABILITY = (*EIGENVALUES, *("unstable_fraction", "cone_opening", "soft_angle"))
# The loop in its packing.
PLACE = "packing"
# Traction closure with free spins: the loop cut out of its packing.
FREE = "traction_free"
MECHANICS = (
    "sliding_contacts",
    *STRESS_COLUMNS,
    *(f"{closure}_{name}" for closure in CLOSURES for name in (*STABILITY, "error")),
    "traction_condition",
    *(f"{FREE}_{name}" for name in (*EIGENVALUES, "error")),
)

# Loops of this order and beyond form one group, in every table, figure and report.
LAST_ORDER = 8
GROUPS = (*map(str, range(3, LAST_ORDER)), f"{LAST_ORDER}+")
# Rows of the loops of each group.
Groups = dict[str, Integers | slice]


def loop_columns(
    snapshot: Snapshot, *, compiled: bool | None = None, threads: int | None = None
) -> dict[str, Any]:
    """Table of the loops of a snapshot, one row per loop in the order of `snapshot.faces.loops`.

    Columns by columns.toml; nan where the tangent's error leaves no sign: rounding, or the lever
    arms of even loops with free spins (`MacroTangent.sensitivity`).
    """
    faces, graph = snapshot.faces, snapshot.graph
    count, order = len(faces.loops), faces.order[faces.loops]
    table: dict[str, Any] = {"loop": np.arange(count), "order": order}
    for name in (*SHAPE, *(MECHANICS if snapshot.mechanical else ())):
        table[name] = np.empty(count, dtype=np.int64 if name == "sliding_contacts" else np.float64)
    law, regime = snapshot.mechanics() if snapshot.mechanical else (None, None)
    kn = snapshot.mean_kn if snapshot.mechanical else np.nan

    def columns(loops: LoopNumbers) -> tuple[Any, Columns]:
        return loops.at, _columns(loops, order[loops.at], kn, by_kernels)

    by_kernels = use_compiled(compiled, graph.contact_count)
    how: dict[str, Any] = {"compiled": by_kernels, "threads": threads}
    with ThreadPoolExecutor(1) as other:
        grains = other.submit(_grain_lists, snapshot, order)
        for at, values in loop_numbers(graph, faces, law, regime, columns, **how):
            for name, column in values.items():
                table[name][at] = column
    if graph.cell is not None:
        # Into the cell, whichever images of the grains a file has.
        at, periodic = np.stack([table["x"], table["y"]]), np.array(snapshot.periodic)[:, None]
        table["x"], table["y"] = at - graph.cell @ (
            np.floor(np.linalg.solve(graph.cell, at)) * periodic
        )
    table["grains"] = grains.result()
    return table


def _grain_lists(snapshot: Snapshot, order: Integers) -> pa.LargeListArray:
    """Ids of the grains of each loop."""
    faces = snapshot.faces
    ids = snapshot.ids[faces.grains[np.repeat(faces.kind == FaceKind.LOOP, faces.order)]]
    offsets = np.concatenate([[0], np.cumsum(order)])
    return pa.LargeListArray.from_arrays(as_arrow(offsets), as_arrow(ids))


def _columns(loops: LoopNumbers, order: Integers, kn: float, compiled: bool) -> Columns:
    """Columns of the numbers of some loops, tangents over `kn`."""
    columns: Columns = dict(zip(SHAPE, loops.shape, strict=True))
    columns["orientation"] = np.degrees(columns["orientation"])
    if loops.stress is not None:
        columns |= {"sliding_contacts": np.asarray(loops.sliding), **_stress(loops.stress)}
    for (closure, spins), tangent in loops.tangents.items():
        name = FREE if spins == "free" else closure
        error = tangent.error / kn
        if name == "traction":
            # Both closures give the same tangent for a triangle.
            own = order != 3
            judged = _judged(name, tangent.matrix[own] / kn, error[own], compiled=compiled)
            for key, values in judged.items():
                columns[key] = columns[key.replace("traction", "affine")].copy()
                columns[key][own] = values
        else:
            columns |= _judged(name, tangent.matrix / kn, error, compiled=compiled)
        columns[f"{name}_error"] = error
        if name == "traction":
            columns["traction_condition"] = tangent.condition
    return columns


def _stress(whole: Floats) -> Columns:
    """Stress columns from (L, 4) the stress with contacts counted whole: loops share them."""
    stress = 0.5 * whole.T
    half, off = 0.5 * (stress[0] - stress[3]), 0.5 * (stress[1] + stress[2])
    values = (*stress, 0.5 * (stress[0] + stress[3]), np.hypot(half, off))
    return dict(zip(STRESS_COLUMNS, values, strict=True))


def _judged(closure: str, matrix: Floats, error: Floats, *, compiled: bool) -> Columns:
    """Columns of a closure's tangents over `kn`; nan where the error exceeds the first eigenvalue.

    With spins free eigenvalues alone.
    """
    values: tuple[Floats, ...]
    if closure == FREE:
        values = tuple(loop_spectra(matrix, compiled=compiled).T)
    else:
        found = loop_stability(matrix, compiled=compiled)
        angles = np.degrees(found.cone_opening), np.degrees(found.soft_angle)
        values = (*found.eigenvalues.T, found.unstable_fraction, *angles)
    sure = np.abs(values[0]) > error
    return {
        f"{closure}_{name}": np.where(sure, value, np.nan)
        for name, value in zip(STABILITY, values, strict=False)
    }


def group_rows(order: Integers) -> Groups:
    """Rows of the loops of each group of orders, and of `all`."""
    grouped = np.minimum(order, LAST_ORDER).astype(np.int8)
    rows: Groups = {name: np.flatnonzero(grouped == 3 + k) for k, name in enumerate(GROUPS)}
    return rows | {"all": slice(None)}


def share(having: Flags) -> dict[str, Any]:
    """Share of loops that have a property, its standard error `sqrt(p (1 - p)/n)` and number n."""
    return share_of(int(np.count_nonzero(having)), len(having))


def share_of(some: int, count: int) -> dict[str, Any]:
    """`share` by numbers."""
    if count == 0:
        return {"mean": float("nan"), "std_error": float("nan"), "count": 0}
    p = some / count
    return {"mean": p, "std_error": float(np.sqrt(p * (1 - p) / count)), "count": count}


class LoopPolygons(NamedTuple):
    """Loops as polygons: corners `[offsets[l] : offsets[l + 1]]` and their grains, by number."""

    offsets: Integers
    corners: Floats
    grains: Integers


def loop_polygons(
    graph: GrainGraph, faces: Faces, picked: Integers | slice = slice(None)
) -> LoopPolygons:
    """Polygons of the loops, or of those picked.

    They are unrolled through periodic images from each loop's first grain.
    """
    loops = faces.loops[picked]
    order = faces.order[loops]
    offsets = np.concatenate([[0], np.cumsum(order)])
    first = faces.offsets[loops] - offsets[:-1]
    at = np.repeat(first, order) + np.arange(offsets[-1])
    grains = faces.grains[at]
    x = graph.x[grains]
    if graph.cell is not None and graph.images is not None and len(at):
        image = graph.images[faces.contacts[at]] * np.where(faces.forward[at], 1, -1)[:, None]
        passed = np.cumsum(image, axis=0) - image
        passed -= np.repeat(passed[offsets[:-1]], order, axis=0)
        x = x + passed @ graph.cell.T
    return LoopPolygons(offsets, x, grains)


def loops_for_map(snapshot: Snapshot, table: Mapping[str, Any], **series: Any) -> list[LoopsForMap]:
    """Map of the loops of a snapshot with the columns of a table; none beyond `MOST_LOOPS`."""
    faces = snapshot.faces
    if len(faces.loops) > MOST_LOOPS:
        return []
    offsets, corners, grains = loop_polygons(snapshot.graph, faces)
    columns = {name: np.asarray(values) for name, values in table.items() if name != "grains"}
    return [LoopsForMap(offsets, corners, snapshot.ids[grains], columns, **series)]


def write_paraview(
    folder: Path, snapshot: Snapshot, table: Mapping[str, Any], provenance: Mapping[str, Any]
) -> None:
    """Write `loops.vtp`, one polygon per loop, and `contacts.vtp`, one line per contact.

    Both are unrolled across periodic borders; the provenance is field data, as JSON.
    """
    source, graph, faces = as_json(provenance), snapshot.graph, snapshot.faces
    offsets, corners, grains = loop_polygons(graph, faces)
    numbered = {name: np.asarray(v) for name, v in table.items() if name != "grains"}
    if "region" in numbered:
        numbered["region"] = np.unique(numbered["region"], return_inverse=True)[1]
    write_polydata(
        folder / "loops.vtp",
        points=corners,
        offsets=offsets,
        lines=False,
        cell_data={name: v for name, v in numbered.items() if v.dtype.kind in "iufb"},
        point_data={"grain": snapshot.ids[grains]},
        source=source,
    )
    start, branches = graph.x[graph.contacts[:, 0]], graph.branches
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
    with library(path.name, "vtk"):
        from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
        from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
        from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter
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
