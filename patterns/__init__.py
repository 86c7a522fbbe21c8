"""Grain graphs of the diamond, of polygons, of DEM snapshots and of synthetic networks."""

from typing import TYPE_CHECKING

from loops.lazy import lazy_face

if TYPE_CHECKING:
    from patterns.diamond import diamond as diamond
    from patterns.polygons import hexagon as hexagon
    from patterns.polygons import opposite_gap as opposite_gap
    from patterns.polygons import polydisperse_polygon as polydisperse_polygon
    from patterns.polygons import random_loop as random_loop
    from patterns.polygons import regular_polygon as regular_polygon
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
    from patterns.synthetic import synthetic_network as synthetic_network

lazy_face(__name__)
