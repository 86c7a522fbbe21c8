"""The state of a packing on its path: geometry and forces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.boundary import Boundary
from loops.errors import InputError
from loops.graph import GrainGraph, branches_between
from loops.shown import Shown

# Largest change of the stress in an interval, over itself: beyond, the interval met a jump.
JUMP = 0.5
# Largest motion of a centre against the others in an interval, over the mean diameter.
LEAP = 0.02


@dataclass(frozen=True, eq=False, repr=False)
class PackingState(Shown):
    """A state of a packing on its path.

    Attributes
    ----------
    radii : (B,) array
        Radii of the grains, then zero for each wall.
    x, angle : (B, 2), (B,) array
        Centres, and angles that the grains have turned by since the start; then a point of each
        wall, which goes with the cell.
    cell : (2, 2) array
        Periodic cell, or the sides of the box between walls.
    contacts, images : (C, 2) array of int
        Contacts of the start first, those with walls last, then pairs that have touched since, or
        might.
    normal_force, shear_force : (C,) array
        `N` and `T`; zero where open.
    rolling_moment : (C,) array
        Moment of the rolling spring on the second grain; zero where there is none.
    closed : (C,) array of bool
        Contacts that carry, whatever the sign of their force; at the start those with a force.
    walls : (W, 2) array
        Unit normals of the walls into the sample, which keep their directions.
    cell0 : (2, 2) array
        Cell at the start.
    """

    radii: Floats
    x: Floats
    angle: Floats
    cell: Floats
    contacts: Integers
    images: Integers
    normal_force: Floats
    shear_force: Floats
    rolling_moment: Floats
    closed: Flags
    walls: Floats
    cell0: Floats

    @property
    def count(self) -> int:
        """Number of grains."""
        return len(self.x) - len(self.walls)

    @property
    def mean_radius(self) -> float:
        """Mean radius of the grains."""
        return float(self.radii[: self.count].mean())

    @property
    def strain(self) -> Floats:
        """(2, 2) displacement gradient of the cell since the start, compression positive."""
        return np.asarray(np.eye(2) - self.cell @ np.linalg.inv(self.cell0))

    @property
    def at_wall(self) -> Flags:
        """(C,) contacts with walls."""
        return np.asarray(self.contacts[:, 1] >= self.count)

    @cached_property
    def apart(self) -> Floats:
        """(C, 2) from the centre of a grain to that of the other, or to the point of the wall."""
        return branches_between(self.x, self.contacts, self.images, self.cell)

    @cached_property
    def branches(self) -> Floats:
        """(C, 2) branch vectors; to the foot on a wall."""
        if not len(self.walls):
            return self.apart
        d, rows = self.apart.copy(), self.at_wall
        normal = self.walls[self.contacts[rows, 1] - self.count]
        d[rows] = np.sum(d[rows] * normal, axis=1, keepdims=True) * normal
        return d

    @cached_property
    def forces(self) -> Floats:
        """(C, 2) forces of grain i on grain j."""
        d = self.branches
        n = d / np.linalg.norm(d, axis=1, keepdims=True)
        t = np.column_stack([-n[:, 1], n[:, 0]])
        return self.normal_force[:, None] * n + self.shear_force[:, None] * t

    @cached_property
    def stress(self) -> Floats:
        """(2, 2) stress, compression positive, over the current cell.

        In a box it is the force on the upper and on the right wall over their lengths, whose
        diagonal is that of Love and Weber between smooth walls.
        """
        return self.forces.T @ self.apart / abs(np.linalg.det(self.cell))

    @property
    def pressure(self) -> float:
        """Half the trace of the stress; where contacts pull, of the sizes of the normal forces."""
        if not (self.normal_force < 0).any():
            return 0.5 * float(np.trace(self.stress))
        carried = np.abs(self.normal_force) @ np.linalg.norm(self.branches, axis=1)
        return 0.5 * float(carried) / abs(float(np.linalg.det(self.cell)))

    @cached_property
    def resultants(self) -> Floats:
        """(B, 3) contact forces and moments on the grains; walls need no balance."""
        i, j = self.contacts.T
        out = np.zeros((len(self.x), 3))
        length = np.linalg.norm(self.branches, axis=1)
        arm_i = 0.5 * (length + self.radii[i] - self.radii[j])
        np.add.at(out[:, :2], j, self.forces)
        np.add.at(out[:, :2], i, -self.forces)
        np.add.at(out[:, 2], i, -arm_i * self.shear_force)
        np.add.at(out[:, 2], j, -(length - arm_i) * self.shear_force)
        if self.rolling_moment.any():
            np.add.at(out[:, 2], i, -self.rolling_moment)
            np.add.at(out[:, 2], j, self.rolling_moment)
        out[self.count :] = 0.0
        return out

    @property
    def mean_force(self) -> float:
        """Mean force of the closed contacts between grains; nan if there are none."""
        carried = np.linalg.norm(self.forces[self.closed & ~self.at_wall], axis=1)
        return float(carried.mean()) if carried.any() else float("nan")

    @property
    def unbalanced(self) -> float:
        """Mean resultant on a grain over the mean contact force, as Yade; nan without forces."""
        left = np.linalg.norm(self.resultants[: self.count, :2], axis=1)
        return float(left.mean() / self.mean_force)

    def graph(self) -> GrainGraph:
        """Return the closed contacts between grains as a graph of their own."""
        c, periodic = self.closed & ~self.at_wall, not len(self.walls)
        return GrainGraph(
            x=self.x[: self.count],
            radii=self.radii[: self.count],
            contacts=self.contacts[c],
            images=self.images[c] if periodic else None,
            cell=self.cell if periodic else None,
            normal_force=self.normal_force[c],
            shear_force=self.shear_force[c],
            rolling_moment=self.rolling_moment[c] if self.rolling_moment.any() else None,
        )


def start_state(
    graph: GrainGraph, boundary: Boundary | None = None, *, still: bool = False
) -> PackingState:
    """Return the state of a graph with its own forces, in its cell or between walls.

    The box is that of four walls along the axes, or of walls that stand `still` in any direction.
    """
    x, radii, angle = graph.x, graph.radii, np.zeros(graph.grain_count)
    N, T, M = graph.normal_force, graph.shear_force, np.zeros(graph.contact_count)
    if graph.rolling_moment is not None:
        M = graph.rolling_moment
    if graph.cell is not None:
        assert graph.images is not None
        cell, normals = graph.cell, np.zeros((0, 2))
        contacts, images = graph.contacts, graph.images
    elif boundary is None or boundary.walls is None or boundary.kind != "walls":
        remedy = "Give the cell, or the contacts with the walls."
        raise InputError("packing", "no cell and no walls", "either of them", remedy)
    else:
        planes = boundary.walls
        normals, points, wall, cell = boundary.standing(graph) if still else boundary.box(graph)
        count, n = graph.grain_count, normals[wall]
        x, none = np.concatenate([x, points]), np.zeros(len(points))
        radii, angle = np.append(radii, none), np.append(angle, none)
        contacts = np.vstack([graph.contacts, np.column_stack([planes.grain, count + wall])])
        images = np.zeros_like(contacts)
        distance = np.linalg.norm(planes.branch, axis=1)
        push = planes.kn * np.maximum(graph.radii[planes.grain] - distance, 0.0)
        force = push[:, None] * n if planes.force is None else planes.force
        # The normal of a contact points from the grain to the wall.
        frame = n, np.column_stack([-n[:, 1], n[:, 0]])
        N, T = (
            np.append(old, np.sum(force * way, axis=1))
            for old, way in zip((N, T), frame, strict=True)
        )
        M = np.append(M, 0.0 * distance)
    return PackingState(
        radii=radii,
        x=x,
        angle=angle,
        cell=cell,
        contacts=contacts,
        images=images,
        normal_force=N,
        shear_force=T,
        rolling_moment=M,
        closed=N != 0,
        walls=normals,
        cell0=cell,
    )


def nominal(stress: Floats, H: Floats) -> Floats:
    """Return the nominal stress over the first cell, `det F P F^-T` with `F = 1 - H`."""
    F = np.eye(2) - H
    return np.asarray(np.linalg.det(F) * stress @ np.linalg.inv(F).T)


def jumped(before: PackingState, after: PackingState, stress: float) -> str:
    """Tell the jump of the stress or of a centre in a short strain; empty if there is none.

    `stress` is the norm of the stress at the start of the path.
    """
    # Near zero stress the change is measured by the stress of the start; contacts that pull cancel
    # others in the stress, and count besides.
    pull = np.maximum(-before.normal_force[before.closed], 0.0).sum()
    pulls = 2.0 * before.mean_radius * pull / abs(np.linalg.det(before.cell))
    size = max(float(np.linalg.norm(before.stress)), stress) + pulls
    change = np.linalg.norm(after.stress - before.stress) / size
    if not change < JUMP:
        return f"the stress jumped by {change:.2g} of what it was"
    beyond = after.x - before.x @ (after.cell @ np.linalg.inv(before.cell)).T
    carries = np.bincount(after.contacts[after.closed].ravel(), minlength=len(beyond)) > 1
    leap = np.abs(beyond[carries]).max(initial=0.0) / (2.0 * after.mean_radius)
    return f"a grain leapt by {leap:.2g} diameters" if leap > LEAP else ""
