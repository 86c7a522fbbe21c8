"""The study behind `grainloops snapshot`: the loops of one instant and their stability."""

from studies.snapshot.run import SnapshotInput, run_snapshot

__all__ = ["SnapshotInput", "run_snapshot"]
