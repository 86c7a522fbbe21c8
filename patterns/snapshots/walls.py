"""Walls of a sample: their contacts, the box that they make, and the plates that strain with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from loops import ContactLaw, GrainGraph
from loops.arrays import Floats
from loops.boundary import UPRIGHT, PlaneContacts, plane_contacts
from loops.laws.of_pairs import MovableLaw, PairLaw
from loops.shown import Shown
from patterns.snapshots.checks import SLIDING_SHARE


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
    feet = x[walls.grain] - walls.branch
    length = np.hypot(*walls.branch.T)
    across = np.abs(walls.branch) > UPRIGHT * length[:, None]
    if across.all(axis=1).any():
        return None
    ends = []
    for axis in (0, 1):
        own = across[:, axis]
        low = own & (walls.branch[:, axis] > 0)
        high = own & (walls.branch[:, axis] < 0)
        if not (low.any() and high.any()):
            return None
        near, far = float(feet[low, axis].mean()), float(feet[high, axis].mean())
        if max(np.ptp(feet[low, axis]), np.ptp(feet[high, axis])) > UPRIGHT * (far - near):
            return None
        ends.append((near, far))
    return np.array(ends).T


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
    if isinstance(law, MovableLaw) and graph.contact_count:
        # Tangents are those of the law under these forces: 3/2 of force over overlap under Hertz's.
        springs, count = planes.springs(graph.radii), graph.contact_count
        on_plates = graph.radii[planes.grain] * np.array([[1.0], [0.0]])
        radii = np.hstack([graph.radii[graph.contacts].T, on_plates])
        wall = np.repeat([-1, 0], [count, len(planes.grain)])
        overlap = np.append(np.zeros(count), springs[3])
        kn, _ = PairLaw.made(law, radii, wall, springs).stiffnesses(overlap)
        planes = replace(planes, kn=kn[count:])
    return planes, ["walls: frictionless, with the stiffness that their forces and overlaps give"]
