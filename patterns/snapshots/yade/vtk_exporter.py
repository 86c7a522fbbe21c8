"""The frame of VTKExporter's files, whose arrays have the names that the user gave them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from patterns.snapshots.frame import Frame, Source
from patterns.snapshots.yade.vtk_files import Piece
from patterns.snapshots.yade.vtk_pairs import Columns, ends_of, grains_of, make_frame, refuse_strays

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Names under which the forces are looked for; others come by the column map.
NORMAL_NAMES = ("fn", "normalForce")
SHEAR_NAMES = ("fs", "shearForce")
WALL_ID = -1
PARALLEL = 1e-3


def exporter_frame(source: Source, spheres: Piece, lines: Piece) -> Frame:
    """Frame of `exportSpheres` and `exportInteractions`.

    A vector array `A` stands for the columns `A_x, A_y, A_z`. A vector of the normal force is
    projected on the line of centres. Lines that begin at no sphere are contacts with walls, whose
    normal is that of their normal force; without that force they are refused.

    Parameters
    ----------
    source : Source
        What the user gave, with the column map.
    spheres, lines : Piece
        The two files.

    Returns
    -------
    Frame
        Ids are the order of the spheres if no array `id` was exported.

    Raises
    ------
    InputError
        For lines that end at no sphere, without radii.
    """
    grains, notes = grains_of(spheres, "radius")
    notes.append("VTKExporter: numbers of six digits, overlaps from the centres mean nothing")
    ends = ends_of(spheres, lines)
    vectors = {name: v[:, :2] for name, v in lines.lines_data.items() if v.ndim == 2}
    columns = dict(source.columns)
    normal, shear = (
        _named(columns.get("fn"), NORMAL_NAMES, vectors),
        _named(None, SHEAR_NAMES, vectors),
    )
    force = vectors.get(normal)
    branch = _branches(lines, ends, spheres, force)
    n = branch / np.hypot(*branch.T)[:, None]
    ids = np.append(grains["id"].astype(np.int64), WALL_ID)
    contacts: Columns = {"id1": ids[ends[:, 0]], "id2": ids[ends[:, 1]]}
    contacts |= _flattened(lines.lines_data)
    contacts |= {"nx": n[:, 0], "ny": n[:, 1], "branch_x": branch[:, 0], "branch_y": branch[:, 1]}
    if force is not None:
        columns.pop("fn", None)
        contacts["fn"] = np.einsum("ck,ck->c", force, n)
        notes.append(f"fn from the vectors {normal!r}, along the line of centres")
    if shear in vectors and not {"fsx", "fx_on_2"} & set(columns):
        contacts |= {"fsx": vectors[shear][:, 0], "fsy": vectors[shear][:, 1]}
        notes.append(f"shear force on grain 2 from the vectors {shear!r}")
    if (ends < 0).any():
        grains = _with_wall(grains)
        notes.append("lines that begin at no sphere are taken as contacts with walls")
    return make_frame(replace(source, columns=columns), (spheres, lines), grains, contacts, notes)


def _named(given: str | None, names: tuple[str, ...], vectors: Mapping[str, Floats]) -> str:
    wanted = names if given is None else (given,)
    return next((name for name in wanted if name in vectors), "")


def _flattened(arrays: Mapping[str, Floats]) -> Columns:
    columns: Columns = {name: values for name, values in arrays.items() if values.ndim == 1}
    for name, values in arrays.items():
        if values.ndim == 2:
            columns |= {f"{name}_{axis}": values[:, k] for k, axis in enumerate("xyz")}
    return columns


def _branches(lines: Piece, ends: Integers, spheres: Piece, force: Floats | None) -> Floats:
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


def _with_wall(grains: Columns) -> Columns:
    grown = {name: np.append(v, WALL_ID if name == "id" else 0) for name, v in grains.items()}
    return grown | {"type": np.append(np.zeros(len(grains["id"])), 1)}
