"""Tables of grains and contacts written from inside Yade.

This file runs in Yade's own Python and needs nothing else: copy it beside the script of the
simulation, or read it with `exec(open("yade_export.py").read())`. Then `export_tables("out")`
writes the present snapshot, and

    PyRunner(iterPeriod=1000, command='export_tables("out")')

one every 1000 steps. Placed between the InteractionLoop and the NewtonIntegrator, positions,
contacts and forces are of the same snapshot; elsewhere the positions are one step older or newer.
"""

from __future__ import annotations

import gzip
import json
import os
import re
from collections.abc import Iterable, Sequence
from typing import Any

GRAINS = ("id", "type", "x", "y", "z", "radius", "mass", "vx", "vy", "omega_z")
CONTACTS = ("id1", "id2", "cell_dx", "cell_dy", "branch_x", "branch_y", "nx", "ny")
FORCES = ("fn", "fsx", "fsy", "fx_on_2", "fy_on_2", "kn", "ks", "mu")
BONDS = ("adhesion", "cohesion")
# Kinds of bodies in the column `type`.
SPHERE = 0
WALL = 1


def export_tables(folder: str, number: int | None = None) -> str:
    """Write `grains_KK.csv.gz`, `contacts_KK.csv.gz` and `cell_KK.json` of this snapshot.

    The columns are those of the plain tables: numbers with 17 digits, compression positive, forces
    on grain 2, the branch from centre 1 to the image of centre 2. Every body that is no sphere is a
    wall (`type` 1): its contacts have it as `id1`, their normal points into the grain, their branch
    runs along it from the foot on the wall to the centre. `cell_KK.json` holds the periodic cell
    (columns are its vectors; null without one), the iteration, the time and the shear increment.

    Parameters
    ----------
    folder : str
        Where to write; made if it is missing.
    number : int, optional
        KK, at least two digits; if left out, the one after the highest in the folder.

    Returns
    -------
    str
        The file of grains, written last: if it exists, the others are complete.

    Raises
    ------
    ValueError
        For clumps and for contacts without stiffness or shear force, and for no real contact.
    """
    from yade import O  # type: ignore[import-not-found]

    grains, columns, contacts, frame = tables_of(O)
    os.makedirs(folder, exist_ok=True)
    if number is None:
        names = (re.fullmatch(r"grains_(\d+)\.csv\.gz", name) for name in os.listdir(folder))
        number = max((int(name.group(1)) for name in names if name), default=-1) + 1
    label = f"{number:02d}"
    _write(os.path.join(folder, f"cell_{label}.json"), (json.dumps(frame) + "\n").encode())
    _write(os.path.join(folder, f"contacts_{label}.csv.gz"), _csv(columns, contacts))
    path = os.path.join(folder, f"grains_{label}.csv.gz")
    _write(path, _csv(GRAINS, grains))
    return path


def tables_of(
    scene: Any,
) -> tuple[list[tuple[float, ...]], tuple[str, ...], list[tuple[float, ...]], dict[str, Any]]:
    """Rows of the grains; columns and rows of the contacts; the cell and what stands beside it."""
    grains, spheres = [], set()
    for body in scene.bodies:
        if body.isClump or body.isClumpMember:
            raise ValueError(f"body {body.id} belongs to a clump: loops are of single grains")
        if body.shape is None:
            continue
        kind, radius = WALL, 0.0
        if _is_sphere(body):
            spheres.add(body.id)
            kind, radius = SPHERE, body.shape.radius
        state = body.state
        place, motion = (state.pos[k] for k in (0, 1, 2)), (state.vel[0], state.vel[1])
        grains.append((body.id, kind, *place, radius, state.mass, *motion, state.angVel[2]))
    real = [i for i in scene.interactions if i.isReal and (i.id1 in spheres or i.id2 in spheres)]
    if not real:
        raise ValueError("no real interaction at this snapshot: nothing to export")
    for i in real:
        if not (hasattr(i.phys, "kn") and hasattr(i.phys, "ks") and hasattr(i.phys, "shearForce")):
            physics = type(i.phys).__name__
            raise ValueError(f"interaction {i.id1}-{i.id2}: {physics} lacks kn, ks or shearForce")
    rough = all(hasattr(i.phys, "tangensOfFrictionAngle") for i in real)
    columns = CONTACTS + (FORCES if rough else FORCES[:-1])
    contacts = [_contact(scene, i)[: len(columns)] for i in real]
    bonds = _bonds(real) if rough else None
    if bonds:
        columns += BONDS
        contacts = [row + bond for row, bond in zip(contacts, bonds, strict=True)]
    h = scene.cell.hSize if scene.periodic else None
    cell = None if h is None else [[float(h[row, k]) for k in (0, 1)] for row in (0, 1)]
    frame: dict[str, Any] = {"cell": cell, "iteration": int(scene.iter), "time": float(scene.time)}
    frame["shear_increment"] = _shear_increment(scene)
    if bonds:
        frame["law"] = "bonded"
    return grains, columns, contacts, frame


