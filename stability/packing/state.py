"""The state of a packing on its path: geometry and forces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from loops.arrays import Flags, Floats, Integers
from loops.graph import GrainGraph, branches_between

# Largest change in an interval: of the stress, over itself; of a centre, over the mean diameter.
JUMP, LEAP = 0.5, 0.02


@dataclass(frozen=True, eq=False)
class PackingState:
    """A state of a packing on its path.

    Attributes
    ----------
    x, angle : (G, 2), (G,) array
        Centres, and angles that the grains have turned by since the start.
    cell : (2, 2) array
        Periodic cell.
    contacts, images : (C, 2) array of int
        Contacts of the start first, then pairs that have touched since, or might.
    normal_force, shear_force : (C,) array
        `N` and `T`; zero where open.
    """

    radii: Floats
    x: Floats
    angle: Floats
    cell: Floats
    contacts: Integers
    images: Integers
    normal_force: Floats
    shear_force: Floats

    @property
    def closed(self) -> Flags:
        """(C,) contacts that carry a force."""
        return self.normal_force > 0

    @cached_property
    def branches(self) -> Floats:
        """(C, 2) branch vectors."""
        return branches_between(self.x, self.contacts, self.images, self.cell)

    @cached_property
    def forces(self) -> Floats:
        """(C, 2) forces of grain i on grain j."""
        d = self.branches
        n = d / np.linalg.norm(d, axis=1, keepdims=True)
        t = np.column_stack([-n[:, 1], n[:, 0]])
        return self.normal_force[:, None] * n + self.shear_force[:, None] * t

    @cached_property
    def stress(self) -> Floats:
        """(2, 2) stress, compression positive, over the current cell."""
        return self.forces.T @ self.branches / abs(np.linalg.det(self.cell))

    @cached_property
    def resultants(self) -> Floats:
        """(G, 3) contact forces and moments on the grains."""
        i, j = self.contacts.T
        out = np.zeros((len(self.x), 3))
        length = np.linalg.norm(self.branches, axis=1)
        arm_i = 0.5 * (length + self.radii[i] - self.radii[j])
        np.add.at(out[:, :2], j, self.forces)
        np.add.at(out[:, :2], i, -self.forces)
        np.add.at(out[:, 2], i, -arm_i * self.shear_force)
        np.add.at(out[:, 2], j, -(length - arm_i) * self.shear_force)
        return out

    @property
    def unbalanced(self) -> float:
        """Mean resultant on a grain over the mean contact force, as Yade; nan without forces."""
        carried = np.linalg.norm(self.forces[self.closed], axis=1)
        mean = carried.mean() if carried.any() else np.nan
        return float(np.linalg.norm(self.resultants[:, :2], axis=1).mean() / mean)

    def graph(self) -> GrainGraph:
        """The closed contacts as a graph of their own."""
        c = self.closed
        return GrainGraph(
            x=self.x,
            radii=self.radii,
            contacts=self.contacts[c],
            images=self.images[c],
            cell=self.cell,
            normal_force=self.normal_force[c],
            shear_force=self.shear_force[c],
        )


def start_state(graph: GrainGraph) -> PackingState:
    """The state of a graph, with its own forces."""
    assert graph.cell is not None and graph.images is not None
    return PackingState(
        radii=graph.radii,
        x=graph.x,
        angle=np.zeros(graph.grain_count),
        cell=graph.cell,
        contacts=graph.contacts,
        images=graph.images,
        normal_force=graph.normal_force,
        shear_force=graph.shear_force,
    )


def jumped(before: PackingState, after: PackingState, stress: float) -> str:
    """The jump of the stress or of a centre in a short strain; empty if there is none.

    `stress` is the norm of the stress at the start of the path.
    """
    # Near zero stress the change is measured by the stress of the start.
    size = max(float(np.linalg.norm(before.stress)), stress)
    change = np.linalg.norm(after.stress - before.stress) / size
    if not change < JUMP:
        return f"the stress jumped by {change:.2g} of what it was"
    beyond = after.x - before.x @ (after.cell @ np.linalg.inv(before.cell)).T
    carries = np.bincount(after.contacts[after.closed].ravel(), minlength=len(beyond)) > 1
    leap = np.abs(beyond[carries]).max(initial=0.0) / (2.0 * float(after.radii.mean()))
    return f"a grain leapt by {leap:.2g} diameters" if leap > LEAP else ""
