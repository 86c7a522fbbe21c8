"""From the parameters of a polygon, or of several, to tables, summary and figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from studies.output import UNITS_OF_A_LOOP, provenance, result_folder, write_summary, write_table
from studies.polygon.comparison import ComparisonParameters, compare, compared_tables
from studies.polygon.parameters import PolygonParameters
from studies.polygon.path import follow_polygon
from studies.polygon.summary import polygon_summary
from studies.polygon.table import path_table


def run_polygon(
    parameters: PolygonParameters, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a polygon, and write its table, summary and figures.

    Parameters
    ----------
    parameters : PolygonParameters
        The loop and its programme.
    out : Path
        Result folder: `summary.json`, `path.parquet`, figures as PNG and SVG.
    force : bool
        Whether results of the same names may be replaced.
    csv : bool
        Whether to write the table as CSV too.

    Returns
    -------
    dict
        The summary.

    Raises
    ------
    InputError
        If `out` holds files and `force` is false.
    """
    with result_folder(out, force=force) as folder:
        found = follow_polygon(parameters)
        made = provenance("polygon", parameters.described(), UNITS_OF_A_LOOP)
        summary = {**polygon_summary(found), "provenance": made}
        write_table(folder, "path", path_table(found), made, csv=csv)
        write_summary(folder, summary)
        # Drawing is loaded only when there is something to draw.
        from studies.polygon.figures import draw_figures

        draw_figures(found, summary["critical_strain"], folder, made)
    return summary


def run_comparison(
    parameters: ComparisonParameters, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow loops of several orders, and write them side by side.

    Parameters
    ----------
    parameters : ComparisonParameters
        The orders, and what they share.
    out : Path
        Result folder: `summary.json`; `compare.parquet`, a row an order; `paths.parquet`, the
        stress-strain curves; figures as PNG and SVG.
    force, csv : bool
        See `run_polygon`.

    Returns
    -------
    dict
        The summary.

    Raises
    ------
    InputError
        If `out` holds files and `force` is false.
    """
    with result_folder(out, force=force) as folder:
        compared = compare(parameters)
        made = provenance("polygon --compare", parameters.described(), UNITS_OF_A_LOOP)
        summary = {**compared.summary(), "provenance": made}
        for name, columns in compared_tables(compared).items():
            write_table(folder, name, columns, made, csv=csv)
        write_summary(folder, summary)
        from studies.polygon.comparison_figures import draw_comparison_figures

        draw_comparison_figures(compared, folder, made)
    return summary
