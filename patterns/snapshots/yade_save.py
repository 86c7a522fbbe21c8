"""Saves of Yade, `O.save("state.xml.gz")`, streamed."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from loops import InputError
from loops.arrays import Floats, Integers
from patterns.snapshots.files import opened, require_file, whole_file
from patterns.snapshots.frame import Frame, Frames, Moment, Source, frame_of_tables
from patterns.snapshots.geometry import index_of
from patterns.snapshots.tables import Table

ROOT = b"<boost_serialization"
BINARY = b"serialization::archive"
DECLARATION_BYTES = 65536
LOAD_IN_YADE = "Load it in Yade, O.load(...), and export the tables from there: see docs/yade.md."


@dataclass(eq=False)
class Save:
    """Bodies, interactions and cell of a save, collected from its objects `<px>` one by one."""

    # Id, shape by Yade's class name, x, y, z, and the radius of a sphere, else 0.
    bodies: list[tuple[int, str, float, float, float, float]] = field(default_factory=list)
    # Real interactions: id1, id2, then x and y of normal, contact point, normal force, shear force
    # on body 2 and image of body 2; kn, ks; friction, nan without.
    interactions: list[list[float]] = field(default_factory=list)
    cell: list[float] = field(default_factory=list)  # hSize in the plane, by rows
    periodic: bool = False
    iteration: int = 0
    radii: bool = True  # whether the shear increment is by the radii (avoidGranularRatcheting)
    complete: bool = False  # whether the scene element was read
    classes: dict[str, str] = field(default_factory=dict)
    shapes: dict[str, tuple[str, float]] = field(default_factory=dict)

    def read(self, px: ET.Element) -> None:
        """Read a scene, cell, body or real interaction; other elements are skipped."""
        name = px.get("class_name")
        if name is not None:
            self.classes[px.get("class_id", "")] = name.removeprefix("yade::")
        if px.find("id1") is not None and px.find("geom") is not None:
            self._interaction(px)
        elif px.find("shape") is not None and px.find("state") is not None:
            self._body(px)
        elif name is not None and self._class_of(px).startswith("Ig2_Sphere_Sphere"):
            if px.find("avoidGranularRatcheting") is not None:
                self.radii = _number(px, "avoidGranularRatcheting") != 0
        elif px.find("hSize") is not None:
            self.cell = [_number(px.find("hSize"), m) for m in ("m00", "m01", "m10", "m11")]
        elif px.find("isPeriodic") is not None and px.find("bodies") is not None:
            self.periodic = _number(px, "isPeriodic") != 0
            self.iteration = int(_number(px, "iter"))
            self.complete = True

    def _body(self, px: ET.Element) -> None:
        """Read a body; several may share one shape."""
        body = int(_number(px, "id"))
        clump = px.find("clumpId")
        if clump is not None and clump.text != "-1":
            raise _MissingError(f"body {body} in a clump where loops are of single grains")
        shape = px.find("shape/px")
        if shape is None:
            raise _MissingError(f"no <shape> in body {body}")
        shared = shape.get("object_id_reference")
        if shared is None:
            name, where = self._class_of(shape), f"shape of body {body}"
            radius = _number(shape, "radius", where) if name == "Sphere" else 0.0
            shared = shape.get("object_id", "")
            self.shapes[shared] = (name, radius)
        elif shared not in self.shapes:
            raise _MissingError(f"no shape {shared}, which body {body} refers to")
        name, radius = self.shapes[shared]
        position = next(px.find("state").iter("position"), None)  # type: ignore[union-attr]
        x, y, z = (_number(position, axis, f"position of body {body}") for axis in "xyz")
        self.bodies.append((body, name, x, y, z, radius))

    def _class_of(self, px: ET.Element) -> str:
        return self.classes.get(px.get("class_id_reference", px.get("class_id", "")), "none")

    def _interaction(self, px: ET.Element) -> None:
        """A row; geometry or law are null in interactions that are only potential."""
        ids = [_number(px, "id1"), _number(px, "id2")]
        parts = [px.find(name) for name in ("geom/px", "phys/px")]
        if any(part is None or not len(part) for part in parts):
            return
        geom, phys = (self._class_of(part) for part in parts if part is not None)
        where = f"interaction {ids[0]:.0f}-{ids[1]:.0f} ({geom}, {phys})"
        found = {element.tag: element for element in px.iter()}
        row = ids
        for name in ("normal", "contactPoint", "normalForce", "shearForce", "cellDist"):
            vector = found.get(name)
            if vector is None:
                raise _MissingError(f"no <{name}> in {where}")
            row += [_number(vector, "x", where), _number(vector, "y", where)]
        for name in ("kn", "ks"):
            row.append(_value(found.get(name), name, where))
        friction = found.get("tangensOfFrictionAngle")
        row.append(math.nan if friction is None else _value(friction, "friction", where))
        self.interactions.append(row)


def read_save(path: Path) -> Save:
    """Read bodies, interactions and cell of a save.

    Elements are dropped once they are read: the memory is that of the rows, not of the file.
    """
    require_file(path)
    save, done = Save(), False
    try:
        with whole_file(path), opened(path) as file:
            # Yade writes no declarations before the root, and entities may expand endlessly.
            head = file.read(DECLARATION_BYTES)
            file.seek(0)
            start = head.find(ROOT)
            if start < 0 or b"<!ENTITY" in head[:start]:
                received = "declarations of entities" if start >= 0 else "no <boost_serialization>"
                if start < 0 and BINARY in head[:64]:
                    received = "Yade's binary save, readable by the build of Yade that wrote it"
                expected = 'XML as O.save("....xml.gz") writes it'
                raise InputError(str(path), received, expected, LOAD_IN_YADE)
            for _, element in ET.iterparse(file):
                if element.tag == "px":
                    save.read(element)
                elif element.tag == "item":
                    element.clear()
                elif element.tag == "scene":
                    done = True
    except ET.ParseError as error:
        raise InputError(
            str(path), f"XML that ends or breaks ({error})", "a complete save", "Save it again."
        ) from None
    except _MissingError as error:
        raise InputError(
            str(path), f"another serialisation, {error}", "a save of Yade 2023", LOAD_IN_YADE
        ) from None
    if not done or not save.complete or (save.periodic and not save.cell):
        received = "no <cell>" if done and save.complete else "no <scene>"
        raise InputError(str(path), received, "a save of Yade, O.save(...)", LOAD_IN_YADE)
    return save


class _MissingError(Exception):
    """An element that is missing; not a ValueError, which means a damaged file."""


def _number(parent: ET.Element | None, name: str, where: str = "") -> float:
    return _value(None if parent is None else parent.find(name), name, where)


def _value(element: ET.Element | None, name: str, where: str) -> float:
    if element is None or element.text is None:
        raise _MissingError(f"no <{name}> in {where or 'an object'}")
    try:
        value = float(element.text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _MissingError(f"<{name}> {element.text!r} in {where or 'an object'}")
    return value


# Branches and normals further apart than this (radians) are not of one snapshot.
SAME_SNAPSHOT = 1e-9


def is_yade_save(path: Path, head: bytes) -> bool:
    """Whether this is a save of Yade, XML or binary."""
    return (
        ROOT in head or BINARY in head[:64] or path.name.lower().endswith((".xml.bz2", ".yade.bz2"))
    )


def yade_save_frames(source: Source) -> Frames:
    """The one snapshot of a save.

    Spheres are grains, all other bodies walls. The branch of a wall contact runs along the normal
    from the contact point to the centre.
    """
    return [Moment(lambda: frame_of_save(source, read_save(source.path)))]


def frame_of_save(source: Source, save: Save) -> Frame:
    """Plain tables of a save."""
    if not save.interactions or not save.bodies:
        remedy = "Save after a step, without resetting the interactions."
        raise InputError(str(source.path), "no interaction with forces", "contacts", remedy)
    ids = np.array([body[0] for body in save.bodies], dtype=np.int64)
    sphere = np.array([body[1] == "Sphere" for body in save.bodies])
    place = np.array([body[2:] for body in save.bodies], dtype=float)
    grains = {"id": ids, "type": np.where(sphere, 0, 1)}
    grains |= dict(zip(("x", "y", "z", "radius"), place.T, strict=True))
    cell = np.reshape(save.cell, (2, 2)) if save.periodic else None
    contacts, off = _contacts(source.path, save, ids, place, cell)
    tables = (
        Table(f"bodies of {source.path}", grains),
        Table(f"interactions of {source.path}", contacts),
    )
    notes: list[str] = []
    if off > SAME_SNAPSHOT:
        notes.append(
            f"normals up to {off:.1g} rad off the line of centres: saved after the grains moved, "
            "forces are one step older than positions"
        )
    other = sorted({body[1] for body in save.bodies} - {"Sphere"})
    if other:
        notes.append(f"bodies taken as walls: {', '.join(other)}")
    return frame_of_tables(
        source,
        dict(zip(("grains", "contacts"), tables, strict=True)),
        cell=cell,
        step=float(save.iteration),
        notes=notes,
        shear_increment="radii" if save.radii else "branch",
        has_types=True,
    )


def _contacts(
    path: Path, save: Save, ids: Integers, place: Floats, cell: Floats | None
) -> tuple[dict[str, NDArray[np.generic]], float]:
    """Plain columns, walls first in each row; largest angle of normals to the line of centres."""
    rows = np.array(save.interactions)
    pairs = rows[:, :2].astype(np.int64)
    n, point, normal, shear, image = (rows[:, k : k + 2] for k in range(2, 12, 2))
    found = index_of(ids, pairs)
    if (found < 0).any():
        c = int(np.argmax((found < 0).any(axis=1)))
        where = f"interaction {pairs[c, 0]}-{pairs[c, 1]} of {path}"
        remedy = "Save again after O.interactions.eraseNonReal()."
        raise InputError(where, "a body that is not saved", "both bodies", remedy)
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
    # From the foot on the wall to the centre. Yade's contact point is the foot on a `Wall`; on
    # boxes and facets it lies halfway through the overlap.
    distance = np.einsum("ck,ck->c", x[found[:, 1]] - point, n)
    infinite = np.array([body[1] == "Wall" for body in save.bodies])[found[:, 0]]
    reach = np.where(infinite, distance, 2 * distance - place[found[:, 1], 3])
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
