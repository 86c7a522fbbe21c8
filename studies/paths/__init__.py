"""The study of paths behind `grainloops diamond` and `grainloops polygon`."""

from studies.paths.options import ComparisonOptions, DiamondOptions, PolygonOptions
from studies.paths.run import run_comparison, run_diamond, run_polygon

__all__ = [
    "ComparisonOptions",
    "DiamondOptions",
    "PolygonOptions",
    "run_comparison",
    "run_diamond",
    "run_polygon",
]
