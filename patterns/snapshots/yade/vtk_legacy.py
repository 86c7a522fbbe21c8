"""The legacy `.vtk` polydata of Yade's `export.VTKExporter`: text, arrays named by the user."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.tables import Table
from patterns.snapshots.text import Text, open_text, read_body
from patterns.snapshots.yade.vtk_files import Piece

Floats = NDArray[np.float64]

START = b"# vtk DataFile"
REMEDY = "Export or copy it again."
# Section headers stand alone on lines that begin with a capital; all else is numbers.
SECTION = re.compile(
    rb"^(POINTS|LINES|POINT_DATA|CELL_DATA|SCALARS|VECTORS|TENSORS|LOOKUP_TABLE)[ ](.*)\n", re.M
)
WIDTHS = {"SCALARS": 1, "VECTORS": 3}


def read_legacy(path: Path) -> Piece:
    """Read a legacy polydata file as VTKExporter writes it."""
    text = open_text(path)
    if text[: len(START)] != START or b"\nASCII\n" not in text[:512].replace(b"\r", b""):
        raise InputError(
            str(path),
            "no ASCII legacy VTK file",
            "polydata as export.VTKExporter writes it",
            "Write .vtu and .vtp by VTKRecorder, or see docs/yade.md.",
        )
    points, lines = np.zeros((0, 3)), np.zeros((0, 2), dtype=np.int64)
    data: dict[str, dict[str, Floats]] = {"POINT_DATA": {}, "CELL_DATA": {}}
    holder, rows, name = data["POINT_DATA"], 0, ""
    for kind, words, span in _sections(path, text):
        if kind == "POINTS":
            points = _block(path, text, span, _count(path, kind, words), 3)
        elif kind == "LINES":
            joined = _block(path, text, span, _count(path, kind, words), 3)
            lines = joined[:, 1:].astype(np.int64)
            if (joined[:, 0] != 2).any() or (lines < 0).any() or (lines >= len(points)).any():
                raise InputError(str(path), "lines that join no two of its points", "pairs", REMEDY)
        elif kind in data:
            holder, rows = data[kind], _count(path, kind, words)
        elif kind == "LOOKUP_TABLE":
            holder[name] = _block(path, text, span, rows, 1)[:, 0]
        elif kind == "VECTORS":
            holder[words[0]] = _block(path, text, span, rows, 3)
        elif kind == "SCALARS":
            name = words[0]
    return Piece(path, points, lines, data["POINT_DATA"], data["CELL_DATA"])


def _sections(path: Path, text: Text) -> list[tuple[str, list[str], tuple[int, int]]]:
    """Kind, words and bytes of the numbers of each section."""
    found = list(SECTION.finditer(text))
    if not found:
        raise InputError(str(path), "a header alone", "VTK polydata", REMEDY)
    stops = [match.start() for match in found[1:]] + [len(text)]
    sections = []
    for match, stop in zip(found, stops, strict=True):
        words = match.group(2).decode(errors="replace").split()
        if not words:
            raise InputError(str(path), "a section without a name", "VTK polydata", REMEDY)
        sections.append((match.group(1).decode(), words, (match.end(), stop)))
    return sections


def _count(path: Path, kind: str, words: list[str]) -> int:
    if not words[0].isdecimal():
        raise InputError(str(path), f"{kind} {words[0]}", "a number of rows", REMEDY)
    return int(words[0])


def _block(path: Path, text: Text, span: tuple[int, int], rows: int, width: int) -> Floats:
    start, stop = span
    # Blank lines part the sections.
    while stop - start > 1 and text[stop - 2 : stop] == b"\n\n":
        stop -= 1
    names = [f"{k}" for k in range(width)]
    where = f"{path}, bytes {start} to {stop}"
    if rows == 0 or stop <= start:
        found = np.zeros((0, width))
    else:
        found = Table(where, read_body(where, text, (start, stop), names, names)).columns(*names)
    if len(found) != rows:
        raise InputError(where, f"{len(found)} rows", f"{rows} as its header says", REMEDY)
    return found
