"""Where grain graphs come from: the diamond, polygons, DEM snapshots, synthetic networks."""

from patterns.diamond import diamond
from patterns.polygons import regular_polygon
from patterns.snapshots import Snapshot, read_snapshot, sample_cell, sample_path
from patterns.synthetic import synthetic_network

__all__ = [
    "Snapshot",
    "diamond",
    "read_snapshot",
    "regular_polygon",
    "sample_cell",
    "sample_path",
    "synthetic_network",
]
