"""Where grain graphs come from: the diamond, polygons, DEM snapshots, synthetic networks."""

from typing import TYPE_CHECKING

from loops.lazy import lazy_face

if TYPE_CHECKING:
    from patterns.diamond import diamond
    from patterns.polygons import (
        SnapshotLoop,
        equilateral_polygon,
        hexagon,
        loop_of_snapshot,
        opposite_gap,
        polydisperse_polygon,
        random_loop,
        regular_polygon,
    )
    from patterns.snapshots import (
        Snapshot,
        WallContacts,
        count_frames,
        read_frames,
        read_snapshot,
        sample_cell,
        sample_path,
        write_snapshot,
    )
    from patterns.synthetic import synthetic_network

__all__ = [
    "Snapshot",
    "SnapshotLoop",
    "WallContacts",
    "count_frames",
    "diamond",
    "equilateral_polygon",
    "hexagon",
    "loop_of_snapshot",
    "opposite_gap",
    "polydisperse_polygon",
    "random_loop",
    "read_frames",
    "read_snapshot",
    "regular_polygon",
    "sample_cell",
    "sample_path",
    "synthetic_network",
    "write_snapshot",
]

lazy_face(__name__, __file__)
