"""One loop of a snapshot, cut out with its forces and its law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from loops import GrainGraph, InputError, LinearFrictional, Regime, branch_vectors
from loops.arrays import Integers, Regimes
from loops.shown import Shown
from patterns.polygons.shapes import ring_contacts

if TYPE_CHECKING:
    from patterns.snapshots.snapshot import Snapshot


@dataclass(frozen=True, eq=False, repr=False)
class SnapshotLoop(Shown):
    """A loop as the simulation left it.

    Attributes
    ----------
    graph : GrainGraph
        Grains counter-clockwise, contacts (c, c+1), unrolled from the first one at the origin
        if the loop crosses a periodic border; forces and regimes as in the snapshot, the reference
        is the current configuration.
    law : LinearFrictional
        Stiffness and friction of the n contacts.
    regime : (n,) array of int8
        `Regime` of the contacts, sliding where the snapshot flags it.
    ids : (n,) array of int
        Ids of the grains as the file has them.
    grains, contacts : (n,) array of int
        Grains and contacts as numbered in the snapshot's graph.
    """

    graph: GrainGraph
    law: LinearFrictional
    regime: Regimes
    ids: Integers
    grains: Integers
    contacts: Integers

    def facts(self) -> dict[str, object]:
        """Facts that the prompt and a notebook show."""
        sliding = int(np.count_nonzero(self.regime == Regime.SLIDING))
        return {"grains": self.ids.tolist(), "contacts sliding": sliding}


def loop_of_snapshot(snapshot: Snapshot, loop: int) -> SnapshotLoop:
    """Cut one loop out of a snapshot by its id.

    Parameters
    ----------
    snapshot : Snapshot
        The snapshot.
    loop : int
        Number of the loop in `snapshot.faces.loops`, the id in the table of loops.

    Returns
    -------
    SnapshotLoop
        The loop's graph, law, regimes and ids.

    Raises
    ------
    InputError
        If there is no loop of that number.

    Examples
    --------
    >>> from patterns import loop_of_snapshot, read_snapshot, sample_path
    >>> loop = loop_of_snapshot(read_snapshot(sample_path()), 3)
    >>> loop.graph.grain_count == len(loop.ids) == len(loop.regime)
    True
    """
    faces = snapshot.faces
    count = len(faces.loops)
    if not (0 <= loop < count and int(loop) == loop):
        raise InputError("loop", str(loop), f"a number from 0 to {count - 1}", "Pick a loop.")
    start, end = faces.offsets[faces.loops[loop] + np.arange(2)]
    grains, contacts = faces.grains[start:end], faces.contacts[start:end]
    sign = np.where(faces.forward[start:end], 1.0, -1.0)
    packing = snapshot.graph
    law, regime = snapshot.mechanics()
    x = packing.x[grains]
    if packing.images is not None and packing.images[contacts].any():
        edges = sign[:, None] * branch_vectors(packing)[contacts]
        x = np.cumsum(edges, axis=0) - edges
    graph = GrainGraph(
        x=x,
        radii=packing.radii[grains],
        contacts=ring_contacts(len(grains)),
        normal_force=packing.normal_force[contacts],
        shear_force=packing.shear_force[contacts],
        regime=regime[contacts],
    )
    return SnapshotLoop(
        graph, law.take(contacts), regime[contacts], snapshot.ids[grains], grains, contacts
    )
