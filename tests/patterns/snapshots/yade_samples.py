"""The sample files of Yade and what they have in common, for the tests."""

import gzip

import numpy as np

from loops import find_faces
from patterns import read_snapshot, sample_path

NATIVE = sample_path("yade_native")
BOX, PERIODIC = NATIVE / "box", NATIVE / "periodic"


def snapshot_of(path, **how):
    """The snapshot of a save, whose contacts have their own springs and friction."""
    return read_snapshot(path, format="yade-xml", **how)


def table_of(folder):
    """The tables that `export_tables` wrote inside Yade at the same snapshot."""
    return read_snapshot(folder / "grains_00.csv.gz")


def cycles(snapshot):
    """Loops as a set of sets of ids."""
    faces = find_faces(snapshot.graph)
    return {
        frozenset(snapshot.ids[faces.grains[faces.offsets[f] : faces.offsets[f + 1]]].tolist())
        for f in faces.loops
    }


def by_pair(snapshot, values):
    """Values of the contacts in an order that does not depend on the file."""
    pairs = np.sort(snapshot.ids[snapshot.graph.contacts], axis=1)
    keys = [pairs[:, 1], pairs[:, 0]]
    if snapshot.graph.images is not None:
        keys = [*np.abs(snapshot.graph.images).T, *keys]
    return np.asarray(values)[np.lexsort(keys)]


def changed(path, folder, old, new, name=None):
    """Copy of a text file (plain or gzip) with one passage replaced."""
    content = path.read_bytes()
    content = gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content
    assert old in content
    copy = folder / (name or path.name.removesuffix(".gz"))
    copy.write_bytes(content.replace(old, new, 1))
    return copy
