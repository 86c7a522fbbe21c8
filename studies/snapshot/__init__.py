"""The study behind `grainloops snapshot`: the loops of one snapshot and their stability."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path
from typing import Any

from loops import ForceChains, force_chains
from loops.arrays import Integers
from loops.errors import InputError, check_choice
from patterns import Snapshot
from studies.output import Summary, definitions, readable
from studies.questions import Snapshotting, taken
from studies.reading import read_planar, reading
from studies.snapshot.in_packing import add_in_packing
from studies.snapshot.regions import compared
from studies.snapshot.summary import (
    chains_table,
    fabric_table,
    order_columns,
    snapshot_summary,
    verdict_properties,
)
from studies.snapshot.table import loop_columns
from studies.study import files_of, study


def run_snapshot(path: Path, out: Path, **how: Any) -> Summary:
    """Find and judge the loops of a snapshot, write tables, figures and a report; the summary.

    `how` are the options of `Snapshotting` and `read_planar`, and files of `study`.
    """
    asked: Any = taken(Snapshotting, how)
    in_packing, hold, yield_band = asked.in_packing, asked.hold, asked.yield_band
    files = files_of(how)
    configuration = {"path": path, **reading(**how)}
    if asked.input_error is not None:
        configuration["input_error"] = asked.input_error
    if asked.regions is not None:
        configuration["regions"] = asked.regions
    if in_packing is not None:
        from loops.in_place import METHODS

        check_choice("--in-packing", in_packing, METHODS)
        configuration |= {"in_packing": in_packing, "hold": hold, "yield_band": yield_band}
    elif hold or yield_band is not None:
        expected = "with --in-packing: loops are judged in their packing alone"
        given = ", ".join(["--hold"] * hold + ["--yield-band"] * (yield_band is not None))
        raise InputError(given, "no --in-packing", expected, "Add --in-packing.")
    with study("snapshot", out, configuration, **files) as results:
        snapshot = read_planar(path, **how)
        with ThreadPoolExecutor(1) as other:
            found = other.submit(chains_on_loops, snapshot) if snapshot.mechanical else None
            table = loop_columns(snapshot)
        chains, on_loops = (None, None) if found is None else found.result()
        in_place, notes = None, list[str]()
        if in_packing is not None:
            in_place, notes = add_in_packing(
                snapshot, table, in_packing, hold=hold, yield_band=yield_band
            )
        if on_loops is not None:
            table["chain_contacts"] = on_loops
        if asked.regions is not None:
            by_region = compared(table, asked.regions, verdict_properties(table))
        certain = None
        if asked.input_error is not None:
            from studies.snapshot.input_error import add_input_errors, certain_columns

            certain = add_input_errors(snapshot, table, asked.input_error)
        # Writing a million loops takes a third of the time of the summary, on another core.
        with ThreadPoolExecutor(1) as other:
            written = other.submit(results.write_tables, {"loops": table})
            beside = None if chains is None else other.submit(chains_table, table)
            summary = snapshot_summary(snapshot, table, in_place, chains)
            written.result()
        summary["notes"] += notes
        tables: dict[str, Any] = {"orders": order_columns(summary, table)}
        if certain is not None:
            summary |= certain
            summary["definitions"] |= definitions("snapshot_input_error")
            tables["certain"] = certain_columns(snapshot, table)
        if asked.regions is not None:
            tables["regions"], summary["regions"] = by_region
            summary["definitions"] |= definitions("regions")
        if asked.quadrons:
            from studies.snapshot.quadrons import quadron_columns, quadron_summary

            tables["quadrons"] = quadron_columns(snapshot)
            summary["quadrons"] = quadron_summary(tables["quadrons"])
        if beside is not None:
            tables["chains"] = beside.result()
        if results.figures:
            tables["fabric"] = fabric_table(snapshot.graph, summary)
        summary = results.write_results(tables, summary)
        if asked.paraview:
            from studies.snapshot.table import write_paraview

            write_paraview(results.folder, snapshot, table, results.source)
        if results.figures:
            from studies.snapshot.figures import chain_segments, snapshot_figures
            from studies.snapshot.table import loops_for_map

            links = {} if chains is None else {"links": chain_segments(snapshot, chains)}
            drawn = snapshot_figures(snapshot, table, summary, **links)
            if asked.quadrons:
                from studies.snapshot.quadrons import quadron_figure

                drawn = chain(drawn, [("quadrons", lambda: quadron_figure(tables["quadrons"]))])
            if certain is not None:
                from studies.snapshot.input_error import draw_certain

                shown = tables["certain"], str(asked.input_error)
                drawn = chain(drawn, [("certain", lambda: draw_certain(*shown))])
            title = f"Loops of {readable(path.name)}"
            maps = loops_for_map(snapshot, table, **links)
            results.write_report(title, summary, drawn, maps)
    return summary


def chains_on_loops(snapshot: Snapshot) -> tuple[ForceChains, Integers]:
    """Find the force chains, and count the links of each loop."""
    chains = force_chains(snapshot.graph)
    return chains, chains.on_loops(snapshot.faces)
