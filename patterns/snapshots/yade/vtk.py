"""VTK files of Yade: VTKRecorder's `.vtu`, `.vtp`, `.vtm` and VTKExporter's legacy `.vtk`."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.frame import Frame, Source
from patterns.snapshots.instants import Instants
from patterns.snapshots.text import open_text
from patterns.snapshots.yade.shear import shear_signs
from patterns.snapshots.yade.vtk_exporter import exporter_frame
from patterns.snapshots.yade.vtk_files import Piece, read_piece
from patterns.snapshots.yade.vtk_legacy import START, read_legacy
from patterns.snapshots.yade.vtk_pairs import Columns, ends_of, grains_of, make_frame, refuse_strays

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Beyond this residual of the balances (over the mean normal force) signs of shear are a guess.
BALANCED = 0.05


def recognises(path: Path, head: bytes) -> bool:
    """Whether this is a VTK file of one of the kinds that Yade writes."""
    if head.startswith(START):
        return True
    kinds = (b"UnstructuredGrid", b"PolyData", b"vtkMultiBlockDataSet")
    return b"<VTKFile" in head and any(b'type="' + kind + b'"' in head for kind in kinds)


def frames(source: Source) -> Instants:
    """The one instant of a pair of VTK files.

    The main file is that of the spheres, `...spheres.N.vtu`, with `...intrs.N.vtp` beside it; or a
    `.vtm` that names both; or `...-spheres-N.vtk` with `...-intrs-N.vtk` beside it. Lines are
    brought to the spheres by the coordinates of their ends. What the files lack is in the notes.

    Parameters
    ----------
    source : Source
        What the user gave.

    Returns
    -------
    Instants
        One; `step` is the number in the file's name. Reading it raises `InputError` for missing,
        damaged or truncated files, files of two instants, and contacts across a periodic border,
        which these files garble.
    """
    return Instants([partial(_frame, source)])


def _frame(source: Source) -> Frame:
    path = source.path
    name = path.name.lower().removesuffix(".gz")
    if name.endswith(".vtk"):
        contacts = _contacts_path(source, ".vtk")
        return exporter_frame(source, read_legacy(path), read_legacy(contacts))
    if name.endswith(".vtm"):
        path, contacts = _blocks(path)
    elif name.endswith(".vtu"):
        contacts = _contacts_path(source, ".vtp")
    else:
        raise InputError(
            str(path), "a file of lines", "the file of the spheres, ...spheres.N.vtu", "Name it."
        )
    return _recorder_frame(source, read_piece(path), read_piece(contacts))


def _contacts_path(source: Source, ending: str) -> Path:
    """The file of interactions beside that of the spheres, gzip or not."""
    if source.contacts is not None:
        return source.contacts
    path = source.path
    stem = re.sub(r"\.(vtu|vtk)(\.gz)?$", "", path.name, flags=re.I)
    for name in (stem.replace("spheres", "intrs") + e for e in (ending, ending + ".gz")):
        if "spheres" in stem and path.with_name(name).is_file():
            return path.with_name(name)
    raise InputError(
        f"interactions of {path}",
        "no such file beside it",
        stem.replace("spheres", "intrs") + ending,
        "Record 'intr' too, or name the file of the contacts.",
    )


def _blocks(path: Path) -> tuple[Path, Path]:
    names = re.findall(rb'\bfile="([^"]+)"', bytes(open_text(path)))
    files = [path.parent / name.decode(errors="replace") for name in names]
    spheres = [file for file in files if file.suffix == ".vtu"]
    lines = [file for file in files if file.suffix == ".vtp"]
    if len(spheres) != 1 or len(lines) != 1:
        raise InputError(
            str(path),
            f"{len(spheres)} .vtu and {len(lines)} .vtp blocks",
            "the spheres and the interactions",
            "Record ['spheres', 'intr'] alone with multiblock=True.",
        )
    return spheres[0], lines[0]


def _recorder_frame(source: Source, spheres: Piece, lines: Piece) -> Frame:
    grains, notes = grains_of(spheres, "radii")
    ends = ends_of(spheres, lines)
    refuse_strays(lines, ends)
    notes += [
        "VTKRecorder: no stiffness, no friction, no wall contacts, centres in single precision"
    ]
    ids = grains["id"]
    contacts: Columns = {"id1": ids[ends[:, 0]], "id2": ids[ends[:, 1]]}
    normal, size = (lines.lines_data.get(name) for name in ("forceN", "absForceT"))
    if normal is not None and size is not None and len(ends):
        found, note = _shear(lines, spheres, ends, normal, size)
        contacts |= {"fn": normal, **found}
        notes.append(note)
    return make_frame(source, (spheres, lines), grains, contacts, notes)


def _shear(
    lines: Piece, spheres: Piece, ends: Integers, normal: Floats, components: Floats
) -> tuple[Columns, str]:
    """Shear force on grain 2, its sign from the balance of the grains; none if that is no guide."""
    x, radii = spheres.points[:, :2], spheres.points_data["radii"]
    numbers = (x, radii, normal, components)
    if components.ndim != 2 or normal.ndim != 1 or not all(np.isfinite(a).all() for a in numbers):
        raise InputError(
            str(lines.path),
            "values that are no finite forces",
            "forceN, absForceT",
            "Record again.",
        )
    size = np.hypot(components[:, 0], components[:, 1])
    found = shear_signs(x, radii, ends, normal, size)
    share = f"{100 * found.residual:.2g} % of the mean normal force"
    if found.residual > BALANCED:
        return {}, (
            "shear forces left out: the file has their size without direction, and forces in the "
            f"file leave the grains unbalanced by {share} (gravity, motion, walls inside?)"
        )
    d = x[ends[:, 1]] - x[ends[:, 0]]
    t = np.column_stack([-d[:, 1], d[:, 0]]) / np.hypot(*d.T)[:, None]
    vector = (found.sign * size)[:, None] * t
    doubtful = ~found.decided & (size > 0)
    largest = size[doubtful].max(initial=0.0) / (np.abs(normal).mean() or 1.0)
    return {"fsx": vector[:, 0], "fsy": vector[:, 1], "shear_undecided": doubtful}, (
        "shear forces: the file has their size without direction; signs found from the balance of "
        f"the grains, which they leave unbalanced by {share}; {np.count_nonzero(doubtful)} of "
        f"{len(size)} undecided, of at most {100 * largest:.2g} % of the mean normal force"
    )
