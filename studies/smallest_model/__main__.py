"""What symmetry saves on a path: `python -m studies.smallest_model --out DIR`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from loops import InputError
from studies.output import provenance, result_folder, write_summary, write_table
from studies.smallest_model.figures import draw
from studies.smallest_model.measure import rows

UNITS = "processor time in seconds; differences over the size of each quantity"


def main(
    out: Annotated[Path, typer.Option(help="Result folder.")],
    repeats: Annotated[int, typer.Option(min=1, help="Times every path is followed.")] = 2,
    force: Annotated[bool, typer.Option("--force", help="Replace results.")] = False,
) -> None:
    """Follow polygons by the smallest and by the full model; write a table and a figure."""
    try:
        with result_folder(out, force=force) as folder:
            found = rows(repeats=repeats)
            made = provenance("smallest model", {"repeats": repeats}, UNITS)
            columns = {key: [row[key] for row in found] for key in found[0]}
            write_table(folder, "smallest_model", columns, made, csv=True)
            write_summary(folder, {"rows": found, "provenance": made})
            draw(found, folder, made)
    except InputError as error:
        typer.echo(f"smallest_model: {' '.join(str(error).split())}", err=True)
        raise typer.Exit(2) from None
    for row in found:
        typer.echo(
            f"{row['scene']:<24} n = {row['order']:>3}  {row['seconds_auto']:8.3f} s against "
            f"{row['seconds_full']:8.3f} s  unknowns {row['unknowns_auto']:>3} of "
            f"{row['unknowns_full']:>3}  solves {row['solves_auto']:>4} of "
            f"{row['solves_full']:>4}  difference {row['difference']:.1e}"
        )
    typer.echo(f"results in {out}")


if __name__ == "__main__":
    typer.run(main)
