"""The contacts of a packing: its bodies and their pairs, forces, what is closed, the law."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from loops.arrays import Flags, Floats, Integers
from loops.boundary import Boundary
from loops.errors import InputError
from loops.graph import GrainGraph, branches_between, require_one_state
from loops.laws.frictional import FrictionalLaw
from loops.laws.of_pairs import PairLaw, require_movable
from loops.neighbours import new_pairs
from loops.scene import Scene
from loops.shown import Shown

# A pair at one geometry, as the kernels take it; all lengths but `d` are over the mean radius.
PAIR = np.dtype(
    [
        ("grains", "i8", 2),
        ("d", "f8", 2),  # from the first centre to the second, or to the point of the wall
        ("n", "f8", 2),
        ("t", "f8", 2),
        ("turns", "f8"),  # 1 where the frame turns with the branch, 0 where it keeps its direction
        ("turning", "f8"),  # the shear rate is `turning` times `t . d'`
        ("lever", "f8", 2),  # minus `lever` times the spins
        ("arm", "f8", 2),  # levers of the shear force
        ("rotation", "f8", 2),  # force rate per `t . d'`, as the pair rotates
        ("growth", "f8"),  # moment rate per `n . d'`, as the arms grow
        ("kn", "f8"),
        ("kt", "f8"),
        ("coupling", "f8"),  # stuck, `-T'` per `n . d'`: of a `T` that goes with `kt`
        ("mu", "f8"),  # slope of the strength with N, 0 where it is not finite
        ("cohesion", "f8"),  # the strength less `mu N`
        ("at_touch", "f8"),  # normal force at which it opens and with which it closes
        ("slides", "i8"),  # whether the strength is finite
        ("push", "f8"),  # share of the normal force that acts on the grains: none of a spring's
    ]
)

# Share of its strength from which a contact is at yield.
AT_YIELD = 1.0 - 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class Contacts(Shown):
    """Contact table of a packing: its state on a path, and the law of the contacts.

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
    law : PairLaw
        What the law gives for these contacts at their overlaps; None of a state that is asked for
        its forces alone.
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
    law: PairLaw = None  # type: ignore[assignment]

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
    def length(self) -> Floats:
        """(C,) lengths of the branches."""
        return np.linalg.norm(self.branches, axis=1)

    @cached_property
    def axes(self) -> tuple[Floats, Floats]:
        """(C, 2) unit normals along the branches, and the tangents, turned counter-clockwise."""
        n = self.branches / self.length[:, None]
        return n, np.column_stack([-n[:, 1], n[:, 0]])

    @cached_property
    def forces(self) -> Floats:
        """(C, 2) forces of grain i on grain j."""
        n, t = self.axes
        return self.normal_force[:, None] * n + self.shear_force[:, None] * t

    @cached_property
    def stress(self) -> Floats:
        """(2, 2) stress, compression positive, over the current cell.

        In a box it is the force on the upper and on the right wall over their lengths, whose
        diagonal is that of Love and Weber between smooth walls.
        """
        return self.forces.T @ self.apart / abs(np.linalg.det(self.cell))

    @property
    def pull(self) -> float:
        """Mean stress that contacts which pull take from the others."""
        pulled = float(np.maximum(-self.normal_force, 0.0) @ self.length)
        return pulled / abs(float(np.linalg.det(self.cell)))

    @property
    def pressure(self) -> float:
        """Half the trace of the stress, as if contacts that pull pressed by as much."""
        return 0.5 * float(np.trace(self.stress)) + self.pull

    @cached_property
    def resultants(self) -> Floats:
        """(B, 3) contact forces and moments on the grains; walls need no balance."""
        i, j = self.contacts.T
        out = np.zeros((len(self.x), 3))
        length = self.length
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

    @cached_property
    def mean_force(self) -> float:
        """Mean force of the closed contacts between grains; nan if there are none."""
        return self.mean_force_of(self.closed)

    def mean_force_of(self, rows: Flags) -> float:
        """Return the mean force of those rows (C,) that are between grains; nan without any."""
        carried = np.linalg.norm(self.forces[rows & ~self.at_wall], axis=1)
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

    # ---- under its law

    @cached_property
    def overlap(self) -> Floats:
        """(C,) overlaps, zero where a pair is apart."""
        return np.asarray(np.maximum(self.law.touching - self.length, 0.0))

    @cached_property
    def strength(self) -> Floats:
        """(C,) shear force that contacts can carry, infinite where they never slide."""
        return self.law.shear_strength(self.overlap, self.normal_force)

    @property
    def rolling_strength(self) -> Floats:
        """(C,) rolling moment that contacts can carry."""
        return self.law.rolling_strength(self.normal_force, self.closed)

    def at_limit(self, share: float = AT_YIELD) -> Flags:
        """Return closed contacts (C,) with this share of their strength at least."""
        reached = np.abs(self.shear_force) >= share * self.strength
        return np.asarray(self.closed & reached)

    def with_normal_forces(self) -> Self:
        """Return the contacts with normal forces of their overlaps; what overlaps is closed."""
        N = self.law.normal_force(self.overlap)
        return replace(self, normal_force=N, closed=self.overlap > 0)

    def with_forces_of_geometry(self) -> Self:
        """Return the contacts with these normal forces, and shear forces within the cone."""
        state = self.with_normal_forces()
        most, closed = state.strength, state.closed
        T = np.clip(np.where(closed, state.shear_force, 0.0), -most, most)
        most, springs = state.rolling_strength, closed & (state.law.k_r > 0)
        M = np.clip(np.where(springs, state.rolling_moment, 0.0), -most, most)
        return replace(state, shear_force=T, rolling_moment=M)

    def parted(self, opened: Flags) -> Self:
        """Return the contacts once some (C,) have opened: bonds among these are gone."""
        law = self.law.parted(opened)
        return self if law is self.law else replace(self, law=law)

    @cached_property
    def stored_energy(self) -> float:
        """Energy of the springs of closed contacts at their overlaps."""
        springs, rolling = self._stored(self.closed)
        return float(np.sum(springs)) + rolling

    def energy(self, rows: Flags) -> float:
        """Return the energy of the springs of some rows (C,)."""
        if not rows.any():
            return 0.0
        springs, rolling = self._stored(rows)
        return float(np.sum(springs[rows])) + rolling

    def _stored(self, rows: Flags) -> tuple[Floats, float]:
        """Return the energies (C,) of springs of some rows, and that of those against rolling."""
        overlap, T = np.where(rows, self.overlap, 0.0), self.shear_force
        kt = self.law.stiffnesses(overlap)[1]
        shear = np.divide(T**2, 2.0 * kt, out=np.zeros(len(T)), where=rows & (kt > 0))
        rolling = self.law.rolling_energy(np.where(rows, self.rolling_moment, 0.0))
        return self.law.normal_energy(overlap) + shear, rolling

    def with_near(self, gap: float) -> Self:
        """Return the contacts, then all other pairs closer than `gap`, open."""
        known = self.contacts, self.images
        ends, images = new_pairs(*known, self.x, self.radii, self.cell, self.walls, gap)
        wall = np.where(ends[:, 1] >= self.count, ends[:, 1] - self.count, -1)
        none = np.zeros(len(ends))
        return replace(
            self,
            contacts=np.concatenate([self.contacts, ends]),
            images=np.concatenate([self.images, images]),
            normal_force=np.append(self.normal_force, none),
            shear_force=np.append(self.shear_force, none),
            rolling_moment=np.append(self.rolling_moment, none),
            closed=np.append(self.closed, none > 0),
            law=self.law.grown(self.radii[ends].T, wall),
        )

    def records(self, reach: float = 0.0) -> NDArray[Any]:
        """Return records `PAIR` (C,) at this geometry and these forces.

        With springs for rolling (2 C,): theirs come after, `T` the moment over the mean radius.
        """
        law = self.law
        frame = np.empty(len(law), dtype=PAIR)
        (n, t), length = self.axes, self.length
        radii = self.radii[self.contacts]
        arms = 0.5 * (length[:, None] + radii - radii[:, ::-1])
        unit = self.mean_radius
        N, T = self.normal_force, self.shear_force
        frame["grains"], frame["d"], frame["n"], frame["t"] = self.contacts, self.apart, n, t
        frame["turning"] = radii.sum(axis=1) / length if law.by_radii else 1.0
        frame["lever"] = (radii if law.by_radii else arms) / unit
        frame["arm"] = arms / unit
        frame["turns"] = ~self.at_wall
        turned = frame["turns"][:, None] * (N[:, None] * t - T[:, None] * n)
        frame["rotation"] = turned / length[:, None]
        frame["growth"] = 0.5 * T / unit
        for name, values in law.tangent(law.touching - length, T, reach).items():
            frame[name] = values
        frame["slides"], frame["at_touch"], frame["push"] = law.slides, law.at_touch, 1.0
        if law.springs == 1:
            return frame
        # A spring against rolling slides at a share of the N of its pair, and shears by the spins.
        rolling = frame.copy()
        for name in ("t", "turning", "rotation", "growth", "coupling", "push"):
            rolling[name] = 0.0
        rolling["lever"] = rolling["arm"] = 1.0, -1.0
        rolling["kt"] = law.k_r / unit**2
        most = law.rolling_reach / unit
        rolling["slides"] = np.isfinite(most)
        rolling["mu"] = np.where(rolling["slides"], most, 0.0)
        rolling["cohesion"] = -rolling["mu"] * rolling["at_touch"]
        return np.concatenate([frame, rolling])


