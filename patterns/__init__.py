"""Where grain graphs come from: the diamond, polygons, DEM snapshots, synthetic networks."""

from patterns.polygons import regular_polygon

__all__ = ["regular_polygon"]
