"""Write a snapshot as plain tables."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from loops import InputError, LinearFrictional, Regime, branch_vectors, contact_forces
from patterns.snapshots.snapshot import Snapshot


def write_snapshot(path: str | Path, snapshot: Snapshot) -> None:
    """Write the tables that `read_snapshot` reads, walls left out.

    Parameters
    ----------
    path : str or Path
        The table of grains, `grains` in its name, ending in `.parquet` or `.csv`. The contacts,
        the cell of a periodic snapshot and the shear increment `radii` are written beside it;
        files of these names are replaced, each when its successor is complete.
    snapshot : Snapshot
        What to write; without forces the tables have none.

    Raises
    ------
    InputError
        For another name or ending.

    Examples
    --------
    >>> import tempfile
    >>> from patterns import read_snapshot, sample_path, write_snapshot
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_snapshot(f"{folder}/grains_1.parquet", read_snapshot(sample_path()))
    ...     read_snapshot(f"{folder}/grains_1.parquet").graph.contact_count
    819
    """
    path = Path(path)
    if "grains" not in path.name or path.suffix not in (".parquet", ".csv"):
        raise InputError(
            str(path), "this name", "grains... ending in .parquet or .csv", "Rename it."
        )
    graph = snapshot.graph
    grains = {"id": snapshot.ids, "x": graph.x[:, 0], "y": graph.x[:, 1], "radius": graph.radii}
    _write(path, grains)
    _write(path.with_name(path.name.replace("grains", "contacts")), _contacts(snapshot))
    cell = path.with_name(path.name.replace("grains", "cell").removesuffix(path.suffix) + ".json")
    told: dict[str, object] = {"cell": None if graph.cell is None else graph.cell.tolist()}
    if snapshot.law is not None and snapshot.law.shear_increment != "branch":
        told["shear_increment"] = snapshot.law.shear_increment
    if told == {"cell": None}:
        # The cell of an earlier snapshot of this name would be taken for this one's.
        cell.unlink(missing_ok=True)
    else:
        partial = cell.with_name(f".{cell.name}.partial")
        partial.write_text(json.dumps(told) + "\n")
        os.replace(partial, cell)


def _contacts(snapshot: Snapshot) -> dict[str, NDArray[np.generic]]:
    graph = snapshot.graph
    branches = branch_vectors(graph)
    columns: dict[str, NDArray[np.generic]] = {
        "id1": snapshot.ids[graph.contacts[:, 0]],
        "id2": snapshot.ids[graph.contacts[:, 1]],
        "branch_x": branches[:, 0],
        "branch_y": branches[:, 1],
    }
    if graph.images is not None:
        columns |= {"cell_dx": graph.images[:, 0], "cell_dy": graph.images[:, 1]}
    if snapshot.mechanical:
        law, regime = snapshot.mechanics()
        force = contact_forces(graph)
        columns |= {"fx_on_2": force[:, 0], "fy_on_2": force[:, 1]}
        columns |= _law(law, graph.contact_count)
        columns["sliding"] = (regime == Regime.SLIDING).astype(np.int8)
    return columns


def _law(law: LinearFrictional, count: int) -> dict[str, NDArray[np.generic]]:
    columns = {"kn": law.kn, "ks": law.kt, "mu": law.mu}
    full = {name: np.broadcast_to(values, count) for name, values in columns.items()}
    # Without friction on record it stands for infinite, and no file holds that.
    return {name: values for name, values in full.items() if np.isfinite(values).all()}


def _write(path: Path, columns: Mapping[str, NDArray[np.generic]]) -> None:
    table = pyarrow.table({name: np.ascontiguousarray(values) for name, values in columns.items()})
    partial = path.with_name(f".{path.name}.partial")
    write = pyarrow.parquet.write_table if path.suffix == ".parquet" else pyarrow.csv.write_csv
    # Opened here, since names that are no UTF-8 are nothing that pyarrow takes.
    with open(partial, "wb") as file:
        write(table, file)
    os.replace(partial, path)
