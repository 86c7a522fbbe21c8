"""Loops of grains: regular, equilateral, polydisperse, random, of a hexagon, of a snapshot."""

from patterns.polygons.random_loops import random_loop
from patterns.polygons.ring import opposite_gap
from patterns.polygons.shapes import (
    equilateral_polygon,
    hexagon,
    polydisperse_polygon,
    regular_polygon,
)
from patterns.polygons.snapshot_loop import SnapshotLoop, loop_of_snapshot

__all__ = [
    "SnapshotLoop",
    "equilateral_polygon",
    "hexagon",
    "loop_of_snapshot",
    "opposite_gap",
    "polydisperse_polygon",
    "random_loop",
    "regular_polygon",
]
