"""Saves of Yade, `O.save("state.xml.gz")`, streamed into what the export snippet takes for `O`."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import SimpleNamespace as Box
from typing import Any

import numpy as np

from loops import InputError
from patterns.snapshots.files import opened, require_file, whole_file
from patterns.snapshots.frame import Frame, Frames, Moment, frame_of_tables
from patterns.snapshots.source import Source
from patterns.snapshots.tables import Table
from patterns.snapshots.yade_export import GRAINS, tables_of

ROOT = b"<boost_serialization"
DECLARATION_BYTES = 65536
LOAD_IN_YADE = "Load it in Yade, O.load(...), and export the tables from there: see docs/yade.md."
# Elements that the snippet reads; of an interaction all these vectors are needed.
OF_STATE = ("position", "vel", "angVel")
OF_INTERACTION = ("normal", "contactPoint", "normalForce", "shearForce", "cellDist")
NUMBERS = {
    *("mass", "kn", "ks", "tangensOfFrictionAngle", "normalAdhesion", "shearAdhesion", "unp"),
    *("unpMax", "fragile", "cohesionBroken", "cohesionDisablesFriction", "momentRotationLaw"),
}


class _MissingError(Exception):
    """An element that is missing; not a ValueError, which means a damaged file."""


class _Vector(tuple[float, ...]):
    def dot(self, other: _Vector) -> float:
        return sum(a * b for a, b in zip(self, other, strict=True))


class _Bodies(dict[int, Any]):
    """Bodies by id; a loop runs over the bodies, as in Yade."""

    def __iter__(self) -> Iterator[Any]:
        return iter(self.values())


class Save:
    """Yade's `O` as far as the export snippet reads it, from the objects `<px>` of a save."""

    def __init__(self) -> None:
        self.bodies, self.interactions, self.engines = _Bodies(), list[Any](), list[Any]()
        self.cell, self.periodic, self.iter, self.time = Box(hSize={}), False, 0, 0.0
        self.complete = False  # whether the scene element was read
        self._classes: dict[str, str] = {}
        self._shapes: dict[str, Any] = {}

    def read(self, px: ET.Element) -> None:
        """Read a scene, cell, body or real interaction; other elements are skipped."""
        name = px.get("class_name")
        if name is not None:
            self._classes[px.get("class_id", "")] = name.removeprefix("yade::")
        if px.find("id1") is not None and px.find("geom") is not None:
            self._interaction(px)
        elif px.find("shape") is not None and px.find("state") is not None:
            self._body(px)
        elif px.find("avoidGranularRatcheting") is not None:
            functor = _class(self._class_of(px))()
            functor.avoidGranularRatcheting = _number(px, "avoidGranularRatcheting") != 0
            self.engines.append(Box(geomDispatcher=Box(functors=[functor])))
        elif (size := px.find("hSize")) is not None:
            places = ((row, k) for row in (0, 1, 2) for k in (0, 1, 2))
            self.cell.hSize = {at: _number(size, "m{}{}".format(*at)) for at in places}
        elif px.find("isPeriodic") is not None and px.find("bodies") is not None:
            self.periodic = _number(px, "isPeriodic") != 0
            self.iter, self.time = int(_number(px, "iter")), _number(px, "time")
            self.complete = True

    def _body(self, px: ET.Element) -> None:
        """Read a body; several may share one shape."""
        number, clump, shape = int(_number(px, "id")), px.find("clumpId"), px.find("shape/px")
        if shape is None:
            raise _MissingError(f"no <shape> in body {number}")
        shared = shape.get("object_id_reference")
        if shared is None:
            name, where = self._class_of(shape), f"shape of body {number}"
            radius = {"radius": _number(shape, "radius", where)} if name == "Sphere" else {}
            shared = shape.get("object_id", "")
            self._shapes[shared] = _class(name)(**radius)
        elif shared not in self._shapes:
            raise _MissingError(f"no shape {shared}, which body {number} refers to")
        state = _values(px.find("state"), f"body {number}", OF_STATE)
        state.pos = state.position
        in_clump = clump is not None and clump.text != "-1"
        found = {"id": number, "shape": self._shapes[shared], "state": state}
        self.bodies[number] = Box(**found, isClump=False, isClumpMember=in_clump)

    def _class_of(self, px: ET.Element) -> str:
        return self._classes.get(px.get("class_id_reference", px.get("class_id", "")), "none")

    def _interaction(self, px: ET.Element) -> None:
        """Read an interaction; geometry or law are null where it is only potential."""
        one, two = (int(_number(px, name)) for name in ("id1", "id2"))
        parts = [px.find(name) for name in ("geom/px", "phys/px")]
        if any(part is None or not len(part) for part in parts):
            return
        geom, phys = (self._class_of(part) for part in parts if part is not None)
        values = _values(px, f"interaction {one}-{two} ({geom}, {phys})", OF_INTERACTION)
        found = {"id1": one, "id2": two, "isReal": True, "cellDist": values.cellDist}
        found |= {"geom": values, "phys": _class(phys)(**vars(values))}
        self.interactions.append(Box(**found))


