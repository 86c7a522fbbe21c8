"""Snapshots of discrete-element simulations, one reader per format."""

from patterns.snapshots.formats import count_frames as count_frames
from patterns.snapshots.formats import read_frames as read_frames
from patterns.snapshots.formats import read_snapshot as read_snapshot
from patterns.snapshots.formats import snapshot_from_tables as snapshot_from_tables
from patterns.snapshots.frame import write_snapshot as write_snapshot
from patterns.snapshots.snapshot import Snapshot as Snapshot
from patterns.snapshots.snapshot import SnapshotLoop as SnapshotLoop
from patterns.snapshots.snapshot import loop_of_snapshot as loop_of_snapshot
from patterns.snapshots.snapshot import planar as planar
from patterns.snapshots.snapshot import sample_cell as sample_cell
from patterns.snapshots.snapshot import sample_path as sample_path
from patterns.snapshots.walls import WallContacts as WallContacts
