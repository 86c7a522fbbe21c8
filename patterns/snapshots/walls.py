"""Walls of a sample: their contacts, from its tables too, the box that they make, their plates."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loops import ContactLaw, GrainGraph
from loops.arrays import Flags, Floats, Integers, median
from loops.boundary import UPRIGHT, PlaneContacts, plane_contacts
from loops.laws.frictional import FrictionalLaw
from loops.laws.of_pairs import PairLaw
from loops.shown import Shown
from patterns.snapshots.checks import SAME_FORCE, SLIDING_SHARE
from patterns.snapshots.findings import Finding, few, finding
from patterns.snapshots.forces import Forces, resultants
from patterns.snapshots.geometry import GEOMETRY_TOLERANCE, Contacts, index_of, refuse_unknown
from patterns.snapshots.tables import Table


@dataclass(frozen=True, eq=False, repr=False)
class WallContacts(Shown):
    """Contacts of grains with walls: they belong to no loop, but carry stress.

    Attributes
    ----------
    grain : (W,) array of int
        Grain of each, an index of the graph.
    force : (W, 2) array
        Force of the wall on the grain (force).
    branch : (W, 2) array
        From the foot on the wall to the centre of the grain (length).
    kn, kt : (W,) array, optional
        Stiffness, if the file has it; `kt` is zero where nothing sticks to the wall.
    mu : (W,) array, optional
        Friction, if the file has it; without it a contact with `kt` never slides in a path.
    sliding : (W,) array of bool, optional
        Contacts that the file flags as sliding; without it those at their strength slide.
    """

    grain: NDArray[np.int64]
    force: NDArray[np.float64]
    branch: NDArray[np.float64]
    kn: NDArray[np.float64] | None = None
    kt: NDArray[np.float64] | None = None
    mu: NDArray[np.float64] | None = None
    sliding: NDArray[np.bool_] | None = None

    def of_kept(self, grains: NDArray[np.int64]) -> WallContacts:
        """Return the contacts of the grains that stay, which are numbered in their order."""
        at = np.isin(self.grain, grains)
        number = np.searchsorted(grains, self.grain[at])
        own: Any = (self.force, self.branch, self.kn, self.kt, self.mu, self.sliding)
        kept: Any = (None if values is None else values[at] for values in own)
        return WallContacts(number, *kept)

    def facts(self) -> dict[str, object]:
        """Facts shown at the prompt and in a notebook."""
        total = ", ".join(f"{part:.4g}" for part in self.force.sum(axis=0))
        stiffness = "known" if self.kn is not None else "not known"
        return {"contacts": len(self.grain), "total force": f"({total})", "stiffness": stiffness}


def box_area(x: Floats, walls: WallContacts) -> float | None:
    """Return the area within upright walls if grains touch all four of them; else None."""
    sides = box_sides(x, walls)
    return None if sides is None else float(np.prod(sides))


def box_sides(x: Floats, walls: WallContacts) -> Floats | None:
    """Return (2,) sides within upright walls if grains touch all four of them; else None."""
    corners = box_corners(x, walls)
    return None if corners is None else corners[1] - corners[0]


def box_corners(x: Floats, walls: WallContacts) -> Floats | None:
    """Return (2, 2), the lower left and upper right corner within four upright walls; else None."""
    sides = [feet_along(x, walls, axis, UPRIGHT) for axis in (0, 1)]
    if sum(len(feet) for pair in sides for feet in pair) < len(walls.grain):
        return None
    if not all(len(feet) for pair in sides for feet in pair):
        return None
    ends = np.array([[feet.mean() for feet in pair] for pair in sides])
    for feet, (near, far) in zip(sides, ends, strict=True):
        if max(map(np.ptp, feet)) > UPRIGHT * (far - near):
            return None
    return ends.T


def feet_along(x: Floats, walls: WallContacts, axis: int, leaning: float) -> tuple[Floats, Floats]:
    """Feet along an axis, on the walls below and on those above, whose branches lean by less."""
    feet, along = (x[walls.grain] - walls.branch)[:, axis], walls.branch[:, axis]
    flat = np.abs(walls.branch[:, 1 - axis]) <= leaning * np.hypot(*walls.branch.T)
    return feet[flat & (along > 0)], feet[flat & (along < 0)]


def height_between(x: Floats, walls: WallContacts | None, axis: int) -> float | None:
    """Distance of the flat walls on both sides along an axis, by the feet; None without them."""
    if walls is None:
        return None
    low, high = feet_along(x, walls, axis, GEOMETRY_TOLERANCE)
    return float(high.mean() - low.mean()) if len(low) and len(high) else None


def wall_plates(
    graph: GrainGraph, walls: WallContacts, law: ContactLaw | None
) -> tuple[PlaneContacts, list[str]]:
    """Return the contacts of a sample with its walls, which strain as plates, and notes."""
    if walls.kn is not None and walls.kt is not None:
        sliding, notes = walls.sliding, []
        if walls.mu is not None and sliding is None:
            n = walls.branch / np.linalg.norm(walls.branch, axis=1, keepdims=True)
            N = np.sum(walls.force * n, axis=1)
            T = n[:, 0] * walls.force[:, 1] - n[:, 1] * walls.force[:, 0]
            sliding = np.abs(T) >= SLIDING_SHARE * walls.mu * N
        if walls.mu is None and walls.kt.any():
            notes = ["walls: no friction known, contacts with a shear stiffness stick"]
        given = walls.kn, walls.kt, walls.mu, walls.force, sliding
        return PlaneContacts(walls.grain, -walls.branch, *given), notes
    planes = plane_contacts(graph, walls.grain, walls.force, walls.branch)
    if isinstance(law, FrictionalLaw) and graph.contact_count:
        # Tangents are those of the law under these forces: 3/2 of force over overlap under Hertz's.
        springs, count = planes.springs(graph.radii), graph.contact_count
        on_plates = graph.radii[planes.grain] * np.array([[1.0], [0.0]])
        radii = np.hstack([graph.radii[graph.contacts].T, on_plates])
        wall = np.repeat([-1, 0], [count, len(planes.grain)])
        overlap = np.append(np.zeros(count), springs[3])
        kn, _ = PairLaw.made(law, radii, wall, springs).stiffnesses(overlap)
        planes = replace(planes, kn=kn[count:])
    return planes, ["walls: frictionless, with the stiffness that their forces and overlaps give"]


# Lengths of branches of walls over the radii: less by the overlap.
WALL_REACH = (0.6, 1.05)
# Weaker pulls of a wall, in mean forces, are those of damping.
WEAK = 0.1
# Share of the walls' force whose branches must fit.
FITTING = 0.9


class ReadWalls(NamedTuple):
    """Contacts with walls, None where force or branch is not known; their number, what is said."""

    contacts: WallContacts | None
    number: int
    notes: list[str]
    findings: list[Finding]


def walls_of_rows(
    table: Table, named: Integers, ends: Integers, contacts: Contacts, forces: Forces,
    kn: float | None,
) -> ReadWalls:  # fmt: skip
    """Contacts with walls among the rows of the contacts: one of the bodies `ends` is a grain.

    `named` (W, 2) are the bodies' rows, which tell walls apart. The branch is that of the file, or
    from the contact point, or else along the normal.
    """
    assert forces.at_walls is not None
    force = np.where(ends[:, :1] < 0, 1.0, -1.0) * forces.at_walls
    # A contact from both of its bodies counts once, as between grains.
    again, near = np.zeros(len(force), dtype=bool), SAME_FORCE * float(np.abs(force).mean())
    seen: dict[tuple[int, ...], list[int]] = defaultdict(list)
    for k, pair in enumerate(np.sort(named, axis=1).tolist()):
        again[k] = any(np.abs(force[k] - force[j]).max() <= near for j in seen[tuple(pair)])
        seen[tuple(pair)].append(k)
    table, ends, force = table.take(~again), ends[~again], force[~again]
    wall_first = ends[:, 0] < 0
    sign = np.where(wall_first, 1.0, -1.0)[:, None]
    grain = np.where(wall_first, ends[:, 1], ends[:, 0])
    return _walls(table, grain, force, sign, contacts, forces, kn)


def walls_of_table(
    table: Table, contacts: Contacts, forces: Forces, kn: float | None, shift: int
) -> ReadWalls:
    """Contacts with walls from a table of their own, `id` the grain of each, less the `shift`."""
    named, ids = table.integers("id") + shift, contacts.bodies.ids
    grain = index_of(ids, named)
    refuse_unknown(table, ("id",), named[:, None], grain[:, None], "Correct or drop it.")
    return _walls(table, grain, table.columns("fx", "fy"), 1.0, contacts, forces, kn)


def _walls(
    table: Table,
    grain: Integers,
    force: Floats,
    sign: Floats | float,
    contacts: Contacts,
    forces: Forces,
    kn: float | None,
) -> ReadWalls:
    """Contacts of these grains with walls; signs and branches are those that fit the grains.

    `sign` (W, 1) turns vectors of the table to those that act on the grains.
    """
    bodies = contacts.bodies
    branch, along = table.optional("branch_x", "branch_y"), table.optional("fnx", "fny")
    branch = None if branch is None else sign * branch
    if along is None and forces.known and not forces.shear.any():
        along = force
    notes: list[str] = []
    springs = {k: table.column(k) for k in ("kn", "ks", "mu", "sliding") if table.has(k)}
    flags = springs["sliding"] != 0 if "sliding" in springs else None
    stiff, kt, mu = (springs.get(name) for name in ("kn", "ks", "mu"))
    if kt is not None and (mu is not None or flags is not None):
        # Nothing sticks without friction; where the file has none, where it flags sliding.
        kt = np.where(~(mu > 0) if mu is not None else flags, 0.0, kt)  # type: ignore[arg-type]
    x, radii = bodies.x[grain], bodies.radii[grain]
    if _acts_on_walls(bodies.x, grain, force, resultants(contacts, forces)):
        force = -force
        notes.append("forces of contacts with walls act on the walls: turned, as balance needs")
    point, normal = table.optional("cx", "cy"), table.optional("nx", "ny")
    if branch is not None and np.allclose(np.hypot(*branch.T), 1.0, rtol=1e-6) and np.ptp(radii):
        normal, branch = sign * branch, None
    if branch is None and point is None and normal is None and along is not None and along.any():
        normal = sign * along * np.sign(np.einsum("wk,wk->w", along, force))[:, None]
    if branch is None and point is None and normal is None:
        unknown = finding("wall_branches", 0.0, "unknown", count=len(grain))
        return ReadWalls(None, len(grain), [], [unknown])
    given: list[tuple[str, Floats]] = []
    if branch is not None:
        given += [("", branch), ("turned: they point to the walls", -branch)]
        given.append(("taken as contact points", x - sign * branch))
        power = np.rint(np.log10(median(np.hypot(*branch.T) / radii) or 1.0))
        scaled = branch * 10.0**-power
        given += [(f"times 10^{-power:.0f}: they are of another unit", s * scaled) for s in (1, -1)]
    if point is not None:
        given.append(("", x - point))
    if normal is not None:
        length = np.hypot(*normal.T)[:, None]
        unit = sign * normal / np.where(length > 0, length, 1.0)
        # The overlap is left out where no stiffness tells it.
        overlap = np.einsum("wk,wk->w", force, unit) / (
            stiff if stiff is not None else kn or np.inf
        )
        given += [("from the radii along the normals", s * (radii - s * overlap)[:, None] * unit)
                  for s in (1, -1)]  # fmt: skip
    size = np.hypot(*force.T)
    fits = [np.sum(_fits(one, force, radii) * size) >= FITTING * size.sum() for _, one in given]
    words, one = given[fits.index(True) if True in fits else 0]
    if words and any(fits):
        notes.append(f"branches of contacts with walls {words}")
    good = _fits(one, force, radii)
    case, odd = "ok" if good.all() else "some" if good.mean() >= FITTING else "most", ~good
    values = {"odd": odd.sum(), "count": len(good), "each": few(bodies.ids[grain[odd]])}
    fitting = finding("wall_branches", median(np.hypot(*one.T) / radii), case, **values)
    walls = WallContacts(grain, force, one, stiff, kt, mu, flags)
    return ReadWalls(walls, len(grain), notes, [fitting])


def _acts_on_walls(x: Floats, grain: Integers, force: Floats, resultant: Floats) -> bool:
    """Whether the forces push outward, and would balance the grains if they were turned."""
    if np.sum(force * (x[grain] - x.mean(axis=0))) <= 0:
        return False
    pushed = np.zeros_like(x)
    np.add.at(pushed, grain, force)
    own = np.unique(grain)
    as_given, turned = (np.hypot(*(resultant + s * pushed)[own].T) for s in (1, -1))
    return bool(median(turned) < median(as_given))


def _fits(branch: Floats, force: Floats, radii: Floats) -> Flags:
    """(W,) branches as long as the radii less an overlap, along which the walls push."""
    ratio = np.hypot(*branch.T) / radii
    size = np.hypot(*force.T)
    pushes = np.einsum("wk,wk->w", branch, force) >= -WEAK * size.mean() * radii
    return np.asarray((ratio > WALL_REACH[0]) & (ratio < WALL_REACH[1]) & pushes)
