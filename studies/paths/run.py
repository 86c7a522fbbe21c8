"""The studies of paths as commands run them: follow, then write summary, tables and figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from studies.output import Summary
from studies.paths.diamond import diamond_summary, diamond_tables, follow_diamond
from studies.paths.figures import comparison_figures, diamond_figures, polygon_figures
from studies.paths.options import ComparisonOptions, DiamondOptions, PolygonOptions
from studies.paths.polygon import compare_orders, follow_polygon, polygon_summary, polygon_table
from studies.study import study


def run_diamond(options: DiamondOptions, out: Path, **how: Any) -> Summary:
    """Follow a diamond and write `summary.json`, tables and figures; return the summary."""
    with study("diamond", out, options.described(), **how) as results:
        found, ignored = follow_diamond(options), None
        if options.contact_on_touch == "add":
            ignored = follow_diamond(replace(options, contact_on_touch="ignore"))
        tables = diamond_tables(found, ignored)
        drawings = diamond_figures(found, ignored, tables["path_dependence"])
        return results.write_results(tables, diamond_summary(found), drawings)


def run_polygon(options: PolygonOptions, out: Path, **how: Any) -> Summary:
    """Follow a polygon and write `summary.json`, the tables `path` and `polar`, and figures."""
    with study("polygon", out, options.described(), **how) as results:
        found = follow_polygon(options)
        tables = {"path": polygon_table(found), "polar": found.polar_table()}
        return results.write_results(tables, polygon_summary(found), polygon_figures(found))


def run_comparison(options: ComparisonOptions, out: Path, **how: Any) -> Summary:
    """Follow loops of several orders and write `summary.json`, `compare`, `paths` and figures."""
    described = options.described()
    with study("polygon --compare", out, described, **how) as results:
        compared = compare_orders(options)
        tables = {"compare": compared.table, "paths": compared.curves()}
        return results.write_results(tables, compared.summary(), comparison_figures(compared))
