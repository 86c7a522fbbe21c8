"""One loop of a snapshot as a study of paths follows it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from loops import GrainGraph, LinearFrictional, contact_state
from loops.arrays import Floats
from patterns import Snapshot, loop_of_snapshot
from stability import Stage
from studies.paths.options import PROGRAMMES, PolygonOptions

# Strain of the programme over the mean overlap, if nobody says where it ends.
OVERLAPS = 5.0
NEWTON_STEPS = 20


@dataclass(frozen=True)
class LoopOptions(PolygonOptions):
    """One loop of a snapshot, followed from the state that it is in, which is the reference.

    `loop` is its number in the table of loops. Lengths are over the mean diameter of its grains,
    stiffnesses and forces over the mean `kn` of its contacts; law, forces and regimes are the
    snapshot's. `end` is an E1 beyond that state, five mean overlaps if left out.
    """

    snapshot: Snapshot | None = None
    loop: int = 0
    source: str = ""

    @cached_property
    def taken(self) -> tuple[GrainGraph, LinearFrictional, float]:
        """The loop in these units, its law, and how far a grain was moved to fit the forces."""
        assert self.snapshot is not None
        found = loop_of_snapshot(self.snapshot, self.loop)
        given, law = found.graph, found.law
        length, kn = 2.0 * given.radii.mean(), float(np.mean(law.kn))
        law = LinearFrictional(law.kn / kn, law.kt / kn, law.mu, law.shear_increment)
        N, T = (force / (kn * length) for force in (given.normal_force, given.shear_force))
        radii, x0 = given.radii / length, (given.x - given.x.mean(axis=0)) / length
        x = ring_of_lengths(x0, radii + np.roll(radii, -1) - N / law.kn)
        graph = GrainGraph(x=x, radii=radii, contacts=given.contacts)
        # The forces of the overlaps, which those of the file are to rounding.
        graph = graph.replace(normal_force=law.normal_force(contact_state(graph)), shear_force=T)
        return graph.replace(regime=found.regime), law, float(np.abs(x - x0).max())

    @property
    def keeps_shape(self) -> bool:
        """The state is given, no isotropic strain leads to it."""
        return False

    @property
    def last_strain(self) -> float:
        """E1 at the end of the programme."""
        graph, law, _ = self.taken
        return self.end or float(f"{OVERLAPS * np.mean(graph.normal_force / law.kn):.3g}")

    def graph(self, strain: Floats | float = 0.0) -> GrainGraph:
        """The loop as the snapshot has it."""
        return self.taken[0]

    def law(self) -> LinearFrictional:
        """The snapshot's law."""
        return self.taken[1]

    def stages(self) -> tuple[tuple[str, Stage], ...]:
        """The programme, from the state of the snapshot on."""
        return ((self.programme, Stage(PROGRAMMES[self.programme](), "H11", self.last_strain)),)

    def described(self) -> dict[str, Any]:
        """Every value in force, under the names of the command line."""
        names = ("order", "closure", "spins", "programme", "model")
        values = {name: getattr(self, name) for name in names} | {"end": self.last_strain}
        return {"snapshot": self.source, "loop": self.loop, "moved": self.taken[2], **values}


def ring_of_lengths(x: Floats, lengths: Floats) -> Floats:
    """Centres nearby whose branches (c, c + 1) have these lengths: Newton, the smallest moves.

    A file that rounds positions gives overlaps that don't fit its forces.
    """
    x, c = x.copy(), np.arange(len(x))
    for _ in range(NEWTON_STEPS):
        d = np.roll(x, -1, axis=0) - x
        size = np.hypot(*d.T)
        if np.abs(size - lengths).max() <= 4.0 * np.finfo(float).eps * lengths.max():
            break
        slopes, n = np.zeros((len(c), len(c), 2)), d / size[:, None]
        slopes[c, c], slopes[c, np.roll(c, -1)] = -n, n
        x += np.linalg.lstsq(slopes.reshape(len(c), -1), lengths - size)[0].reshape(-1, 2)
    return x
