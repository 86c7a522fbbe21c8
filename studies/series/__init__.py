"""The study behind `grainloops series`: the loops of many snapshots, and what becomes of them."""

from studies.series.run import run_series as run_series
