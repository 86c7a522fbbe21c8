"""The study behind `grainloops diamond`: the paper's special case, with its events located."""

from studies.diamond.parameters import DiamondParameters
from studies.diamond.run import run_diamond

__all__ = ["DiamondParameters", "run_diamond"]
