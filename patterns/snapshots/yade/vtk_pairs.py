"""Spheres and lines of two VTK files brought together."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.frame import Frame, Source, with_plain_names
from patterns.snapshots.tables import Table
from patterns.snapshots.yade.vtk_files import Piece

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Columns = dict[str, NDArray[np.generic]]

SNIPPET = "Export tables from inside Yade instead, see docs/yade.md."


def grains_of(piece: Piece, radius: str) -> tuple[Columns, list[str]]:
    """Plain columns of the grains.

    Parameters
    ----------
    piece : Piece
        The file of the spheres.
    radius : str
        Name of the array of the radii.

    Returns
    -------
    columns : dict of str to array
        `id, x, y, z, radius`.
    notes : list of str
        What was assumed.

    Raises
    ------
    InputError
        If the file has no radii.
    """
    if radius not in piece.points_data or not len(piece.points):
        raise InputError(
            str(piece.path),
            f"points with {', '.join(piece.points_data) or 'no arrays'}",
            f"spheres with {radius!r}",
            "Give the file of the spheres; the recorder 'spheres' writes them.",
        )
    x = piece.points
    ids = piece.points_data.get("id")
    notes = [] if ids is not None else ["no ids in the file: grains are numbered in its order"]
    columns: Columns = {"id": np.arange(len(x)) if ids is None else ids}
    columns |= {"x": x[:, 0], "y": x[:, 1], "z": x[:, 2], "radius": piece.points_data[radius]}
    return columns, notes


def ends_of(spheres: Piece, lines: Piece) -> Integers:
    """Spheres at the ends of the lines, found by their coordinates.

    Parameters
    ----------
    spheres, lines : Piece
        The two files.

    Returns
    -------
    (L, 2) array of int
        Indices of the spheres, -1 for none.

    Raises
    ------
    InputError
        For a line that ends at the sphere where it began.
    """
    keys, at = _keys(spheres.points), _keys(lines.points)
    order = np.argsort(keys)
    place = order[np.minimum(np.searchsorted(keys, at, sorter=order), len(keys) - 1)]
    ends = np.where(keys[place] == at, place, -1)[lines.lines]
    if ((ends[:, 0] == ends[:, 1]) & (ends[:, 0] >= 0)).any():
        raise InputError(
            str(lines.path),
            "a line from a sphere to itself",
            "lines between distinct centres",
            "Export it again; two spheres at one place have no contact direction.",
        )
    return ends


def _keys(points: Floats) -> NDArray[np.uint64]:
    """One number for the bits of x and y: both files print the same ones for the same body."""
    bits = np.ascontiguousarray(points[:, :2] + 0.0, dtype=np.float32).view(np.uint32)
    return bits[:, 0].astype(np.uint64) << np.uint64(32) | bits[:, 1]


def refuse_strays(lines: Piece, ends: Integers) -> None:
    """Raise `InputError` if a line ends at no sphere.

    Parameters
    ----------
    lines : Piece
        The file of the interactions.
    ends : (L, 2) array of int
        Spheres at the ends, -1 for none.

    Raises
    ------
    InputError
        With the number of such lines.
    """
    if len(ends) and (ends < 0).all():
        raise InputError(
            str(lines.path),
            "lines that end at none of the spheres",
            "files of one instant",
            "Give the two files of the same iteration.",
        )
    strays = int(np.count_nonzero((ends < 0).any(axis=1)))
    if strays:
        raise InputError(
            str(lines.path),
            f"{strays} of {len(ends)} lines that end at no sphere",
            "contacts between spheres of the other file",
            "Contacts across a periodic border or with walls can't be told apart here, and files "
            f"of two instants look like this too. {SNIPPET}",
        )


def make_frame(
    source: Source,
    pieces: tuple[Piece, Piece],
    grains: Columns,
    contacts: Columns,
    notes: Sequence[str],
) -> Frame:
    """Frame of the columns of two files; its step is the last number in the name.

    Parameters
    ----------
    source : Source
        What the user gave.
    pieces : (Piece, Piece)
        Files of the spheres and of the interactions.
    grains, contacts : dict of str to array
        Columns.
    notes : sequence of str
        What was assumed.

    Returns
    -------
    Frame
        With plain names.
    """
    tables = Table(pieces[0].path, grains), Table(pieces[1].path, contacts)
    numbers = re.findall(r"\d+", source.path.name)
    return Frame(
        *with_plain_names(source, *tables),
        cell=source.cell,
        step=float(numbers[-1]) if numbers else None,
        notes=tuple(notes),
        shear_increment="radii",
    )
