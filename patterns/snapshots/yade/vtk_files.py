"""Points, lines and arrays of the VTK files that Yade writes."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from loops import InputError
from loops.arrays import Floats, Integers
from patterns.snapshots.text import PACKING, open_text, require_line_end, whole_file

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
    """What a VTK file holds."""

    path: Path
    points: Floats
    lines: Integers
    points_data: dict[str, Floats] = field(default_factory=dict)
    lines_data: dict[str, Floats] = field(default_factory=dict)


def read_vtk(path: Path) -> VtkData:
    """Read a `.vtu` or `.vtp` file of any encoding, or legacy polydata in text; plain or gzip."""
    content = bytes(open_text(path))
    legacy = content.startswith(LEGACY)
    polydata = legacy or b"UnstructuredGrid" not in content[:512]
    arrays: int | None = None
    if legacy:
        *promised, arrays = _check_legacy(path, content)
    else:
        promised = [*_promised(path, content)]
        with whole_file(path):
            _check_arrays(path, content, *promised)
    data = _read_with_vtk(path, content, polydata, legacy)
    if data.GetNumberOfPoints() != promised[0] or data.GetNumberOfCells() < promised[1]:
        raise _damaged(path)
    from vtkmodules.util.numpy_support import vtk_to_numpy

    def arrays_of(holder: Any) -> dict[str, Floats]:
        found = [holder.GetArray(k) for k in range(holder.GetNumberOfArrays())]
        return {a.GetName(): vtk_to_numpy(a).astype(float) for a in found if a is not None}

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
        remedy = "Write .vtu and .vtp by VTKRecorder, or see docs/yade.md."
        raise InputError(str(path), received, "polydata as export.VTKExporter writes it", remedy)
    words = re.findall(rb"^([A-Z_]{4,})\b", content, re.M)
    counts = {kind: numbers.split() for kind, numbers in COUNTS.findall(content)}
    # Of points the type follows.
    whole = [
        n for kind, found in counts.items() for n in (found[:1] if kind != b"LINES" else found)
    ]
    sound = all(n.isdigit() and int(n) <= len(content) for n in whole)
    if b"POINTS" not in counts or not set(words) <= SECTIONS or not sound:
        raise _damaged(path)
    lines = int(counts[b"LINES"][0]) if b"LINES" in counts else 0
    return int(counts[b"POINTS"][0]), lines, words.count(b"SCALARS") + words.count(b"VECTORS")


def _read_with_vtk(path: Path, content: bytes, polydata: bool, legacy: bool) -> Any:
    """Dataset of a file; vtk reports on the screen, here its silence and the counts must do."""
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


def _promised(path: Path, content: bytes) -> tuple[int, int]:
    """Points and lines that the header speaks of."""
    piece = re.search(rb"<Piece\b([^>]*)>", content)
    counts = [
        re.search(rb"\b" + name + rb'="(\d{1,15})\s*"', piece.group(1)) if piece else None
        for name in (b"NumberOfPoints", b"NumberOf(?:Lines|Cells)")
    ]
    if b"</VTKFile>" not in content[-64:] or counts[0] is None or counts[1] is None:
        raise _damaged(path)
    points, lines = int(counts[0].group(1)), int(counts[1].group(1))
    if max(points, lines) > PACKING * len(content):
        raise InputError(str(path), f"{points} points and {lines} lines", "what fits", REMEDY)
    return points, lines


def _check_arrays(path: Path, content: bytes, points: int, lines: int) -> None:
    """Compare what arrays hold with the counts: vtk takes what it needs, or allocates at will."""
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
        if rows != wanted.get(section, rows):
            _refuse_rows(path, section, rows, wanted[section], attributes.get(b"Name", b""))


def _refuse_rows(path: Path, section: bytes, rows: int, wanted: int, name: bytes) -> None:
    values = f"{rows} values of {name.decode(errors='replace')}"
    if section != b"CellData":
        raise InputError(str(path), f"{wanted} points and {values}", "a value a point", REMEDY)
    raise InputError(
        str(path),
        f"{wanted} lines and {values}",
        "a value a line",
        "In a periodic cell Yade's recorder writes two values for a contact across the border and "
        "no line, so that values and lines can't be told apart: export tables from inside Yade, "
        "see docs/yade.md.",
    )


def _numbers(content: bytes, attributes: dict[bytes, bytes], body: bytes) -> int:
    """How many numbers an array holds, from the header of its block."""
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
