"""The study behind `grainloops series`: the loops of many snapshots and their fates."""

from studies.series.run import run_series as run_series
