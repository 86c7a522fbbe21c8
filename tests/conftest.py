"""One setting for every property test: the same examples on each run, no clock."""

import os

from hypothesis import settings

# Figures are drawn to files, with or without a screen.
os.environ.setdefault("MPLBACKEND", "Agg")

settings.register_profile("grainloops", derandomize=True, deadline=None)
settings.load_profile("grainloops")
