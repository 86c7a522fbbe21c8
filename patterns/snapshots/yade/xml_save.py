"""Yade's own saves, `O.save("state.xml.gz")`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from patterns.snapshots.frame import Frame, Source, with_plain_names
from patterns.snapshots.instants import Instants
from patterns.snapshots.tables import Table
from patterns.snapshots.yade.scene import BINARY, ROOT, Scene, read_scene

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# Branches and normals further apart than this (radians) are not of one instant.
SAME_INSTANT = 1e-9


def recognises(path: Path, head: bytes) -> bool:
    """Whether this is a save of Yade, XML or binary."""
    return (
        ROOT in head or BINARY in head[:64] or path.name.lower().endswith((".xml.bz2", ".yade.bz2"))
    )


def frames(source: Source) -> Instants:
    """The one instant of a save.

    Spheres are grains, all other bodies walls. The branch of a wall contact runs along the normal
    from the contact point to the centre.

    Parameters
    ----------
    source : Source
        What the user gave.

    Returns
    -------
    Instants
        One; `step` is Yade's iteration. Reading it raises `InputError` for a binary save, a
        damaged or truncated file, another serialisation (the message names what is missing),
        clumps, no interaction with forces.
    """
    return Instants([lambda: frame_of_scene(source, read_scene(source.path))])


def frame_of_scene(source: Source, scene: Scene) -> Frame:
    """Plain tables of what a save holds.

    Parameters
    ----------
    source : Source
        What the user gave.
    scene : Scene
        Bodies, interactions and cell.

    Returns
    -------
    Frame
        Spheres as grains, other bodies as walls.

    Raises
    ------
    InputError
        If there are no interactions or one has a body that is not there.
    """
    if not scene.interactions or not scene.bodies:
        raise InputError(
            str(source.path),
            "no interaction with forces",
            "contacts",
            "Save after a step, without resetting the interactions.",
        )
    ids = np.array([body[0] for body in scene.bodies], dtype=np.int64)
    sphere = np.array([body[1] == "Sphere" for body in scene.bodies])
    place = np.array([body[2:] for body in scene.bodies], dtype=float)
    grains = {"id": ids, "type": np.where(sphere, 0, 1)}
    grains |= dict(zip(("x", "y", "z", "radius"), place.T, strict=True))
    cell = np.reshape(scene.cell, (2, 2)) if scene.periodic else None
    contacts, off = _contacts(source.path, scene, ids, place, cell)
    tables = (
        Table(f"bodies of {source.path}", grains),
        Table(f"interactions of {source.path}", contacts),
    )
    return Frame(
        *with_plain_names(source, *tables),
        cell=cell if source.cell is None else source.cell,
        step=float(scene.iteration),
        notes=_notes(scene, off),
        shear_increment="radii" if scene.radii else "branch",
    )


def _contacts(
    path: Path, scene: Scene, ids: Integers, place: Floats, cell: Floats | None
) -> tuple[dict[str, NDArray[np.generic]], float]:
    """Plain columns, walls first in each row; how far normals are off the line of centres."""
    rows = np.array(scene.interactions)
    pairs = rows[:, :2].astype(np.int64)
    n, point, normal, shear, image = (rows[:, k : k + 2] for k in range(2, 12, 2))
    order = np.argsort(ids)
    found = order[np.minimum(np.searchsorted(ids, pairs, sorter=order), len(ids) - 1)]
    if (ids[found] != pairs).any():
        c = int(np.argmax((ids[found] != pairs).any(axis=1)))
        raise InputError(
            f"interaction {pairs[c, 0]}-{pairs[c, 1]} of {path}",
            "a body that is not saved",
            "both bodies",
            "Save again after O.interactions.eraseNonReal().",
        )
    wall = place[found, 3] == 0
    flip = wall[:, 1]
    sign = np.where(flip, -1.0, 1.0)[:, None]
    pairs, found = (np.where(flip[:, None], a[:, ::-1], a) for a in (pairs, found))
    n, normal, shear, image = sign * n, sign * normal, sign * shear, sign * image
    x = place[:, :2]
    branch = x[found[:, 1]] - x[found[:, 0]] + (0.0 if cell is None else image @ cell.T)
    single = wall.any(axis=1)
    length = np.hypot(*branch.T)
    off = np.abs(branch / np.where(length > 0, length, 1.0)[:, None] - n)[~single].max(initial=0.0)
    reach = _reach(scene, found, np.einsum("ck,ck->c", x[found[:, 1]] - point, n), place[:, 3])
    branch = np.where(single[:, None], reach[:, None] * n, branch)
    force = normal + shear
    columns: dict[str, NDArray[np.generic]] = {"id1": pairs[:, 0], "id2": pairs[:, 1]}
    columns |= {"fn": np.einsum("ck,ck->c", normal, n), "kn": rows[:, 12], "ks": rows[:, 13]}
    for name, vector in (("n", n), ("branch_", branch), ("fs", shear), ("cell_d", image)):
        columns |= {f"{name}x": vector[:, 0], f"{name}y": vector[:, 1]}
    columns |= {"fx_on_2": force[:, 0], "fy_on_2": force[:, 1]}
    if not np.isnan(rows[:, 14]).any():
        columns["mu"] = rows[:, 14]
    return columns, float(off)


def _reach(scene: Scene, found: Integers, distance: Floats, radii: Floats) -> Floats:
    """From the foot on the wall to the centre: Yade's contact point is the foot on a `Wall`.

    On boxes and facets it lies halfway through the overlap.
    """
    infinite = np.array([body[1] == "Wall" for body in scene.bodies])[found[:, 0]]
    return np.where(infinite, distance, 2 * distance - radii[found[:, 1]])


def _notes(scene: Scene, off: float) -> tuple[str, ...]:
    notes = []
    if off > SAME_INSTANT:
        notes.append(
            f"normals up to {off:.1g} rad off the line of centres: saved after the grains moved, "
            "forces are one step older than positions"
        )
    other = sorted({body[1] for body in scene.bodies} - {"Sphere"})
    if other:
        notes.append(f"bodies taken as walls: {', '.join(other)}")
    return tuple(notes)
