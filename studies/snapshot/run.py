"""From the files of a snapshot to tables, summary and figures."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from loops import Faces, InputError, find_crossings, find_faces
from patterns import Snapshot, read_snapshot
from studies.output import provenance, result_folder, write_summary, write_table
from studies.snapshot.summary import snapshot_summary
from studies.snapshot.table import loop_table

UNITS = (
    "as the input's: lengths, forces, stress = force/length (two dimensions); eigenvalues over the "
    "mean kn; angles in degrees"
)
# Shorter work needs no progress bar.
LONG = 20_000


@dataclass(frozen=True)
class SnapshotInput:
    """What to read.

    Attributes
    ----------
    path : Path
        The table of grains.
    contacts : Path, optional
        The table of contacts; found beside `path` if None.
    cell : tuple of 4 floats, optional
        Periodic cell HXX, HXY, HYX, HYY, its columns are the cell vectors.
    kn, kt, mu : float, optional
        Contact parameters that the tables lack.
    """

    path: Path
    contacts: Path | None = None
    cell: tuple[float, float, float, float] | None = None
    kn: float | None = None
    kt: float | None = None
    mu: float | None = None


def run_snapshot(
    source: SnapshotInput, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Find the loops of a snapshot, judge each, and write tables, summary and figures.

    Parameters
    ----------
    source : SnapshotInput
        What to read.
    out : Path
        Result folder: `loops.parquet`, `orders.parquet`, `summary.json`, `map` and `orders` as
        PNG and SVG.
    force : bool
        Whether results of the same names may be replaced.
    csv : bool
        Whether to write the tables as CSV too.

    Returns
    -------
    dict
        The summary.

    Raises
    ------
    InputError
        For bad input, a network with crossing branches, or an `out` that holds files.
    """
    with result_folder(out, force=force) as folder:
        snapshot, faces, table = analyse(source)
        summary = snapshot_summary(snapshot, faces, table)
        made = provenance("snapshot", asdict(source), UNITS)
        summary["provenance"] = made
        write_table(folder, "loops", table, made, csv=csv)
        write_table(folder, "orders", _orders(summary, table), made, csv=csv)
        write_summary(folder, summary)
        # Drawing is loaded only when there is something to draw.
        from studies.snapshot.figures import draw_figures

        draw_figures(snapshot, faces, table, summary, folder, made)
    return summary


def analyse(source: SnapshotInput) -> tuple[Snapshot, Faces, dict[str, Any]]:
    """Read a snapshot, find its loops and tabulate them.

    Parameters
    ----------
    source : SnapshotInput
        What to read.

    Returns
    -------
    Snapshot, Faces, dict of str to array
        The input, its faces and the table of its loops.

    Raises
    ------
    InputError
        For bad input, and for a network with crossing branches.
    """
    cell = None if source.cell is None else np.reshape(source.cell, (2, 2))
    snapshot = read_snapshot(
        source.path, source.contacts, cell=cell, kn=source.kn, kt=source.kt, mu=source.mu
    )
    _refuse_crossings(snapshot, source.path)
    faces = find_faces(snapshot.graph)
    hidden = len(faces.loops) < LONG
    with Progress(console=Console(stderr=True), disable=hidden, transient=True) as bar:
        task = bar.add_task("loops", total=len(faces.loops))
        table = loop_table(snapshot, faces, lambda done: bar.advance(task, done))
    return snapshot, faces, table


def _refuse_crossings(snapshot: Snapshot, path: Path) -> None:
    pairs = find_crossings(snapshot.graph)
    if len(pairs) == 0:
        return
    named = snapshot.ids[snapshot.graph.contacts[pairs[:3]]]
    shown = "; ".join(f"{a[0]}-{a[1]} and {b[0]}-{b[1]}" for a, b in named.tolist())
    more = " ..." if len(pairs) > len(named) else ""
    raise InputError(
        f"contacts of {path}",
        f"{len(pairs)} pairs of crossing branches (grains {shown}{more})",
        "a planar network",
        "Drop one contact of each pair; opposite grains of a loop overlap, or the cell is wrong.",
    )


def _orders(summary: dict[str, Any], table: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """The numbers behind the figure of orders."""
    orders = [int(n) for n in summary["orders"]]
    area = [float(table["area"][table["order"] == n].sum()) for n in orders]
    columns: dict[str, Any] = {
        "order": orders,
        "loops": list(summary["orders"].values()),
        "area": area,
    }
    for closure, shares in summary["unstable_fraction"].items():
        columns[f"{closure}_unstable_fraction"] = list(shares.values())
    return columns
