"""The study of paths behind `grainloops diamond` and `grainloops polygon`."""

from studies.paths.options import ComparisonOptions as ComparisonOptions
from studies.paths.options import DiamondOptions as DiamondOptions
from studies.paths.options import PolygonOptions as PolygonOptions
from studies.paths.run import run_comparison as run_comparison
from studies.paths.run import run_diamond as run_diamond
from studies.paths.run import run_polygon as run_polygon
