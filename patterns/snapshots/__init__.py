"""Snapshots of discrete-element simulations, one reader per format."""

from patterns.snapshots.formats import count_frames, read_frames, read_snapshot
from patterns.snapshots.plain import write_snapshot
from patterns.snapshots.sample_data import sample_cell, sample_path
from patterns.snapshots.snapshot import Snapshot, WallContacts

__all__ = [
    "Snapshot",
    "WallContacts",
    "count_frames",
    "read_frames",
    "read_snapshot",
    "sample_cell",
    "sample_path",
    "write_snapshot",
]
