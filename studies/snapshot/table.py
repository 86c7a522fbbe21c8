"""The loops of a snapshot: one row per loop, and their polygons for figures, pages and ParaView."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from loops import (
    Faces,
    GrainGraph,
    InputError,
    LoopBatch,
    Regime,
    loop_batches,
    love_weber_stress,
    macroscopic_tangent,
    polygon_area,
    polygon_centroid,
    polygon_perimeter,
    polygon_shape,
)
from loops.arrays import Flags, Floats, Integers, available_cores
from loops.compiled import use_compiled
from loops.loop_batches import TANGENTS, compiled_packing
from patterns import Snapshot
from stability.verdict import loop_spectra, loop_stability
from studies.output import Columns, as_arrow, as_json
from studies.study import MOST_LOOPS, LoopsForMap

CLOSURES: tuple[Literal["affine", "traction"], ...] = ("affine", "traction")
SHAPE = ("x", "y", "area", "perimeter", "elongation", "orientation")
STRESS_COLUMNS = ("stress_11", "stress_12", "stress_21", "stress_22", "pressure", "deviator")
EIGENVALUES = ("lambda_min", "lambda_mid", "lambda_max")
STABILITY = (*EIGENVALUES, *("unstable_fraction", "cone_opening", "soft_angle"))
# Traction closure with free spins: the loop cut out of its packing.
FREE = "traction_free"
MECHANICS = (
    "sliding_contacts",
    *STRESS_COLUMNS,
    *(f"{closure}_{name}" for closure in CLOSURES for name in STABILITY),
    "traction_condition",
    *(f"{FREE}_{name}" for name in EIGENVALUES),
)
Wanted = Literal["all", "tangents", "free"]  # columns of loops that closures compute
LOOPS_AT_A_TIME = 2**13  # loops that a thread computes at a time

# Loops of this order and beyond form one group, in every table, figure and report.
LAST_ORDER = 8
GROUPS = (*map(str, range(3, LAST_ORDER)), f"{LAST_ORDER}+")


def loop_columns(
    snapshot: Snapshot, *, compiled: bool | None = None, threads: int | None = None
) -> dict[str, Any]:
    """Table of the loops of a snapshot, one row per loop in the order of `snapshot.faces.loops`.

    - `loop`, `order`; centroid `x`, `y`, `area`, `perimeter`; `elongation` and `orientation` of the
      long axis (degrees in (-90, 90] from axis 1);
    - `grains`: ids in order, counter-clockwise.

    Of a snapshot with forces, besides:

    - `sliding_contacts`; the loop's Love-Weber stress `stress_11` to `stress_22` over its polygon,
      each contact shared half and half between its two loops, row = force, column = branch;
      its `pressure` and `deviator` (half the difference of the principal stresses);
    - for either closure, with spins blocked and contacts flagged sliding in their sliding block:
      `*_lambda_min`, `*_lambda_mid`, `*_lambda_max`, the eigenvalues of Ks over the mean kn, in the
      symmetric subspace; `*_unstable_fraction`, the share of its directions with negative
      second-order work; `*_cone_opening`, that of the cone in the plane of (11, 22) strains
      (degrees, 0 if there is none); `*_soft_angle`, the direction of the mode of the smallest
      eigenvalue: the axis of compression, with the sign that makes the principal strain of larger
      size a compression (degrees in (-90, 90]; of a pure shear either axis);
    - `traction_condition`, see `MacroTangent`;
    - `traction_free_lambda_min`, `*_mid`, `*_max`: the same eigenvalues under the traction closure
      with spins free, as if the loop were cut out of its packing.

    Eigenvalues, fractions and angles are nan where the tangent's error leaves no sign: rounding, or
    the lever arms of even loops with free spins (`MacroTangent.sensitivity`).
    """
    faces = snapshot.faces
    count = len(faces.loops)
    table: dict[str, Any] = {"loop": np.arange(count), "order": faces.order[faces.loops]}
    for name in (*SHAPE, *(MECHANICS if snapshot.mechanical else ())):
        table[name] = np.empty(count, dtype=np.int64 if name == "sliding_contacts" else np.float64)
    by_kernels = use_compiled(compiled, snapshot.graph.contact_count)
    for at, columns in _parts(snapshot, by_kernels, threads or available_cores()):
        for name, values in columns.items():
            table[name][at] = values
    ids = snapshot.ids[faces.grains[np.repeat(faces.row >= 0, faces.order)]]
    offsets = np.concatenate([[0], np.cumsum(faces.order[faces.loops])])
    table["grains"] = pa.LargeListArray.from_arrays(as_arrow(offsets), as_arrow(ids))
    return table


def _parts(snapshot: Snapshot, compiled: bool, threads: int) -> Iterator[tuple[Any, Columns]]:
    """Rows and columns: by the kernels block by block, by the closures order by order.

    Closures compute the loops that the kernels leave as ill-conditioned, or all without kernels.
    """
    loops = snapshot.faces.loops
    tasks: list[tuple[Integers, Wanted]] = [(loops, "all")]
    with ThreadPoolExecutor(threads) as pool:
        if compiled:
            law, regime = snapshot.mechanics() if snapshot.mechanical else (None, None)
            packing = compiled_packing(snapshot.graph, snapshot.faces, law, regime, threads)
            kn = np.nan if law is None else snapshot.mean_kn
            work = partial(_compiled_columns, packing, loops, kn)
            starts = range(0, len(loops), LOOPS_AT_A_TIME)
            blocks = [slice(start, start + LOOPS_AT_A_TIME) for start in starts]
            poor = np.zeros((2, len(loops)), dtype=bool)
            for block, found in zip(blocks, pool.map(work, blocks), strict=True):
                columns, poor[:, block] = found
                yield block, columns
            blocked, free = poor
            # Most have a gear mode, which only spins that are free have.
            tasks = [(some, "tangents") for some in np.array_split(loops[blocked], threads)]
            tasks += [(some, "free") for some in np.array_split(loops[free & ~blocked], threads)]
        for part in pool.map(lambda task: list(_by_closures(snapshot, *task)), tasks):
            yield from part


def _by_closures(
    snapshot: Snapshot, loops: Integers, wanted: Wanted
) -> Iterator[tuple[Integers, Columns]]:
    """Rows and columns of some loops, order by order, in numpy."""
    for batch in loop_batches(snapshot.graph, snapshot.faces, loops=loops):
        columns = _shapes(batch) if wanted == "all" else {}
        if snapshot.mechanical:
            law, regime = snapshot.mechanics()
            own, kn, regimes = law.take(batch.contacts), snapshot.mean_kn, regime[batch.contacts]
            if wanted == "all":
                columns["sliding_contacts"] = np.count_nonzero(regimes == Regime.SLIDING, axis=1)
                columns |= _stress(love_weber_stress(batch.graph).reshape(-1, 4))
            for name, (closure, spins) in zip((*CLOSURES, FREE), TANGENTS, strict=True):
                if wanted == "free" and name != FREE:
                    continue
                tangent = macroscopic_tangent(
                    batch.graph, own, closure, spins=spins, regime=regimes
                )
                over_kn = tangent.matrix / kn, tangent.error / kn
                columns |= _judged(name, *over_kn, compiled=False)
                if name == "traction":
                    columns["traction_condition"] = tangent.condition
        yield batch.row, columns


def _shapes(batch: LoopBatch) -> Columns:
    """Columns `SHAPE` of loops of one order."""
    x = batch.graph.x
    centre = polygon_centroid(x) + batch.origin
    elongation, orientation = polygon_shape(x)
    long_axis = elongation, np.degrees(orientation)
    values = (*centre.T, polygon_area(x), polygon_perimeter(x), *long_axis)
    return dict(zip(SHAPE, values, strict=True))


def _compiled_columns(
    packing: Any, loops: Integers, kn: float, block: slice
) -> tuple[Columns, Flags]:
    """Columns of a block of loops, tangents over `kn`, and flags of the ill-conditioned loops."""
    from loops.compiled import given
    from loops.compiled import tangents as kernel

    chosen = given(loops[block], np.int64)
    shape = packing.shapes(chosen).T
    columns: Columns = dict(zip(SHAPE, shape, strict=False))
    columns["orientation"] = np.degrees(columns["orientation"])
    if packing.law is None:
        return columns, np.zeros((2, len(chosen)), dtype=bool)
    columns["sliding_contacts"] = shape[kernel.SLIDING]
    columns |= _stress(shape[kernel.S11 : kernel.S22 + 1].T)
    (affine, traction, free), poor = packing.tangents(chosen)
    columns |= _judged("affine", affine.matrix / kn, affine.error / kn, compiled=True)
    # Both closures give the same tangent for a triangle.
    own = packing.faces[0][chosen + 1] - packing.faces[0][chosen] != 3
    over_kn = traction.matrix[own] / kn, traction.error[own] / kn
    for name, values in _judged("traction", *over_kn, compiled=True).items():
        columns[name] = columns[name.replace("traction", "affine")].copy()
        columns[name][own] = values
    columns["traction_condition"] = traction.condition
    return columns | _judged(FREE, free.matrix / kn, free.error / kn, compiled=True), poor


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

    Loops and contacts that cross the border of a periodic cell are unrolled. Cell data of the
    polygons are the columns of the table, point data the ids of the grains; cell data of the
    lines are the ids of both grains, the branch length and, where there are forces, N, T and
    whether the contact slides. The provenance is field data of both, as JSON.
    """
    source, graph, faces = as_json(provenance), snapshot.graph, snapshot.faces
    offsets, corners, grains = loop_polygons(graph, faces)
    write_polydata(
        folder / "loops.vtp",
        points=corners,
        offsets=offsets,
        lines=False,
        cell_data={name: np.asarray(v) for name, v in table.items() if name != "grains"},
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