def start_state(
    graph: GrainGraph, boundary: Boundary | None = None, *, still: bool = False
) -> Contacts:
    """Return the state of a graph with its own forces, in its cell or between walls, without a law.

    The box is that of four walls along the axes, or of walls that stand `still` in any direction.
    """
    require_one_state(graph)
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
        count = graph.grain_count
        x, none = np.concatenate([x, points]), np.zeros(len(points))
        radii, angle = np.append(radii, none), np.append(angle, none)
        contacts = np.vstack([graph.contacts, np.column_stack([planes.grain, count + wall])])
        images = np.zeros_like(contacts)
        at_walls = planes.state(graph.radii)
        N, T = np.append(N, at_walls.normal_force), np.append(T, at_walls.shear_force)
        M = np.append(M, 0.0 * at_walls.length)
    return Contacts(
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


def contacts_at_start(scene: Scene, *, still: bool = False) -> Contacts:
    """Return the contacts of a scene with its own forces, for paths and equations of motion.

    Walls are those of `start_state`. `InputError` where the law is none of theirs, or the scene
    carries nothing, or has neither cell nor walls.
    """
    start = start_state(scene.graph, scene.boundary, still=still)
    law = require_movable(scene.law, scene.contact_state)
    return contacts_of(start, law, scene.boundary)


def contacts_of(start: Contacts, law: FrictionalLaw, boundary: Boundary | None = None) -> Contacts:
    """Return the contacts of a state under a law, those with walls last."""
    wall = np.where(start.at_wall, start.contacts[:, 1] - start.count, -1)
    radii = np.ascontiguousarray(start.radii[start.contacts].T)
    planes, springs = None if boundary is None else boundary.walls, None
    if len(start.walls) and planes is not None:
        springs = planes.springs(start.radii)
    contacts = replace(start, law=PairLaw.made(law, radii, wall, springs))
    return contacts.parted(contacts.overlap == 0)