def _is_sphere(body: Any) -> bool:
    return type(body.shape).__name__ == "Sphere"


def _contact(scene: Any, i: Any) -> tuple[float, ...]:
    """Row of `CONTACTS` and `FORCES`; a wall comes first, whatever Yade's order."""
    one, two, sign = scene.bodies[i.id1], scene.bodies[i.id2], 1
    if not _is_sphere(two):
        one, two, sign = two, one, -1
    n, shear, normal = (
        [sign * float(vector[k]) for k in (0, 1)]
        for vector in (i.geom.normal, i.phys.shearForce, i.phys.normalForce)
    )
    image = [sign * int(i.cellDist[k]) for k in (0, 1, 2)] if scene.periodic else [0, 0, 0]
    if _is_sphere(one):
        branch = [two.state.pos[k] - one.state.pos[k] for k in (0, 1)]
        if scene.periodic:
            h = scene.cell.hSize
            branch = [
                branch[row] + sum(float(h[row, k]) * image[k] for k in (0, 1, 2)) for row in (0, 1)
            ]
    else:
        # From the foot on the wall to the centre; penetrationDepth is not saved by O.save. Yade's
        # contact point is the foot on a `Wall`; on boxes and facets it lies halfway through the
        # overlap.
        point = i.geom.contactPoint
        reach = sum(float(two.state.pos[k] - point[k]) * n[k] for k in (0, 1))
        if type(one.shape).__name__ != "Wall":
            reach = 2 * reach - float(two.shape.radius)
        branch = [component * reach for component in n]
    # With the components out of the plane: a tilted normal must not look like a smaller force.
    compression = i.phys.normalForce.dot(i.geom.normal)
    force = [normal[k] + shear[k] for k in (0, 1)]
    mu = getattr(i.phys, "tangensOfFrictionAngle", 0.0)
    return (
        *(one.id, two.id, image[0], image[1], *branch, *n),
        *(compression, *shear, *force, i.phys.kn, i.phys.ks, mu),
    )


def _bonds(real: Sequence[Any]) -> list[tuple[float, float]] | None:
    """Pull and shear strength of bonds of `CohFrictPhys`, zero of broken ones; None of other laws.

    A bond that breaks in shear, stretches plastically or carries moments is another law.
    """
    found = []
    for p in (i.phys for i in real):
        if not hasattr(p, "normalAdhesion"):
            return None
        plastic = p.unp != 0 or p.unpMax != 0
        other = p.fragile or plastic or p.cohesionDisablesFriction or p.momentRotationLaw
        if not p.cohesionBroken and other:
            return None
        found.append((0.0, 0.0) if p.cohesionBroken else (p.normalAdhesion, p.shearAdhesion))
    return found


def _shear_increment(scene: Any) -> str:
    """Shear increment: 'radii', Yade's default, unless avoidGranularRatcheting is off."""
    for engine in scene.engines:
        for functor in getattr(getattr(engine, "geomDispatcher", None), "functors", ()):
            if type(functor).__name__.startswith("Ig2_Sphere_Sphere"):
                return "radii" if getattr(functor, "avoidGranularRatcheting", True) else "branch"
    return "radii"


def _csv(columns: Sequence[str], rows: Iterable[Sequence[float]]) -> bytes:
    """Compressed CSV with 17 digits, which restore the same float64."""
    lines = [",".join(f"{float(value):.17g}" for value in row) for row in rows]
    return gzip.compress("\n".join([",".join(columns), *lines, ""]).encode(), mtime=0)


def _write(path: str, content: bytes) -> None:
    """Write a temporary file, then rename it: an interrupted run leaves no half-written file."""
    temporary = path + ".part"
    with open(temporary, "wb") as file:
        file.write(content)
    os.replace(temporary, path)
