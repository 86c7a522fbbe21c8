"""From the parameters of a diamond to tables, summary and figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from studies.diamond.added_contact import added_table
from studies.diamond.model import check_model
from studies.diamond.parameters import DiamondParameters
from studies.diamond.path import DiamondPath, follow
from studies.diamond.path_dependence import path_dependence_table
from studies.diamond.polar import polar_table
from studies.diamond.summary import diamond_summary
from studies.diamond.table import path_table, snapshot_tables
from studies.output import UNITS_OF_A_LOOP, provenance, result_folder, write_summary, write_table


def run_diamond(
    parameters: DiamondParameters, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a diamond, locate its events, and write tables, summary and figures.

    Parameters
    ----------
    parameters : DiamondParameters
        The diamond and what is asked of it.
    out : Path
        Result folder: `summary.json`; `path.parquet`, `polar.parquet`, `path_dependence.parquet`,
        and the loop at A as a plain snapshot, `grains_A.parquet` and `contacts_A.parquet`; the
        figures as PNG and SVG. With contacts added, `added_contact.parquet` too.
    force : bool
        Whether results of the same names may be replaced.
    csv : bool
        Whether to write the tables as CSV too.

    Returns
    -------
    dict
        The summary.

    Raises
    ------
    InputError
        If `out` holds files and `force` is false, or the full model is asked for with the printed
        rule of sliding.
    """
    check_model(parameters)
    with result_folder(out, force=force) as folder:
        path = follow(parameters)
        made = provenance("diamond", parameters.described(), UNITS_OF_A_LOOP)
        summary = {**diamond_summary(path), "provenance": made}
        for name, columns in tables(path).items():
            write_table(folder, name, columns, made, csv=csv)
        write_summary(folder, summary)
        # Drawing is loaded only when there is something to draw.
        from studies.diamond.figures import draw_figures

        draw_figures(path, folder, made)
    return summary


def tables(path: DiamondPath) -> Mapping[str, dict[str, Any]]:
    """Every table of the study by its name.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.

    Returns
    -------
    mapping of str to dict
    """
    found = {
        "path": path_table(path),
        "polar": polar_table(path),
        "path_dependence": path_dependence_table(path.loop),
    }
    if "A" in path.marks:
        snapshot = snapshot_tables(path, "A")
        found |= {f"{name}_A": columns for name, columns in snapshot.items()}
    if path.parameters.contact_on_touch == "add":
        found["added_contact"] = added_table(path)
    return found
