"""The rate problem of a snapshot's packing, from its contacts at yield on."""

from __future__ import annotations

from loops import Faces, outline_area
from patterns import Snapshot
from stability.packing.edge import YieldEdge, yield_edge
from studies.snapshot.in_packing import sample_boundary
from studies.snapshot.mechanics import box_area


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
