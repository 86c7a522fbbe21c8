"""The study behind `grainloops snapshot`, and the reading of a snapshot whose loops are defined."""

from __future__ import annotations

import inspect
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow

from loops import force_chains
from patterns import Snapshot, planar, read_snapshot
from studies.output import readable
from studies.snapshot.in_packing import add_in_packing
from studies.snapshot.summary import chains_table, order_columns, snapshot_summary
from studies.snapshot.table import loop_columns
from studies.study import one_of, study

if TYPE_CHECKING:
    from loops.packing import Method

UNITS = (
    "as the input's: lengths, forces, stress = force/length (two dimensions); eigenvalues over the "
    "mean kn; angles in degrees"
)


def reading(**how: Any) -> dict[str, Any]:
    """All options of `read_planar` but the path: the given ones, defaults for the others."""
    asked = list(inspect.signature(read_snapshot).parameters.values())[1:]
    # Contradictory input is always refused here.
    defaults = {one.name: one.default for one in asked if one.name != "strict"}
    return {**defaults, "drop_crossings": False, **how}


def read_planar(path: Path, *, drop_crossings: bool = False, **how: Any) -> Snapshot:
    """Read a snapshot, find its faces; `InputError` for crossing branches, unless dropped."""
    if how.get("cell") is not None:
        how["cell"] = np.reshape(how["cell"], (2, 2))
    snapshot = read_snapshot(path, **how)
    # Otherwise Arrow keeps memory, a quarter of the size of a large file, for later tables.
    pyarrow.default_memory_pool().release_unused()
    # Crossings and faces are found on two cores. If branches cross, the result and the errors of
    # the search for faces mean nothing.
    with ThreadPoolExecutor(1) as other:
        found = other.submit(getattr, snapshot, "faces")
        plane = planar(snapshot, str(path), drop=drop_crossings)
    if plane is snapshot:
        found.result()
    return plane


def run_snapshot(
    path: Path,
    out: Path,
    *,
    force: bool = False,
    csv: bool = False,
    figures: bool = True,
    paraview: bool = False,
    in_packing: Method | None = None,
    **how: Any,
) -> dict[str, Any]:
    """Find and judge the loops of a snapshot, write tables, figures and a report; the summary.

    `how` are options of `read_planar`; `in_packing` is auto, whole or blocks.
    """
    configuration = {"path": path, **reading(**how)}
    if in_packing is not None:
        from loops.packing import METHODS

        one_of("--in-packing", in_packing, METHODS)
        configuration["in_packing"] = in_packing
    with study("snapshot", out, configuration, UNITS, force=force, csv=csv) as results:
        snapshot = read_planar(path, **how)
        with ThreadPoolExecutor(1) as other:
            found = other.submit(force_chains, snapshot.graph) if snapshot.mechanical else None
            table = loop_columns(snapshot)
        chains = None if found is None else found.result()
        in_place, notes = None, list[str]()
        if in_packing is not None:
            in_place, notes = add_in_packing(snapshot, table, in_packing)
        if chains is not None:
            table["chain_contacts"] = chains.on_loops(snapshot.faces)
        # Writing a million loops takes a third of the time of the summary, on another core.
        with ThreadPoolExecutor(1) as other:
            written = other.submit(results.write_tables, {"loops": table})
            summary = snapshot_summary(snapshot, table, in_place, chains)
            written.result()
        summary["notes"] += notes
        tables: dict[str, Any] = {"orders": order_columns(summary, table)}
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
