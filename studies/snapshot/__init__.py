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
from studies.output import Summary, definitions, readable, values_of
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
from studies.snapshot.table import loop_columns, loops_for_map, write_paraview
from studies.study import files_of, study


def run_snapshot(path: Path, out: Path, **how: Any) -> Summary:
    """Find and judge the loops of a snapshot, write tables, figures and a report; the summary.

    `how` are the options of `Snapshotting` and `read_planar`, and files of `study`.
    """
    asked: Any = taken(Snapshotting, how)
    in_packing, hold, yield_band = asked.in_packing, asked.hold, asked.yield_band
    files = files_of(how)
    configuration = {"path": path, **reading(**how)}
    chosen = values_of(asked, "input_error", "regions").items()
    configuration |= {name: value for name, value in chosen if value is not None}
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
        tables, more, keys = dict[str, Any](), Summary(), list[str]()
        drawn: list[tuple[str, Any]] = []
        if asked.regions is not None:
            by_region = compared(table, asked.regions, verdict_properties(table))
            tables["regions"], more["regions"] = by_region
            keys.append("regions")
        if asked.quadrons:
            from studies.snapshot.quadrons import quadron_columns, quadron_figure, quadron_summary

            quadrons = tables["quadrons"] = quadron_columns(snapshot)
            more["quadrons"] = quadron_summary(quadrons)
            drawn.append(("quadrons", lambda: quadron_figure(quadrons)))
        if asked.input_error is not None:
            from studies.snapshot.input_error import add_input_errors, certain_columns, draw_certain

            more |= add_input_errors(snapshot, table, asked.input_error)
            certain = tables["certain"] = certain_columns(snapshot, table)
            keys.append("snapshot_input_error")
            drawn.append(("certain", lambda: draw_certain(certain, str(asked.input_error))))
        # Writing a million loops takes a third of the time of the summary, on another core.
        with ThreadPoolExecutor(1) as other:
            written = other.submit(results.write_tables, {"loops": table})
            beside = None if chains is None else other.submit(chains_table, table)
            summary = snapshot_summary(snapshot, table, in_place, chains) | more
            written.result()
        summary["notes"] += notes
        summary["definitions"] |= definitions(*keys)
        tables["orders"] = order_columns(summary, table)
        if beside is not None:
            tables["chains"] = beside.result()
        if results.figures:
            tables["fabric"] = fabric_table(snapshot.graph, summary)
        summary = results.write_results(tables, summary)
        if asked.paraview:
            write_paraview(results.folder, snapshot, table, results.source)
        if results.figures:
            from studies.snapshot.figures import chain_segments, snapshot_figures

            links = {} if chains is None else {"links": chain_segments(snapshot, chains)}
            every = chain(snapshot_figures(snapshot, table, summary, **links), drawn)
            maps = loops_for_map(snapshot, table, **links)
            results.write_report(f"Loops of {readable(path.name)}", summary, every, maps)
    return summary


def chains_on_loops(snapshot: Snapshot) -> tuple[ForceChains, Integers]:
    """Find the force chains, and count the links of each loop."""
    chains = force_chains(snapshot.graph)
    return chains, chains.on_loops(snapshot.faces)
