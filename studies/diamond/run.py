"""From the parameters of a diamond to tables, summary and figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from studies.diamond.parameters import DiamondParameters
from studies.diamond.path import DiamondPath, follow, path_table
from studies.diamond.polar import polar_table
from studies.diamond.states import loop_graph
from studies.diamond.summary import diamond_summary
from studies.output import provenance, result_folder, write_summary, write_table

UNITS = (
    "dimensionless: lengths over l0 (two radii), forces over kn l0, stresses over kn; "
    "angles in degrees"
)


def run_diamond(
    parameters: DiamondParameters, out: Path, *, force: bool = False, csv: bool = False
) -> dict[str, Any]:
    """Follow a diamond, locate its events, and write tables, summary and figures.

    Parameters
    ----------
    parameters : DiamondParameters
        The diamond and what is asked of it.
    out : Path
        Result folder: `summary.json`; `path.parquet`, `polar.parquet`, and the loop at A as a
        plain snapshot, `grains_A.parquet` and `contacts_A.parquet`; `determinant`,
        `eigenvalues`, `polar` and `loop_A` as PNG and SVG.
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
        If `out` holds files and `force` is false.
    """
    with result_folder(out, force=force) as folder:
        path = follow(parameters)
        made = provenance("diamond", parameters.described(), UNITS)
        summary = {**diamond_summary(path), "provenance": made}
        write_table(folder, "path", path_table(path), made, csv=csv)
        write_table(folder, "polar", polar_table(path), made, csv=csv)
        if "A" in path.marks:
            for name, columns in snapshot_tables(path, "A").items():
                write_table(folder, f"{name}_A", columns, made, csv=csv)
        write_summary(folder, summary)
        # Drawing is loaded only when there is something to draw.
        from studies.diamond.figures import draw_figures

        draw_figures(path, folder, made)
    return summary


def snapshot_tables(path: DiamondPath, name: str) -> dict[str, dict[str, Any]]:
    """The loop at a named state as the two tables of a plain snapshot.

    Parameters
    ----------
    path : DiamondPath
        From `follow`.
    name : {'I', 'A'}
        Which state.

    Returns
    -------
    dict
        Columns of `grains` (`id, x, y, radius`) and of `contacts` (`id1, id2, branch_x,
        branch_y, fn`, the shear force `fsx, fsy` on grain 2, `kn, ks, mu`).
    """
    row = path.marks[name]
    graph = loop_graph(path.loop, path.states)
    x, (i, j) = graph.x[row], graph.contacts.T
    branch = x[j] - x[i]
    normal = branch / np.linalg.norm(branch, axis=1, keepdims=True)
    shear = graph.shear_force[row][:, None] * np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    grains = {"id": np.arange(4), "x": x[:, 0], "y": x[:, 1], "radius": graph.radii[row]}
    contacts = {
        "id1": i,
        "id2": j,
        "branch_x": branch[:, 0],
        "branch_y": branch[:, 1],
        "fn": graph.normal_force[row],
        "fsx": shear[:, 0],
        "fsy": shear[:, 1],
        "kn": np.ones(4),
        "ks": np.full(4, path.loop.kappa),
        "mu": np.full(4, path.loop.mu),
    }
    return {"grains": grains, "contacts": contacts}
