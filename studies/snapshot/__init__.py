"""The study behind `grainloops snapshot`: the loops of one snapshot and their stability."""

from studies.snapshot.run import run_snapshot as run_snapshot
