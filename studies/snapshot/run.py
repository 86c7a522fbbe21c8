"""The study behind `grainloops snapshot`."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from loops import force_chains
from studies.output import readable
from studies.snapshot.in_packing import add_in_packing, method_named
from studies.snapshot.source import read_planar, reading
from studies.snapshot.summary import chains_table, order_table, snapshot_summary
from studies.snapshot.table import loop_table
from studies.study import study

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

    `how` are options of `read_planar`; `in_packing` is auto, whole or blocks.
    """
    configuration = {"path": path, **reading(**how)}
    if in_packing is not None:
        configuration["in_packing"] = method_named(in_packing)
    with study("snapshot", out, configuration, UNITS, force=force, csv=csv) as results:
        snapshot = read_planar(path, **how)
        with ThreadPoolExecutor(1) as other:
            found = other.submit(force_chains, snapshot.graph) if snapshot.mechanical else None
            table = loop_table(snapshot)
        chains = None if found is None else found.result()
        method, notes = None, list[str]()
        if in_packing is not None:
            method, notes = add_in_packing(snapshot, table, method_named(in_packing))
        if chains is not None:
            table["chain_contacts"] = chains.on_loops(snapshot.faces)
        # Writing a million loops takes a third of the time of the summary, on another core.
        with ThreadPoolExecutor(1) as other:
            written = other.submit(results.write_tables, {"loops": table})
            summary = snapshot_summary(snapshot, table, method, chains)
            written.result()
        summary["notes"] += notes
        tables: dict[str, Any] = {"orders": order_table(summary, table)}
        if chains is not None:
            tables["chains"] = chains_table(table)
        results.write_tables(tables)
        summary = results.write_summary(summary)
        if paraview:
            from studies.snapshot.polygons import write_paraview

            write_paraview(results.folder, snapshot, table, results.source)
        if figures:
            from studies.snapshot.figures import chain_segments, fabric_table, snapshot_figures
            from studies.snapshot.polygons import loops_for_map

            results.write_tables({"fabric": fabric_table(snapshot.graph, summary)})
            links = {} if chains is None else {"links": chain_segments(snapshot, chains)}
            pictures = results.save_figures(snapshot_figures(snapshot, table, summary, **links))
            title = f"Loops of {readable(path.name)}"
            maps = loops_for_map(snapshot, table, **links)
            results.write_report(title, summary, pictures, maps)
    return summary
