"""The studies behind `grainloops diamond` and `grainloops polygon`: follow, write, draw."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from studies.columns import definitions
from studies.output import UNITS_OF_A_LOOP, provenance, result_folder, write_results
from studies.paths.diamond import follow_diamond
from studies.paths.diamond_summary import diamond_summary
from studies.paths.diamond_tables import diamond_tables
from studies.paths.options import ComparisonOptions, DiamondOptions, PolygonOptions
from studies.paths.polygon import (
    compare,
    curves,
    follow_polygon,
    polygon_summary,
    polygon_table,
)


def run_diamond(
    options: DiamondOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a diamond and write `summary.json`, tables and figures; return the summary.

    Tables `path`, `polar`, `path_dependence`; the loop at A as a plain snapshot, `grains_A` and
    `contacts_A`; with contacts added, `added_contact`.
    """
    with result_folder(out, force=force) as folder:
        found, ignored = follow_diamond(options), None
        if options.contact_on_touch == "add":
            ignored = follow_diamond(replace(options, contact_on_touch="ignore"))
        made = provenance("diamond", options.described(), UNITS_OF_A_LOOP)
        summary = diamond_summary(found) | {"provenance": made}
        tables = diamond_tables(found, ignored)
        columns = {name: dict(table.items()) for name, table in tables.items()}
        write_results(folder, summary, columns, csv=csv)
        # Drawing is loaded only when there is something to draw.
        from studies.paths.diamond_figures import diamond_figures
        from studies.style import save_figures

        save_figures(dict(diamond_figures(found, ignored)), folder, made)
    return summary


def run_polygon(
    options: PolygonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a polygon and write `summary.json`, the table `path` and figures."""
    with result_folder(out, force=force) as folder:
        found = follow_polygon(options)
        made = provenance("polygon", options.described(), UNITS_OF_A_LOOP)
        summary = polygon_summary(found) | {"provenance": made}
        write_results(folder, summary, {"path": dict(polygon_table(found).items())}, csv=csv)
        # Drawing is loaded only when there is something to draw.
        from studies.paths.figures import polygon_figures
        from studies.style import save_figures

        critical = summary["critical_strain"]["diagonal"]
        save_figures(dict(polygon_figures(found, critical)), folder, made)
    return summary


def run_comparison(
    options: ComparisonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow loops of several orders and write `summary.json`, `compare`, `paths` and figures."""
    with result_folder(out, force=force) as folder:
        compared = compare(options)
        made = provenance("polygon --compare", options.described(), UNITS_OF_A_LOOP)
        loops = compared.loops
        early = [str(loop["order"]) for loop in loops if loop["status"] != "finished"]
        notes = [f"paths that end before their target: orders {', '.join(early)}"] if early else []
        summary = {
            "parameters": options.described(),
            "loops": list(loops),
            "notes": notes,
            "definitions": definitions("polygon", "compare"),
            "provenance": made,
        }
        tables = {"compare": compared.table, "paths": curves(compared)}
        columns = {name: dict(table.items()) for name, table in tables.items()}
        write_results(folder, summary, columns, csv=csv)
        # Drawing is loaded only when there is something to draw.
        from studies.paths.figures import comparison_figures
        from studies.style import save_figures

        save_figures(dict(comparison_figures(compared)), folder, made)
    return summary
