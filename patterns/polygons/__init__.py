"""Loops of grains: regular, equilateral, polydisperse, random, of a hexagon, of a snapshot."""

from patterns.polygons.random_loops import random_loop as random_loop
from patterns.polygons.shapes import equilateral_polygon as equilateral_polygon
from patterns.polygons.shapes import hexagon as hexagon
from patterns.polygons.shapes import opposite_gap as opposite_gap
from patterns.polygons.shapes import polydisperse_polygon as polydisperse_polygon
from patterns.polygons.shapes import regular_polygon as regular_polygon
from patterns.polygons.snapshot_loop import SnapshotLoop as SnapshotLoop
from patterns.polygons.snapshot_loop import loop_of_snapshot as loop_of_snapshot
