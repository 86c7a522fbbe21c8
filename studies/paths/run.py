"""The studies behind `grainloops diamond` and `grainloops polygon`: follow, write, draw."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from studies.output import UNITS_OF_A_LOOP
from studies.paths.diamond import follow_diamond
from studies.paths.diamond_figures import diamond_figures
from studies.paths.diamond_tables import diamond_summary, diamond_tables
from studies.paths.figures import comparison_figures, polygon_figures
from studies.paths.options import ComparisonOptions, DiamondOptions, PolygonOptions
from studies.paths.polygon import (
    compare_orders,
    follow_polygon,
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
    made = ("diamond", out, options.described(), UNITS_OF_A_LOOP)
    with study(*made, force=force, csv=csv) as results:
        found, ignored = follow_diamond(options), None
        if options.contact_on_touch == "add":
            ignored = follow_diamond(replace(options, contact_on_touch="ignore"))
        tables = diamond_tables(found, ignored)
        results.write_tables(tables)
        summary = results.write_summary(diamond_summary(found))
        results.save_figures(diamond_figures(found, ignored, tables["path_dependence"]))
    return summary


def run_polygon(
    options: PolygonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a polygon and write `summary.json`, the table `path` and figures."""
    made = ("polygon", out, options.described(), UNITS_OF_A_LOOP)
    with study(*made, force=force, csv=csv) as results:
        found = follow_polygon(options)
        results.write_tables({"path": polygon_table(found)})
        summary = results.write_summary(polygon_summary(found))
        results.save_figures(polygon_figures(found, summary["critical_strain"]["diagonal"]))
    return summary


def run_comparison(
    options: ComparisonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow loops of several orders and write `summary.json`, `compare`, `paths` and figures."""
    made = ("polygon --compare", out, options.described(), UNITS_OF_A_LOOP)
    with study(*made, force=force, csv=csv) as results:
        compared = compare_orders(options)
        results.write_tables({"compare": compared.table, "paths": compared.curves()})
        summary = results.write_summary(compared.summary())
        results.save_figures(comparison_figures(compared))
    return summary
