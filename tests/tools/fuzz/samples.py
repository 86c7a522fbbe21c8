"""One healthy snapshot of every format, to be damaged."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from patterns import read_snapshot, sample_path, write_snapshot


class Sample(NamedTuple):
    """Files of a snapshot in a folder of their own; `path` is the one given to the reader."""

    name: str
    path: Path
    options: dict[str, Any]


def write_samples(folder: Path) -> list[Sample]:
    """Write one snapshot of each format."""
    biaxial = read_snapshot(sample_path())
    samples = []
    for ending in ("csv", "parquet"):
        path = _room(folder, ending) / f"grains_1.{ending}"
        write_snapshot(path, biaxial)
        samples.append(Sample(ending, path, {}))
    for ending in ("npz", "h5"):
        path = _room(folder, ending) / f"packing.{ending}"
        _write_arrays(path)
        samples.append(Sample(ending, path, {}))
    law = {"kn": 1e6, "kt": 5e5, "mu": 0.5}
    for name, inner, pattern, options in (
        ("csv.gz", "", "*_biaxial.csv.gz", {}),
        ("yade-xml", "yade_native/box", "state.xml.gz", {}),
        ("lammps", "lammps", "dump.*", law),
        ("liggghts", "liggghts", "*.dump.gz", law),
        ("mercury", "mercury", "box.*", law),
    ):
        found = sorted(file for file in sample_path(inner).glob(pattern) if file.suffix != ".md")
        room = _room(folder, name)
        for file in found:
            shutil.copy(file, room / file.name)
        if found:
            samples.append(Sample(name, room / _main(found).name, options))
    return samples


def _main(files: list[Path]) -> Path:
    """The file of the grains: by its name, else the first."""
    words = ("grains", "spheres", "atoms", ".data")
    return next((file for word in words for file in files if word in file.name), files[0])


def _room(folder: Path, name: str) -> Path:
    room = folder / name.replace(".", "-")
    room.mkdir()
    return room


def _write_arrays(path: Path) -> None:
    import pandas as pd

    arrays: dict[str, Any] = {}
    for group in ("grains", "contacts"):
        table = pd.read_csv(sample_path(f"{group}_biaxial.csv.gz"), dtype=float)
        arrays |= {f"{group}/{name}": table[name].to_numpy() for name in table}
    if path.suffix == ".npz":
        np.savez(path, **arrays)
        return
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values
