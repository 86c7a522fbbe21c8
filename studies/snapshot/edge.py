"""The rate problem of a snapshot's packing, from its contacts at yield on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from loops import Faces, InputError, outline_area
from patterns import Snapshot
from stability.packing.edge import YieldEdge, yield_edge
from stability.packing.pairs import contact_pairs, require_replayable
from stability.packing.state import start_state
from studies.snapshot.in_packing import sample_boundary
from studies.snapshot.mechanics import box_area

# Of the mean contact force: from here on it is said, beyond it a sample flows.
UNBALANCED, FLOWS = 1e-3, 0.1


def balance_notes(snapshot: Snapshot) -> list[str]:
    """What is to be said before a state is followed; `InputError` where it flows or can't be."""
    graph, law = snapshot.graph, snapshot.mechanics()[0]
    pairs, state = contact_pairs(graph, require_replayable(graph, law)), start_state(graph)
    overlap = graph.radii[graph.contacts].sum(axis=1) - np.linalg.norm(state.branches, axis=1)
    # As paths begin: normal forces of the geometry.
    share = replace(state, normal_force=np.maximum(pairs.kn * overlap, 0.0)).unbalanced
    told = f"an unbalanced force of {share:.2g} of the mean contact force"
    if share > FLOWS:
        expected = f"{FLOWS:g} at most: a state near rest"
        raise InputError("snapshot", told, expected, "Hold the sample until it is quiet.")
    kept = "it stays as a constant load, and the motion it stands for is not followed"
    return [f"{told}: {kept}"] if share > UNBALANCED else []


def sample_edge(snapshot: Snapshot, faces: Faces, yield_band: float) -> YieldEdge:
    """The rate problem; a sample ends at its cell, at its walls, or at an outline that is held."""
    graph, (law, regime) = snapshot.graph, snapshot.mechanics()
    planes, held, _ = sample_boundary(snapshot, faces)
    volume = None
    if graph.cell is None:
        box = None if snapshot.walls is None else box_area(graph.x, snapshot.walls)
        volume = box or outline_area(graph, faces)
    return yield_edge(
        graph, law, yield_band=yield_band, regime=regime, planes=planes, held=held, volume=volume
    )
