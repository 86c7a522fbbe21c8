"""Loops of grains: regular, equilateral, polydisperse, random, and the hexagon."""

from patterns.polygons.random_loops import random_loop as random_loop
from patterns.polygons.shapes import equilateral_polygon as equilateral_polygon
from patterns.polygons.shapes import hexagon as hexagon
from patterns.polygons.shapes import opposite_gap as opposite_gap
from patterns.polygons.shapes import polydisperse_polygon as polydisperse_polygon
from patterns.polygons.shapes import regular_polygon as regular_polygon
