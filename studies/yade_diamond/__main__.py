"""Run the comparison with Yade: `python -m studies.yade_diamond --out DIR [--data DIR]`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer

from patterns import sample_path
from studies.output import provenance, result_folder, write_summary, write_table
from studies.yade_diamond.comparison import FORCES, compare, platform_check
from studies.yade_diamond.convergence import convergence_rows
from studies.yade_diamond.figures import draw_figure
from studies.yade_diamond.probes import read_probes


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    data: Annotated[
        Path | None, typer.Option(help="Folder of Yade's tables; the sample if left out.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Compare every probe; write the tables and the figure."""
    source = data if data is not None else sample_path("yade_diamond")
    probes, steps = read_probes(source), convergence_rows(source)
    rows = [{**compare(probe), **platform_check(probe)} for probe in probes]
    worst = summary(rows)
    for kind, errors in worst.items():
        typer.echo(f"{kind:<18} " + "  ".join(f"{k} {v:.3g}" for k, v in errors.items()))
    with result_folder(out, force=force) as folder:
        made = provenance("comparison with Yade", {"data": source.name}, "dimensionless, degrees")
        for name, table in (("probes", rows), ("convergence", steps)):
            columns = {key: [row[key] for row in table] for key in table[0]}
            write_table(folder, name, columns, made, csv=True)
        write_summary(folder, {"worst": worst, "convergence": steps, "provenance": made})
        draw_figure(probes, steps, folder, made)


def summary(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Largest differences of each kind of probe, increment and contacts.

    Parameters
    ----------
    rows : list of dict
        From `compare` and `platform_check`.

    Returns
    -------
    dict of str to dict
        Kind to number of probes and largest differences.
    """
    measures = [*(f"error_{name}" for name in FORCES), "replay_T", "rates", "path"]
    groups = pd.DataFrame(rows).groupby(["increment", "contacts"])
    return {
        f"{increment}, {contacts}": {"probes": len(own), **own[measures].max().to_dict()}
        for (increment, contacts), own in groups
    }


if __name__ == "__main__":
    typer.run(main)
