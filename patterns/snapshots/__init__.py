"""Snapshots of discrete-element simulations, one reader per format."""

from patterns.snapshots.plain import read_snapshot
from patterns.snapshots.sample_data import sample_cell, sample_path
from patterns.snapshots.snapshot import Snapshot

__all__ = ["Snapshot", "read_snapshot", "sample_cell", "sample_path"]
