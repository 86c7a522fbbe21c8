"""Loops of any order: regular, equilateral, polydisperse, random, the hexagon, cut out."""

from patterns.polygons.equilateral import equilateral_polygon
from patterns.polygons.hexagon import hexagon
from patterns.polygons.hexagon_balance import (
    HexagonForces,
    hexagon_contact_forces,
    hexagon_external_forces,
    hexagon_lengths,
    hexagon_stress,
)
from patterns.polygons.polydisperse import polydisperse_polygon
from patterns.polygons.random_loops import random_loop
from patterns.polygons.regular import regular_polygon
from patterns.polygons.ring import opposite_gap
from patterns.polygons.snapshot_loop import SnapshotLoop, loop_of_snapshot

__all__ = [
    "HexagonForces",
    "SnapshotLoop",
    "equilateral_polygon",
    "hexagon",
    "hexagon_contact_forces",
    "hexagon_external_forces",
    "hexagon_lengths",
    "hexagon_stress",
    "loop_of_snapshot",
    "opposite_gap",
    "polydisperse_polygon",
    "random_loop",
    "regular_polygon",
]
