"""The studies of paths as commands run them: follow, then write summary, tables and figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from studies.output import UNITS
from studies.paths.diamond import diamond_summary, diamond_tables, follow_diamond
from studies.paths.figures import comparison_figures, diamond_figures, polygon_figures
from studies.paths.options import ComparisonOptions, DiamondOptions, PolygonOptions
from studies.paths.polygon import (
    compare_orders,
    follow_polygon,
    polygon_diagrams,
    polygon_summary,
    polygon_table,
)
from studies.study import study


def run_diamond(
    options: DiamondOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a diamond and write `summary.json`, tables and figures; return the summary.

    Tables `path`, `polar`, `path_dependence`; the loop at A as a plain snapshot, `grains_A` and
    `contacts_A`; with contacts added, `added_contact`.
    """
    made = ("diamond", out, options.described(), UNITS["paths"])
    with study(*made, force=force, csv=csv) as results:
        found, ignored = follow_diamond(options), None
        if options.contact_on_touch == "add":
            ignored = follow_diamond(replace(options, contact_on_touch="ignore"))
        tables, summary = diamond_tables(found, ignored), diamond_summary(found)
        figures = diamond_figures(found, ignored, tables["path_dependence"])
        summary = results.write_results(tables, summary)
        results.save_figures(figures)
    return summary


def run_polygon(
    options: PolygonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a polygon and write `summary.json`, the table `path` and figures."""
    made = ("polygon", out, options.described(), UNITS["paths"])
    with study(*made, force=force, csv=csv) as results:
        found = follow_polygon(options)
        summary = results.write_results({"path": polygon_table(found)}, polygon_summary(found))
        critical = summary["critical_strain"]["diagonal"]
        results.save_figures(polygon_figures(found, polygon_diagrams(found, critical)))
    return summary


def run_comparison(
    options: ComparisonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow loops of several orders and write `summary.json`, `compare`, `paths` and figures."""
    made = ("polygon --compare", out, options.described(), UNITS["paths"])
    with study(*made, force=force, csv=csv) as results:
        compared = compare_orders(options)
        tables = {"compare": compared.table, "paths": compared.curves()}
        summary = results.write_results(tables, compared.summary())
        results.save_figures(comparison_figures(compared))
    return summary
