"""`grainloops polygon`: regular loops of any order under a loading programme."""

from studies.polygon.comparison import ComparisonParameters
from studies.polygon.parameters import PolygonParameters
from studies.polygon.run import run_comparison, run_polygon

__all__ = ["ComparisonParameters", "PolygonParameters", "run_comparison", "run_polygon"]
