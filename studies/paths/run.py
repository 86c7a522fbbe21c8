"""From options to tables, summary and figures: a diamond, a polygon, or several."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from studies.output import UNITS_OF_A_LOOP, provenance, result_folder, write_results
from studies.paths.comparison import compare
from studies.paths.diamond import follow_diamond
from studies.paths.diamond_summary import diamond_summary
from studies.paths.options import ComparisonOptions, DiamondOptions, PolygonOptions
from studies.paths.polar import polar_table
from studies.paths.polygon import follow_polygon, polygon_summary
from studies.paths.tables import (
    diamond_table,
    path_dependence_table,
    polygon_table,
    snapshot_tables,
)

ADDED_COLUMNS = (
    "stage", "regime", "E1", "E2", "s1", "s2", "lambda_1", "lambda_2", "det_K", "det_Ks",
    "chord_1", "chord_2",
)  # fmt: skip
Tables = dict[str, dict[str, Any]]


def run_diamond(
    options: DiamondOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a diamond and write `summary.json`, tables and figures; return the summary.

    Tables `path`, `polar`, `path_dependence`; the loop at A as a plain snapshot, `grains_A` and
    `contacts_A`; with contacts added, `added_contact`.
    """
    with result_folder(out, force=force) as folder:
        found = follow_diamond(options)
        ignored = None
        tables: Tables = {
            "path": diamond_table(found),
            "polar": polar_table(found),
            "path_dependence": path_dependence_table(found.loop),
        }
        if "A" in found.marks:
            snapshot = snapshot_tables(found, found.marks["A"])
            tables |= {f"{name}_A": columns for name, columns in snapshot.items()}
        if options.contact_on_touch == "add":
            ignored = follow_diamond(replace(options, contact_on_touch="ignore"))
            both = {"ignored": diamond_table(ignored), "added": tables["path"]}
            tables["added_contact"] = _one_below_the_other(both)
        told = diamond_summary(found)
        return _write(folder, "diamond", options, told, tables, csv, found, ignored)


def run_polygon(
    options: PolygonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a polygon and write `summary.json`, the table `path` and figures."""
    with result_folder(out, force=force) as folder:
        found = follow_polygon(options)
        told = polygon_summary(found)
        drawn, tables = (found, told["critical_strain"]), {"path": polygon_table(found)}
        return _write(folder, "polygon", options, told, tables, csv, *drawn)


def run_comparison(
    options: ComparisonOptions, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow loops of several orders and write `summary.json`, `compare`, `paths` and figures."""
    with result_folder(out, force=force) as folder:
        compared = compare(options)
        told, tables = compared.summary(), compared.tables()
        return _write(folder, "polygon --compare", options, told, tables, csv, compared)


def _write(
    folder: Path,
    command: str,
    options: Any,
    told: dict[str, Any],
    tables: Tables,
    csv: bool,
    *drawn: Any,
) -> dict[str, Any]:
    """Tables, summary and figures of a study in their files; the summary with what made it."""
    made = provenance(command, options.described(), UNITS_OF_A_LOOP)
    summary = told | {"provenance": made}
    write_results(folder, summary, tables, csv=csv)
    draw(command, folder, made, *drawn)
    return summary


def draw(command: str, folder: Path, made: dict[str, Any], *drawn: Any) -> None:
    """Draw and save figures; drawing is loaded only when there is something to draw."""
    from studies.paths.comparison_figures import comparison_figures
    from studies.paths.diamond_figures import diamond_figures
    from studies.paths.figures import polygon_figures
    from studies.style import save_figures

    figures: dict[str, Any] = {"diamond": diamond_figures, "polygon": polygon_figures}
    save_figures(figures.get(command, comparison_figures)(*drawn), folder, made)


def _one_below_the_other(tables: Tables) -> dict[str, Any]:
    names = [np.full(len(table["E1"]), name) for name, table in tables.items()]
    joined = {key: [table[key] for table in tables.values()] for key in ADDED_COLUMNS}
    columns = {key: np.concatenate(parts) for key, parts in joined.items()}
    return {"opposite": np.concatenate(names), **columns}
