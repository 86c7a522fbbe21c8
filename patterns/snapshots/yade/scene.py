"""Bodies, interactions and cell out of the XML that Yade saves, streamed."""

from __future__ import annotations

import bz2
import gzip
import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, cast

from loops import InputError
from patterns.snapshots.text import require_file, whole_file

ROOT = b"<boost_serialization"
BINARY = b"serialization::archive"
HEAD = 65536
SNIPPET = "Load it in Yade, O.load(...), and export the tables from there: see docs/yade.md."


@dataclass(eq=False)
class Scene:
    """What a save holds, as far as it is asked for.

    Attributes
    ----------
    bodies : list of (id, shape, x, y, z, radius)
        Spheres and others; of others, the radius is 0. Shapes by Yade's class names.
    interactions : list of 16 numbers
        Real ones: `id1, id2`, then x and y of the normal, the contact point, the normal force and
        the shear force on body 2, the image of body 2, `kn, ks`, and the friction, nan without.
    cell : list of 4 numbers
        `hSize` in the plane, by rows.
    periodic : bool
        Whether the cell is used.
    iteration : int
        Number of steps done.
    radii : bool
        Whether shear turns by the radii (`avoidGranularRatcheting` of two spheres), as by default.
    """

    bodies: list[tuple[int, str, float, float, float, float]] = field(default_factory=list)
    interactions: list[list[float]] = field(default_factory=list)
    cell: list[float] = field(default_factory=list)
    periodic: bool = False
    iteration: int = 0
    radii: bool = True


def read_scene(path: Path) -> Scene:
    """Read what a save holds of bodies, interactions and cell.

    Memory is that of the rows, not of the file: elements are dropped once they are read.

    Parameters
    ----------
    path : Path
        `.xml`, `.xml.gz` or `.xml.bz2`.

    Returns
    -------
    Scene
        Its rows.

    Raises
    ------
    InputError
        For a missing, empty, damaged or truncated file, entities declared in it, clumps, and
        another serialisation: the message names what is missing.
    """
    require_file(path)
    reader = _Reader()
    done = False
    try:
        with whole_file(path), _opened(path) as file:
            _check_head(path, file)
            for _, element in ET.iterparse(file):
                if element.tag == "px":
                    reader.read(element)
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
            str(path), f"another serialisation, {error}", "a save of Yade 2023", SNIPPET
        ) from None
    scene = reader.scene
    if not done or not reader.scene_read or (scene.periodic and not scene.cell):
        received = "no <cell>" if done and reader.scene_read else "no <scene>"
        raise InputError(str(path), received, "a save of Yade, O.save(...)", SNIPPET)
    return scene


class _MissingError(Exception):
    """What an element lacks. No ValueError, which would pass for a damaged file."""


def _opened(path: Path) -> BinaryIO:
    with open(path, "rb") as file:
        magic = file.read(3)
    if magic[:2] == b"\x1f\x8b":
        return cast(BinaryIO, gzip.open(path))
    return cast(BinaryIO, bz2.open(path)) if magic == b"BZh" else open(path, "rb")


def _check_head(path: Path, file: BinaryIO) -> None:
    """Declarations stand before the root: Yade writes none, and entities may expand endlessly."""
    head = file.read(HEAD)
    file.seek(0)
    start = head.find(ROOT)
    if start >= 0 and b"<!ENTITY" not in head[:start]:
        return
    received = "declarations of entities" if start >= 0 else "no <boost_serialization>"
    if start < 0 and BINARY in head[:64]:
        received = "Yade's binary save, readable by the build of Yade that wrote it"
    raise InputError(str(path), received, 'XML as O.save("....xml.gz") writes it', SNIPPET)


class _Reader:
    """Takes the objects, `<px>`, as they end, and remembers classes and shared shapes."""

    def __init__(self) -> None:
        self.scene = Scene()
        self.scene_read = False
        self.classes: dict[str, str] = {}
        self.shapes: dict[str, tuple[str, float]] = {}

    def read(self, px: ET.Element) -> None:
        """Take a scene, cell, body or real interaction; anything else is passed over."""
        name = px.get("class_name")
        if name is not None:
            self.classes[px.get("class_id", "")] = name.removeprefix("yade::")
        if px.find("id1") is not None and px.find("geom") is not None:
            self._interaction(px)
        elif px.find("shape") is not None and px.find("state") is not None:
            self._body(px)
        elif name is not None and self._class_of(px).startswith("Ig2_Sphere_Sphere"):
            if px.find("avoidGranularRatcheting") is not None:
                self.scene.radii = _number(px, "avoidGranularRatcheting") != 0
        elif px.find("hSize") is not None:
            self.scene.cell = [_number(px.find("hSize"), m) for m in ("m00", "m01", "m10", "m11")]
        elif px.find("isPeriodic") is not None and px.find("bodies") is not None:
            self.scene.periodic = _number(px, "isPeriodic") != 0
            self.scene.iteration = int(_number(px, "iter"))
            self.scene_read = True

    def _body(self, px: ET.Element) -> None:
        body = int(_number(px, "id"))
        clump = px.find("clumpId")
        if clump is not None and clump.text != "-1":
            raise _MissingError(f"body {body} in a clump where loops are of single grains")
        shape, radius = self._shape(px, body)
        position = next(px.find("state").iter("position"), None)  # type: ignore[union-attr]
        x, y, z = (_number(position, axis, f"position of body {body}") for axis in "xyz")
        self.scene.bodies.append((body, shape, x, y, z, radius))

    def _shape(self, px: ET.Element, body: int) -> tuple[str, float]:
        """Class and radius of a shape, which bodies may share."""
        shape = px.find("shape/px")
        if shape is None:
            raise _MissingError(f"no <shape> in body {body}")
        shared = shape.get("object_id_reference")
        if shared is not None:
            if shared not in self.shapes:
                raise _MissingError(f"no shape {shared}, which body {body} refers to")
            return self.shapes[shared]
        name = self._class_of(shape)
        radius = _number(shape, "radius", f"shape of body {body}") if name == "Sphere" else 0.0
        self.shapes[shape.get("object_id", "")] = (name, radius)
        return name, radius

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
        self.scene.interactions.append(row)


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
