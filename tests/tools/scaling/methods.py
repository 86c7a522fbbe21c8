"""What is timed: faces, crossings, the table of loops and a whole snapshot, each way."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from loops import Faces, GrainGraph, LinearFrictional, Regime, find_crossings, find_faces
from patterns import Snapshot, read_snapshot, sample_path, synthetic_network, write_snapshot
from studies.output import write_table
from studies.reading import read_planar
from studies.snapshot.summary import snapshot_summary
from studies.snapshot.table import loop_columns

KN, KT, MU, SLIDING = 1.0, 0.5, 0.5, 0.06
Work = Callable[[], Any]


def synthetic_snapshot(grains: int) -> Snapshot:
    """A synthetic network as a snapshot, 6 % of its contacts sliding."""
    graph = synthetic_network(grains, seed=1)
    slides = np.random.default_rng(0).random(graph.contact_count) < SLIDING
    limit = MU * graph.normal_force
    shear = np.where(slides, np.sign(graph.shear_force) * limit, 0.9 * graph.shear_force)
    return Snapshot(
        graph=graph.replace(shear_force=shear),
        law=LinearFrictional(kn=np.full(graph.contact_count, KN), kt=KT, mu=MU),
        regime=np.where(slides, Regime.SLIDING, Regime.ELASTIC).astype(np.int8),
        ids=np.arange(graph.grain_count),
        wall_contacts=0,
        notes=(),
    )


def shuffled(snapshot: Snapshot) -> Snapshot:
    """The same packing with grains and contacts in random order, as codes insert and sort them."""
    graph, random = snapshot.graph, np.random.default_rng(2)
    grains, rows = random.permutation(graph.grain_count), random.permutation(graph.contact_count)
    place = np.argsort(grains)
    mixed = graph.replace(
        x=graph.x[grains],
        radii=graph.radii[grains],
        contacts=place[graph.contacts[rows]],
        **graph.at_contacts(rows),
    )
    return replace(snapshot, graph=mixed, regime=snapshot.regime[rows])


def table_of(snapshot: Snapshot, *, compiled: bool) -> Work:
    """Shape, stress, both tangents, eigenvalues, unstable fractions and cones of all loops."""
    assert len(snapshot.faces.loops)  # found before the clock starts
    return partial(loop_columns, snapshot, compiled=compiled)


def written(snapshot: Snapshot) -> Path:
    """The snapshot as Parquet, in a folder that is kept until the process ends."""
    room = tempfile.TemporaryDirectory()
    KEPT.append(room)
    path = Path(room.name) / "grains.parquet"
    write_snapshot(path, snapshot)
    return path


KEPT: list[tempfile.TemporaryDirectory[str]] = []


def whole_snapshot(snapshot: Snapshot) -> Work:
    """From Parquet to table and summary, as `grainloops snapshot` does it without figures."""
    path = written(snapshot)

    def work() -> None:
        read = read_planar(path)
        table = loop_columns(read)
        snapshot_summary(read, table)
        write_table(path.parent, "loops", table, {}, csv=False)

    return work


def summary_of(snapshot: Snapshot) -> Work:
    """The summary of a snapshot and its loops."""
    return partial(snapshot_summary, snapshot, loop_columns(snapshot))


def writing_of(snapshot: Snapshot) -> Work:
    """The table of loops to Parquet."""
    table, folder = loop_columns(snapshot), written(snapshot).parent
    return partial(write_table, folder, "loops", table, {}, csv=False)


def command(*arguments: str) -> Work:
    """A command of its own process, its result folder replaced by the next."""
    out = str(written(synthetic_snapshot(100)).parent / "out")
    line = [sys.executable, "-m", "studies.cli", *arguments, "--quiet", "--force", "--out", out]
    return partial(subprocess.run, line, check=True)


def snapshot_command(snapshot: Snapshot) -> Work:
    """`grainloops snapshot --no-figures`."""
    return command("snapshot", str(written(snapshot)), "--no-figures")


def faces_networkx(snapshot: Snapshot) -> Work:
    """Faces by networkx: its planar embedding, neighbours put in by angle, nothing pruned."""
    import networkx as nx

    graph = snapshot.graph

    def work() -> list[list[int]]:
        around: dict[int, list[tuple[float, int]]] = {}
        d = graph.x[graph.contacts[:, 1]] - graph.x[graph.contacts[:, 0]]
        there = np.arctan2(d[:, 1], d[:, 0]).tolist()
        back = np.arctan2(-d[:, 1], -d[:, 0]).tolist()
        for (i, j), angle, opposite in zip(graph.contacts.tolist(), there, back, strict=True):
            around.setdefault(i, []).append((angle, j))
            around.setdefault(j, []).append((opposite, i))
        embedding = nx.PlanarEmbedding()
        for grain, neighbours in around.items():
            last = None
            # Clockwise, as networkx wants them.
            for _, other in sorted(neighbours, reverse=True):
                embedding.add_half_edge(grain, other, ccw=last)
                last = other
        seen: set[tuple[int, int]] = set()
        return [
            embedding.traverse_face(i, j, seen) for i, j in embedding.edges if (i, j) not in seen
        ]

    return work


def faces_shapely(snapshot: Snapshot) -> Work:
    """Faces by shapely's polygonize, corners mapped back to grains by their coordinates."""
    import shapely

    graph = snapshot.graph
    lines = shapely.linestrings(graph.x[graph.contacts])

    def work() -> list[list[int]]:
        polygons = shapely.get_parts(shapely.polygonize(lines))
        grain = {tuple(x): g for g, x in enumerate(graph.x.tolist())}
        rings = [ring.tolist() for ring in map(shapely.get_coordinates, polygons)]
        return [[grain[tuple(corner)] for corner in ring[:-1]] for ring in rings]

    return work


