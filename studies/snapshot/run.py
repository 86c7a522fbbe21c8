"""From the files of a snapshot to tables, summary and figures."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from loops import Faces, find_faces
from patterns import Snapshot, read_snapshot
from studies.output import provenance, result_folder, write_summary, write_table
from studies.snapshot.planar import planar
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
        The file, or that of the grains.
    contacts : Path, optional
        The file of contacts; found beside `path` if None.
    cell : tuple of 4 floats, optional
        Periodic cell HXX, HXY, HYX, HYY, its columns are the cell vectors.
    kn, kt, mu : float, optional
        Contact parameters that the file lacks.
    format : str
        Name of the format, 'auto' to tell it by the content.
    columns : dict of str to str, optional
        Plain name to the column that holds it.
    frame : int, optional
        Which instant of a file with several.
    drop_crossings : bool
        Whether to leave out contacts whose branches cross others, instead of refusing.
    shear_increment : str, optional
        What shear turns by, where not what the source tells.
    """

    path: Path
    contacts: Path | None = None
    cell: tuple[float, float, float, float] | None = None
    kn: float | None = None
    kt: float | None = None
    mu: float | None = None
    format: str = "auto"
    columns: dict[str, str] | None = None
    frame: int | None = None
    drop_crossings: bool = False
    shear_increment: str | None = None

    def read(self) -> Snapshot:
        """Read it; `InputError` as `read_snapshot`, and for crossing branches."""
        snapshot = read_snapshot(
            self.path,
            self.contacts,
            cell=None if self.cell is None else np.reshape(self.cell, (2, 2)),
            kn=self.kn,
            kt=self.kt,
            mu=self.mu,
            shear_increment=self.shear_increment,
            format=self.format,
            columns=self.columns,
            frame=self.frame,
        )
        return planar(snapshot, str(self.path), drop=self.drop_crossings)


def run_snapshot(
    source: SnapshotInput,
    out: Path,
    *,
    force: bool = False,
    csv: bool = False,
    figures: bool = True,
    paraview: bool = False,
) -> dict[str, Any]:
    """Find the loops of a snapshot, judge each, and write tables, summary, figures and a report.

    Parameters
    ----------
    source : SnapshotInput
        What to read.
    out : Path
        Result folder: `loops.parquet`, `orders.parquet`, `summary.json`; with figures the PNG and
        SVG of each, `fabric.parquet` and `report.html`; for ParaView `loops.vtp`, `contacts.vtp`.
    force : bool
        Whether results of the same names may be replaced.
    csv : bool
        Whether to write the tables as CSV too.
    figures : bool
        Whether to draw figures and write the report that holds them.
    paraview : bool
        Whether to write the files for ParaView.

    Returns
    -------
    dict
        The summary.

    Raises
    ------
    InputError
        For bad input, a network with crossing branches, an `out` that holds files, or a missing
        library.
    """
    with result_folder(out, force=force) as folder:
        snapshot, faces, table = analyse(source)
        made = provenance("snapshot", asdict(source), UNITS)
        # Of a million grains, writing takes a third as long as summing up, on another core.
        with ThreadPoolExecutor(1) as other:
            written = other.submit(write_table, folder, "loops", table, made, csv=csv)
            summary = snapshot_summary(snapshot, faces, table)
            written.result()
        summary["provenance"] = made
        write_table(folder, "orders", _orders(summary), made, csv=csv)
        write_summary(folder, summary)
        if paraview:
            from studies.snapshot.paraview import write_paraview

            write_paraview(folder, snapshot, faces, table, made)
        if figures:
            _draw(snapshot, faces, table, summary, folder, csv=csv)
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
    snapshot = source.read()
    faces = find_faces(snapshot.graph)
    hidden = len(faces.loops) < LONG
    with Progress(console=Console(stderr=True), disable=hidden, transient=True) as bar:
        task = bar.add_task("loops", total=len(faces.loops))
        table = loop_table(snapshot, faces, lambda done: bar.advance(task, done))
    return snapshot, faces, table


def _draw(
    snapshot: Snapshot,
    faces: Faces,
    table: dict[str, Any],
    summary: dict[str, Any],
    folder: Path,
    *,
    csv: bool,
) -> None:
    """Figures, the numbers behind the rose of contacts, and the report."""
    # Drawing is loaded only when there is something to draw.
    from studies.snapshot.figures import draw_figures
    from studies.snapshot.report import write_report
    from studies.snapshot.report_map import loops_for_map
    from studies.snapshot.roses import fabric_table

    made = summary["provenance"]
    write_table(folder, "fabric", fabric_table(snapshot.graph, summary), made, csv=csv)
    drawn = draw_figures(snapshot, faces, table, summary, folder, made)
    title = f"Loops of {made['configuration']['path'].name}"
    write_report(folder, title, summary, drawn, loops_for_map(snapshot, faces, table), made)


def _orders(summary: dict[str, Any]) -> dict[str, Any]:
    """The numbers behind the figure of orders."""
    columns: dict[str, Any] = {
        "order": [int(n) for n in summary["orders"]],
        "loops": list(summary["orders"].values()),
        "area": list(summary["orders_area"].values()),
    }
    for judge, shares in summary.get("unstable_loops", {}).items():
        columns[f"{judge}_unstable_loops"] = list(shares.values())
    return columns
