"""The studies of paths as commands run them: follow, then write summary, tables and figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from studies.output import UNITS, Summary
from studies.paths.comparison import compare_orders
from studies.paths.diamond import diamond_summary, diamond_tables, follow_diamond
from studies.paths.figures import comparison_figures, diamond_figures, polygon_figures
from studies.paths.options import ComparisonOptions, DiamondOptions, PolygonOptions
from studies.paths.polygon import follow_polygon, polygon_diagrams, polygon_summary, polygon_table
from studies.study import study


class _Answer(NamedTuple):
    """Tables and summary of a study, and what draws its figures from the summary."""

    tables: dict[str, Any]
    summary: Summary
    figures: Callable[[dict[str, Any]], Any]


Options = DiamondOptions | PolygonOptions | ComparisonOptions


def _run(
    name: str, options: Options, out: Path, answer: Callable[[], _Answer], force: bool, csv: bool
) -> dict[str, Any]:
    """Answer a study of paths and write what it has found; return the summary."""
    about = options.described(), UNITS["paths"]
    with study(name, out, *about, force=force, csv=csv) as results:
        found = answer()
        summary = results.write_results(found.tables, found.summary)
        results.save_figures(found.figures(summary))
    return summary


def run_diamond(
    options: DiamondOptions, out: Path, *, force: bool = False, csv: bool = False
) -> Summary:
    """Follow a diamond and write `summary.json`, tables and figures; return the summary.

    Tables `path`, `polar`, `path_dependence`; the loop at A as a plain snapshot, `grains_A` and
    `contacts_A`; with contacts added, `added_contact`.
    """

    def answer() -> _Answer:
        found, ignored = follow_diamond(options), None
        if options.contact_on_touch == "add":
            ignored = follow_diamond(replace(options, contact_on_touch="ignore"))
        tables, summary = diamond_tables(found, ignored), diamond_summary(found)
        figures = diamond_figures(found, ignored, tables["path_dependence"])
        return _Answer(tables, summary, lambda _: figures)

    return _run("diamond", options, out, answer, force, csv)


def run_polygon(
    options: PolygonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> Summary:
    """Follow a polygon and write `summary.json`, the table `path` and figures."""

    def answer() -> _Answer:
        found = follow_polygon(options)

        def figures(summary: Summary) -> Any:
            critical = summary["critical_strain"]["diagonal"]
            return polygon_figures(found, polygon_diagrams(found, critical))

        return _Answer({"path": polygon_table(found)}, polygon_summary(found), figures)

    return _run("polygon", options, out, answer, force, csv)


def run_comparison(
    options: ComparisonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> Summary:
    """Follow loops of several orders and write `summary.json`, `compare`, `paths` and figures."""

    def answer() -> _Answer:
        compared = compare_orders(options)
        tables = {"compare": compared.table, "paths": compared.curves()}
        return _Answer(tables, compared.summary(), lambda _: comparison_figures(compared))

    return _run("polygon --compare", options, out, answer, force, csv)