def bytes_moved(what: str, graph: GrainGraph, faces: Faces, table: dict[str, Any]) -> int:
    """Bytes that any program must read and write once: its input and its result."""
    found = [faces.offsets, faces.grains, faces.contacts, faces.forward, faces.area]
    found += [faces.kind, faces.component]
    moved = [graph.x, graph.contacts, *found]
    if what == "read":  # ten columns of contacts and four of grains, and what is kept of them
        return 130 * graph.contact_count + 64 * graph.grain_count
    if what == "table":
        moved += [graph.normal_force, graph.shear_force, *table.values()]
    if what in ("summary", "write"):
        moved = [*table.values()] * (2 if what == "write" else 1)
    return sum(int(array.nbytes) for array in moved)


# What is found, how, and up to how many grains unless told otherwise.
METHODS: dict[tuple[str, str], tuple[Callable[[Snapshot], Work], float]] = {
    ("faces", "compiled"): (lambda s: partial(find_faces, s.graph, compiled=True), np.inf),
    ("faces", "numpy"): (lambda s: partial(find_faces, s.graph, compiled=False), 1e6),
    ("faces", "networkx"): (faces_networkx, 1e5),
    ("faces", "shapely"): (faces_shapely, 1e5),
    ("crossings", "compiled"): (lambda s: partial(find_crossings, s.graph, compiled=True), np.inf),
    ("crossings", "numpy"): (lambda s: partial(find_crossings, s.graph, compiled=False), 1e6),
    ("table", "compiled"): (lambda s: table_of(s, compiled=True), np.inf),
    ("table", "numpy"): (lambda s: table_of(s, compiled=False), 1e4),
    ("read", "by size"): (lambda s: partial(read_snapshot, written(s)), np.inf),
    ("read", "random order"): (lambda s: partial(read_snapshot, written(shuffled(s))), np.inf),
    ("faces", "random order"): (
        lambda s: partial(find_faces, read_snapshot(written(shuffled(s))).graph, compiled=True),
        np.inf,
    ),
    ("summary", "by size"): (summary_of, np.inf),
    ("write", "by size"): (writing_of, np.inf),
    ("snapshot", "by size"): (whole_snapshot, np.inf),
    ("command", "by size"): (snapshot_command, np.inf),
    ("command", "random order"): (lambda s: snapshot_command(shuffled(s)), np.inf),
}
# Commands whose whole time is told, of no size of their own.
COMMANDS = {
    "diamond --table 1": ("diamond", "--table", "1"),
    "diamond --table 2": ("diamond", "--table", "2"),
    "polygon --order 5": ("polygon", "--order", "5"),
    "snapshot of the sample": ("snapshot", str(sample_path("grains_biaxial.csv.gz"))),
}
