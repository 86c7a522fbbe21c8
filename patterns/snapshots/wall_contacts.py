"""Contacts with walls from the tables of a snapshot: forces on the grains, feet on the walls."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import numpy as np

from loops.arrays import Flags, Floats, Integers, median
from patterns.snapshots.checks import SAME_FORCE
from patterns.snapshots.findings import Finding, few, finding
from patterns.snapshots.forces import Forces, resultants
from patterns.snapshots.geometry import GEOMETRY_TOLERANCE, Contacts, index_of, refuse_unknown
from patterns.snapshots.tables import Table
from patterns.snapshots.walls import WallContacts

# Lengths of branches of walls over the radii: less by the overlap.
WALL_REACH = (0.6, 1.05)
# Weaker pulls of a wall, in mean forces, are those of damping.
WEAK = 0.1
# Share of the walls' force whose branches must fit.
FITTING = 0.9


class Walls(NamedTuple):
    """Contacts with walls, None where force or branch is not known; their number, what is said."""

    contacts: WallContacts | None
    number: int
    notes: list[str]
    findings: list[Finding]


def walls_of_rows(
    table: Table, named: Integers, ends: Integers, contacts: Contacts, forces: Forces,
    kn: float | None,
) -> Walls:  # fmt: skip
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
) -> Walls:
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
) -> Walls:
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
        return Walls(None, len(grain), [], [unknown])
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
    walls = WallContacts(grain, force, one, stiff, kt, mu, flags)
    return Walls(walls, len(grain), notes, [_branches(one, force, radii, good, bodies.ids[grain])])


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


def _branches(branch: Floats, force: Floats, radii: Floats, good: Flags, ids: Integers) -> Finding:
    """Finding on branches of walls against the radii and the forces of their grains."""
    ratio = median(np.hypot(*branch.T) / radii)
    case = "ok" if good.all() else "some" if good.mean() >= FITTING else "most"
    odd = ids[~good]
    values = {"odd": len(odd), "count": len(good), "each": few(odd)}
    return finding("wall_branches", ratio, case, **values)


def height_between(x: Floats, walls: WallContacts | None, axis: int) -> float | None:
    """Distance of the flat walls on both sides along an axis, by the feet; None without them."""
    if walls is None:
        return None
    feet = (x[walls.grain] - walls.branch)[:, axis]
    across = np.abs(walls.branch[:, 1 - axis]) < GEOMETRY_TOLERANCE * np.hypot(*walls.branch.T)
    low, high = across & (walls.branch[:, axis] > 0), across & (walls.branch[:, axis] < 0)
    if not (low.any() and high.any()):
        return None
    return float(feet[high].mean() - feet[low].mean())
