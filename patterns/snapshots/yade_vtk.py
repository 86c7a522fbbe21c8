"""VTK files of Yade: `VTKRecorder` and `export.VTKExporter`, read by the library vtk."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from loops.arrays import Floats, Integers
from patterns.snapshots.files import PACKING, open_text, require_line_end, whole_file
from patterns.snapshots.frame import Frame, Frames, Moment, Source, contacts_path, frame_of_tables
from patterns.snapshots.geometry import index_of
from patterns.snapshots.tables import Table

LEGACY = b"# vtk DataFile"
SECTIONS = {
    *(b"ASCII", b"DATASET", b"POINTS", b"LINES", b"POINT_DATA", b"CELL_DATA"),
    *(b"SCALARS", b"VECTORS", b"LOOKUP_TABLE"),
}
COUNTS = re.compile(rb"^(POINTS|LINES|POINT_DATA|CELL_DATA)[ \t]+(\S.*)$", re.M)
REMEDY = "Write or copy it again."
TAG = re.compile(
    rb"<(PointData|CellData|Points|Cells|Verts|Lines|Strips|Polys|DataArray)\b([^>]*)>"
)
ATTRIBUTE = re.compile(rb'(\w+)="([^"]*)"')


@dataclass(frozen=True, eq=False)
class VtkData:
    """Points, lines and arrays of a VTK file."""

    path: Path
    points: Floats
    lines: Integers
    points_data: dict[str, NDArray[Any]] = field(default_factory=dict)
    lines_data: dict[str, NDArray[Any]] = field(default_factory=dict)


def read_vtk(path: Path) -> VtkData:
    """Read a `.vtu` or `.vtp` file of any encoding, or legacy polydata in text; plain or gzip."""
    content = bytes(open_text(path))
    legacy = content.startswith(LEGACY)
    polydata = legacy or b"UnstructuredGrid" not in content[:512]
    arrays: int | None = None
    if legacy:
        *promised, arrays = _check_legacy(path, content)
    else:
        # Numbers of points and lines in the header.
        piece = re.search(rb"<Piece\b([^>]*)>", content)
        counts = [
            re.search(rb"\b" + name + rb'="(\d{1,15})\s*"', piece.group(1)) if piece else None
            for name in (b"NumberOfPoints", b"NumberOf(?:Lines|Cells)")
        ]
        promised = [int(count.group(1)) for count in counts if count]
        if b"</VTKFile>" not in content[-64:] or len(promised) < 2:
            raise _damaged(path)
        if max(promised) > PACKING * len(content):
            received = f"{promised[0]} points and {promised[1]} lines"
            raise InputError(str(path), received, "what fits", REMEDY)
        with whole_file(path):
            _check_arrays(path, content, *promised)
    data = _read_with_vtk(path, content, polydata, legacy)
    if data.GetNumberOfPoints() != promised[0] or data.GetNumberOfCells() < promised[1]:
        raise _damaged(path)
    from vtkmodules.util.numpy_support import vtk_to_numpy

    def arrays_of(holder: Any) -> dict[str, NDArray[Any]]:
        found = [holder.GetArray(k) for k in range(holder.GetNumberOfArrays())]
        named = {a.GetName(): vtk_to_numpy(a) for a in found if a is not None}
        # Whole numbers stay: ids may have more digits than a float.
        return {n: a if a.dtype.kind in "iu" else a.astype(float) for n, a in named.items()}

    points, lines = np.zeros((0, 3)), np.zeros((0, 2), dtype=np.int64)
    if data.GetNumberOfPoints():
        points = vtk_to_numpy(data.GetPoints().GetData()).astype(float)
    if polydata and promised[1]:
        joined = data.GetLines()
        lines = vtk_to_numpy(joined.GetConnectivityArray()).astype(np.int64)
        starts = vtk_to_numpy(joined.GetOffsetsArray())
        sound = len(lines) == 2 * promised[1] and (np.diff(starts) == 2).all()
        if not sound or lines.max() >= len(points) or lines.min() < 0:
            raise InputError(str(path), "lines that do not join two of its points", "pairs", REMEDY)
        lines = lines.reshape(-1, 2)
    found = arrays_of(data.GetPointData()), arrays_of(data.GetCellData())
    if arrays is not None and arrays != len(found[0]) + len(found[1]):
        raise InputError(str(path), "arrays that break off", f"{arrays} whole ones", REMEDY)
    return VtkData(path, points, lines, *found)


def _damaged(path: Path) -> InputError:
    return InputError(str(path), "a damaged or truncated VTK file", "a whole one", REMEDY)


def _check_legacy(path: Path, content: bytes) -> tuple[int, int, int]:
    """Points, lines and arrays of legacy polydata; counts must fit, vtk allocates what they say."""
    require_line_end(str(path), content, len(content))
    if b"\nASCII\n" not in content[:512].replace(b"\r", b""):
        received = "no ASCII legacy VTK file"
        remedy = "Write it as text, see docs/yade.md."
        raise InputError(str(path), received, "polydata as export.VTKExporter writes it", remedy)
    words = re.findall(rb"^([A-Z_]{4,})\b", content, re.M)
    counts = {kind: numbers.split() for kind, numbers in COUNTS.findall(content)}
    # After the number of points follows their type.
    whole = [
        n for kind, found in counts.items() for n in (found[:1] if kind != b"LINES" else found)
    ]
    sound = all(n.isdigit() and int(n) <= len(content) for n in whole)
    if b"POINTS" not in counts or not set(words) <= SECTIONS or not sound:
        raise _damaged(path)
    lines = int(counts[b"LINES"][0]) if b"LINES" in counts else 0
    return int(counts[b"POINTS"][0]), lines, words.count(b"SCALARS") + words.count(b"VECTORS")


def _read_with_vtk(path: Path, content: bytes, polydata: bool, legacy: bool) -> Any:
    """Dataset of a file; messages of vtk are kept off the screen, damage is found by the counts."""
    try:
        from vtkmodules.vtkCommonCore import vtkObject
        from vtkmodules.vtkIOLegacy import vtkPolyDataReader
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader
    except ImportError:
        raise InputError(
            str(path), "a VTK file", "the library vtk", "Install it: pip install vtk."
        ) from None
    reader: Any = vtkXMLPolyDataReader() if polydata else vtkXMLUnstructuredGridReader()
    shown = vtkObject.GetGlobalWarningDisplay()
    vtkObject.SetGlobalWarningDisplay(0)
    try:
        if legacy:
            reader = vtkPolyDataReader()
            reader.ReadAllScalarsOn()
            reader.ReadAllVectorsOn()
        reader.SetReadFromInputString(True) if legacy else reader.ReadFromInputStringOn()
        reader.SetInputString(content)
        reader.Update()
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)
    if reader.GetErrorCode():
        raise _damaged(path)
    return reader.GetOutput()


def _check_arrays(path: Path, content: bytes, points: int, lines: int) -> None:
    """Compare the lengths of arrays with the counts, which vtk itself trusts."""
    wanted = {b"PointData": points, b"Points": points, b"CellData": lines}
    section = b""
    for match in TAG.finditer(content.partition(b"<AppendedData")[0]):
        kind, attributes = match.group(1), dict(ATTRIBUTE.findall(match.group(2)))
        if kind != b"DataArray":
            section = kind
            continue
        body = content[match.end() : content.find(b"<", match.end())]
        numbers = _numbers(content, attributes, body)
        rows = numbers // int(attributes.get(b"NumberOfComponents", b"1"))
        if numbers > PACKING * len(content):
            raise ValueError(f"an array of {numbers} numbers")
        if rows == wanted.get(section, rows):
            continue
        values = f"{rows} values of {attributes.get(b'Name', b'').decode(errors='replace')}"
        if section != b"CellData":
            raise InputError(str(path), f"{points} points and {values}", "a value a point", REMEDY)
        raise InputError(
            str(path),
            f"{lines} lines and {values}",
            "a value a line",
            "In a periodic cell Yade's recorder writes two values for a contact across the border "
            "and no line, so that values can't be assigned to lines: export tables from inside "
            "Yade, see docs/yade.md.",
        )


def _numbers(content: bytes, attributes: dict[bytes, bytes], body: bytes) -> int:
    """Number of values in an array, from the header of its block."""
    if attributes.get(b"format") == b"ascii":
        return len(body.split())
    start = re.search(rb"<VTKFile\b([^>]*)>", content)
    file = dict(ATTRIBUTE.findall(start.group(1))) if start else {}
    raw = False
    if attributes.get(b"format") == b"appended":
        section = content.find(b"<AppendedData")
        raw = b'"raw"' in content[section : section + 64]
        offset = content.find(b"_", section + 13) + 1 + int(attributes[b"offset"])
        body = content[offset : offset + 64]
    order = "<" if file.get(b"byte_order") != b"BigEndian" else ">"
    word = np.dtype(f"{order}u{8 if file.get(b'header_type') == b'UInt64' else 4}")
    size = word.itemsize * (3 if b"compressor" in file else 1)
    header = body if raw else base64.b64decode(body.strip()[: -(-size // 3) * 4])
    if len(header) < size:
        raise ValueError("an array without its header")
    words = [int(w) for w in np.frombuffer(header[:size], word)]
    length = words[0]
    if len(words) == 3:
        blocks, block, last = words
        if blocks > len(content):
            raise ValueError(f"an array of {blocks} blocks")
        length = blocks * block if last == 0 else (blocks - 1) * block + last
    # Types are Float64, Int32, ...
    return length // max(1, int(re.sub(rb"\D", b"", attributes[b"type"])) // 8)


def is_yade_vtk(path: Path, head: bytes) -> bool:
    """Whether this is a VTK file of one of the kinds that Yade writes."""
    if head.startswith(LEGACY):
        return True
    kinds = (b"UnstructuredGrid", b"PolyData", b"vtkMultiBlockDataSet")
    return b"<VTKFile" in head and any(b'type="' + kind + b'"' in head for kind in kinds)


def yade_vtk_frames(source: Source) -> Frames:
    """The one snapshot of `...spheres.N.vtu` and `...intrs.N.vtp` beside it, or a `.vtm` of both.

    Or of `...-spheres-N.vtk` and `...-intrs-N.vtk`.
    """

    def read() -> Frame:
        path = source.path
        name = path.name.lower().removesuffix(".gz")
        if name.endswith(".vtk"):
            contacts = _contacts_path(source, ".vtk")
            return exporter_frame(source, read_vtk(path), read_vtk(contacts))
        if name.endswith(".vtm"):
            names = re.findall(rb'\bfile="([^"]+)"', bytes(open_text(path)))
            files = [path.parent / name.decode(errors="replace") for name in names]
            spheres = [file for file in files if file.suffix == ".vtu"]
            lines = [file for file in files if file.suffix == ".vtp"]
            if len(spheres) != 1 or len(lines) != 1:
                received = f"{len(spheres)} .vtu and {len(lines)} .vtp blocks"
                remedy = "Record ['spheres', 'intr'] alone with multiblock=True."
                raise InputError(str(path), received, "the spheres and the interactions", remedy)
            path, contacts = spheres[0], lines[0]
        elif name.endswith(".vtu"):
            contacts = _contacts_path(source, ".vtp")
        else:
            raise InputError(
                str(path),
                "a file of lines",
                "the file of the spheres, ...spheres.N.vtu",
                "Name it.",
            )
        return recorder_frame(source, read_vtk(path), read_vtk(contacts))

    return [Moment(read)]


def _contacts_path(source: Source, ending: str) -> Path:
    """The file of interactions beside that of the spheres, gzip or not."""
    stem = re.sub(r"\.(vtu|vtk)(\.gz)?$", "", source.path.name, flags=re.I)
    wanted = stem.replace("spheres", "intrs") + ending
    hint = "Record 'intr' too, or name the file of the contacts."
    names = [wanted] if "spheres" in stem else []
    return contacts_path(source, names, "no such file beside it", wanted, hint)


def recorder_frame(source: Source, spheres: VtkData, lines: VtkData) -> Frame:
    """Frame of `VTKRecorder`, whose lines join the spheres in contact."""
    grains, notes = grains_of(spheres, "radii")
    ends = line_ends(spheres, lines)
    refuse_strays(lines, ends)
    notes += [
        "VTKRecorder: no stiffness, no friction, no wall contacts, centres in single precision"
    ]
    ids = grains["id"]
    contacts: PlainColumns = {"id1": ids[ends[:, 0]], "id2": ids[ends[:, 1]]}
    normal = lines.lines_data.get("forceN")
    if normal is not None and len(ends):
        if normal.ndim != 1 or not np.isfinite(normal).all():
            received = "values that are no finite forces"
            raise InputError(str(lines.path), received, "one forceN a line", "Record again.")
        contacts["fn"] = normal
        notes.append(
            f"VTKRecorder has the size of shear forces without their direction. {EXPORT_TABLES}"
        )
    return make_frame(source, (spheres, lines), grains, contacts, notes)


PlainColumns = dict[str, NDArray[np.generic]]
EXPORT_TABLES = "Export tables from inside Yade instead, see docs/yade.md."


def grains_of(piece: VtkData, radius: str) -> tuple[PlainColumns, list[str]]:
    """Plain columns of the grains."""
    if radius not in piece.points_data or not len(piece.points):
        received = f"points with {', '.join(piece.points_data) or 'no arrays'}"
        remedy = "Give the file of the spheres; the recorder 'spheres' writes them."
        raise InputError(str(piece.path), received, f"spheres with {radius!r}", remedy)
    x = piece.points
    ids = piece.points_data.get("id")
    notes = [] if ids is not None else ["no ids in the file: grains are numbered in its order"]
    if ids is not None:
        ids = Table(piece.path, {"id": ids}).integers("id")
    columns: PlainColumns = {"id": np.arange(len(x)) if ids is None else ids}
    columns |= {"x": x[:, 0], "y": x[:, 1], "z": x[:, 2], "radius": piece.points_data[radius]}
    return columns, notes


def line_ends(spheres: VtkData, lines: VtkData) -> Integers:
    """Spheres at the ends of the lines, found by their coordinates."""
    ends = index_of(_keys(spheres.points), _keys(lines.points))[lines.lines]
    if ((ends[:, 0] == ends[:, 1]) & (ends[:, 0] >= 0)).any():
        received = "a line from a sphere to itself"
        remedy = "Export it again; two spheres at one place have no contact direction."
        raise InputError(str(lines.path), received, "lines between distinct centres", remedy)
    return ends


def _keys(points: Floats) -> Integers:
    """One number for the bits of x and y: both files print the same ones for the same body."""
    bits = np.ascontiguousarray(points[:, :2] + 0.0, dtype=np.float32).view(np.uint32)
    return (bits[:, 0].astype(np.uint64) << np.uint64(32) | bits[:, 1]).view(np.int64)


def refuse_strays(lines: VtkData, ends: Integers) -> None:
    """Raise `InputError` if a line ends at no sphere."""
    if len(ends) and (ends < 0).all():
        expected, remedy = "files of one snapshot", "Give the two files of the same iteration."
        raise InputError(str(lines.path), "lines that end at none of the spheres", expected, remedy)
    strays = int(np.count_nonzero((ends < 0).any(axis=1)))
    if strays:
        raise InputError(
            str(lines.path),
            f"{strays} of {len(ends)} lines that end at no sphere",
            "contacts between spheres of the other file",
            "Contacts across a periodic border or with walls can't be recognised here, and files "
            f"of two snapshots look like this too. {EXPORT_TABLES}",
        )


def make_frame(
    source: Source,
    pieces: tuple[VtkData, VtkData],
    grains: PlainColumns,
    contacts: PlainColumns,
    notes: Sequence[str],
) -> Frame:
    """Frame of the columns of two files; its step is the last number in the name."""
    tables = {"grains": Table(pieces[0].path, grains), "contacts": Table(pieces[1].path, contacts)}
    numbers = re.findall(r"\d+", source.path.name)
    step = float(numbers[-1]) if numbers else None
    told = {"notes": notes, "shear_increment": "radii", "has_types": True}
    return frame_of_tables(source, tables, step=step, **told)


# Names under which the forces are looked for; others come by the column map.
NORMAL_NAMES = ("fn", "normalForce")
SHEAR_NAMES = ("fs", "shearForce")
WALL_ID = -1
PARALLEL = 1e-3


def exporter_frame(source: Source, spheres: VtkData, lines: VtkData) -> Frame:
    """Frame of `exportSpheres` and `exportInteractions`; a vector `A` is `A_x, A_y, A_z`.

    Lines that begin at no sphere are contacts with walls, whose normal is that of their normal
    force; without that force they are refused.
    """
    grains, notes = grains_of(spheres, "radius")
    notes.append("VTKExporter: numbers of six digits, too coarse for overlaps")
    ends = line_ends(spheres, lines)
    vectors = {name: v[:, :2] for name, v in lines.lines_data.items() if v.ndim == 2}
    columns = dict(source.columns)
    normal, shear = (
        _named(columns.get("fn"), NORMAL_NAMES, vectors),
        _named(None, SHEAR_NAMES, vectors),
    )
    force = vectors.get(normal)
    branch = _branches(lines, ends, spheres, force)
    n = branch / np.hypot(*branch.T)[:, None]
    ids = np.append(grains["id"], WALL_ID)
    contacts: PlainColumns = {"id1": ids[ends[:, 0]], "id2": ids[ends[:, 1]]}
    for name, values in lines.lines_data.items():
        if values.ndim == 1:
            contacts[name] = values
        else:
            contacts |= {f"{name}_{axis}": values[:, k] for k, axis in enumerate("xyz")}
    contacts |= {"nx": n[:, 0], "ny": n[:, 1], "branch_x": branch[:, 0], "branch_y": branch[:, 1]}
    if force is not None:
        columns.pop("fn", None)
        contacts["fn"] = np.einsum("ck,ck->c", force, n)
        notes.append(f"fn from the vectors {normal!r}, along the line of centres")
    if shear in vectors and not {"fsx", "fx_on_2"} & set(columns):
        contacts |= {"fsx": vectors[shear][:, 0], "fsy": vectors[shear][:, 1]}
        notes.append(f"shear force on grain 2 from the vectors {shear!r}")
    if (ends < 0).any():
        types = np.append(np.zeros(len(grains["id"])), 1)
        grains = {key: np.append(v, WALL_ID if key == "id" else 0) for key, v in grains.items()}
        grains["type"] = types
        notes.append("lines that begin at no sphere are taken as contacts with walls")
    return make_frame(replace(source, columns=columns), (spheres, lines), grains, contacts, notes)


def _named(given: str | None, names: tuple[str, ...], vectors: Mapping[str, Floats]) -> str:
    wanted = names if given is None else (given,)
    return next((name for name in wanted if name in vectors), "")


def _branches(lines: VtkData, ends: Integers, spheres: VtkData, force: Floats | None) -> Floats:
    """From centre to centre; with walls along the normal force, from the wall to the centre."""
    x = spheres.points[:, :2]
    branch = x[ends[:, 1]] - x[ends[:, 0]]
    wall = ends[:, 0] < 0
    if not wall.any() and (ends >= 0).all():
        return branch
    if force is None or (ends[:, 1] < 0).any():
        refuse_strays(lines, ends)
        return branch
    length = np.hypot(*force[wall].T)
    push = force[wall] / np.where(length > 0, length, 1.0)[:, None]
    along = np.diff(lines.points[lines.lines[wall], :2], axis=1)[:, 0]
    turned = np.abs(push[:, 0] * along[:, 1] - push[:, 1] * along[:, 0])
    if (turned <= PARALLEL * np.hypot(*along.T)).all() or not length.all():
        # Along the line of centres: these are grains, on the other side of a periodic border.
        refuse_strays(lines, ends)
    # Walls and facets are where they lie; the position of a box is inside it, beyond the radius.
    reach = np.abs(np.einsum("ck,ck->c", push, along))
    branch[wall] = push * np.minimum(reach, spheres.points_data["radius"][ends[wall, 1]])[:, None]
    return branch
