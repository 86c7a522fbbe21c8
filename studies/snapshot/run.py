"""From the files of a snapshot to tables, summary and figures."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from loops import Faces, ForceChains, force_chains
from patterns import Snapshot
from studies.output import provenance, readable, result_folder, write_summary, write_table
from studies.snapshot.chains import chain_segments, chains_summary, chains_table
from studies.snapshot.in_packing import add_in_packing, place_options, share_by_order
from studies.snapshot.source import read_planar, reading
from studies.snapshot.summary import snapshot_summary
from studies.snapshot.table import loop_table

UNITS = (
    "as the input's: lengths, forces, stress = force/length (two dimensions); eigenvalues over the "
    "mean kn; angles in degrees"
)


def run_snapshot(
    path: Path,
    out: Path,
    *,
    force: bool = False,
    csv: bool = False,
    figures: bool = True,
    paraview: bool = False,
    in_packing: str | None = None,
    **how: Any,
) -> dict[str, Any]:
    """Find the loops of a snapshot, judge each, write tables, figures and a report; the summary.

    It is read with the options `how` of `read_planar`; `in_packing` is auto, whole, blocks or a
    radius in mean diameters.
    """
    asked = {} if in_packing is None else {"in_packing": in_packing}
    for name in asked.values():
        place_options(name)
    with result_folder(out, force=force) as folder:
        snapshot = read_planar(path, **how)
        faces = snapshot.faces
        with ThreadPoolExecutor(1) as other:
            told = other.submit(force_chains, snapshot.graph) if snapshot.mechanical else None
            table = loop_table(snapshot, faces)
        chains = None if told is None else told.result()
        place = None
        if in_packing is not None:
            snapshot, place = add_in_packing(snapshot, faces, table, in_packing)
        if chains is not None:
            table["chain_contacts"] = chains.on_loops(faces)
        made = provenance("snapshot", {"path": path, **reading(**how), **asked}, UNITS)
        # Of a million grains, writing takes a third as long as summing up, on another core.
        with ThreadPoolExecutor(1) as other:
            written = other.submit(write_table, folder, "loops", table, made, csv=csv)
            summary = snapshot_summary(snapshot, faces, table, place)
            written.result()
        summary["provenance"] = made
        if chains is not None:
            summary["force_chains"] = chains_summary(chains, table)
            write_table(folder, "chains", chains_table(table), made, csv=csv)
        write_table(folder, "orders", _orders(summary, table), made, csv=csv)
        write_summary(folder, summary)
        if paraview:
            from studies.snapshot.paraview import write_paraview

            write_paraview(folder, snapshot, faces, table, made)
        if figures:
            _draw(snapshot, faces, table, chains, summary, folder, csv=csv)
    return summary


def analyse(path: Path, **how: Any) -> tuple[Snapshot, Faces, dict[str, Any]]:
    """A snapshot as `read_planar` reads it, its faces and the table of its loops."""
    snapshot = read_planar(path, **how)
    return snapshot, snapshot.faces, loop_table(snapshot, snapshot.faces)


def _draw(
    snapshot: Snapshot,
    faces: Faces,
    table: dict[str, Any],
    chains: ForceChains | None,
    summary: dict[str, Any],
    folder: Path,
    *,
    csv: bool,
) -> None:
    """Figures, the numbers behind the rose of contacts, and the report."""
    # Drawing is loaded only when there is something to draw.
    from studies.snapshot.figures import fabric_table, snapshot_drawings
    from studies.snapshot.report import loops_for_map, write_report
    from studies.style import save_drawings

    made = summary["provenance"]
    write_table(folder, "fabric", fabric_table(snapshot.graph, summary), made, csv=csv)
    links = None if chains is None else chain_segments(snapshot, chains)
    drawings = snapshot_drawings(snapshot, faces, table, links, summary)
    title = f"Loops of {readable(made['configuration']['path'].name)}"
    shown = loops_for_map(snapshot, faces, table, **({} if links is None else {"links": links}))
    write_report(folder, title, summary, save_drawings(drawings, folder, made), shown, made)


def _orders(summary: dict[str, Any], table: dict[str, Any]) -> dict[str, Any]:
    """The numbers behind the figure of orders."""
    columns: dict[str, Any] = {
        "order": [int(n) for n in summary["orders"]],
        "loops": list(summary["orders"].values()),
        "area": list(summary["orders_area"].values()),
    }
    for judge, shares in summary.get("unstable_loops", {}).items():
        columns[f"{judge}_unstable_loops"] = list(shares.values())
    if "in_packing" in summary:
        columns |= share_by_order(table, columns["order"])
    return columns