@cache
def _class(name: str) -> type[Box]:
    return type(name, (Box,), {})


def _values(parent: ET.Element | None, where: str, vectors: tuple[str, ...]) -> Box:
    """These vectors, and the numbers of `NUMBERS` below an element."""
    elements = {} if parent is None else {element.tag: element for element in parent.iter()}
    if lacking := [name for name in vectors if name not in elements]:
        raise _MissingError(f"no <{lacking[0]}> in {where}")
    found: dict[str, Any] = {
        n: _Vector(_number(elements[n], axis, f"{n} of {where}") for axis in "xyz") for n in vectors
    }
    found |= {n: _value(elements[n], n, where) for n in NUMBERS & {*elements}}
    return Box(**found)


def _number(parent: ET.Element, name: str, where: str = "an object") -> float:
    return _value(parent.find(name), name, where)


def _value(element: ET.Element | None, name: str, where: str) -> float:
    if element is None or element.text is None:
        raise _MissingError(f"no <{name}> in {where}")
    with suppress(ValueError):
        if math.isfinite(value := float(element.text)):
            return value
    raise _MissingError(f"<{name}> {element.text!r} in {where}")


def read_save(path: Path) -> Save:
    """Read bodies, interactions and cell of a save; elements are dropped once they are read."""
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
    if not done or not save.complete or (save.periodic and not save.cell.hSize):
        raise InputError(str(path), "no <scene>", "a complete save", LOAD_IN_YADE)
    return save


def is_yade_save(path: Path, head: bytes) -> bool:
    """Whether this is an XML save of Yade."""
    return ROOT in head


def yade_save_frames(source: Source) -> Frames:
    """The one snapshot of a save, as `export_tables` of the export snippet has it."""
    return [Moment(lambda own: frame_of_save(own, read_save(own.path)))]


def frame_of_save(source: Source, save: Save) -> Frame:
    """Plain tables of a save."""
    try:
        bodies, names, rows, told = tables_of(save)
    except (ValueError, AttributeError, KeyError) as error:
        missing = f"no body {error} of an interaction" if isinstance(error, KeyError) else error
        expected = "spheres in contact, their law with kn, ks and shearForce"
        raise InputError(str(source.path), str(missing), expected, LOAD_IN_YADE) from None
    grains = dict(zip(GRAINS, np.array(bodies, dtype=float).T, strict=True))
    contacts = dict(zip(names, np.array(rows, dtype=float).T, strict=True))
    cell = None if told["cell"] is None else np.array(told["cell"])
    notes = []
    if walls := sorted({type(body.shape).__name__ for body in save.bodies} - {"Sphere"}):
        notes.append(f"bodies taken as walls: {', '.join(walls)}")
    tables = {"grains": Table(f"bodies of {source.path}", grains)}
    tables["contacts"] = Table(f"interactions of {source.path}", contacts)
    of_frame = {"step": float(save.iter), "time": save.time, "law": told.get("law")}
    of_frame |= {"shear_increment": told["shear_increment"], "cell": cell, "notes": notes}
    return frame_of_tables(source, tables, has_types=True, **of_frame)
